"""Modes are ordered by frequency; where two have one frequency, rounding does not decide which of them is first."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.quality import modes_from_lambda, modes_from_theta

# K φ = θ φ with K = [[1, c], [−c, 1]] has θ = 1 ± i c, with right and left vectors (1, ± i).
COUPLED = 1e-2
VECTORS = np.array([[1, 1, 0], [1j, -1j, 0], [0, 0, 1]])
K = sp.csr_array(np.array([[1, COUPLED, 0], [-COUPLED, 1, 0], [0, 0, 1 + 1e-6]]))


@pytest.mark.parametrize("rounding", [1e-13, -1e-13])
@pytest.mark.parametrize("swapped", [False, True])
def test_the_growing_mode_of_a_pair_comes_first(rounding, swapped):
    """The third mode is 1e-6 away, and stays at its own place."""
    theta = np.array([1 + COUPLED * 1j, 1 - COUPLED * 1j, 1 + 1e-6]) + np.array([rounding, -rounding, 0])
    order = [2, 1, 0] if swapped else [0, 1, 2]
    vectors = VECTORS[:, order].astype(complex)
    modes = modes_from_theta(Pencil(sp.csr_array(np.eye(3)), K), theta[order], vectors, vectors, "given")
    pair = modes.lam[np.abs(modes.lam.real) > 1e-3]
    assert pair[0].real > 0 > pair[1].real
    assert np.abs(np.diff(pair.imag)) > 0, "without a difference of frequency the test shows nothing"
    assert np.all(np.diff(modes.lam.imag) > -1e-9)
    np.testing.assert_allclose(K @ modes.right, -modes.right * modes.lam**2, atol=1e-12)


@pytest.mark.parametrize("rounding", [1e-13, -1e-13])
def test_with_damping_growth_decides_as_well(rounding):
    lam = np.array([-0.2 + 1j * (1 + rounding), -0.1 + 1j])
    C, stiffness = np.diag(-2 * lam.real), np.diag(np.abs([-0.2 + 1j, -0.1 + 1j]) ** 2)
    pencil = Pencil(*(sp.csr_array(A) for A in (np.eye(2), stiffness, C)))
    vectors = np.eye(2, dtype=complex)
    modes = modes_from_lambda(pencil, lam, vectors, vectors, "given")
    np.testing.assert_allclose(modes.lam.real, [-0.1, -0.2], rtol=1e-9)


@pytest.mark.parametrize("off", [0.1, 0.45, 0.9])
def test_the_uncertainty_of_a_divergence_reaches_the_exact_one(off):
    """θ = −1 is given where it is −1 + off: of a θ that nears zero λ = √−θ moves by more than its slope at −1 says."""
    pencil = Pencil(sp.csr_array(np.eye(1)), sp.csr_array([[off - 1.0]]), symmetric=True)
    modes = modes_from_theta(pencil, np.array([-1.0]), np.eye(1), np.eye(1), "given")
    np.testing.assert_allclose(modes.re_uncertainty, 1 - np.sqrt(1 - off), rtol=1e-9)
