"""Springs and dampers under blocks that are stiff against them: the lumped formulas.

The block's own compliance lowers ω by about k/(E L) ~ 1e-6 here; tolerances are 1e-5.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
from selection import crossed

from meshes import STEEL, box, join, make_problem, modes_of, rigid_motions, term

SIDE, HEIGHT = 0.1, 0.06
MASS = STEEL["density"] * SIDE**2 * HEIGHT
STIFFNESS = 2e4
TOLERANCE = 1e-5


def block(n=3, corner=(-SIDE / 2, -SIDE / 2, 0.0), name="block"):
    return box("hex1", (n, n, n), (SIDE, SIDE, HEIGHT), corner, name=name)


def spring(direction, surface="bottom", **more):
    return {"name": "foundation", "surface": surface, "direction": direction, **more}


def foundation_on_rigid_motions(direction, stiffness):
    """∫ (k/A)(d·r_i)(d·r_j) dA over the bottom face z = 0, centred; d·(e × x) = x·(d × e)."""
    d = np.array(direction) / np.linalg.norm(direction)
    gauss, _ = np.polynomial.legendre.leggauss(2)
    K = np.zeros((6, 6))
    for x in gauss * SIDE / 2:
        for y in gauss * SIDE / 2:
            row = np.concatenate([d, np.cross([x, y, 0.0], d)])
            K += stiffness / 4 * np.outer(row, row)
    return K


def mass_on_rigid_motions():
    """Rigid mass matrix about the centre of the bottom face, centre of mass at (0, 0, h/2)."""
    cross = np.array([[0, HEIGHT / 2, 0], [-HEIGHT / 2, 0, 0], [0, 0, 0]])  # columns e × c
    rotation = np.diag([SIDE**2 / 12 + HEIGHT**2 / 3] * 2 + [SIDE**2 / 6])
    return MASS * np.block([[np.eye(3), cross], [cross.T, rotation]])


@pytest.mark.parametrize("direction", [(0, 0, 1), (0, 0, -2), (1, 0, 0), (1.0, -0.4, 0.7)])
def test_foundation_on_rigid_motions(direction):
    """Total stiffness k along d, spread evenly; the length and sign of d do not matter. Exact quadrature: 1e-12."""
    problem = make_problem(block(), springs=[spring(direction, stiffness=STIFFNESS)])
    R = rigid_motions(problem)
    expected = foundation_on_rigid_motions(direction, STIFFNESS)
    np.testing.assert_allclose(R.T @ (term(problem, "spring") @ R), expected, atol=1e-12 * STIFFNESS)
    np.testing.assert_allclose(R.T @ (problem.pencil().M @ R), mass_on_rigid_motions(), atol=1e-12 * MASS)


@pytest.mark.parametrize("direction", [(0, 0, 1), (1.0, -0.4, 0.7)])
def test_frequencies_of_a_block_on_a_foundation(direction):
    """Six modes as those of the rigid block; normal to the face: √(k/m), and rocking √(k L²/12 / I) twice."""
    problem = make_problem(block(), springs=[spring(direction, stiffness=STIFFNESS)])
    lam = modes_of(problem, 6).lam
    theta = la.eigh(foundation_on_rigid_motions(direction, STIFFNESS), mass_on_rigid_motions(), eigvals_only=True)
    expected = np.sqrt(np.where(theta > 1e-9 * theta.max(), theta, 0.0))
    np.testing.assert_allclose(lam.imag, expected, rtol=TOLERANCE, atol=1e-5 * expected.max())
    if direction == (0, 0, 1):
        inertia = MASS * (SIDE**2 + HEIGHT**2) / 12
        rocking = np.sqrt(STIFFNESS * SIDE**2 / 12 / inertia)
        np.testing.assert_allclose(lam.imag[3:], sorted([rocking, rocking, np.sqrt(STIFFNESS / MASS)]), rtol=TOLERANCE)


def test_spring_between_two_blocks():
    """ω = √(k(1/m1 + 1/m2)) along the line of the centres; eleven motions stay free."""
    upper = block(2, (-SIDE / 2, -SIDE / 2, 0.05))
    lower = box("hex1", (2, 2, 2), (SIDE, SIDE, 2 * HEIGHT), (-SIDE / 2, -SIDE / 2, -2 * HEIGHT), name="lower")
    springs = [spring((0, 0, 1), "bottom", stiffness=STIFFNESS, to="top_lower")]
    problem = make_problem(join(upper, lower), springs=springs)
    lam = modes_of(problem, 12).lam
    expected = np.sqrt(STIFFNESS * (1 / MASS + 1 / (2 * MASS)))
    assert np.abs(lam[:11]).max() < 1e-4 * expected
    assert lam[11].imag == pytest.approx(expected, rel=TOLERANCE)


def test_inclined_spring_between_two_blocks():
    """Force k (mean − mean')·d along d on both, opposite: no net force, rank one, k d dᵀ on either block."""
    upper = block(2, (-SIDE / 2, -SIDE / 2, 0.05))
    lower = block(2, (-SIDE / 2, -SIDE / 2, -HEIGHT), "lower")
    springs = [spring((1, 2, 3), "bottom", stiffness=STIFFNESS, to="top_lower")]
    problem = make_problem(join(upper, lower), springs=springs)
    K = term(problem, "spring").toarray()
    d = np.array([1, 2, 3]) / np.sqrt(14)
    T = rigid_motions(problem)[:, :3]
    assert np.abs(K @ T).max() < 1e-12 * STIFFNESS
    only_upper = T * np.repeat(problem.discretisation.space.coordinates[:, 2] > 0.01, 3)[:, None]
    np.testing.assert_allclose(only_upper.T @ K @ only_upper, STIFFNESS * np.outer(d, d), atol=1e-12 * STIFFNESS)
    assert np.linalg.matrix_rank(K) == 1


@pytest.mark.parametrize(
    ("n", "zeta"), crossed([2, 4], [0.02, 0.6, 1.5], fast=lambda n, zeta: n == 2 or zeta == 0.6)  # LAPACK and ARPACK
)
def test_damper(n, zeta):
    """λ = −ζω ± ω√(ζ² − 1), ζ = c/(2√(km)): oscillating below ζ = 1, two real eigenvalues above.

    The side face is held along x and y, so that the block only moves along z.
    """
    omega = np.sqrt(STIFFNESS / MASS)
    damping = zeta * 2 * np.sqrt(STIFFNESS * MASS)
    supports = [{"surface": s, "fixed": "xy"} for s in ("left", "right", "front", "back")]
    springs = [spring((0, 0, 1), stiffness=STIFFNESS, damping=damping)]
    problem = make_problem(block(n), supports=supports, springs=springs)
    assert problem.problem_class == "quadratic"
    lam = modes_of(problem, 3).lam
    assert (lam.real < 0).all()
    root = omega * np.sqrt(complex(zeta**2 - 1))
    for expected in [-zeta * omega + root] + ([-zeta * omega - root] if zeta > 1 else []):
        assert np.abs(lam - expected).min() < 1e-4 * omega
