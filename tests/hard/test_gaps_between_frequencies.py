"""Modes beyond a wide gap of frequencies, with overdamped modes that make the modes asked for reach beyond it.

As many modes are asked for as there are below the gap without dampers. Some of these creep with dampers, and the first
modes above the gap, which flutter, take their places. An empty range must not be taken for the end of the spectrum.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes

LIGHT, CREEPING, ABOVE = 40, 12, 355


@pytest.mark.parametrize("gap", [30.0, 100.0])
def test_the_first_mode_beyond_a_gap_is_found(gap):
    rng = np.random.default_rng(0)
    light = rng.uniform(0.97, 1.03, LIGHT) ** 2
    flutter = gap**2 * np.array([[1.0, 0.06], [-0.06, 1.0]])
    above = (gap * rng.uniform(1.5, 30.0, ABOVE)) ** 2
    K = la.block_diag(np.diag(light), np.diag(rng.uniform(0.1, 0.5, CREEPING)), flutter, np.diag(above))
    damping = np.full(len(K), 0.01)
    damping[LIGHT : LIGHT + CREEPING] = 4.0
    pencil = Pencil(*(sp.csr_array(A) for A in (np.eye(len(K)), K, np.diag(damping))))
    modes = solve_modes(pencil, Request(count=LIGHT + 1))
    found = modes.lam[modes.lam.imag > 0]
    expected = np.append(np.sort(np.sqrt(light - 0.005**2)), np.sqrt(la.eigvals(flutter) - 0.005**2 + 0j)[0].real)
    assert len(found) >= LIGHT + 1
    np.testing.assert_allclose(np.sort(found.imag)[: LIGHT + 1], expected, rtol=1e-5)
    assert np.count_nonzero(modes.stability == "unstable") == 1
