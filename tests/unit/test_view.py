"""The axis along which pictures show a model: that of sliding around, or the normal where sliding is straight."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fe_squeal.run.view import view_axis

ANGLES = {"whole": np.linspace(0, 2 * np.pi, 50, endpoint=False), "shoe": np.linspace(-0.6, 0.5, 20)}


def seen(normals, directions):
    contact = SimpleNamespace(normals=normals, directions=directions)
    return view_axis(SimpleNamespace(contacts={"pad": contact}))


def turned(*vectors):
    """Rotate all by one and the same random rotation; return it first."""
    Q = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
    return Q, *(v @ Q.T for v in vectors)


@pytest.mark.parametrize("extent", list(ANGLES))
@pytest.mark.parametrize("surface", ["disc", "drum"])
@pytest.mark.parametrize("slides", [True, False])
def test_around_an_axis(surface, extent, slides):
    """Of a drum the normals mean nothing; of one that is tied they are all there is."""
    a = ANGLES[extent]
    radial, around, up = (np.column_stack(x) for x in (
        (np.cos(a), np.sin(a), 0 * a), (-np.sin(a), np.cos(a), 0 * a), (0 * a, 0 * a, 1 + 0 * a)))  # fmt: skip
    Q, normals, directions = turned(up if surface == "disc" else radial, around if slides else 0 * around)
    if surface == "drum" and extent == "shoe" and not slides:
        expected = Q @ radial.mean(axis=0) / np.linalg.norm(radial.mean(axis=0))
        assert_allclose(seen(normals, directions), expected, atol=1e-9)
        return
    axis = np.array(seen(normals, directions))
    assert_allclose(axis * np.sign(axis @ Q[:, 2]), Q[:, 2], atol=1e-9)
    if surface == "disc":
        assert axis @ normals[0] > 0


def test_a_belt_is_seen_along_its_normal():
    normal, way = np.array([0.0, 0.6, 0.8]), np.array([1.0, 0.0, 0.0])
    assert_allclose(seen(np.tile(normal, (9, 1)), np.tile(way, (9, 1))), normal)
    assert view_axis(None) == (0.0, 0.0, 1.0)
