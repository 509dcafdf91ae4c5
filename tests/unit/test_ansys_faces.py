"""Faces that contact and target elements of Ansys archives cover, by the number of their nodes."""

from __future__ import annotations

import numpy as np
import pytest

from fe_squeal.mesh.readers.ansys_archive import Archive
from fe_squeal.mesh.readers.ansys_faces import contact_surfaces, pressures

NUMBERS = np.arange(11, 31)


def archive(*segments: tuple[int, list[int]]) -> Archive:
    """Segments of kind 170 or 174 with real constant set 4, in rows that are as wide as those of SOLID186."""
    head = [1, 0, 4, 1, 0, 0, 0, 0, 0, 0]
    elem = np.zeros((len(segments), 30), np.int64)
    for row, (kind, nodes) in zip(elem, segments, strict=True):
        row[: 10 + len(nodes)] = [*head, *nodes]
        row[1] = kind
    kinds = np.array([[170, 170], [174, 174]])
    return Archive(NUMBERS, np.zeros((20, 3)), np.zeros((20, 3)), kinds, elem, {}, {}, {})


@pytest.mark.parametrize(("kind", "nodes", "corners"), [
    (170, [11, 12, 13], [0, 1, 2]), (170, [11, 12, 13, 14, 15, 16], [0, 1, 2]),
    (170, [11, 12, 13, 14], [0, 1, 2, 3]), (170, [11, 12, 13, 14, 15, 16, 17, 18], [0, 1, 2, 3]),
    (174, [11, 12, 13, 13], [0, 1, 2]), (174, [11, 12, 13, 13, 15, 16, 13, 18], [0, 1, 2]),
    (174, [11, 12, 13, 14, 0, 16, 0, 18], [0, 1, 2, 3]), (174, [11, 12, 13, 14, 0, 16], [0, 1, 2, 3]),
    (174, [11, 12, 13, 14, 15, 16], [0, 1, 2, 3]), (170, [11, 12, 13, 14, 0, 16], [0, 1, 2, 3]),
    (170, [11], []), (170, [11, 12], []),
], ids=["TRI", "TRI6", "QUAD", "QUA8", "triangle", "quadratic triangle", "midside nodes left out",
        "three of them, with the last", "the last two of them", "three of a target", "pilot", "line"])  # fmt: skip
def test_segments_have_the_corners_of_their_shape(kind: int, nodes: list[int], corners: list[int]) -> None:
    """Beside a triangle and a quadrilateral, which stay."""
    name = {170: "target_4", 174: "contact_4"}[kind]
    segments = [(kind, [21, 22, 23, 23]), (kind, nodes), (kind, [21, 22, 23, 24])]
    three, four = contact_surfaces(archive(*segments), NUMBERS)[name]
    expected = {3: [[10, 11, 12]], 4: [[10, 11, 12, 13]]}
    if corners:
        expected[len(corners)].insert(-1 if len(corners) == 4 else 1, corners)
    assert (three.tolist(), four.tolist()) == (expected[3], expected[4])


@pytest.mark.parametrize("indent", ["", "  ", "\t"])
def test_indented_loads_are_read(indent: str) -> None:
    """As every other command of Ansys may be."""
    row = f"{7:9d}{2:4d}{1:4d}" + f"{5.0:20.9E}" * 4
    block = ["SFEBLOCK,1,PRES,1,1,0", "(i9,i4,i4,6(pg20.9))", row, "SFE,END,LOC,-1"]
    lines = [f"{indent}SFE,7,3,PRES,1,2.0", f"{indent}{block[0]}", *block[1:], f"{indent}SFEDELE,ALL"]
    found = pressures(archive((174, [11, 12, 13, 14])), lines, "a.cdb")
    assert found == {2.0: [(7, 3, "line 1")], 5.0: [(7, 2, "line 4")]}
