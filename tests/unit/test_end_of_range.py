"""Modes of damping ratios up to 0.2 just below the end of a range, where the discs that cover it do not reach."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal.eigen import known_band
from fe_squeal.eigen.found_pairs import FoundPairs
from fe_squeal.eigen.known_band import KnownBand, is_light
from fe_squeal.eigen.linear.factor import SingularError
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.shift import BEHIND, LIGHT, LIGHT_RATIO, on_slant
from fe_squeal.eigen.solve import solve_modes

N = 420
RATIO = -LIGHT_RATIO + 1j * np.sqrt(1 - LIGHT_RATIO**2)  # λ / |λ| of the most damped mode that has to be found
ROUND = 46  # more than are looked for at once


def pencil_of(lam: np.ndarray, others: int = 60) -> Pencil:
    """Return oscillators with these λ, some others next to the axis far below them, and the rest far above."""
    omega = np.concatenate([np.linspace(0.05, 0.3, others), np.abs(lam), np.linspace(5.0, 50.0, N - others - len(lam))])
    c = np.concatenate([np.full(others, 0.002), -2 * lam.real, np.full(N - others - len(lam), 0.002)])
    M, C, K = (sp.csr_array(sp.diags_array(d)) for d in (np.ones(N), c, omega**2))
    return Pencil(M, K, C, symmetric=True)


def test_the_damping_ratio_is_that_of_the_modes_file():
    """−Re λ / |λ|, of which 0.2 is 0.2041 of −Re λ / Im λ."""
    assert is_light(np.array([RATIO])).all() and not is_light(np.array([1.001 * RATIO.real + 1j * RATIO.imag])).any()


def test_the_disc_at_the_end_holds_what_is_left_out_beside_it():
    """Between the ray of the most damped modes, a circle around a real shift, and the end of the range, 1 rad/s."""
    for shift in (BEHIND, 1.1 * BEHIND, 1.03 * 1.1 * BEHIND):
        leaves = on_slant(shift, float(np.hypot(shift, 1.0)), LIGHT)
        rim = leaves * (1j - LIGHT)
        assert abs(rim - shift) == pytest.approx(np.hypot(shift, 1.0), rel=1e-12)
        corners = np.array([1j, 1j - LIGHT, rim])
        assert np.abs(corners - known_band._END).max() < known_band._END_RADIUS


def test_modes_far_above_all_others_at_the_end_of_the_range():
    """The upper of two discs reaches to |λ − 0.75i| = 0.296 and shows nothing, so that the others end at 0.3."""
    lam = RATIO / RATIO.imag * np.array([0.985, 0.999])
    modes = solve_modes(pencil_of(lam), Request(max_frequency_hz=1 / (2 * np.pi)))
    assert len(modes) == 62 and not modes.unsearched
    np.testing.assert_allclose(modes.lam[-2:], lam, rtol=1e-9)


@pytest.mark.parametrize(
    "lam", [np.full(6, -0.19 + 0.995j), -0.196 + 0.98j + 0.002 * np.exp(2j * np.pi * np.arange(ROUND) / ROUND)]
)
def test_more_modes_at_the_end_than_one_search_shows(lam):
    """A block of four vectors shows four of equal parts, and 40 modes are looked for at once."""
    known = KnownBand(FoundPairs(pencil_of(lam)), None, "auto")
    known.add_end(1.0)
    assert np.count_nonzero(np.abs(known.found.lam - lam[0]) < 0.005) == len(lam) and not known.unsearched


def test_more_flutter_aslant_than_one_search_shows():
    """They grow with about Re λ = Im λ / 2."""
    lam = 0.4 + 0.8j + 0.02 * np.exp(2j * np.pi * np.arange(ROUND) / ROUND)
    known = KnownBand(FoundPairs(pencil_of(lam)), None, "auto", near=0.4)
    known.add_aslant(1.0)
    assert np.count_nonzero(np.abs(known.found.lam - 0.4 - 0.8j) < 0.021) == ROUND and not known.unsearched


def with_equal(k: float, c: float, copies: int) -> tuple[Pencil, complex]:
    """Return oscillators of which some are equal, and their λ of the larger real or imaginary part."""
    stiffness = np.concatenate([np.full(copies, k), np.linspace(0.06, 50.0, N - copies) ** 2])
    damping = np.concatenate([np.full(copies, c), np.full(N - copies, 0.002)])
    M, C, K = (sp.csr_array(sp.diags_array(d)) for d in (np.ones(N), damping, stiffness))
    return Pencil(M, K, C, symmetric=True), -c / 2 + np.sqrt(complex(c**2 / 4 - k))


@pytest.mark.parametrize("copies", [4, 5, 6, 7, 11])
def test_more_equal_parts_that_diverge_fast_than_a_block_shows(copies):
    """Rounding parts the real eigenvalues of two of them into a pair with conjugate vectors, which count as two."""
    pencil, lam = with_equal(-4.0, 0.1, copies)
    modes = solve_modes(pencil, Request(max_frequency_hz=1 / (2 * np.pi)))
    growing = modes.select(np.flatnonzero(modes.lam.real > 0.01))
    np.testing.assert_allclose(growing.lam, np.full(copies, lam), rtol=1e-12)
    shares = np.linalg.svd(growing.right / np.linalg.norm(growing.right, axis=0), compute_uv=False)
    assert shares.min() > 1e-6 and not modes.unsearched


@pytest.mark.parametrize(
    ("copies", "loss", "damper"), [(8, 0.0, None), (12, 0.02, None), (6, 0.02, 0.01), (5, 0.5, 0.01)]
)
def test_more_equal_parts_that_diverge_fast_in_other_classes(copies, loss, damper):
    """Two of the others are coupled by friction. Solves without C have found some of the copies before."""
    K = sp.lil_array(with_equal(-4.0, 0.0, copies)[0].K)
    K[copies + 3, copies + 4], K[copies + 4, copies + 3] = 1e-3, -2e-3
    M, K = sp.eye_array(N, format="csr"), sp.csr_array(K) * (1 + 1j * loss if loss else 1)
    modes = solve_modes(Pencil(M, K, None if damper is None else M * damper), Request(max_frequency_hz=1 / (2 * np.pi)))
    c = damper or 0.0
    lam = -c / 2 + np.sqrt(c**2 / 4 + 4 * (1 + 1j * loss))
    np.testing.assert_allclose(modes.lam[modes.lam.real > 1], np.full(copies, lam), rtol=1e-10)


@pytest.mark.parametrize(
    ("copies", "mu", "most"), [(25, 1.0, 400.0), pytest.param(41, 0.7, 60.0, marks=pytest.mark.slow)]
)
def test_more_equal_parts_that_diverge_than_a_space_of_vectors_parts(copies, mu, most):
    """Each has a diverging mode, and no two of its modes are orthogonal. Others swing beside them."""
    chain = [3 * np.eye(n) - 1.4 * (np.eye(n, k=1) + np.eye(n, k=-1)) for n in (12, 200)]
    part, fall = 4 * chain[0] + 2 * np.eye(12), np.zeros((12, 12))
    fall[0, :2], fall[3, 4] = [-most, -0.3 * most], 0.2
    K = sp.csr_array(sp.block_diag([*(part + mu * fall for _ in range(copies)), chain[1]]))
    modes = solve_modes(Pencil(sp.eye_array(K.shape[0], format="csr"), K), Request(count=12))
    theta = np.linalg.eigvals(part + mu * fall).real.min()
    growing = modes.lam.real > 1
    np.testing.assert_allclose(modes.lam[growing], np.full(copies, np.sqrt(-theta)), rtol=1e-9)
    assert not modes.unsearched


def test_a_shift_that_is_moved_away_from_an_eigenvalue_leaves_nothing_out(monkeypatch):
    """The disc reaches up to the end of the range from where the shift is then."""
    whole = known_band.ShiftInverted

    def singular_there(pencil, sigma, *given):
        if sigma == BEHIND:
            raise SingularError("an eigenvalue is there")
        return whole(pencil, sigma, *given)

    monkeypatch.setattr(known_band, "ShiftInverted", singular_there)
    pencil, growth = with_equal(-BEHIND * (BEHIND + 0.1), 0.1, 1)
    known = KnownBand(FoundPairs(pencil), None, "auto")
    assert growth == pytest.approx(BEHIND) and known.add_beside(1.0)
    assert np.abs(known.found.lam - BEHIND).min() < 1e-9


@pytest.mark.parametrize(("k", "c", "copies"), [(4e-4, 0.002, 12), (1e-6, 2e-4, 30)])
def test_more_equal_parts_that_swing_slowly_than_a_block_shows(k, c, copies):
    pencil, lam = with_equal(k, c, copies)
    known = KnownBand(FoundPairs(pencil), None, "auto", near=0.05)
    known.add_slow(1.0)
    assert np.count_nonzero(np.abs(known.found.lam - lam) < 1e-9 * abs(lam)) == copies and known.low < abs(lam)


def test_a_search_that_fails_at_the_end_leaves_out_what_decays_alone(monkeypatch):
    monkeypatch.setattr(KnownBand, "_disc", lambda self, sigma, *given: (sigma, 0.0))
    known = KnownBand(FoundPairs(pencil_of(np.zeros(0))), None, "auto")
    known.add_end(1.0)
    assert known.unsearched.damped and not known.unsearched.may_grow


@pytest.mark.parametrize(("begins", "damped"), [(0.48, False), (0.52, True)])
def test_discs_that_are_narrow_where_they_meet_leave_damped_modes_out_of_a_crowd(monkeypatch, begins, damped):
    monkeypatch.setattr(KnownBand, "_disc", lambda self, sigma, radius, *given: (sigma, radius))
    known = KnownBand(FoundPairs(pencil_of(np.zeros(0))), None, "auto", near=0.1, low=0.1)
    known._lit = [(begins, 0.8), (0.09, 0.5), (0.75, 1.01)]
    known.add_aslant(1.0)
    assert known.unsearched.damped == damped and not known.unsearched.may_grow


def test_a_disc_that_shows_nothing_is_halved_and_leaves_nothing_out(monkeypatch):
    whole, shifts = KnownBand._disc, []

    def first_fails(self, sigma, *given):
        shifts.append(sigma)
        return (sigma, 0.0) if len(shifts) == 1 else whole(self, sigma, *given)

    monkeypatch.setattr(KnownBand, "_disc", first_fails)
    known = KnownBand(FoundPairs(pencil_of(np.array([RATIO]), others=12)), None, "auto")
    known.cover(0.0, 0.3, 12)
    assert len(shifts) > 2 and np.count_nonzero(known.found.lam.imag > 0) >= 12 and not known.unsearched
