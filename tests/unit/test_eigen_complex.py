"""Pencils with a complex stiffness (structural damping) against NumPy and closed forms."""

from functools import cache

import numpy as np
import pencils
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from pencils import N, definite, distance, reference, sparse
from selection import some

from fe_squeal.eigen.dense import solve_dense
from fe_squeal.eigen.linear import choice
from fe_squeal.eigen.linear.choice import factorize
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import prove_completeness, solve_modes

# (friction, dashpots): every kind of complex pencil.
KINDS = [(0.0, 0.0), (0.9, 0.0), (0.0, 0.05), (0.9, 0.05)]


def random_pencil(friction=0.0, damping=0.0, n=30, eta=0.1, seed=4):
    """Full matrices with a loss of its own distribution and some nonsymmetry."""
    rng = np.random.default_rng(seed)
    K = definite(rng, n) + friction * np.triu(rng.standard_normal((n, n)), 1) / np.sqrt(n)
    C = sparse(damping * definite(rng, n)) if damping else None
    return Pencil(sparse(definite(rng, n)), sparse(K + 1j * eta * definite(rng, n)), C, symmetric=not friction)


def chain(friction=0.0, damping=0.0, n=N, eta=0.1):
    return pencils.chain(friction, damping, n, eta)


def left_errors(pencil, modes):
    """‖Q(λ)ᴴψ‖ relative to what cancels in it."""
    adjoint = pencil.transposed()
    residual = adjoint.apply(modes.lam.conj(), modes.left)
    return la.norm(residual, axis=0) / la.norm(adjoint.magnitude(modes.lam.conj(), modes.left), axis=0)


def check_biorthogonality(pencil, modes, tolerance):
    """ψ_iᴴ((λ_i + λ_j)M + C)φ_j, or ψᴴMφ without C: the identity, up to the conditions of the modes."""
    gram = modes.left.conj().T @ (pencil.M @ modes.right)
    if pencil.C is not None:
        gram = (modes.lam[:, None] + modes.lam) * gram + modes.left.conj().T @ (pencil.C @ modes.right)
    np.testing.assert_allclose(gram.diagonal(), 1, rtol=1e-8)
    size = la.norm(modes.left, axis=0)[:, None] * la.norm(pencil.M @ modes.right, axis=0)
    assert (np.abs(gram - np.diag(gram.diagonal())) < tolerance * size).all()


@pytest.fixture(params=["pardiso", "superlu"])
def solver(request, monkeypatch):
    if request.param == "superlu":
        monkeypatch.setattr(choice, "has_pardiso", lambda: False)
    else:
        request.getfixturevalue("needs_pardiso")
    return request.param


@pytest.mark.parametrize(("friction", "damping"), KINDS)
@pytest.mark.parametrize("seed", [4, 5, 6])
def test_dense_modes_agree_with_numpy(friction, damping, seed):
    pencil = random_pencil(friction, damping, seed=seed)
    assert pencil.problem_class == "complex"
    modes, expected = solve_dense(pencil), reference(pencil)
    assert len(modes) == len(expected)
    assert distance(modes.lam, expected) < 1e-10 and distance(expected, modes.lam) < 1e-10
    assert (modes.lam.imag > 0).all() and (np.diff(modes.lam.imag) >= 0).all()
    assert modes.backward_error.max() < 1e-13 and left_errors(pencil, modes).max() < 1e-13
    np.testing.assert_allclose(np.einsum("ij,ij->j", modes.right.conj(), pencil.M @ modes.right), 1, rtol=1e-12)
    check_biorthogonality(pencil, modes, 1e-9)
    ordinary = np.abs(modes.lam.real) < modes.lam.imag
    assert modes.re_uncertainty[ordinary].max() < 1e-9


@cache
def dense_modes(friction, damping):
    """Return all modes by LAPACK, whichever sparse solver there is."""
    return solve_dense(chain(friction, damping))


@pytest.mark.parametrize(
    ("solver", "friction", "damping"),
    some([(solver, *kind) for solver in ("pardiso", "superlu") for kind in KINDS],
         lambda solver, friction, damping: not damping),
    indirect=["solver"],
)  # fmt: skip
def test_sparse_modes_agree_with_dense_ones(solver, friction, damping):
    pencil = chain(friction, damping)
    modes, dense = solve_modes(pencil, Request(count=12)), dense_modes(friction, damping)
    assert modes.method != dense.method
    ordinary = [lam[np.abs(lam.real) < lam.imag][:12] for lam in (modes.lam, dense.lam)]
    assert len(ordinary[0]) == 12
    np.testing.assert_allclose(*ordinary, rtol=0, atol=1e-10)
    assert distance(modes.lam, dense.lam) < 1e-10
    assert modes.backward_error.max() < 1e-13 and left_errors(pencil, modes).max() < 1e-12
    check_biorthogonality(pencil, modes, 1e-9)
    assert prove_completeness(pencil, modes).expected is None


@pytest.mark.parametrize("solver", ["pardiso", pytest.param("superlu", marks=pytest.mark.slow)], indirect=True)
def test_all_modes_up_to_a_frequency(solver):
    """Also those whose damping takes them farther from the shift than lightly damped ones above the limit."""
    pencil, limit = chain(0.9, eta=0.6), 0.8
    expected = reference(pencil)
    modes = solve_modes(pencil, Request(max_frequency_hz=limit / (2 * np.pi)))
    assert len(modes) == (expected.imag <= limit).sum() > 30
    assert distance(expected[expected.imag <= limit], modes.lam) < 1e-10


@pytest.mark.parametrize("limit", some([4.0, 6.0], lambda limit: limit < 6))
def test_strongly_damped_modes_below_the_frequency_are_not_overlooked(limit):
    """λ = iω√(1 + 3i) lies 1.24 times as far from zero as its Im λ: outside of the lightly damped ones nearest zero."""
    theta, eta = np.linspace(1.0, 400.0, N), np.full(N, 0.001)
    eta[60] = 3.0
    theta[60] = (0.99 * limit) ** 2 / np.sqrt(1 + 3j).real ** 2
    lam = 1j * np.sqrt(theta * (1 + 1j * eta))
    for C in (None, sp.csr_array((N, N))):
        K = sp.csr_array(sp.diags_array(theta * (1 + 1j * eta)))
        pencil = Pencil(sp.eye_array(N, format="csr"), K, C, symmetric=True)
        modes = solve_modes(pencil, Request(max_frequency_hz=limit / (2 * np.pi)))
        assert len(modes) == (lam.imag <= limit).sum()
        assert distance(lam[lam.imag <= limit], modes.lam) < 1e-9


@pytest.mark.parametrize("eta", [1e-6, 0.02, 1.0])
@pytest.mark.parametrize("n", [50, N])
def test_proportional_damping_turns_the_undamped_modes(n, eta):
    """K(1 + iη): λ = iω√(1 + iη), so Re λ = −ω√((√(1 + η²) − 1)/2) = −ωη/2 to first order, and the modes stay."""
    undamped = chain(n=n, eta=0.0)
    K = sp.csr_array(undamped.K.real)
    omega = np.sqrt(la.eigvalsh(K.toarray(), undamped.M.toarray()))[:10]
    modes = solve_modes(Pencil(undamped.M, sp.csr_array(K * (1 + 1j * eta)), symmetric=True), Request(count=10))
    growth = -omega * eta / np.sqrt(2 * (np.hypot(1, eta) + 1))  # without the cancellation
    np.testing.assert_allclose(modes.lam.imag, omega * np.sqrt((np.hypot(1, eta) + 1) / 2), rtol=1e-8)
    np.testing.assert_allclose(modes.lam.real, growth, rtol=1e-6, atol=1e-11)
    assert (np.abs(modes.lam.real - growth) < modes.re_uncertainty + 1e-11).all()
    assert (modes.stability == "stable").all()


def test_every_mode_is_there_once_without_a_mirror():
    """Two springs coupled by friction flutter: with real K both λ and −λ*, with loss two modes of different growth."""
    K = np.array([[2.0, 0.5], [-0.5, 2.1]])
    M = sp.eye_array(2, format="csr")
    real = solve_dense(Pencil(M, sparse(K)))
    np.testing.assert_allclose(real.lam.real[0], -real.lam.real[1], rtol=1e-12)
    lossy = solve_dense(Pencil(M, sparse(K * (1 + 0.05j))))
    np.testing.assert_allclose(np.sort_complex(lossy.lam), np.sort_complex(real.lam * np.sqrt(1 + 0.05j)), rtol=1e-12)
    assert lossy.stability.tolist().count("unstable") == 1


@pytest.mark.parametrize("damping", [0.0, 1e-3])
@pytest.mark.parametrize("loss", [1e-9, -1e-9, 0.0])
def test_modes_without_oscillation_are_marginal(loss, damping):
    """θ = −4 ± 0i: the half plane alone decides the sign of Re λ = ±2. The mode at 3i keeps its own verdict."""
    K = np.diag([-4.0 + 1j * loss, 9.0 + 0.1j])
    C = sparse(damping * np.eye(2)) if damping else None
    modes = solve_dense(Pencil(sp.eye_array(2, format="csr"), sparse(K), C, symmetric=True))
    nearly_real = np.abs(modes.lam.real) >= np.abs(modes.lam.imag)
    np.testing.assert_allclose(np.abs(modes.lam[nearly_real]), 2, rtol=1e-3)
    assert nearly_real.any() and (modes.re_uncertainty >= np.abs(modes.lam))[nearly_real].all()
    assert (modes.stability[nearly_real] == "marginal").all()
    assert modes.stability[~nearly_real].tolist() == ["stable"]


@pytest.mark.parametrize("n", [40, N])
@pytest.mark.parametrize("damping", [0.0, 1e-2])
def test_a_rigid_mode_is_zero_and_marginal(n, damping):
    """A free chain with loss; dashpots between its masses leave it free."""
    k = np.ones(n - 1)
    K = sp.diags_array([np.r_[1.0, 2 * np.ones(n - 2), 1.0], -k, -k], offsets=[0, 1, -1]).tocsr()
    C = sp.csr_array(damping * K) if damping else None
    modes = solve_modes(Pencil(sp.eye_array(n, format="csr"), sp.csr_array(K * (1 + 0.1j)), C, True), Request(count=4))
    assert modes.lam[0] == 0 and modes.stability[0] == "marginal"
    theta = (2 * np.sin(np.arange(1, 4) * np.pi / (2 * n))) ** 2
    c = damping * theta
    expected = -c / 2 + 1j * np.sqrt(theta * (1 + 0.1j) - c**2 / 4)
    np.testing.assert_allclose(modes.lam[-3:], expected, rtol=1e-7)
    assert (modes.stability[-3:] == "stable").all()


@pytest.mark.parametrize("n", [39, 40, 41, 42, N, N + 1])
@pytest.mark.parametrize("place", [0, 7])
def test_a_rigid_motion_held_by_a_dashpot_is_kept(n, place):
    """One λ = 0, which rounding may put on either side of the real axis; the other rigid one is a real λ."""
    k = np.ones(n - 1)
    K = sp.diags_array([np.r_[1.0, 2 * np.ones(n - 2), 1.0], -k, -k], offsets=[0, 1, -1]).tocsr()
    C = sp.csr_array(([0.3], ([place], [place])), shape=(n, n))
    modes = solve_modes(Pencil(sp.eye_array(n, format="csr"), sp.csr_array(K * (1 + 0.1j)), C, True), Request(count=5))
    assert (np.abs(modes.lam) < 1e-7).sum() == 1


@pytest.mark.slow
def test_modes_outside_the_law_do_not_crowd_out_oscillating_ones():
    """60 overdamped oscillators of low λ beside lightly damped ones: the 10 lowest asked for are those that swing."""
    theta, c = np.arange(1.0, N + 1), np.full(N, 0.02)
    theta[-60:], c[-60:] = np.linspace(1.0, 4.0, 60), 200.0
    K = sp.csr_array(sp.diags_array(theta * (1 + 0.01j)))
    modes = solve_modes(
        Pencil(sp.eye_array(N, format="csr"), K, sp.csr_array(sp.diags_array(c)), symmetric=True), Request(count=10)
    )
    k = np.arange(1.0, 11) * (1 + 0.01j)
    np.testing.assert_allclose(modes.lam[modes.stability == "stable"], -0.01 + 1j * np.sqrt(k - 1e-4), rtol=1e-9)


@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("kind", ["real", "complex"])
def test_factors_solve_with_the_matrix_its_transpose_and_its_adjoint(solver, symmetric, kind):
    pencil = chain(friction=0.0 if symmetric else 0.9)
    K = pencil.K.real if kind == "real" else pencil.K + 0.2j * pencil.M
    A = sp.csr_array(K - 0.7 * pencil.M)
    factor = factorize(A, symmetric)
    assert kind == "real" or factor.negative_pivots is None
    rng = np.random.default_rng(2)
    real = rng.standard_normal((N, 3))
    for b in (real, real[:, 0], real + 1j * rng.standard_normal((N, 3)), (1 + 2j) * real[:, 0]):
        for x, matrix in (
            (factor.solve(b), A), (factor.solve_transposed(b), A.T), (factor.solve_adjoint(b), A.conj().T)
        ):  # fmt: skip
            assert x.shape == b.shape
            assert np.abs(matrix @ x - b).max() < 1e-12 * np.abs(x).max()
