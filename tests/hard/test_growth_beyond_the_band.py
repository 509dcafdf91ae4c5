"""Modes that grow faster than anything in the band swings: |λ| lies beyond it, and Im λ within."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from selection import some

from fe_squeal.eigen import shift_invert
from fe_squeal.eigen.dense import DENSE_LIMIT
from fe_squeal.eigen.growth import may_grow
from fe_squeal.eigen.pencil import Modes, Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.shift import BELOW
from fe_squeal.eigen.solve import solve_modes

N, BAND = DENSE_LIMIT + 50, 0.3
REQUESTS = [Request(count=20), Request(max_frequency_hz=BAND / (2 * np.pi))]


def chain(stiffness: np.ndarray, damping: np.ndarray | None = None, loss: float = 0.0, unit: float = 1.0) -> Pencil:
    """Return a chain between walls with friction at one place, and other masses beside it.

    Parameters
    ----------
    stiffness, damping : (k, k) float
        Those of the masses beside it; without damping nothing is damped.
    loss : float
        Loss factor of the chain.
    unit : float
        The unit of time, in seconds.
    """
    n = N - len(stiffness)
    k = np.random.default_rng(0).uniform(1, 3, n + 1)
    K = sp.lil_array(sp.diags_array([k[:-1] + k[1:], -k[1:-1], -k[1:-1]], offsets=[0, 1, -1]))
    K[50, 51] += 0.3
    C = None if damping is None else sp.csr_array(sp.block_diag([0.002 * np.eye(n), damping])) * unit
    whole = sp.csr_array(sp.block_diag([K * (1 + 1j * loss) if loss else K, stiffness])) * unit**2
    return Pencil(sp.eye_array(N, format="csr"), whole, C)


def growing(modes: Modes) -> np.ndarray:
    return modes.lam[modes.stability == "unstable"]


@pytest.mark.parametrize("request_", REQUESTS)
@pytest.mark.parametrize(
    ("flutter", "damping", "loss"),
    some([(0.0, None, 0.0), (0.0, None, 0.01), (0.0, 0.002, 0.0), (0.02, None, 0.0), (0.02, None, 0.01),
          (0.02, 0.002, 0.0)], fast=lambda *made: sum(map(bool, made)) < 2),
)  # fmt: skip
def test_growth_faster_than_the_band(flutter, damping, loss, request_):
    theta = -((0.9 + 1j * flutter) ** 2)
    block = np.array([[theta.real, theta.imag], [-theta.imag, theta.real if flutter else 9.0]])
    modes = solve_modes(chain(block, None if damping is None else damping * np.eye(2), loss), request_)
    c = damping or 0.0
    found = modes.lam[modes.lam.real > 0.1]
    np.testing.assert_allclose(found, [-c / 2 + np.sqrt(c**2 / 4 - theta)], rtol=1e-9)
    assert modes.backward_error.max() < 1e-11
    if not loss:  # whose law is one of what swings
        np.testing.assert_array_equal(growing(modes), found)
    if not damping and not loss:  # λ and −λ* come together
        assert np.abs(modes.lam + found.conj()).min() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(("flutter", "request_"), [(0.0, REQUESTS[0]), (0.02, REQUESTS[1])])
def test_growth_faster_than_the_band_beside_dampers_and_losses(flutter, request_):
    """Such problems take seconds: each by one of the requests."""
    test_growth_faster_than_the_band(flutter, 0.002, 0.01, request_)


@pytest.mark.parametrize("request_", [Request(count=32), REQUESTS[1]])
@pytest.mark.parametrize(("damping", "loss"), [(None, 0.0), (0.002, 0.0), (None, 0.01)])
@pytest.mark.parametrize(("growth", "swings"), [(0.1, 0.29), (0.18, 0.27), (0.22, 0.28), (0.3, 0.285), (0.21, 0.2)])
def test_flutter_that_swings_in_the_band_and_reaches_beyond_it(growth, swings, damping, loss, request_):
    """|λ| is up to 1.4 times the highest frequency: nothing finds it that looks for the smallest |λ| alone."""
    theta = -((growth + 1j * swings) ** 2)
    block = np.array([[theta.real, theta.imag], [-theta.imag, theta.real]])
    modes = solve_modes(chain(block, None if damping is None else damping * np.eye(2), loss), request_)
    c = damping or 0.0
    root = np.sqrt(c**2 / 4 - theta)
    np.testing.assert_allclose(modes.lam[modes.lam.real > 0.05], [-c / 2 + root], rtol=1e-8)
    assert "without" not in modes.method


@pytest.mark.slow
@pytest.mark.parametrize(("growth", "swings"), [(0.1, 0.29), (0.18, 0.27), (0.22, 0.28), (0.3, 0.285), (0.21, 0.2)])
def test_flutter_that_reaches_beyond_the_band_beside_dampers_and_losses(growth, swings):
    test_flutter_that_swings_in_the_band_and_reaches_beyond_it(growth, swings, 0.002, 0.01, REQUESTS[1])


@pytest.mark.parametrize("unit", [1.0, 1e-4])
@pytest.mark.parametrize(
    ("stiffness", "damping", "grows"),
    [
        ([[-(200.0**2), 0], [0, 9.0]], [[0, 0], [0, 0]], 200.0),  # far beyond the first disc
        ([[1.0, 0], [0, 9.0]], [[-8.0, 0], [0, 0]], 4 + 15**0.5),  # by negative damping alone
        ([[-1.0, 0], [0, -1.0]], [[0, 0.1], [-0.1, 0]], np.sqrt(1 - 0.05**2)),  # with gyroscopic forces
    ],
)
def test_what_makes_it_grow(stiffness, damping, grows, unit):
    request = Request(max_frequency_hz=BAND * unit / (2 * np.pi))
    modes = solve_modes(chain(np.array(stiffness), np.array(damping), unit=unit), request)
    assert np.abs(growing(modes).real / unit - grows).min() < 1e-8 * grows
    assert "without" not in modes.method


def test_what_may_grow():
    """K has θ = −4 and C = −6 somewhere; λ² − 6λ + 25 = 0 has no real λ, and that is not sought further."""
    one, K = np.eye(3), np.diag([1.0, -4.0, 25.0])
    undamped = Pencil(*(sp.csr_array(A) for A in (one, K)), symmetric=True)
    assert [may_grow(undamped, rate) for rate in (1.0, 3.9, 4.1)] == [True, True, False]
    damped = Pencil(undamped.M, undamped.K, sp.csr_array(np.diag([0.0, 0.0, -6.0])), symmetric=True)
    assert [may_grow(damped, rate) for rate in (1.0, 59.0, 61.0)] == [True, True, False]


def test_nothing_grows_without_mass():
    """A multiplier makes K indefinite, which lets nothing grow."""
    K = sp.block_diag([np.diag([1.0, 2.0, 3.0]), [[0.0]]]).tolil()
    K[0, 3] = K[3, 0] = 1.0
    M = sp.csr_array(np.diag([1.0, 1.0, 1.0, 0.0]))
    assert may_grow(Pencil(M, sp.csr_array(K)), 0.1) is False
    assert may_grow(Pencil(M, sp.csr_array(K), sp.csr_array(0.01 * M)), 0.1) is False


@pytest.mark.slow
@pytest.mark.parametrize(("ratio", "swings"), [(0.2, 1.3), (0.6, 0.9), (0.95, 1.55), (3.0, 0.8)])
def test_fast_growth_beside_a_crowd_of_overdamped_modes(ratio, swings):
    lam = swings * (ratio + 1j)
    light, over = np.linspace(0.05, 2, 150) ** 2, np.linspace(0.5, 3, 120)
    theta = -(lam**2)
    others = np.full(N - 272, 25.0)
    coupled = [[theta.real, theta.imag], [-theta.imag, theta.real]]
    K = la.block_diag(np.diag(np.concatenate([light, over, others])), coupled)
    c = [np.full(150, 0.005), np.linspace(3, 40, 120), np.full(len(others), 0.01), np.zeros(2)]
    pencil = Pencil(sp.eye_array(N, format="csr"), sp.csr_array(K), sp.diags_array(np.concatenate(c)).tocsr())
    modes = solve_modes(pencil, Request(max_frequency_hz=1.6 / (2 * np.pi)))
    np.testing.assert_allclose(growing(modes), [lam], rtol=1e-9)


@pytest.mark.parametrize("in_blocks", [0, N + 1])
@pytest.mark.parametrize("loss", [0.0, 0.01])
def test_modes_by_arpack_and_in_blocks_are_those_of_lapack(monkeypatch, loss, in_blocks):
    monkeypatch.setattr(shift_invert, "_IN_BLOCKS", in_blocks)
    pencil = chain(np.diag([0.04, 9.0]), loss=loss)
    modes = solve_modes(pencil, Request(count=30))
    assert ("block" in modes.method) == (in_blocks == 0)
    exact = 1j * np.sqrt(la.eigvals(pencil.K.toarray()).astype(complex))
    exact = exact[np.argsort(exact.imag)][:30]
    np.testing.assert_allclose(modes.lam.imag, exact.imag, rtol=1e-10)
    assert np.abs(modes.lam[:, None] - exact).min(axis=1).max() < 1e-9


def test_a_shift_that_is_an_eigenvalue_moves_in_blocks_too(monkeypatch):
    monkeypatch.setattr(shift_invert, "_IN_BLOCKS", 0)
    theta = np.arange(1.0, N + 1)
    theta[0] = -((BELOW * 16.0) ** 2)
    K = sp.csr_array(sp.diags_array(theta)) + sp.csr_array(([0.5], ([5], [9])), shape=(N, N))
    modes = solve_modes(Pencil(sp.eye_array(N, format="csr"), sp.csr_array(K)), Request(count=12), 16.0)
    np.testing.assert_allclose(growing(modes), [BELOW * 16.0], rtol=1e-9)
    np.testing.assert_allclose(modes.lam.imag[modes.lam.imag > 0][:10], np.sqrt(theta[1:11]), rtol=1e-9)


def test_a_body_of_which_a_rigid_motion_alone_is_asked_for():
    """With λ = 0 as the highest frequency, too, what grows without swinging is found."""
    n = N - 2
    k = np.r_[0.0, np.ones(n - 1), 0.0]
    free = sp.diags_array([k[:-1] + k[1:], -k[1:-1], -k[1:-1]], offsets=[0, 1, -1])
    K = sp.csr_array(sp.block_diag([free, np.array([[-600.0, 0.5], [0.0, 9.0]])]))
    modes = solve_modes(Pencil(sp.eye_array(N, format="csr"), K), Request(count=1))
    np.testing.assert_allclose(growing(modes), [np.sqrt(600)], rtol=1e-12)
    assert 0 in modes.lam


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("growth", [3.0, 1e3])
def test_a_negative_stiffness_or_damper_without_mass(growth, sign):
    """Of c u̇ + k u = 0 with k/c < 0, λ = −k/c grows; as an unknown without mass alone it would be a constraint."""
    pencil = chain(np.diag([sign * growth, 9.0]), np.diag([-float(sign), 0.002]))
    mass = sp.lil_array(pencil.M)
    mass[N - 2, N - 2] = 0.0
    pencil = Pencil(sp.csr_array(mass), pencil.K, pencil.C)
    assert may_grow(pencil, BAND)
    for request in REQUESTS:
        np.testing.assert_allclose(growing(solve_modes(pencil, request)), [growth], rtol=1e-9)


def test_springs_and_dampers_without_mass_are_no_growth():
    """Nor are two unknowns without mass that one damper and one spring join, whose matrices are singular."""
    n = N - 4
    both = np.array([[1.0, -1.0], [-1.0, 1.0]])
    k, c = (sp.block_diag([A, np.eye(2), both]) for A in (2.0 * sp.eye_array(n), 0.01 * sp.eye_array(n)))
    M = sp.diags_array(np.append(np.ones(n), np.zeros(4)))
    assert may_grow(Pencil(*(sp.csr_array(A) for A in (M, k, c))), 1.0) is False


@pytest.mark.parametrize("limit", [40.0, 100.0])
def test_flutter_between_the_last_mode_and_the_end_of_the_range(limit):
    """At (0.45 + 0.9i) times the limit, where the modes that swing end at 20 rad/s: discs on the axis miss it."""
    lam = (0.45 + 0.9j) * limit
    theta = -(lam**2)
    w = np.concatenate([[5.0, 10.0, 20.0], np.linspace(400, 4000, N - 5)])
    K = sp.block_diag([np.diag(w**2), [[theta.real, theta.imag], [-theta.imag, theta.real]]])
    pencil = Pencil(sp.eye_array(N, format="csr"), sp.csr_array(K), sp.csr_array(1e-3 * sp.eye_array(N)))
    modes = solve_modes(pencil, Request(max_frequency_hz=limit / (2 * np.pi)))
    np.testing.assert_allclose(growing(modes), [lam - 5e-4], rtol=1e-6)


def test_growth_that_is_not_looked_for_is_told():
    pencil = chain(np.diag([-1e14, 9.0]), 1e-3 * np.eye(2))
    modes = solve_modes(pencil, REQUESTS[0])
    assert not len(growing(modes)) and modes.unsearched.rate < 1e6


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("damping", [None, 0.002])
def test_friction_by_a_multiplier(sign, damping):
    """It holds u₁ = 0 by a force that acts on u₁ and on u₂, which leaves λ² + cλ + 1 − 50 = 0 of u₂."""
    block = np.array([[1e4, 50.0, sign], [50.0, 1.0, sign], [1.0, 0.0, 0.0]])
    held = np.diag([1.0, 1.0, 0.0])
    pencil = chain(block, None if damping is None else damping * held)
    pencil = Pencil(sp.csr_array(sp.diags_array(np.append(np.ones(N - 1), 0.0))), pencil.K, pencil.C)
    c = damping or 0.0
    for request in REQUESTS:
        found = growing(solve_modes(pencil, request))
        np.testing.assert_allclose(found, [np.sqrt(49 + c**2 / 4) - c / 2], rtol=1e-9)


def test_flutter_beside_losses_and_overdamped_modes_that_do_not_count():
    """The ten modes asked for swing far above the tenth one without dampers, and flutter that grows fast is between."""
    lam, crowd = 2.6 + 3.1j, 48
    theta = np.r_[np.arange(1.0, 401), np.linspace(1, 4, crowd)]
    flutter = np.array([[-(lam**2).real, -(lam**2).imag], [(lam**2).imag, -(lam**2).real]])
    K = sp.csr_array(sp.block_diag([np.diag(theta) * (1 + 0.01j), flutter]))
    C = sp.csr_array(sp.diags_array(np.r_[np.full(400, 0.02), np.full(crowd, 200.0), np.full(2, 0.02)]))
    modes = solve_modes(Pencil(sp.eye_array(crowd + 402, format="csr"), K, C), Request(count=10))
    np.testing.assert_allclose(modes.lam[modes.lam.real > 1], [-0.01 + np.sqrt(lam**2 + 0.01**2)], rtol=1e-9)
    assert "without" not in modes.method
