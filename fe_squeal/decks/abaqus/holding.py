"""*Boundary, *Spring and *Dashpot: supports and springs of the scene."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np

from ...errors import MeshError
from ...mesh.readers.abaqus.model import Links, Statement
from ...mesh.readers.abaqus.text import is_label
from ..directions import along_axes, held_projector
from ..draft import Value, plain_name
from .content import Content, Reference, fields, real, short, spoken
from .links import links_under
from .materials import clean
from .operations import takes_away
from .orientations import local_axes
from .transforms import axes_at, held_directions

_NAMED = {
    "ENCASTRE": (1, 2, 3, 4, 5, 6), "PINNED": (1, 2, 3), "XSYMM": (1, 5, 6), "YSYMM": (2, 4, 6), "ZSYMM": (3, 4, 5),
    "XASYMM": (2, 3, 4), "YASYMM": (1, 3, 5), "ZASYMM": (1, 2, 6), "NOWARP": (), "NOOVAL": (), "NODEFORM": (),
}  # fmt: skip
_KINDS = ("SPRING", "DASHPOT")
_HELD = 1e-9  # length of what a unit vector has besides the directions that are held
_COINCIDENT = 1e-9  # part of the model's size: two nodes nearer to each other than this have no direction between them


def read_boundary(content: Content, statement: Statement) -> None:
    """Take *Boundary: what is held, or let go again with OP=NEW."""
    block, where = statement.block, content.where(statement)
    released = takes_away(content, statement) and bool(content.held)
    if released:
        content.held.clear()
    if content.perturbation and (block.lines or released):
        text = "in a step of vibrations counts for these alone; here the static state has the same supports"
        content.draft.find("*Boundary", where, text)
    kind = block.value("TYPE").upper()
    if kind in ("VELOCITY", "ACCELERATION") or "SUBMODEL" in block.parameters or "USER" in block.parameters:
        text = "a motion that is prescribed is taken as held: vibrations about it are zero there"
        content.draft.find(f"*Boundary, {kind or 'SUBMODEL'}", where, text)
    for line in block.lines:
        parts = [part for part in fields(line)]
        reference = (parts[0], statement.scope)
        freedoms = _freedoms(content, statement, parts)
        if not freedoms:
            continue
        _check(content, statement, reference)
        value = number_of(content, statement, parts[3]) if len(parts) > 3 and parts[3] else 0.0
        if value:
            text = "a displacement that is prescribed is held; what it does to the static state is not simulated"
            content.draft.find("*Boundary", where, text)
        for freedom in freedoms:
            content.held.setdefault(reference, {})[freedom] = where


def _freedoms(content: Content, statement: Statement, parts: list[str]) -> tuple[int, ...]:
    if len(parts) < 2 or not parts[1]:
        raise MeshError(
            f'{content.source}: {statement.block.where}: *Boundary: "{statement.block.shown(",".join(parts))}" names no'
            " degree of freedom; expected numbers such as 1, 3 or a word such as ENCASTRE"
        )
    word = parts[1].upper()
    if word in _NAMED:
        return _NAMED[word]
    if not is_label(word):
        raise MeshError(
            f'{content.source}: {statement.block.where}: *Boundary: "{statement.block.shown(parts[1])}" is no degree of'
            f" freedom; expected a number, or one of {', '.join(_NAMED)}"
        )
    first = int(number_of(content, statement, parts[1]))
    last = int(number_of(content, statement, parts[2])) if len(parts) > 2 and parts[2] else first
    if first > 6 or first == last == 0:
        return ()  # temperatures, mass flows and the like
    if not 1 <= first <= last:
        raise MeshError(
            f"{content.source}: {statement.block.where}: *Boundary: degrees of freedom {first} to {last}; expected"
            " a first one of 1 to 6 and a last one not below it"
        )
    return tuple(range(first, min(last, 6) + 1))


def number_of(content: Content, statement: Statement, text: str) -> float:
    """Return the number of a field or parameter of a statement.

    Raises
    ------
    MeshError
        It is none.
    """
    try:
        return real(text)
    except ValueError:
        raise MeshError(
            f'{content.source}: {statement.block.where}: *{spoken(statement.block.keyword)}:'
            f' "{statement.block.shown(text)}" is not a number'
        ) from None


def _check(content: Content, statement: Statement, reference: Reference) -> None:
    try:
        content.rows(reference)
    except MeshError as error:
        text = str(error).removeprefix(f"{content.source}: ")
        what = f"{statement.block.where}: *{spoken(statement.block.keyword)}"
        raise MeshError(f"{content.source}: {what}: {text}") from None


def write_supports(content: Content) -> None:
    """Write a support for each node set that is held, and one for all single nodes that are held alike."""
    single: dict[str, list[str]] = {}
    places: dict[str, str] = {}
    for reference, freedoms in content.held.items():
        where = next(iter(freedoms.values()))
        rows = content.rows(reference)
        if not content.on_solids[rows].any():
            continue  # a reference node, or of an element that is no solid
        fixed = held_directions(content, reference, set(freedoms))
        if fixed is None:
            text = f'holds "{reference[0]}" in axes of *Transform that are not along x, y and z: give [[supports]]'
            content.draft.find("*Boundary", where, text, "missing")
        if not fixed:
            continue
        name = content.nodes_name(reference)
        if is_label(reference[0].rpartition(".")[2]):
            single.setdefault(fixed, []).append(name)
            places.setdefault(fixed, where)
            continue
        table = content.draft.add("supports", is_entry=True, values={"nodes": name, "fixed": fixed})
        table.comments.append(f"*Boundary, {where}")
    for fixed, names in single.items():
        table = content.draft.add("supports", is_entry=True, values={"nodes": ", ".join(names), "fixed": fixed})
        table.comments.append(f"*Boundary, {places[fixed]}: single nodes")


def read_spring(content: Content, statement: Statement) -> None:
    """Keep *Spring and *Dashpot until all elements are known."""
    content.springs.append(statement)


def write_springs(content: Content, points: Mapping[int, list[dict[str, Value]]]) -> None:
    """Write the springs and dampers of all *Spring and *Dashpot, each with its elements.

    Parameters
    ----------
    content : Content
        Content of the deck; the springs are added to its scene.
    points : mapping of int to list of dict
        By the row of a reference node, the tables of the scene that take springs at this node.

    Raises
    ------
    MeshError
        A *Spring or *Dashpot of the deck is wrong.
    """
    taken: list[str] = []
    for statement in content.springs:
        block, elset = statement.block, statement.block.value("ELSET")
        keyword, where = spoken(block.keyword), content.where(statement)
        mine = [(key, link) for key, link in links_under(content, statement) if link.kind.startswith(_KINDS)]
        if not mine and not content.placements(statement.scope):
            continue  # of a part that stands nowhere
        if not mine:
            text = f'its element set "{elset}" has no elements of type SPRING1, SPRING2, SPRINGA or DASHPOT...'
            content.draft.find(f"*{keyword}", where, text, "missing")
            continue
        if "NONLINEAR" in block.parameters or "COMPLEX STIFFNESS" in block.parameters:
            text = "a nonlinear characteristic has no one stiffness; give that at the working point in [[springs]]"
            content.draft.find(f"*{keyword}, NONLINEAR", where, text, "missing")
            continue
        rows = [content.floats(block, line) for line in block.lines]
        rows = [row for row in rows if row]
        kind = mine[0][1].kind
        needed = 1 if kind.endswith("A") else 2
        if len(rows) < needed or rows[needed - 1][0] is None:
            raise MeshError(
                f"{content.source}: {block.where}: *{keyword} for elements of type {kind} needs"
                + (" degrees of freedom and then" if needed == 2 else "") + " a number"
            )  # fmt: skip
        if len(rows) > needed:
            content.draft.find(f"*{keyword}", where, "depends on temperature or frequency; the first row is taken")
        size = float(rows[needed - 1][0] or 0.0)
        freedoms = [int(v or 0) for v in rows[0]] if needed == 2 else []
        for key, link in mine:
            axes = local_axes(content, statement, key)
            if axes is not None:
                _write_links(content, statement, key, link, freedoms, size, axes, taken, points)


def _write_links(
    content: Content, statement: Statement, instance: str, link: Links, freedoms: list[int], size: float,
    axes: np.ndarray, taken: list[str], points: Mapping[int, list[dict[str, Value]]],
) -> None:  # fmt: skip
    """Write the springs of one block of elements: those alike that act on single nodes together."""
    keyword, where = spoken(statement.block.keyword), content.where(statement)
    damper = statement.block.keyword == "DASHPOT"
    key = "damping" if damper else "stiffness"
    unit = content.units.damping if damper else content.units.stiffness
    if size < 0:
        text = f"a negative {key} is not simulated"
        content.draft.find(f"*{keyword}", where, text, "missing")
        return
    if size == 0:
        content.draft.find(f"*{keyword}", where, f"a {key} of zero acts on nothing", "harmless")
        return
    ground: dict[tuple[float, ...], list[str]] = {}
    between: list[tuple[str, str, list[float]]] = []
    for label, nodes in zip(link.labels, link.nodes, strict=True):
        ends = [content.rows((node, instance)) for node in nodes]
        if len(ends) != (1 if link.kind[-1] == "1" else 2) or any(len(end) != 1 for end in ends):
            raise MeshError(f"{content.source}: {link.where}: element {label} of type {link.kind} has wrong nodes")
        rows = [int(end[0]) for end in ends]
        if len(rows) == 1 and rows[0] in points and freedoms and 1 <= freedoms[0] <= 6:
            turns = freedoms[0] > 3
            way = [clean(round(float(x), 15)) + 0.0 for x in axes[(freedoms[0] - 1) % 3]]
            total = size * unit * (content.units.length**2 if turns else 1.0)
            points[rows[0]].append({"axis" if turns else "direction": way, key: clean(total)})
            continue
        if link.kind.endswith("A"):
            way = content.raw.points[rows[1]] - content.raw.points[rows[0]]
            if np.linalg.norm(way) <= _COINCIDENT * np.ptp(content.raw.points, axis=0).max():
                text = f"element {label} has both its nodes in one place, and so no direction"
                content.draft.find(f"*Element, TYPE={link.kind}", short(link.where, content.source), text, "missing")
                continue
            way = way / np.linalg.norm(way)
        else:
            if not freedoms or any(f > 3 or f < 1 for f in freedoms[: len(rows)]):
                text = f"acts on degrees of freedom {freedoms}; solids have 1, 2 and 3"
                content.draft.find(f"*{keyword}", where, text, "missing")
                return
            if len(rows) == 2 and freedoms[0] != (freedoms[1] if len(freedoms) > 1 else freedoms[0]):
                text = f"couples degree of freedom {freedoms[0]} with {freedoms[1]}; expected the same at both nodes"
                content.draft.find(f"*{keyword}", where, text, "missing")
                return
            way = axes[freedoms[0] - 1]
        solid = [row for row in rows if content.on_solids[row]]
        tied = [row for row in rows if row in points]
        if len(tied) == 1 and not solid and all(_is_ground(content, row, way) for row in rows if row not in tied):
            direction = [clean(round(float(x), 15)) + 0.0 for x in way]
            points[tied[0]].append({"direction": direction, key: clean(size * unit)})
            continue
        others = [row for row in rows if not content.on_solids[row]]
        if not solid or any(not _is_ground(content, row, way) for row in others):
            text = f"element {label} ends at a node that neither a solid element has nor *Boundary holds"
            content.draft.find(f"*{keyword}", where, text, "missing")
            continue
        names = [content.raw.node_name(row) for row in solid]
        direction = [clean(round(float(x), 15)) + 0.0 for x in way]
        if len(names) == 1:
            ground.setdefault(tuple(direction), []).append(names[0])
        else:
            between.append((names[0], names[1], direction))
    base = plain_name(link.elset or statement.block.value("ELSET"))

    def write(name: str, **values: Value) -> None:
        found = plain_name(name, taken)
        taken.append(found)
        table = content.draft.add("springs", is_entry=True, values={"name": found, **values})
        table.comments.append(f"*{keyword}, {where}")

    for way_of, names in ground.items():
        for nodes, times in _by_count(names):
            total = clean(size * unit * times * len(nodes))
            write(base, nodes=", ".join(nodes), direction=list(way_of), **{key: total})
    for one, other, direction in between:
        write(base, nodes=one, to=other, direction=direction, **{key: clean(size * unit)})


def _by_count(names: list[str]) -> list[tuple[list[str], int]]:
    """Return the names that stand there once, twice, ... with that number."""
    counts = Counter(names)
    return [([n for n in counts if counts[n] == times], times) for times in sorted(set(counts.values()))]


def _is_ground(content: Content, row: int, direction: np.ndarray) -> bool:
    """Whether supports hold a node that no solid has, along a direction (3,)."""
    along, _ = _held(content, row)
    return bool(np.linalg.norm(direction - along @ direction) <= _HELD)


def held_at(content: Content, row: int) -> set[int]:
    """Return the freedoms, 1 to 6 along and about x, y and z, that *Boundary holds at a node; others are asked for."""
    found = set[int]()
    for first, projector in zip((1, 4), _held(content, row), strict=True):
        directions = along_axes(projector)
        if directions is None:
            name = content.raw.node_name(row)
            text = f"holds node {name} in axes of *Transform that are not along x, y and z: give fixed in [[rigid]]"
            content.draft.find("*Boundary", "", text, "missing")
        found |= {first + "xyz".index(c) for c in directions or ""}
    return found


def _held(content: Content, row: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the projectors (3, 3) onto the directions along which *Boundary holds a node, and about which it does."""
    freedoms = {f for reference, held in content.held.items() if row in content.rows(reference) for f in held}
    (axes,) = axes_at(content, np.array([row]))
    along, about = ([f in freedoms for f in wanted] for wanted in ((1, 2, 3), (4, 5, 6)))
    return held_projector(axes, along), held_projector(axes, about)
