"""Oscillating modes by complex shifts, where strong dampers crowd real eigenvalues around every real one."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from selection import some

from fe_squeal.eigen import band, known_band
from fe_squeal.eigen.band import band_modes, count_beside
from fe_squeal.eigen.found_pairs import FoundPairs
from fe_squeal.eigen.free_modes import split_off
from fe_squeal.eigen.inertia import count_below
from fe_squeal.eigen.known_band import KnownBand
from fe_squeal.eigen.multiple import rounding_of_zero
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
        low = 1.01 * modes.unsearched.low  # below nothing is promised
        assert low < 1.5
        expected = light[(light.imag >= low) & (light.imag <= max(found.imag.max(), 0.0) * (1 + 1e-9))]
        found = found[found.imag >= low]
        assert len(found) == len(expected) >= 15
        assert request.count or light.imag[light.imag <= 3.2 * np.pi].max() == pytest.approx(found.imag.max(), rel=1e-9)
        np.testing.assert_allclose(np.sort(found.imag), np.sort(expected.imag), rtol=1e-9)
        assert modes.backward_error.max() < 1e-10
        left = pencil.transposed().apply(modes.lam.conj(), modes.left)
        assert np.abs(left).max() < 1e-8 * np.abs(modes.left).max() * np.abs(pencil.K.diagonal()).max()


@pytest.mark.parametrize("stiffness", [-0.04, -1e-12])
def test_a_band_below_all_modes_has_the_one_that_grows_alone(stiffness):
    """The inertia counts one below any frequency, as its stiffness is negative: its λ = −c/2 + √(c²/4 − k) is real."""
    k, c = np.linspace(1.0, 400.0, N), np.full(N, 0.1)
    k[7] = stiffness
    modes = solve_modes(mixed(np.ones(N), c, k), Request(max_frequency_hz=1e-3))
    [growth] = modes.lam[modes.stability == "unstable"] if stiffness < -1e-9 else modes.lam[modes.lam.imag == 0]
    assert growth == pytest.approx(-0.05 + np.sqrt(0.0025 - stiffness), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("stiffness", [-5.0, -5e7])
def test_growth_is_found_where_nothing_swings(stiffness):
    """All c² > 4k: whatever number of modes is asked for, there is one, λ = −c/2 + √(c²/4 − k) of a negative k."""
    k, c = np.linspace(1.0, 400.0, N), np.full(N, 1e3)
    k[0] = stiffness
    modes = solve_modes(mixed(np.ones(N), c, k), Request(count=3))
    np.testing.assert_allclose(modes.lam, [-500 + np.sqrt(500.0**2 - stiffness)], rtol=1e-6)


def test_free_motions_are_none_of_the_modes_that_are_missing(monkeypatch):
    """Discs do not find them, and the inertia counts them: that alone is no reason to count in parts of the band."""
    k, c = np.append(np.arange(10.0), np.linspace(20.0, 400.0, N - 10)), np.full(N, 0.05)
    counts = []
    monkeypatch.setattr(band, "count_below", lambda *given: counts.append(count_below(*given)) or counts[-1])
    modes = solve_modes(mixed(np.ones(N), c, k), Request(max_frequency_hz=np.sqrt(9.5) / (2 * np.pi)))
    assert counts == [10] and len(modes) == 11  # of the free one 0 and −c
    np.testing.assert_allclose(np.sort(modes.lam.imag)[2:], np.sqrt(k[1:10] - 0.025**2), rtol=1e-9)


def test_rounding_does_not_decide_whether_a_motion_without_force_is_at_rest():
    """The residual of a rigid motion at a λ that should be zero is λ²Mφ: its root is |λ| once more."""
    pencil = Pencil(*(sp.csr_array(np.diag(d)) for d in ([1.0, 1.0, 1.0], [0.0, 1.0, 2.0], [0.0, 0.0, 0.0])))
    lam = np.array([1e-15, 1e-15j]) @ np.random.default_rng(5).standard_normal((2, 400))
    motion = np.tile([[0.7], [0.0], [0.0]], 400) * np.exp(1j * np.linspace(0, 6, 400))
    assert (np.abs(lam) <= rounding_of_zero(pencil, lam, motion)).all()


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


@pytest.mark.parametrize("lost", some([((),), ((3,),), ((0, 11),)], lambda lost: len(lost) == 2))
def test_a_second_search_counts_what_the_first_one_missed(lost):
    """A few overdamped modes do not disturb it, and modes above the frequency do not count."""
    k, c = np.linspace(1.0, 400.0, N), np.full(N, 0.05)
    c[4::60] = 90.0
    k[2], c[2] = 0.0, 0.2  # moves freely
    pencil = mixed(np.ones(N), c, k)
    free = split_off(pencil)
    modes = solve_modes(pencil, Request(count=20))
    swinging = np.flatnonzero(modes.lam.imag > 0)
    assert len(swinging) >= 19 and (modes.lam == 0).any()
    top = float(modes.lam.imag[swinging[-2:]].mean())
    less = modes.select(np.delete(np.arange(len(modes)), swinging[list(lost)]))
    assert count_beside(pencil, less, top, free, "auto") == len(lost)


def test_growth_that_was_missed_is_counted():
    k, c = np.linspace(1.0, 400.0, N), np.full(N, 0.05)
    k[7] = -0.04
    pencil = mixed(np.ones(N), c, k)
    modes = solve_modes(pencil, Request(count=20))
    assert (modes.lam.real > 0).sum() == 1
    stable = modes.select(np.flatnonzero(modes.lam.real <= 0))
    top = float(modes.lam.imag[-2:].mean())
    assert [count_beside(pencil, m, top, None, "auto") for m in (modes, stable)] == [0, 1]


@pytest.mark.slow
def test_a_crowd_is_not_counted_and_not_listed_in_part():
    """Which ones of hundreds of overdamped modes are found is chance: none is listed, and no count is claimed."""
    pencil, lam = oscillators(60.0)
    modes = solve_modes(pencil, Request(count=24))
    assert (modes.lam.imag > 0).all()
    assert count_beside(pencil, modes, float(modes.lam.imag[-2:].mean()), None, "auto") is None
    light = np.sort(lam[lam.real > -0.2 * lam.imag].imag)[: len(modes)]
    np.testing.assert_allclose(modes.lam.imag, light, rtol=1e-9)


@pytest.mark.slow
def test_real_growth_near_zero_and_beyond_the_band_in_a_crowd():
    k, c = np.linspace(1.0, 400.0, N) ** 1.1, np.full(N, 60.0)
    c[::EVERY] = 0.02
    exact = []
    for i, growth in ((7, 1e-4), (13, 0.3), (18, 6.0)):
        c[i], k[i] = 0.5, -growth * (growth + 0.5)
        exact.append(growth)
    modes = solve_modes(mixed(np.ones(N), c, k), Request(count=24))
    growing = np.sort(modes.lam.real[(modes.lam.imag == 0) & (modes.lam.real > 0)])
    np.testing.assert_allclose(growing, exact, rtol=1e-7)


def test_fewer_swinging_modes_than_asked_for_are_all_there_are():
    """All others are overdamped, however far the band is extended: that is no error."""
    k, c = np.linspace(1.0, 400.0, 2 * N), np.full(2 * N, 100.0)
    c[:9] = 0.02
    diagonals = (np.ones(2 * N), k, c)
    pencil = Pencil(*(sp.csr_array(sp.diags_array(d)) for d in diagonals), symmetric=True)
    modes = solve_modes(pencil, Request(count=12))
    found = modes.lam[modes.lam.imag > 0]
    np.testing.assert_allclose(found.imag, np.sqrt(k[:9] - 1e-4), rtol=1e-9)


@pytest.mark.parametrize(("slow", "eta"), some([(0.02, 0.01), (1e-3, 0.01), (1e-3, 1.0)], lambda slow, _: slow > 0.01))
def test_slow_modes_beside_a_wide_band(eta, slow):
    """A mode far below the others lies under the discs of the band, with dampers and loss factors together, too."""
    k = np.append(slow**2, np.linspace(1.0, 400.0, N - 1))
    pencil = mixed(np.ones(N), np.full(N, 1e-4 * slow), k)
    lossy = Pencil(pencil.M, sp.csr_array(pencil.K * (1 + 1j * eta)), pencil.C, symmetric=True)
    for p, loss in ((pencil, 0.0), (lossy, eta)):
        modes = solve_modes(p, Request(max_frequency_hz=1.0))
        exact = 1j * np.sqrt(k * (1 + 1j * loss) - (0.5e-4 * slow) ** 2) - 0.5e-4 * slow
        exact = exact[exact.imag <= 2 * np.pi]
        assert len(modes) == len(exact) > 10
        assert np.abs(modes.lam[:, None] - exact).min(axis=0).max() < 1e-9


def test_modes_just_above_the_band_do_not_stand_for_slow_ones_in_it():
    """As many lie in the discs that cover the band, but beyond its end, as the inertia counts in the band."""
    slow, above = 1e-8 * np.linspace(1.0, 2.0, 6), np.linspace(1.01, 1.03, 6)
    omega = np.concatenate([slow, above, np.linspace(3.0, 50.0, N - 12)])
    modes = solve_modes(mixed(np.ones(N), 0.02 * omega, omega**2), Request(max_frequency_hz=1 / (2 * np.pi)))
    np.testing.assert_allclose(modes.lam.imag, omega[:6] * np.sqrt(1 - 1e-4), rtol=1e-10)


def test_a_range_of_many_modes_has_as_many_discs_as_it_needs(monkeypatch):
    """With a limit of 3 beside those that are planned, a range that is divided into 5 is covered."""
    monkeypatch.setattr(known_band, "_DISCS", 3)
    pencil = mixed(np.ones(N), np.full(N, 0.002), np.linspace(0.05, 6.0, N) ** 2)
    known = KnownBand(FoundPairs(pencil), None, "auto")
    known.cover(0.0, 2.0, 164)
    assert known.discs > 3 and np.count_nonzero((known.found.lam.imag > 0) & (known.found.lam.imag <= 2.0)) >= 160


@pytest.mark.parametrize("eta", [0.0, 1e-6])
def test_a_mode_damped_more_than_all_others_just_below_the_end_of_the_range(eta):
    """λ = −0.19 ± 0.995i beside many modes next to the axis, without and with loss factors."""
    omega, c = np.append(np.linspace(0.05, 1.6, 100), np.linspace(5.0, 50.0, N - 100)), np.full(N, 0.002)
    omega[7], c[7] = np.hypot(0.19, 0.995), 0.38
    pencil = mixed(np.ones(N), c, omega**2)
    if eta:
        pencil = Pencil(pencil.M, sp.csr_array(pencil.K * (1 + 1j * eta)), pencil.C, symmetric=True)
    modes = solve_modes(pencil, Request(max_frequency_hz=1 / (2 * np.pi)))
    assert np.abs(modes.lam - (-0.19 + 0.995j)).min() < 1e-6
    assert len(modes) == np.count_nonzero(omega**2 - c**2 / 4 < 1)


@pytest.mark.parametrize("limit", some([1e3, 1e5, 1e8], lambda limit: limit == 1e5))
def test_a_highest_frequency_far_above_all_modes(limit):
    """All lie within the part of the band at zero that discs leave out, where overdamped modes usually crowd."""
    n, swinging = N, 30
    omega = np.append(np.arange(1.0, swinging + 1), np.ones(n - swinging))
    mass = np.append(np.ones(swinging), np.zeros(n - swinging))  # the others follow
    T = sp.csr_array(sp.eye_array(n) + sp.diags_array(np.full(n - 1, 0.2), offsets=1))
    M, C, K = (sp.csr_array(T.T @ sp.diags_array(d) @ T) for d in (mass, 0.01 * mass * omega, omega**2))
    modes = solve_modes(Pencil(M, K, C), Request(max_frequency_hz=limit / (2 * np.pi)))
    np.testing.assert_allclose(modes.lam.imag, omega[:swinging] * np.sqrt(1 - 0.005**2), rtol=1e-10)
