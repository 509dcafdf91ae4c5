"""*Motion: what slides on what, and how fast."""

from __future__ import annotations

import numpy as np

from ...errors import MeshError
from ...mesh.readers.abaqus.model import Statement
from ..draft import Value
from .amplitudes import factor_of
from .content import Content, Pair, Reference, fields
from .holding import number_of
from .materials import clean

Motion = dict[str, Value] | np.ndarray  # `sliding` of a rotation, or a velocity (3,) in the deck's units
_ALIKE = 1e-9  # of a velocity: sides that move so nearly alike do not slide on each other


def read_motion(content: Content, statement: Statement) -> None:
    """Keep *Motion until all contacts are known."""
    content.motions.append((statement, factor_of(content, statement)))
    if statement.block.value("TYPE").upper() == "DISPLACEMENT":
        text = "of a displacement is read as a velocity, the only one that a static step takes"
        content.draft.find("*Motion, TYPE=DISPLACEMENT", content.where(statement), text)


def relative_motion(
    content: Content, pair: Pair, names: list[str], own: Motion | None, other: Motion | None
) -> dict[str, Value] | None:  # fmt: skip
    """Return the `sliding` of the second surface of a pair against the first one, or of the one that moves.

    Motions are those of the first and of the second surface, `sliding` or a velocity (3,), None where one stands still.
    """
    if own is None or other is None:
        moving = other if own is None else own
        return moving if moving is None or isinstance(moving, dict) else _translation(content, moving)
    together = f"both sides of {names[0]} on {names[1]} move"
    if isinstance(own, dict) or isinstance(other, dict):
        if isinstance(own, dict) and own == other:
            content.draft.find("*Motion", pair.where, f"{together}: nothing slides there")
        else:
            text = f"{together}, and one of them turns: give sliding of one against the other"
            content.draft.find("*Motion", pair.where, text, "missing")
        return None
    apart = other - own
    if np.linalg.norm(apart) <= _ALIKE * max(np.linalg.norm(own), np.linalg.norm(other)):
        content.draft.find("*Motion", pair.where, f"{together}: nothing slides there")
        return None
    return _translation(content, apart)


def _translation(content: Content, velocity: np.ndarray) -> dict[str, Value]:
    size = float(np.linalg.norm(velocity))
    direction: list[Value] = [clean(float(x) / size) + 0.0 for x in velocity]
    return {"direction": direction, "speed": clean(size * content.units.speed)}


def moving_surfaces(content: Content) -> list[tuple[set[str], Motion]]:
    """Return the surfaces that each *Motion moves, and its `sliding` for the scene, or a velocity (3,).

    Components of one node set in several *Motion belong together; of those of one component, and of rotations, the last
    counts, also where it stops the set.

    Raises
    ------
    MeshError
        A *Motion is wrong, or of nodes that do not exist.
    """
    found: list[tuple[set[str], Motion]] = []
    turning_at: dict[tuple[str, str], int] = {}  # where the rotation of a node set stands in what is found
    velocities: dict[tuple[str, str], np.ndarray] = {}
    for statement, factor in content.motions:
        block, where = statement.block, content.where(statement)
        lines: dict[str, list[list[float]]] = {}
        for line in block.lines:
            parts = fields(line)
            numbers = [number_of(content, statement, p) if p else 0.0 for p in parts[1:]]
            lines.setdefault(parts[0], []).append(numbers)
        for text, rows in lines.items():
            surfaces = _moved(content, (text, statement.scope))
            if "ROTATION" in block.parameters:
                turning = _turning(content, rows[0], factor)
                before = turning_at.get((text, statement.scope))
                if turning is None:
                    stops = ", so that nothing slides by it" if before is not None else ""
                    content.draft.find("*Motion", where, f"turns about no axis, or not at all{stops}")
                if before is not None:
                    found[before] = surfaces, np.zeros(3)
                turning_at[text, statement.scope] = len(found)
                found.append((surfaces, np.zeros(3) if turning is None else turning))
                continue
            first = (text, statement.scope) not in velocities
            velocity = velocities.setdefault((text, statement.scope), np.zeros(3))
            for row in rows:
                begin, end = int(row[0]) if row else 0, int(row[1] or row[0]) if len(row) > 1 else 0
                if not (1 <= begin <= end <= 3 and len(row) > 2):
                    raise MeshError(
                        f"{content.source}: {block.where}: *Motion takes a node set, a first and a last component"
                        " of 1 to 3, and a velocity"
                    )
                velocity[begin - 1 : end] = row[2] * factor
            if first:
                found.append((surfaces, velocity))
    still = [text for (text, _), velocity in velocities.items() if not velocity.any()]
    if still:
        content.draft.find("*Motion", "", f"of {', '.join(still)} has no velocity")
    return [(surfaces, m) for surfaces, m in found if isinstance(m, dict) or m.any()]


def _moved(content: Content, reference: Reference) -> set[str]:
    """Return the surfaces of which a node set has more than half of the nodes."""
    mesh = content.loaded.mesh
    moved = np.zeros(len(content.raw.points), bool)
    moved[content.rows(reference)] = True
    columns = _columns(content, moved)
    return {
        name for name, facets in (mesh.boundaries or {}).items()
        if columns[mesh.facets[:, np.asarray(facets)]].mean() > 0.5
    }  # fmt: skip


def _turning(content: Content, row: list[float], factor: float) -> dict[str, Value] | None:
    """Return the `sliding` of a rotation, None where it has no axis or no speed."""
    units, values = content.units, row + [0.0] * 7
    a, b = np.array(values[1:4]), np.array(values[4:7])
    if not values[0] * factor or not np.linalg.norm(b - a) > 0:
        return None
    sliding: dict[str, Value] = {"axis": [clean(round(float(x), 15)) + 0.0 for x in (b - a) / np.linalg.norm(b - a)]}
    if np.any(a):
        sliding["centre"] = [clean(float(x) * units.length) for x in a]
    return sliding | {"speed": clean(values[0] * factor / units.time)}


def _columns(content: Content, rows: np.ndarray) -> np.ndarray:
    """Return for nodes of the mesh whether their rows of the raw mesh are marked."""
    marked = np.zeros(content.loaded.mesh.doflocs.shape[1], bool)
    prefixes = dict((prefix, first) for first, prefix in content.raw.node_prefixes[::-1])
    for prefix, (labels, columns) in content.loaded.node_numbers.items():
        start = prefixes[prefix]
        ends = [first for first, _ in content.raw.node_prefixes if first > start] + [len(content.raw.points)]
        own = content.raw.node_labels[start : ends[0]]
        order = np.argsort(own, kind="stable")
        marked[columns] = rows[start + order[np.searchsorted(own, labels, sorter=order)]]
    return marked
