"""What straight edges leave out of curved faces, which the bars of a mesh do not hold."""

from __future__ import annotations

import numpy as np
import pytest

from fe_squeal import sweep
from fe_squeal.accuracy.discretisation import with_discretisation
from fe_squeal.accuracy.polygons import straight_edges
from meshes import annulus, box, make_problem, mapped, modes_of

SOFT = [{"name": f"s{i}", "surface": "top", "direction": np.eye(3)[i].tolist(), "stiffness": 1e6} for i in range(3)]


def ring(kind, counts):
    return make_problem(annulus(kind, counts, 0.08, 0.10, 0.02), springs=SOFT)


@pytest.mark.slow
def test_a_ring_of_straight_edges_is_farther_off_than_its_bars_and_told():
    exact = modes_of(ring("hex2", (3, 40, 2)), 12).lam.imag[6:]
    for kind, said in (("hex1", 1), ("hex2", 0)):
        result = with_discretisation(sweep(ring(kind, (2, 24, 2)), [0.0], modes=12))
        (point,) = result.points
        off, bar = np.abs(point.modes.lam.imag[6:] - exact), point.discretisation.imag[6:]
        assert (off > bar).any() == bool(said)
        told = [w for w in result.warnings if "straight edges" in w]
        assert len(told) == said
        # (2π/24)²/12: the mean distance of a polygon from its circle, over the radius.
        assert all("body disc" in w and "0.57 % of the radius" in w for w in told)


@pytest.mark.parametrize(("kind", "n", "said"), [
    ("hex1", 24, 1), ("hex1", 12, 1), ("tet1", 24, 1), ("hex1", 8, 0), ("tet2", 24, 1),
    ("hex2", 24, 0), ("hex2", 8, 0), ("hex2", 6, 0),
])  # fmt: skip
def test_faces_of_straight_edges_are_told(kind, n, said):
    """Eight sides are those of an octagon. Middle nodes of these tetrahedra are on straight edges, of hexahedra not."""
    assert len(list(straight_edges(ring(kind, (1, n, 1)).source))) == said


def test_blocks_and_chamfers_are_what_they_are():
    flat = box("hex1", (8, 8, 1), (0.08, 0.08, 0.01))
    chamfered = mapped(flat, lambda x: np.stack([x[0], x[1], x[2] - 0.3 * np.maximum(x[0] - 0.07, 0.0)]))
    for mesh in (flat, chamfered):
        assert not list(straight_edges(make_problem(mesh).source))
