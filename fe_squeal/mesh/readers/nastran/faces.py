"""Faces of solids that cards name by grid points: PLOAD4 and BSURFS make surface groups."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fe_squeal.errors import MeshError

from ...elements import FACES, SHAPE, corner_count
from ...raw import CellBlock, Ints, rows_of
from .text import Card, real


def named_faces(cards: Sequence[Card], blocks: Sequence[CellBlock], labels: Ints, source: str) -> dict[str, list[Ints]]:
    """Return the corners of the faces by group: PLOAD4_3, or PLOAD4_3_1, ... if set 3 has several pressures; BSURFS_4.

    Raises
    ------
    MeshError
        A face that its element does not have.
    """
    if not cards:
        return {}
    place: dict[int, tuple[str, Ints]] = {}
    for block in blocks:
        corners = block.nodes[:, : corner_count(block.kind)]
        place.update(zip(block.labels.tolist(), ((SHAPE[block.kind], row) for row in corners), strict=True))
    found: dict[str, dict[float, list[Ints]]] = {}
    for card in cards:
        try:
            if card.name == "PLOAD4":
                element = int(card.text(1))
                if element not in place:
                    continue  # of a shell
                given = [int(card.text(i)) for i in (6, 7) if card.text(i)]
                face = _face(*place[element], rows_of(np.array(given), labels), opposite=len(given) == 2)
                found.setdefault(f"PLOAD4_{int(card.text(0))}", {}).setdefault(real(card.text(2)), []).append(face)
                continue
            for i in range(4, len(card.fields), 4):
                if card.text(i):
                    element = int(card.text(i))
                    three = rows_of(np.array([int(card.text(i + j)) for j in (1, 2, 3)]), labels)
                    face = _face(*place[element], three, opposite=False)
                    found.setdefault(f"BSURFS_{int(card.text(0))}", {}).setdefault(0.0, []).append(face)
        except (ValueError, KeyError, IndexError, OverflowError):
            raise MeshError(
                f"{source}: {card.where}: {card.name} {card.text(0)[:20]} names no face of a solid; expected a solid"
                " and grid points of one of its faces"
            ) from None
    groups: dict[str, list[Ints]] = {}
    for name, by_pressure in found.items():
        for i, faces in enumerate(by_pressure.values(), 1):
            own = name if len(by_pressure) == 1 else f"{name}_{i}"
            groups[own] = [np.array([f for f in faces if len(f) == n], dtype=np.int64).reshape(-1, n) for n in (3, 4)]
    return groups


def _face(shape: str, corners: Ints, given: Ints, opposite: bool) -> Ints:
    """Return the corners of the face that has the given ones.

    Parameters
    ----------
    opposite : bool
        Of two given corners, whether the second is across a quadrilateral, or of a tetrahedron off the face.
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
