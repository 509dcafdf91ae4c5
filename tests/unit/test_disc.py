"""Eigenvalues in a disc around a shift, against known spectra and LAPACK."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal.eigen import disc
from fe_squeal.eigen.both_sides import pairs_within
from fe_squeal.eigen.disc import BLOCK, largest_within, room_for
from fe_squeal.eigen.known_band import enough_steps
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.shift_invert import ShiftInverted

N = 600


class Counted:
    """The operator z ↦ A⁻¹z of a diagonal A, which counts the columns that it was given."""

    def __init__(self, lam):
        self.lam, self.columns = lam, 0

    def __call__(self, z):
        self.columns += z.shape[1]
        return z / self.lam[:, None]


def sorted_values(nu):
    return np.sort_complex(np.round(1 / nu, 9))


def test_multiple_eigenvalues_are_found_as_often_as_they_are_there():
    """A Krylov space of one vector has a multiple eigenvalue once; blocks of four have it up to four times."""
    inside = np.array([1.0, 2.0, 2.0, 2.0, 2.0, 2.5j, -2.7, -2.7])
    lam = np.concatenate([inside, np.linspace(5.0, 9.0, N - len(inside))])
    nu, z, known = largest_within(Counted(lam), N, 3.0, 20)
    assert known == 3.0
    np.testing.assert_array_equal(sorted_values(nu), np.sort_complex(np.round(inside, 9)))
    residual = z / lam[:, None] - z * nu
    assert np.abs(residual).max() < 1e-12 * np.abs(z).max()
    assert np.linalg.matrix_rank(z) == len(inside)


@pytest.mark.parametrize("width", [1e-2, 1e-6, 0.0])
def test_a_crowd_at_the_rim_does_not_have_to_converge(width):
    """Hundreds of overdamped eigenvalues near zero, as a shift on the imaginary axis sees them: at one distance."""
    inside = np.linspace(0.1, 0.95, 15) * np.exp(1j * np.arange(15))
    crowd = 1.0 + width * np.linspace(0, 1, N - 15)
    operator = Counted(np.concatenate([inside, crowd]))
    nu, _, known = largest_within(operator, N, 0.97, 30)
    assert known == 0.97
    np.testing.assert_allclose(np.sort(np.abs(1 / nu)), np.sort(np.abs(inside)), rtol=1e-10)
    assert operator.columns <= room_for(30) + 4  # without a single restart


@pytest.mark.parametrize("draw", [0, 23, 129, 197, 226])
def test_a_space_that_hardly_goes_on(draw):
    """16 distinct eigenvalues: a Krylov space ends, and of its last products rounding is a part or all."""
    lam = np.concatenate([np.linspace(0.1, 0.95, 15) * np.exp(1j * np.arange(15)), np.ones(N - 15)])
    nu, _, known = largest_within(Counted(lam), N, 0.97, 30, draw=draw)
    assert known == 0.97
    np.testing.assert_allclose(np.sort(np.abs(1 / nu)), np.sort(np.abs(lam[:15])), rtol=1e-10)


def test_more_eigenvalues_than_asked_for_shrink_the_disc():
    lam = np.linspace(1.0, 10.0, N)
    nu, _, known = largest_within(Counted(lam), N, 5.0, 12)
    assert len(nu) == 12 and lam[11] < known < lam[12]
    np.testing.assert_allclose(np.sort(1 / nu.real), lam[:12], rtol=1e-10)


def test_a_full_space_is_cut_back():
    """Distances that hardly differ need more vectors than there is room for."""
    lam = np.concatenate([np.linspace(1.0, 1.1, 30), np.linspace(1.1003, 3.0, 3 * N)])
    operator = Counted(lam)
    nu, _, known = largest_within(operator, len(lam), 1.10015, 40)
    assert operator.columns > room_for(40)
    assert known == 1.10015
    np.testing.assert_allclose(np.sort(1 / nu.real), lam[:30], rtol=1e-9)


@pytest.mark.parametrize("real", [True, False])
def test_nonnormal_operators_against_lapack(real):
    """A random triangular part makes vectors nearly parallel; eigenvalues are those of LAPACK, real ones in pairs."""
    rng = np.random.default_rng(7)
    A = np.triu(rng.standard_normal((N, N)), 1) / np.sqrt(N)
    if real:
        for i in range(0, N, 2):
            a, b = 2 * rng.random(2) + 0.01 * i
            A[i : i + 2, i : i + 2] = [[a, b], [-b, a]]
    else:
        A = A + np.diag(0.01 * np.arange(N) + rng.random(N) + 1j * rng.random(N))
    exact = np.linalg.eigvals(A)
    inverse = np.linalg.inv(A)
    radius = float(np.mean(np.sort(np.abs(exact))[[20, 22]]))
    nu, z, known = largest_within(lambda x: inverse @ x, N, radius, 40)
    assert known == radius
    exact = exact[np.abs(exact) < radius]
    assert len(nu) == len(exact) > 10
    assert np.abs(1 / nu[:, None] - exact[None, :]).min(axis=0).max() < 1e-8  # condition numbers are up to 1e5
    assert np.linalg.norm(inverse @ z - z * nu, axis=0).max() < 1e-11 * np.abs(nu).max()
    if real:
        np.testing.assert_array_equal(np.sort_complex(nu), np.sort_complex(nu.conj()))


def test_an_empty_disc_takes_few_vectors():
    operator = Counted(np.linspace(4.0, 9.0, N))
    nu, z, known = largest_within(operator, N, 3.0, 40)
    assert known == 3.0 and z.shape == (N, 0) and not len(nu)
    assert operator.columns < 60


@pytest.mark.parametrize(("growth", "draws"), [(0.205, [87, 113]), (1.795, range(20))])
def test_what_grows_shows_beside_a_crowd_that_does_not(growth, draws):
    """A real λ at the rim of a disc around 1, and states of pairs that swing slowly: they are not much farther away.
    From the draws 87 and 113, two of 200, as many vectors as an empty disc takes do not show it."""
    square = np.linspace(1e-3, 0.2, 449)[:, None] ** 2  # u̇ = v, v̇ = −ω²u

    def apply(z):
        own, (u, v) = z[:2] / np.array([[growth - 1.0], [-1.0]]), z[2:].reshape(2, 449, -1)
        return np.vstack([own, (-u - v) / (1 + square), (square * u - v) / (1 + square)])

    for draw in draws:
        least = BLOCK * enough_steps(450, 0.8)
        nu, _, known = largest_within(apply, 900, 0.8, 40, 0, draw, least=least)
        np.testing.assert_allclose(1 + 1 / nu, [growth], rtol=1e-9)
        assert known == 0.8


def test_a_left_mode_that_the_start_hardly_has():
    """Of a left mode the random start has as much as lies along the right one; nearly nothing, and it shows late."""
    n = 700
    rng = np.random.default_rng(8)
    theta = np.append(1.0, rng.uniform(1.25, 3.0, n - 1))
    start = np.random.default_rng(disc._SEED).standard_normal((n, BLOCK))
    first = rng.standard_normal(n)
    first -= (1 - 1e-5) * start @ np.linalg.lstsq(start, first, rcond=None)[0]
    right = np.eye(n)
    right[:, 0] = first / np.linalg.norm(first)
    pencil = Pencil(sp.eye_array(n, format="csr"), sp.csr_array(right * theta @ np.linalg.inv(right)))
    operator = ShiftInverted(pencil, 0.0)
    assert len(operator.within(1.1, 40)[0]) == 1
    assert not len(operator.within(1.1, 40, adjoint=True)[0])
    lam, x, y, known = pairs_within(operator, 1.1, 40, 12, needed=lambda v: v.real > 0)
    np.testing.assert_allclose(lam, 1.0, rtol=1e-10)
    assert known == 1.1
    for vector, A in (x, pencil.K), (y, pencil.K.T):
        assert np.linalg.norm(A @ vector - vector) < 1e-9 * np.linalg.norm(vector)
