"""A stiff block on two inclined springs and a belt: the minimal model with two degrees of freedom.

q = (x along the belt, y out of it): K = [[a, b + μ k3], [b, d]], a = Σ k sin²θ, b = −Σ k sinθ cosθ, d = k3 + Σ k cos²θ,
springs along (sin θ, −cos θ) with θ = 120° and 60° (Hoffmann et al. 2002). Only the contact spring k3 carries load, so
μ multiplies k3 alone. Flutter where the discriminant (a − d)² + 4b(b + μ k3) vanishes:
μ_c = ((a − d)² + 4b²)/(4|b| k3).
"""

from __future__ import annotations

import functools

import numpy as np
import pytest
from selection import some

import fe_squeal
from meshes import BELT, box, make_problem, modes_of, rigid_motions, term

K1, K2, K3 = 10.0, 20.0, 10.0
A, B, D = 22.5, -5 * np.sqrt(3) / 2, 17.5
# The block is soft by k/E ~ 1e-5 (m = 1 kg, side 1 m), and rounding grows with E.
YOUNG, SOFT = 1e6, 1e-4
SIZES = [(2, 1), (3, 2)]  # cells and order: 63 unknowns for LAPACK, 931 for ARPACK


def stiffness(mu):
    return np.array([[A, B + mu * K3], [B, D]])


@functools.cache
def belt_problem(n=2, order=1):
    """Block of mass 1, of n³ cells, that moves in x and z alone.

    Held along y, it could still turn about y. A spring between the mean motions of its own left and right face along z
    is a torsional spring: it does not feel translations.
    """
    mesh = box("hex1", (n, n, n))
    springs = [
        {"name": f"spring {i}", "surface": "top", "direction": [np.sin(t), 0.0, -np.cos(t)], "stiffness": k}
        for i, (k, t) in enumerate([(K1, 2 * np.pi / 3), (K2, np.pi / 3)])
    ]
    lock = {"name": "lock", "surface": "left", "to": "right", "direction": [0.0, 0.0, 1.0], "stiffness": YOUNG}
    return make_problem(
        mesh,
        order=order,
        materials={"stiff": {"youngs_modulus": YOUNG, "poisson_ratio": 0.0, "density": 1.0}},
        supports=[{"surface": "front", "fixed": "y"}, {"surface": "back", "fixed": "y"}],
        springs=[*springs, lock],
        contacts=[{"surface": "bottom", "counterface": "rigid", "normal_stiffness": K3, "sliding": BELT}],
        effects={"friction": {"mu": 0.0}},
    )


def test_base_values():
    """a, b, d from the springs' angles."""
    angles = np.radians([120.0, 60.0])
    direction = np.array([np.sin(angles), -np.cos(angles)])
    K = (direction * [K1, K2]) @ direction.T + np.diag([0.0, K3])
    np.testing.assert_allclose(K, stiffness(0.0), rtol=1e-14)


def test_terms_on_translations():
    """On the two translations every term is the lumped one, exactly: K_f = [[0, k3], [0, 0]]."""
    problem = belt_problem()
    T = rigid_motions(problem)[:, [0, 2]]
    np.testing.assert_allclose(T.T @ (term(problem, "friction") @ T), [[0.0, K3], [0.0, 0.0]], atol=1e-12 * K3)
    np.testing.assert_allclose(T.T @ (term(problem, "contact") @ T), [[0.0, 0.0], [0.0, K3]], atol=1e-12 * K3)
    np.testing.assert_allclose(T.T @ (problem.pencil().M @ T), np.eye(2), atol=1e-12)
    for mu in (0.0, 0.3, 1.0):
        found = T.T @ (problem.pencil(mu=mu).K @ T)
        np.testing.assert_allclose(found, stiffness(mu), atol=1e-15 * YOUNG)


@pytest.mark.parametrize(("n", "order"), SIZES)
@pytest.mark.parametrize("mu", [0.0, 0.2, 0.5, 0.8, 1.2])
def test_modes(n, order, mu):
    """λ² = −θ of the 2 × 2 pencil: 3.87298i and 5i without friction, a growing and a decaying one beyond 1/√3."""
    theta = np.linalg.eigvals(stiffness(mu))
    lam = 1j * np.sqrt(theta.astype(complex))
    expected = lam[np.lexsort((-lam.real, lam.imag))]
    if mu == 0.0:
        np.testing.assert_allclose(expected, [3.87298334620742j, 5j], rtol=1e-12)
    found = modes_of(belt_problem(n, order), 2, mu=mu)
    np.testing.assert_allclose(found.lam, expected, atol=SOFT * 5)
    assert ("unstable" in found.stability) == (mu > 1 / np.sqrt(3))


@pytest.mark.parametrize(("n", "order"), some(SIZES, lambda n, order: order == 1))
def test_flutter_onset(n, order):
    """μ_c = (5² + 4·75/4)/(4 · 10 · 5√3/2) = 1/√3, where both θ are (a + d)/2 = 20; there Re λ = c √(μ − μ_c).

    θ = 20 ± i√(|b| k3 (μ − μ_c)), so that c = √(|b| k3) / (2√20).
    """
    values = [0.0, 0.15, 0.3, 0.4, 0.47, 0.52, 0.56, 0.59, 0.62]
    result = fe_squeal.sweep(belt_problem(n, order), values, modes=2)
    (onset,) = [o for o in result.onsets if o.kind == "flutter"]
    assert onset.value == pytest.approx(1 / np.sqrt(3), rel=10 * SOFT)
    assert onset.frequency_hz == pytest.approx(np.sqrt(20.0) / (2 * np.pi), rel=SOFT)
    assert onset.crossing_speed == pytest.approx(np.sqrt(-B * K3) / (2 * np.sqrt(20.0)), rel=10 * SOFT)
    assert onset.direction == "into"
    # Two rigid modes are the whole story here, so the two-mode prediction is right as well.
    assert onset.two_mode_value == pytest.approx(1 / np.sqrt(3), rel=10 * SOFT)
