"""*Step, *Dsload, *Cload, *Frequency and *Complex Frequency: preload of the scene, and what is solved for."""

from __future__ import annotations

import numpy as np

from ...mesh.readers.abaqus.loads import loaded_faces
from ...mesh.readers.abaqus.model import Statement
from ...mesh.readers.abaqus.text import is_label
from ..draft import Table, Value
from .amplitudes import factor_of
from .content import Content, Procedure, fields, spoken
from .forces import References, add_forces
from .holding import _check, number_of
from .materials import clean
from .operations import takes_away


def read_step(content: Content, statement: Statement) -> None:
    """Take *Step: loads of perturbation steps are no preload."""
    block = statement.block
    content.perturbation, content.step_time = "PERTURBATION" in block.parameters, 1.0
    content.operations.clear()
    content.loads_of_step.clear()
    if block.value("NLGEOM").upper() == "YES" or ("NLGEOM" in block.parameters and not block.value("NLGEOM")):
        content.large_displacements = True


def end_step(content: Content, statement: Statement) -> None:
    """Take *End Step."""
    content.perturbation = False


def _excites(content: Content, keyword: str, where: str) -> bool:
    """Return whether a load stands in a perturbation step, where it is no preload, and say so in the draft."""
    if content.perturbation:
        content.draft.find(keyword, where, "in a perturbation step excites vibrations and is no preload", "harmless")
    return content.perturbation


def read_surface_load(content: Content, statement: Statement) -> None:
    """Take *Dsload: pressures on surfaces."""
    block, where = statement.block, content.where(statement)
    if _excites(content, "*Dsload", where):
        return
    factor = factor_of(content, statement)
    if takes_away(content, statement):
        _remove(content, by_faces=False)
    for line in block.lines:
        parts = fields(line)
        kind = parts[1].upper() if len(parts) > 1 else ""
        if kind not in ("P", "PRESSURE"):
            text = f'a load of type "{kind}" is not simulated; [effects.preload] takes pressures on surfaces'
            content.draft.find("*Dsload", where, text)
            continue
        value = number_of(content, statement, parts[2]) if len(parts) > 2 and parts[2] else 0.0
        _tell_again(content, statement, parts[0])
        # Names are the same in any case: the load of a later step is in the place of that of an earlier one.
        own = parts[0].upper(), statement.scope
        reference = next((r for r in content.pressures if (r[0].upper(), r[1]) == own), (parts[0], statement.scope))
        content.pressures[reference] = value * factor, where


def _tell_again(content: Content, statement: Statement, name: str, component: int = 0) -> None:
    """Tell of a load that a step gives twice, since not all programs let the last one count."""
    own = (statement.block.keyword, (name.upper(), statement.scope), component)
    if own in content.loads_of_step:
        text = f'loads "{name}" twice in one step; the last load counts: give their sum if both are meant'
        content.draft.find(f"*{spoken(statement.block.keyword)}", content.where(statement), text)
    content.loads_of_step.add(own)


def _remove(content: Content, by_faces: bool) -> None:
    """Remove the pressures of *Dload, by faces, or those of *Dsload: OP=NEW is for loads of the same keyword alone."""
    for reference in [r for r in content.pressures if r[0].startswith("DLOAD_") == by_faces]:
        del content.pressures[reference]


def read_face_load(content: Content, statement: Statement) -> None:
    """Take *Dload: pressures on faces of elements, which the reader has made surfaces."""
    block, where = statement.block, content.where(statement)
    if _excites(content, "*Dload", where):
        return
    if takes_away(content, statement):
        content.loaded_elements.clear()
        _remove(content, by_faces=True)
    taken, factor = 0, factor_of(content, statement)
    for faces in loaded_faces(content.model):
        if faces.statement is not statement:
            continue
        single = [line for line in faces.lines if is_label(fields(line)[0])]
        if content.loaded_elements & set(single):
            text = "single elements are loaded again in a later step; give the pressure there in [effects.preload]"
            content.draft.find("*Dload", where, text, "missing")
        content.loaded_elements |= set(single)
        value = number_of(content, statement, faces.pressure) * factor
        _tell_again(content, statement, faces.name)
        content.pressures[faces.name, statement.scope] = value, where
        taken += len(faces.lines)
    if taken < sum(any(fields(line)) for line in block.lines):  # without a set it is a load of the whole model
        text = "is a load that is not simulated: the static state has only what [effects.preload] says"
        content.draft.find("*Dload, other than P1 to P6", where, text)


def read_force(content: Content, statement: Statement) -> None:
    """Take *Cload: forces on node sets, which may stand for a pressure on a face."""
    block = statement.block
    if _excites(content, "*Cload", content.where(statement)):
        return
    if takes_away(content, statement):
        content.forces.clear()
    factor = factor_of(content, statement)
    for line in block.lines:
        parts = fields(line)
        if len(parts) < 3:
            continue
        reference = (parts[0], statement.scope)
        _check(content, statement, reference)
        component = int(number_of(content, statement, parts[1]))
        force = number_of(content, statement, parts[2]) * factor
        _tell_again(content, statement, parts[0], component)
        known = [r for r, _ in content.forces if np.array_equal(content.rows(r), content.rows(reference))]
        reference = known[0] if known else reference  # by another name, or another spelling
        content.forces[reference, component] = force, content.where(statement)


def read_frequency(content: Content, statement: Statement) -> None:
    """Take *Frequency or *Complex Frequency; of several the complex ones count, and of these the last."""
    block = statement.block
    content.perturbation = True  # such a step always is
    is_complex = block.keyword == "COMPLEX FREQUENCY"
    before = content.procedure
    if before.is_complex and not is_complex:
        return
    row = content.first(block)
    if block.value("EIGENSOLVER").upper() == "SUBSPACE":  # its fields are number, highest frequency and shift point
        row = [*row[:1], None, *row[1:3]]
    found = Procedure(is_complex=is_complex, where=content.where(statement))
    if row and row[0]:
        found.modes = int(row[0])
    elif before.where:
        found.modes = before.modes
    if len(row) > 2 and row[2]:
        found.highest = float(row[2])
    elif before.where and found.modes is None:
        found.highest = before.highest
    if len(row) > 1 and row[1]:
        text = f"asks for modes above {row[1]:g} cycles per time; here they begin with the lowest: raise modes"
        content.draft.find(f"*{spoken(block.keyword)}", found.where, text)
    if len(row) > 3 and row[3]:
        text = "asks for the modes nearest to a shift point; here they begin with the lowest: raise modes"
        content.draft.find(f"*{spoken(block.keyword)}", found.where, text)
    found.damping = block.value("FRICTION DAMPING").upper() == "YES"
    if block.value("PROPERTY EVALUATION"):
        text = "is for viscoelasticity and springs that depend on the frequency, which are not simulated"
        content.draft.find(f"*{spoken(block.keyword)}, PROPERTY EVALUATION", found.where, text, "harmless")
    content.procedure = found


def write_effects(content: Content, mu: float | None, references: References) -> None:
    """Write friction, preload and damping; forces on reference nodes act by their tables."""
    draft, procedure = content.draft, content.procedure
    if mu:
        table = draft.add("effects", "friction", values={"mu": mu})
        table.comments.append("*Friction: the largest coefficient; friction_ratio of a contact has others")
    pressures = _pressures(content, references)
    if pressures:
        table = draft.add("effects", "preload", values={"pressures": pressures})
        table.comments.append("Pa, against the outward normal, as loaded in the steps before the frequencies")
        if content.large_displacements:
            table.comments.append("NLGEOM: for the stiffness of the static stress add [effects.stress_stiffening]")
        _keep_closed(content, table)
    if procedure.damping and mu:
        table = draft.add("effects", "friction_damping")
        table.comments.append(f"*Complex Frequency, FRICTION DAMPING=YES, {procedure.where}")
        if not pressures:
            table.open.append(("contact_pressure = 1.0e6", "the deck has no pressure on the contacts, Pa"))
    if any(s.structural for s in content.substances.values()):
        table = draft.add("effects", "structural_damping")
        table.comments.append("*Damping, STRUCTURAL: loss_factor above")


def _keep_closed(content: Content, preload: Table) -> None:
    """Let no contact of a preload open where all have *Surface Behavior, NO SEPARATION; say so where only some have."""
    interactions = [i for p in content.pairs if (i := content.interactions.get(p.interaction.upper()))]
    closed = [i for i in interactions if i.no_separation]
    if not closed:
        return
    if len(closed) == len(interactions):
        preload.values["lift_off"] = False
        preload.notes["lift_off"] = f"NO SEPARATION, {closed[0].behaviour_where}"
    else:
        text = "its contacts stay closed there, others may open; here lift_off is of all contacts, so that all may open"
        content.draft.find("*Surface Behavior, NO SEPARATION", closed[0].behaviour_where, text)


def _pressures(content: Content, references: References) -> dict[str, Value]:
    known, found = content.loaded.mesh.boundaries or {}, dict[str, Value]()
    for reference, (value, where) in content.pressures.items():
        names = content.group(known, reference)
        if not names:
            text = f'its surface "{reference[0]}" is no surface of solid elements here{content.reason(reference[0])}'
            content.draft.find("*Dsload", where, text, "missing")
        for name in names:
            if value:
                found[name] = clean(value * content.units.pressure)
    add_forces(content, found, references)
    return found


def write_solution(content: Content, mu: float | None) -> None:
    """Write [sweep] and [solve]."""
    if mu:
        content.draft.add_sweep(mu, "deck")
    procedure, values = content.procedure, dict[str, Value]()
    if procedure.modes:
        values["modes"] = procedure.modes
    elif procedure.highest:
        values["max_frequency"] = clean(procedure.highest / content.units.time)
    if values:
        kind = "Complex Frequency" if procedure.is_complex else "Frequency"
        table = content.draft.add("solve", values=values)
        table.comments.append(f"*{spoken(kind)}, {procedure.where}")
        if procedure.modes and procedure.highest:
            highest = clean(procedure.highest / content.units.time)
            table.comments.append(f"or all modes up to max_frequency = {highest!r}, instead of modes")
