"""Low frequencies of small models whose lightest unknowns swing a million times as fast, against a closed form."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes

_STIFF, _LIGHT = 2.0**27, 2.0**-20  # N/m, kg, beside 1: the matrices have no rounding


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("damping", [0.0, 2.0**-10])
def test_low_frequencies_of_graded_masses(friction: float, damping: float) -> None:
    """Masses of 1 kg on springs, each with a light one on a stiff spring, and one coupling of both signs to the next.

    With u the heavy masses and v the light ones, κ(v − u) = θ m v, so that θ x = S x with the 2 × 2 matrix S of the
    heavy ones alone, up to θ m/κ = 1e-14.
    """
    S = np.array([[2.0, -1.0 - friction], [-1.0 + friction, 2.5]])
    n = 10  # of such pairs, which differ in scale
    scales = 1 + np.arange(n) / 4
    K = np.zeros((4 * n, 4 * n))
    for i, scale in enumerate(scales):
        at = 4 * i + np.arange(4)
        link = _STIFF * np.array([[1.0, -1.0], [-1.0, 1.0]])
        K[np.ix_(at[:2], at[:2])] += scale * S
        for a in (0, 1):
            K[np.ix_(at[[a, a + 2]], at[[a, a + 2]])] += link
    M = np.diag(np.tile([1.0, 1.0, _LIGHT, _LIGHT], n))
    order = np.random.default_rng(5).permutation(4 * n)
    K, M = (A[np.ix_(order, order)] for A in (K, M))
    C = None if damping == 0 else sp.csr_array(damping * M)
    pencil = Pencil(sp.csr_array(M), sp.csr_array(K), C=C, symmetric=friction == 0)
    modes = solve_modes(pencil, Request(count=2 * n))
    # A light mass moves with its heavy one, which is so much heavier.
    theta = np.concatenate([scale * np.linalg.eigvals(S) for scale in scales]) / (1 + _LIGHT)
    expected = np.sort(np.sqrt(theta - damping**2 / 4))
    np.testing.assert_allclose(np.sort(modes.lam.imag), expected, rtol=1e-7)  # a rounding of the stiff springs is 3e-8
    np.testing.assert_allclose(modes.lam.real, -damping / 2, atol=1e-7)
