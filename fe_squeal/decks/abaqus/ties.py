"""*Coupling, *Rigid Body and *MPC of type BEAM: rigid bodies and averaged reference points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...errors import MeshError
from ...mesh.readers.abaqus.model import Statement
from ..draft import Value, plain_name
from ..released import FREEDOMS
from .content import Content, TieData, fields, spoken
from .holding import held_at, number_of
from .links import links_under
from .masses import masses_at
from .materials import clean
from .releases import freedoms_in, read_released, release


def read_coupling(content: Content, statement: Statement) -> None:
    """Take *Coupling; *Kinematic or *Distributing behind it says of which kind."""
    block = statement.block
    tie = TieData(
        block.value("CONSTRAINT NAME") or block.value("SURFACE"), content.where(statement), True,
        (block.value("REF NODE") or block.value("REFNODE"), statement.scope),
        [(block.value("SURFACE"), statement.scope)], of_surface=True, coupling=statement,
    )  # fmt: skip
    if block.value("INFLUENCE RADIUS"):
        tie.radius = number_of(content, statement, block.value("INFLUENCE RADIUS"))
    content.ties_to_points.append(tie)


def read_kind(content: Content, statement: Statement) -> None:
    """Take *Kinematic or *Distributing under *Coupling."""
    block, where = statement.block, content.where(statement)
    if not content.ties_to_points:
        content.draft.find(f"*{spoken(block.keyword)}", where, "stands under no *Coupling", "missing")
        return
    tie = content.ties_to_points[-1]
    tie.rigid = block.keyword == "KINEMATIC"
    if tie.rigid and block.lines:
        _only_all_freedoms(content, statement, [content.floats(block, line) for line in block.lines])
    if not tie.rigid:
        read_released(content, statement, tie)
    if not tie.rigid and block.value("WEIGHTING METHOD").upper() not in ("", "UNIFORM"):
        text = f"weights by {block.value('WEIGHTING METHOD')} are not simulated; all parts of the surface count alike"
        content.draft.find("*Distributing", where, text)


def _only_all_freedoms(content: Content, statement: Statement, rows: list[list[float | None]]) -> None:
    found = freedoms_in(content, statement, rows)
    if not {1, 2, 3} <= found:
        text = f"ties the freedoms {sorted(found)} alone; a rigid body has all three translations"
        content.draft.find(f"*{spoken(statement.block.keyword)}", content.where(statement), text, "missing")


def read_old_coupling(content: Content, statement: Statement) -> None:
    """Take *Kinematic Coupling or *Distributing Coupling of old decks: node sets on the data lines."""
    block, where = statement.block, content.where(statement)
    if block.keyword == "DISTRIBUTING COUPLING":
        nodes = list({tuple(n) for _, link in links_under(content, statement) for n in link.nodes})
        if len(nodes) != 1 or not nodes[0]:
            content.draft.find("*Distributing Coupling", where, "has no one element of type DCOUP3D", "missing")
            return
        reference = nodes[0][0]
    else:
        reference = (block.value("REF NODE") or block.value("REFNODE"))
        _only_all_freedoms(content, statement, [[_maybe(p) for p in fields(line)[1:]] for line in block.lines])
    members = [(fields(line)[0], statement.scope) for line in block.lines]
    rigid = block.keyword == "KINEMATIC COUPLING"
    weights = {fields(line)[1] for line in block.lines if len(fields(line)) > 1} if not rigid else set()
    if len(weights) > 1:
        text = "weights of its own for each node are not simulated; all count alike"
        content.draft.find("*Distributing Coupling", where, text)
    content.ties_to_points.append(TieData(f"coupling_{reference}", where, rigid, (reference, statement.scope), members))


def _maybe(text: str) -> float | None:
    return float(text) if text.isdigit() else None


def read_rigid_body(content: Content, statement: Statement) -> None:
    """Take *Rigid Body of a node set."""
    block, where = statement.block, content.where(statement)
    names = [name for word in ("NSET", "TIE NSET", "PIN NSET") if (name := block.value(word))]
    if block.value("ELSET") or not names:
        text = f'of element set "{block.value("ELSET")}" is not read; give [[rigid]] with its surface or node set'
        content.draft.find("*Rigid Body", where, text, "missing")
    if not names:
        return
    reference = (block.value("REF NODE") or block.value("REFNODE"))
    members = [(name, statement.scope) for name in names]
    content.ties_to_points.append(TieData(f"rigid_{names[0]}", where, True, (reference, statement.scope), members))
    if block.value("POSITION").upper() == "CENTER OF MASS":
        text = "its reference is moved to the centre of mass of the body: give reference there in [[rigid]]"
        content.draft.find("*Rigid Body, POSITION", where, text, "missing")
    if block.value("ROT NODE") or block.value("ROTNODE"):
        text = "rotations of a ROT NODE that are held or sprung are not taken over; give fixed = ... in [[rigid]]"
        content.draft.find("*Rigid Body, ROT NODE", where, text)


def read_mpc(content: Content, statement: Statement) -> None:
    """Take *MPC: BEAM ties nodes rigidly to the last one."""
    where = content.where(statement)
    for line in statement.block.lines:
        parts = [part for part in fields(line) if part]
        if len(parts) == 3 and parts[0].upper() == "BEAM":
            same = [t for t in content.ties_to_points if t.reference == (parts[2], statement.scope) and t.rigid]
            if same:
                same[0].members.append((parts[1], statement.scope))
            else:
                ends = [(part, statement.scope) for part in parts[1:]]
                content.ties_to_points.append(TieData(f"beam_{parts[2]}", where, True, ends[1], ends[:1]))
        else:
            text = f"of type {parts[0] if parts else '(none)'} is not read: without it the structure is another one"
            content.draft.find("*Mpc", where, text, "missing")


def find_ties(content: Content) -> dict[int, TieData]:
    """Return the ties by the row of their reference node, those of one reference joined.

    Raises
    ------
    MeshError
    """
    found: dict[int, TieData] = {}
    for tie in (placed for written in content.ties_to_points for placed in _in_each_instance(content, written)):
        if not tie.reference[0]:  # a rigid body without a node of its own
            found[-1 - len(found)] = tie
            continue
        rows = content.rows(tie.reference)
        if len(rows) != 1:
            raise MeshError(f'{content.source}: {tie.where}: the reference "{tie.reference[0]}" is not one node')
        row = int(rows[0])
        if row in found:
            text = f"two couplings have the reference node {tie.reference[0]}; expected one for each"
            content.draft.find("*Coupling", tie.where, text, "missing")
            continue
        if content.on_solids[row]:
            text = f"its reference node {tie.reference[0]} belongs to a solid; expected one of its own"
            content.draft.find("*Coupling", tie.where, text, "missing")
            continue
        found[row] = tie
    return found


def _in_each_instance(content: Content, tie: TieData) -> list[TieData]:
    """Return the tie of a part once for each of its instances, named by them; any other as it is."""
    keys = content.placements(tie.reference[1])
    if len(keys) < 2:
        return [tie]
    return [
        replace(
            tie, name=f"{content.assembly.instances[key].name}_{tie.name}", reference=(tie.reference[0], key),
            members=[(name, key) for name, _ in tie.members], springs=list(tie.springs),
        )
        for key in keys
    ]  # fmt: skip


def write_ties(content: Content, ties: dict[int, TieData]) -> dict[int, dict[str, Value]]:
    """Write [[rigid]] and [[averaged]] with mass, inertia, held freedoms and springs; return each by its reference."""
    masses = masses_at(content, ties)
    taken: list[str] = []
    written: dict[int, dict[str, Value]] = {}
    for row, tie in ties.items():
        place = _place(content, tie)
        if place is None:
            continue
        _check_radius(content, tie, row, place)
        name = plain_name(tie.name, taken)
        taken.append(name)
        values: dict[str, Value] = {"name": name, **place}
        if row >= 0:
            at_node = content.raw.points[row] if tie.place is None else tie.place
            values["reference"] = [clean(float(v) * content.units.length) + 0.0 for v in at_node]
        values |= masses.get(row, {})
        held = " ".join(FREEDOMS[f - 1] for f in sorted(held_at(content, row)))
        if held:
            values["fixed"] = held
        if tie.springs:
            values["springs"] = list(tie.springs)
        release(content, tie, values)
        table = content.draft.add("rigid" if tie.rigid else "averaged", is_entry=True, values=values)
        at = f", reference node {tie.reference[0]}" if row >= 0 else ""
        table.comments.append(f"{'Rigid' if tie.rigid else 'Averaged'}: {tie.where}{at}")
        written[row] = table.values
    return written


def _check_radius(content: Content, tie: TieData, row: int, place: dict[str, Value]) -> None:
    """Ask for the nodes of a surface where *Coupling, INFLUENCE RADIUS leaves some of them out."""
    if tie.radius is None or "surface" not in place:
        return
    mesh = content.loaded.mesh
    corners = np.unique(mesh.facets[:, np.asarray((mesh.boundaries or {})[str(place["surface"])])])
    away = np.linalg.norm(mesh.p[:, corners].T - content.raw.points[row], axis=1)
    if (away > tie.radius).any():
        table = "rigid" if tie.rigid else "averaged"
        text = f"couples only what is within {tie.radius:g} of its reference: give nodes, not surface, in [[{table}]]"
        content.draft.find("*Coupling, INFLUENCE RADIUS", tie.where, text, "missing")


def _place(content: Content, tie: TieData) -> dict[str, Value] | None:
    names: list[str] = []
    for member in tie.members:
        surfaces = content.group(content.loaded.mesh.boundaries or {}, member)
        nodes = content.group(content.loaded.node_groups, member)
        by_faces = not nodes or (tie.of_surface and not content.is_of_nodes(member))
        if len(tie.members) == 1 and len(surfaces) == 1 and by_faces:
            return {"surface": surfaces[0]}
        try:
            names.append(", ".join(nodes) or content.nodes_name(member))
        except MeshError:
            names.append("")
    if not all(names):
        what = tie.members[0][0]
        text = f'"{what}" is no surface and no node set of solid elements here{content.reason(what)}'
        content.draft.find("*Coupling", tie.where, text, "missing")
        return None
    return {"nodes": ", ".join(names)}
