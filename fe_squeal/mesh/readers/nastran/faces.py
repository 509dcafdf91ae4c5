"""Surface groups of the faces that cards name: PLOAD4 and BSURFS by grid points, BSURF by elements."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from fe_squeal.errors import MeshError

from ...elements import FACES, SHAPE, corner_count
from ...raw import CellBlock, Ints, RawMesh, Rows
from ...surfaces import faces_of
from .text import Card, ranges, real


def named_faces(cards: Sequence[Card], blocks: Sequence[CellBlock], labels: Ints, source: str) -> dict[str, list[Ints]]:
    """Return the corners (f, 3 or 4) of the faces of PLOAD4 and BSURFS, by the name of their group.

    The group of load set 3 is PLOAD4_3, or PLOAD4_3_1, PLOAD4_3_2, ... if the set has several pressures, or one several
    times on a face; that of BSURFS 4 is BSURFS_4. Faces on which PLOAD4 acts along a direction of its own are the group
    PLOAD4_3_directed.

    Raises
    ------
    MeshError
        A card names a face that its element does not have.
    """
    return {
        name: [np.array([f for f in faces if len(f) == n], dtype=np.int64).reshape(-1, n) for n in (3, 4)]
        for name, (_, _, faces) in pressed_faces(cards, blocks, labels, source).items()
    }


def pressed_faces(
    cards: Sequence[Card], blocks: Sequence[CellBlock], labels: Ints, source: str
) -> dict[str, tuple[int, float, list[Ints]]]:
    """Return the set, the pressure in the file's unit and the corners (3 or 4,) of each face, by the name of the group.

    A face on which a set has one pressure several times is in as many groups: the pressures add up. The pressure is 0
    for BSURFS and for PLOAD4 along a direction of its own, whose faces are in one group however often they are named.

    Raises
    ------
    MeshError
        As of `named_faces`.
    """
    if not cards:
        return {}
    place: dict[int, tuple[str, Ints]] = {}
    for block in blocks:
        corners = block.nodes[:, : corner_count(block.kind)]
        place.update(zip(block.labels.tolist(), ((SHAPE[block.kind], row) for row in corners), strict=True))
    found: dict[tuple[str, int], dict[tuple[float, int], list[Ints]]] = {}
    times: Counter[tuple[object, ...]] = Counter()
    rows = Rows(labels)
    for card in cards:
        try:
            if card.name == "PLOAD4":
                element = int(card.text(1))
                if element not in place:
                    continue  # a pressure on a shell
                given = [int(card.text(i)) for i in (6, 7) if card.text(i)]
                face = _face(*place[element], rows(np.array(given)), opposite=len(given) == 2)
                sid, directed = int(card.text(0)), is_directed(card)
                pressure = 0.0 if directed else real(card.text(2))
                times[key := (sid, directed, pressure, *sorted(face.tolist()))] += 1
                groups = found.setdefault((f"PLOAD4_{sid}{'_directed' if directed else ''}", sid), {})
                groups.setdefault((pressure, 1 if directed else times[key]), []).append(face)
                continue
            for i in range(4, len(card.fields), 4):
                if card.text(i):
                    element = int(card.text(i))
                    three = rows(np.array([int(card.text(i + j)) for j in (1, 2, 3)]))
                    face = _face(*place[element], three, opposite=False)
                    sid = int(card.text(0))
                    found.setdefault((f"BSURFS_{sid}", sid), {}).setdefault((0.0, 1), []).append(face)
        except (ValueError, KeyError, IndexError, OverflowError):
            raise MeshError(
                f"{source}: {card.where}: {card.name} {card.text(0)[:20]} names no face of a solid; expected a solid"
                " and grid points of one of its faces"
            ) from None
    return {
        name if len(groups) == 1 else f"{name}_{i}": (sid, pressure, faces)
        for (name, sid), groups in found.items()
        for i, ((pressure, _), faces) in enumerate(groups.items(), 1)
    }


def is_directed(card: Card) -> bool:
    """Return whether a PLOAD4 acts along N1, N2, N3, or along what LDIR names, and not along the normal.

    Raises
    ------
    ValueError
        A component cannot be read.
    """
    return any(real(card.text(i)) for i in (9, 10, 11)) or card.text(13).upper() in ("X", "Y", "Z", "TANG")


def _face(shape: str, corners: Ints, given: Ints, opposite: bool) -> Ints:
    """Return the corners of the face of a solid that some given corners identify.

    Parameters
    ----------
    shape : str
        Shape of the solid, a key of `elements.FACES`.
    corners : (c,) int
        The corners of the solid.
    given : (1, 2, 3 or 4,) int
        Corners of the face.
    opposite : bool
        How two given corners are meant, as in PLOAD4: they are diagonally opposite in a quadrilateral, and in a
        tetrahedron the second is the corner that is not on the face. Otherwise both are simply on the face.

    Raises
    ------
    ValueError
        There is no such face, or more than one.
    """
    if len(given) == 0 or (given < 0).any():
        raise ValueError
    faces = [corners[list(face)] for face in FACES[shape]]
    if shape == "tetra" and opposite:
        fits = [f for f in faces if given[1] not in f and given[0] in f]
    elif opposite:
        fits = [f for f in faces if len(f) == 4 and given[0] in f and f[(list(f).index(given[0]) + 2) % 4] == given[1]]
    else:
        fits = [f for f in faces if np.isin(given, f).all() and (len(given) > 1 or len(f) == 3)]
    if len(fits) != 1:
        raise ValueError
    return fits[0]


def faces_of_elements(
    cards: Sequence[Card], raw: RawMesh, shells: dict[int, Ints], source: str
) -> dict[str, list[Ints]]:
    """Return the corners (f, 3 or 4) of the faces of each BSURF, by the name of its group, such as BSURF_5.

    A shell is a face itself. Of a solid, all faces that it does not share with another solid are taken.

    Parameters
    ----------
    shells : dict of int to (3 or 4,) int
        Corners of each shell, by its number.

    Raises
    ------
    MeshError
        A card names an element that is neither a solid nor a shell of the file.
    """
    if not cards:
        return {}
    solids = np.concatenate([np.empty(0, np.int64), *(block.labels for block in raw.blocks)])
    there = {*solids.tolist(), *shells}
    wanted: dict[str, set[int]] = {}
    for card in cards:
        try:
            own = wanted.setdefault(f"BSURF_{int(card.text(0))}", set())
            for some in ranges(card, 1):
                if len(some) > 1:
                    own |= {e for e in there if e in some}  # a range of THRU may contain numbers that no element has
                    continue
                if some[0] not in there:
                    raise MeshError(
                        f"{source}: {card.where}: BSURF {card.text(0)} names element {some[0]}, which is no solid or"
                        " shell of the file"
                    )
                own.add(some[0])
        except (ValueError, OverflowError):
            raise MeshError(
                f"{source}: {card.where}: BSURF {card.text(0)[:20]} is not readable; expected a number, and elements"
                " singly or as first THRU last BY step"
            ) from None
    faces = faces_of(raw)
    groups: dict[str, list[Ints]] = {}
    for name, elements in wanted.items():
        chosen = np.isin(solids, list(elements))
        parts = []
        for n in (3, 4):
            free = faces[n].corners[faces[n].boundary & chosen[faces[n].cells]]
            thin = [corners for label, corners in shells.items() if label in elements and len(corners) == n]
            parts.append(np.vstack([free, *thin]).astype(np.int64))
        if any(len(part) for part in parts):
            groups[name] = parts
    return groups
