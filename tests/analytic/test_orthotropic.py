"""Orthotropic elasticity: which entry of the lists is which, and material axes that differ from the global ones."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse.linalg as spla

from meshes import box, make_problem, term

E1, E2, E3 = 130e9, 11e9, 7e9
NU23, NU13, NU12 = 0.4, 0.25, 0.3
G23, G13, G12 = 3.5e9, 4.5e9, 6e9
PLY = {
    "youngs_modulus": [E1, E2, E3], "poisson_ratio": [NU23, NU13, NU12], "shear_modulus": [G23, G13, G12],
    "density": 1600.0,
}  # fmt: skip
# ε_i under unit stress along axis 1, 2, 3; ν_ij = −ε_j/ε_i under a stress along i.
COMPLIANCE = np.array([
    [1 / E1, -NU12 / E1, -NU13 / E1],
    [-NU12 / E1, 1 / E2, -NU23 / E2],
    [-NU13 / E1, -NU23 / E2, 1 / E3],
])  # fmt: skip
SIZE = np.array([1.0, 0.7, 0.5])
SLIDING = [{"surface": s, "fixed": c} for s, c in (("left", "x"), ("front", "y"), ("bottom", "z"))]
PULLED = ("right", "back", "top")


def ply_problem(kind, axes, supports):
    body = {"material": "ply", **({"axes": axes} if axes else {})}
    mesh = box(kind, (2, 2, 2), SIZE)
    return make_problem(mesh, materials={"ply": PLY}, bodies={"block": body}, supports=supports)


def traction(problem, surface, direction):
    """Return the nodal forces of a unit traction on a face."""
    space = problem.discretisation.space
    face = space.surface(space.mesh.boundaries[surface])
    return space.along(face.values, direction).T @ face.weights


@pytest.mark.parametrize("along", [0, 1, 2])
@pytest.mark.parametrize(
    ("axes", "turned"), [(None, (0, 1, 2)), ([[0, 1, 0], [0, 0, 1]], (1, 2, 0)), ([[0, 0, 1], [0, 1, 0]], (2, 1, 0))]
)
@pytest.mark.parametrize("kind", ["hex1", "tet2"])
def test_uniaxial_tension(kind, axes, turned, along):
    """Pulled along each global axis between sliding supports, the block stretches by S_ij: exact, 1e-9 by conditioning.

    turned[i] is the global axis on which material axis i lies.
    """
    problem = ply_problem(kind, axes, SLIDING)
    K = problem.pencil().K
    u = spla.spsolve(K.tocsc(), traction(problem, PULLED[along], np.eye(3)[along]))
    strain = problem.discretisation.space.expand(u).max(axis=0) + problem.discretisation.space.expand(u).min(axis=0)
    S = np.zeros((3, 3))
    S[np.ix_(turned, turned)] = COMPLIANCE
    np.testing.assert_allclose(strain / SIZE, S[:, along], rtol=1e-9)


@pytest.mark.parametrize(("plane", "modulus"), [((1, 2), G23), ((0, 2), G13), ((0, 1), G12)])
def test_shear_moduli(plane, modulus):
    """The energy of a simple shear u_i = γ x_j is V G_ij γ²/2."""
    problem = ply_problem("hex1", None, [])
    x = problem.discretisation.space.coordinates
    u = np.zeros_like(x)
    u[:, plane[0]] = x[:, plane[1]]
    assert u.ravel() @ (term(problem, "elastic") @ u.ravel()) == pytest.approx(SIZE.prod() * modulus, rel=1e-12)


@pytest.mark.parametrize("degrees", [15.0, 45.0, 70.0])
def test_off_axis_modulus(degrees):
    """1/E_x = c⁴/E1 + (1/G12 − 2ν12/E1) s²c² + s⁴/E2 for fibres at an angle in the plane (Jones 1975, eq. 2.97).

    A free block under opposite unit tractions has a uniform stress; its rigid motion is left to least squares.
    """
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    problem = ply_problem("hex1", [[c, s, 0], [-s, c, 0]], [])
    f = traction(problem, "right", [1.0, 0.0, 0.0]) - traction(problem, "left", [1.0, 0.0, 0.0])
    u = np.linalg.lstsq(problem.pencil().K.toarray(), f, rcond=1e-12)[0]
    # The work of the tractions is that of the uniform stress: f·u = V σ ε_x with σ = 1.
    modulus = SIZE.prod() / (f @ u)
    expected = 1 / (c**4 / E1 + (1 / G12 - 2 * NU12 / E1) * s**2 * c**2 + s**4 / E2)
    assert modulus == pytest.approx(expected, rel=1e-8)
