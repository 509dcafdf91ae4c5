"""Oscillating modes by complex shifts, where strong dampers crowd real eigenvalues around every real one."""

from __future__ import annotations

import re

import numpy as np
import pytest
import scipy.sparse as sp
from selection import some

from fe_squeal.eigen.band import band_modes
from fe_squeal.eigen.free_modes import split_off
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes

N, EVERY = 500, 5


def mixed(M: np.ndarray, C: np.ndarray, K: np.ndarray) -> Pencil:
    """Return the pencil of oscillators with these diagonals in coordinates of two neighbours each."""
    T = sp.csr_array(sp.diags_array([np.ones(N), np.full(N - 1, 0.4)], offsets=[0, 1]))
    return Pencil(*(sp.csr_array(T.T @ sp.diags_array(d) @ T) for d in (M, K, C)), symmetric=True)


def oscillators(damper: float) -> tuple[Pencil, np.ndarray]:
    """Return oscillators of which one in five swings, and the λ of those in the upper half plane."""
    k, c = np.linspace(1.0, 400.0, N) ** 1.1, np.full(N, damper)
    c[::EVERY] = 0.02 + 0.01 * np.arange(0, N, EVERY) / N
    lam = -c / 2 + np.sqrt((c / 2) ** 2 - k + 0j)
    return mixed(np.ones(N), c, k), lam[lam.imag > 0]


@pytest.mark.parametrize("damper", some([60.0, 3e3], lambda damper: damper < 100))
def test_swinging_modes_among_overdamped_ones(damper):
    pencil, lam = oscillators(damper)
    light = np.sort_complex(lam[lam.real > -0.2 * lam.imag])
    for request in (Request(count=24), Request(max_frequency_hz=1.6)):
        modes = solve_modes(pencil, request)
        found = modes.lam[(modes.lam.imag > 0) & (modes.lam.real > -0.2 * modes.lam.imag)]
        said = re.search(r"above (\S+) Hz", modes.method)  # below nothing is promised
        low = 2 * np.pi * float(said[1]) * 1.01 if said else 0.0
        assert low < 1.5
        expected = light[(light.imag >= low) & (light.imag <= max(found.imag.max(), 0.0) * (1 + 1e-9))]
        found = found[found.imag >= low]
        assert len(found) == len(expected) >= 15
        assert request.count or light.imag[light.imag <= 3.2 * np.pi].max() == pytest.approx(found.imag.max(), rel=1e-9)
        np.testing.assert_allclose(np.sort(found.imag), np.sort(expected.imag), rtol=1e-9)
        assert modes.backward_error.max() < 1e-10
        left = pencil.transposed().apply(modes.lam.conj(), modes.left)
        assert np.abs(left).max() < 1e-8 * np.abs(modes.left).max() * np.abs(pencil.K.diagonal()).max()


def test_growing_real_eigenvalue_and_free_motion_beside_a_band():
    """θ = −0.04 with c = 0.1 grows at λ = −0.05 + √0.0425; a free mass stays, or is slowed."""
    k, c = np.linspace(1.0, 400.0, N), np.full(N, 0.05)
    k[7], c[7] = -0.04, 0.1
    k[11], c[11] = 0.0, 0.3
    pencil = mixed(np.ones(N), c, k)
    modes = band_modes(pencil, Request(count=20), 6.0, split_off(pencil), "auto")
    growing = -0.05 + np.sqrt(0.05**2 + 0.04)
    assert np.abs(modes.lam - growing).min() < 1e-9
    assert np.abs(modes.lam).min() == 0
    found = np.sort(modes.lam.imag[modes.lam.imag > 0])
    swinging = np.sqrt(np.delete(k, [7, 11]) - 0.025**2)
    assert len(found) >= 18
    np.testing.assert_allclose(found, swinging[: len(found)], rtol=1e-9)
