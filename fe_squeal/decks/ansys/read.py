"""From an Ansys archive to the draft of a scene: materials, bodies, supports, contacts, pressures, MODOPT."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...mesh.building import build_mesh
from ...mesh.readers.ansys import mesh_of, read_archive, text_of
from ...mesh.readers.ansys_faces import other_loads, pressures, uneven_pressures
from ...mesh.readers.sources import Sources
from ..draft import Draft, Value, Weight
from ..units import SI, likely, recognise
from .contacts import stay_closed, write_contacts
from .content import Content, clean, commands, is_zero
from .elements import list_left_over
from .materials import is_isotropic, read_materials
from .reals import read_real_constants
from .ties import write_supports, write_ties

LEFT_OUT: dict[str, tuple[str, Weight]] = {
    **dict.fromkeys(("CE", "CEBLOCK", "CP", "CPBLOCK", "RBE3"),
                    ("ties nodes and is not read; give [[rigid]] or [[averaged]]", "missing")),
    **dict.fromkeys(("F", "FBLOCK", "SF", "SFBLOCK", "SFA", "BF", "BFE", "BFBLOCK", "BFEBLOCK", "ACEL", "CGOMEGA",
                     "DOMEGA", "INISTATE"),
                    ("is a load that is not read; [effects.preload] takes pressures on surfaces", "changes")),
    "OMEGA": ("turns the whole model: give [effects.rotation] for the body that turns", "changes"),
    "DMPRAT": ("a constant damping ratio has no equivalent; give Rayleigh or structural damping", "changes"),
    "TB": ("other laws than FRIC are not read: materials are linear and isotropic, with the damping of ALPD and BETD",
           "changes"),
    **dict.fromkeys(("CEDELE", "CPDELE", "DDELE", "EDELE", "EKILL", "EMODIF", "MPCHG", "MPDELE", "NDELE",
                     "NMODIF", "NROTAT", "RMODIF", "SFEDELE", "TBDELE"),
                    ("changes what stands before it and is not read; write the archive anew by CDWRITE,DB", "missing")),
    "DMPSTR": ("give loss_factor of the materials and [effects.structural_damping]", "changes"),
}  # fmt: skip
# Sections of SECBLOCK are those of layers, shells and beams, which are listed as elements.
_READ_BLOCKS = ("NBLOCK", "EBLOCK", "CMBLOCK", "RLBLOCK", "SECBLOCK")
_OTHER_BLOCK: tuple[str, Weight] = (
    "is a block that is not read, or not in this form: without it the structure may be another one", "missing",
)  # fmt: skip
_ZERO_IS_NOTHING = ("ACEL", "CGOMEGA", "DOMEGA", "OMEGA", "DMPRAT", "DMPSTR")  # CDWRITE writes them in any case
BECOMES: dict[str, str] = {
    "NBLOCK, EBLOCK": "nodes and SOLID185, 186, 187 and 285; those of layers are asked for",
    "CMBLOCK": "volume groups and node sets", "MP, MPDATA": "`[materials.material_N]`: EX, NUXY or PRXY, DENS;"
    " isotropic ones, the last of a label, and of tables the first value, and told; ALPD and BETD are `rayleigh` of the"
    " bodies; MU is `mu`, and so is `TB,FRIC`, which counts before it",
    "ET, ETBLOCK, KEYOP": "kinds of the elements and their key options",
    "D, DBLOCK": "`[[supports]]` of the nodes that are held alike; in the axes that NBLOCK turns, where they are along"
    " x, y and z, else it is asked for",
    "CONTA173, CONTA174, TARGE170": "surfaces contact_N and target_N by real constant, and `[[contacts]]`; KEYOPT(12)"
    " rough or bonded, and MPC: tied; no separation of all contacts: `lift_off = false` of a preload",
    "RLBLOCK, R, RMORE": "FKN of contacts: negative ones are `normal_stiffness`, factors are asked for with a"
    " suggestion; FACT, DC and TAUMAX are left out, and told",
    "CMROTATE, CMOMEGA": "`sliding` of the contacts on the component, which is their counterface",
    "SFE, SFEBLOCK": "`[effects.preload] pressures` on surfaces pressure_N, on solids and SURF154, whose normals have"
    " to point outwards; the mean of the corners, and told where they differ; loads on faces 2 to 5 of SURF154, along"
    " it, with a gradient or along a vector, are left out, and told",
    "CERIG": "`[[rigid]]` where all translations are tied, node by node, with D and MASS21 at the reference; masses"
    " elsewhere and without real constants are left out, and told",
    "ALPHAD, BETAD": "`[effects.rayleigh]`", "MODOPT": "`[solve] modes` of the last one; a lowest"
    " frequency or a shift point is told",
}  # fmt: skip


def draft_ansys(sources: Sources, mesh_file: str) -> Draft:
    """Return the draft of the scene that an Ansys archive describes; the other parameters as of `draft_abaqus`.

    Raises
    ------
    MeshError
    """
    source = sources.path.name
    archive, text = read_archive(sources), text_of(sources)
    raw = mesh_of(archive, text, source)
    lines = commands(text)
    draft = Draft(sources.path.stem)
    materials = read_materials(lines, source, draft)
    archive = replace(archive, reals=archive.reals | read_real_constants(lines, source))
    content = Content(source, archive, raw, build_mesh(raw, source), draft, text, lines, materials)
    draft.head.append(f"Made by fe-squeal new from the Ansys archive {source}.")
    _find_units(content)
    draft.add("mesh", values={"file": mesh_file, "length_unit": content.units.length_unit, "order": 2})
    _write_bodies(content)
    write_ties(content)
    write_supports(content)
    mu = write_contacts(content)
    _write_effects(content, mu)
    _write_solution(content)
    list_left_over(content)
    for fields, where in lines:
        is_other = fields[0].endswith("BLOCK") and fields[0] not in _READ_BLOCKS
        said, weight = LEFT_OUT.get(fields[0], _OTHER_BLOCK if is_other else ("", "harmless"))
        nothing = fields[0] in _ZERO_IS_NOTHING and all(is_zero(f) for f in fields[1:])
        if said and not nothing and fields[:2] != ["TB", "FRIC"]:
            what = ",".join(fields[:2]) if fields[0] == "TB" else fields[0]
            draft.find(what, where, said, weight)
    return draft


def _find_units(content: Content) -> None:
    draft, materials = content.draft, content.materials.values()
    numbers = [(m["EX"], m["DENS"]) for m in materials if m.get("EX", 0) > 0 and m.get("DENS", 0) > 0]
    size = float(np.ptp(content.loaded.mesh.p, axis=1).max())
    units, others = recognise(numbers, size)
    if units is None:
        draft.units, draft.suggested_in = "any", likely([m["EX"] for m in materials if "EX" in m], size)
        draft.head.append('Units: no usual system makes sense of these numbers; they are left, with units = "any".')
    else:
        more = f" (They could also be {' or '.join(u.name for u in others)}.)" if others else ""
        draft.head.append(f"Units: the archive's numbers are taken as {units.name}.{more}")
    content.units = units or SI


def _write_bodies(content: Content) -> None:
    for group in [g for g in content.raw.volume_groups if g.startswith("material_")]:
        number = group.rpartition("_")[2]
        values = content.materials.get(int(number), {}) if number.isdigit() else {}
        table = content.draft.add("materials", group)
        if not is_isotropic(values):
            table.open.append(("youngs_modulus = [E1, E2, E3]", "orthotropic: give its lists, and axes of the body"))
        elif "EX" in values:
            table.values["youngs_modulus"] = clean(values["EX"] * content.units.pressure)
        else:
            content.draft.ask(table, "youngs_modulus", "the archive has no EX for this material")
        ratio = values.get("PRXY", values.get("NUXY"))
        if ratio is None:
            content.draft.ask(table, "poisson_ratio", "the archive has no NUXY or PRXY for this material")
        else:
            table.values["poisson_ratio"] = ratio
        if "DENS" in values:
            table.values["density"] = clean(values["DENS"] * content.units.density)
        else:
            content.draft.ask(table, "density", "the archive has no DENS for this material")
        body = content.draft.add("bodies", group, values={"material": group})
        own = [values.get(label, 0.0) for label in ("ALPD", "BETD")]
        if any(own):  # of the body, beside that of the whole model
            alpha, beta = (a + b for a, b in zip(own, _whole_damping(content), strict=True))
            table_of = {"alpha": clean(alpha / content.units.time), "beta": clean(beta * content.units.time)}
            body.values["rayleigh"] = dict[str, Value](table_of)
        for label in ("DMPR", "DMPS"):
            if values.get(label):
                text = f"{values[label]:g} of {group} is not read; give loss_factor and [effects.structural_damping]"
                content.draft.find(f"MP,{label}", "", text)


def _write_effects(content: Content, mu: float | None) -> None:
    draft, units = content.draft, content.units
    if mu:
        draft.add("effects", "friction", values={"mu": mu})
    others = other_loads(content.archive, content.text, content.source)
    for where in others[:1]:
        more = f", as {len(others)} loads of that kind in all" if len(others) > 1 else ""
        text = f"acts along SURF154, along a vector or with a gradient (its faces 2 to 5), and is left out{more}"
        draft.find("SFE", where, text)
    sizes = list(pressures(content.archive, content.text, content.source))
    if sizes:
        loads: dict[str, Value] = {f"pressure_{i}": clean(p * units.pressure) for i, p in enumerate(sizes, 1)}
        table = draft.add("effects", "preload", values={"pressures": loads})
        table.comments.append("SFE: Pa, onto the faces")
        for where in uneven_pressures(content.archive, content.text, content.source)[:1]:
            draft.find("SFE", where, "differs from corner to corner; the mean is taken")
        closed = stay_closed(content)
        if closed and all(closed):
            table.values["lift_off"] = False
            table.notes["lift_off"] = "KEYOPT(12): no separation"
        elif any(closed):
            text = "contacts without separation stay closed; here lift_off is of all contacts, so that all may open"
            draft.find("KEYOPT(12)", "", text)
    alpha, beta = _whole_damping(content)
    if alpha or beta:
        draft.add("effects", "rayleigh", values={"alpha": clean(alpha / units.time), "beta": clean(beta * units.time)})
    for what, factor in (("ALPHAD", alpha), ("BETAD", beta)):
        if factor:
            draft.tell_damping_of_all(what, "", of_mass=what == "ALPHAD")
    if mu:
        draft.add_sweep(mu, "archive")


def _write_solution(content: Content) -> None:
    """Write the number of modes of the last MODOPT."""
    for fields, where in reversed(content.lines):
        if fields[0] != "MODOPT" or len(fields) < 3 or not fields[2].isdigit() or not int(fields[2]):
            continue
        content.draft.add("solve", values={"modes": int(fields[2])})
        if len(fields) > 3 and content.number(fields[3], where, fields) > 0:
            text = f"asks for modes from {fields[3]} on, or near it; here they begin with the lowest: raise modes"
            content.draft.find("MODOPT", where, text)
        return


def _whole_damping(content: Content) -> tuple[float, float]:
    """Return alpha and beta of ALPHAD and BETAD in the archive's units."""
    found = {"ALPHAD": 0.0, "BETAD": 0.0}
    for fields, where in content.lines:
        if fields[0] in found and len(fields) > 1:
            found[fields[0]] = content.number(fields[1], where, fields)
    return found["ALPHAD"], found["BETAD"]
