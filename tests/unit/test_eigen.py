"""Modes of sparse pencils against LAPACK on the full matrices, for every class and linear solver."""

import functools

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from pencils import N, chain, distance, reference
from selection import some

from fe_squeal.eigen import memory, shift_invert
from fe_squeal.eigen.dense import DENSE_LIMIT, solve_dense
from fe_squeal.eigen.inertia import count_below
from fe_squeal.eigen.linear import choice
from fe_squeal.eigen.linear.choice import factorize, factorize_complex
from fe_squeal.eigen.pencil import Modes, Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import prove_completeness, solve_modes
from fe_squeal.errors import NotConvergedError, TooLargeError


@pytest.fixture(params=["pardiso", "superlu"])
def solver(request, monkeypatch):
    if request.param == "superlu":
        monkeypatch.setattr(choice, "has_pardiso", lambda: False)
    else:
        request.getfixturevalue("needs_pardiso")
    return request.param


@pytest.mark.parametrize(("friction", "damping", "name"), some([
    (0.0, 0.0, "symmetric"), (0.9, 0.0, "nonsymmetric"), (0.0, 0.2, "quadratic"), (0.9, 0.2, "quadratic"),
], lambda friction, damping, name: not (friction and damping)))  # fmt: skip
def test_lowest_modes_agree_with_lapack(solver, friction, damping, name):
    pencil = chain(friction=friction, damping=damping)
    assert pencil.problem_class == name
    modes = solve_modes(pencil, Request(count=12))
    expected = reference(pencil)
    # Condition numbers here are below 1e3 and the spectrum's radius is 3: 1e-10 leaves two digits.
    assert distance(modes.lam, expected) < 1e-10 and distance(expected[:12], modes.lam) < 1e-10
    assert modes.backward_error.max() < 1e-11
    assert (np.diff(modes.lam.imag) >= 0).all()


@pytest.mark.parametrize("damping", [0.0, 0.2])
def test_right_and_left_modes_are_biorthogonal_and_solve_their_equations(solver, damping):
    pencil = chain(friction=0.9, damping=damping)
    modes = solve_modes(pencil, Request(count=10))
    right = pencil.apply(modes.lam, modes.right)
    left = pencil.transposed().apply(modes.lam.conj(), modes.left)
    assert np.abs(right).max() < 1e-12 and np.abs(left).max() < 1e-11 * np.abs(modes.left).max()
    np.testing.assert_allclose(np.einsum("ij,ij->j", modes.right.conj(), pencil.M @ modes.right), 1, rtol=1e-12)
    weight = pencil.derivative(modes.lam, modes.right) if damping else pencil.M @ modes.right
    np.testing.assert_allclose(np.einsum("ij,ij->j", modes.left.conj(), weight), 1, rtol=1e-9)


def test_all_modes_up_to_a_frequency(solver):
    pencil = chain(friction=0.9)
    expected = reference(pencil)
    limit = 0.8
    modes = solve_modes(pencil, Request(max_frequency_hz=limit / (2 * np.pi)))
    assert len(modes) == (expected.imag <= limit).sum() > 30
    assert distance(expected[expected.imag <= limit], modes.lam) < 1e-10


def test_dense_and_sparse_paths_agree_on_a_damped_problem():
    pencil = chain(friction=0.7, damping=0.3)
    dense, sparse = solve_dense(pencil), solve_modes(pencil, Request(count=8))
    assert distance(sparse.lam, dense.lam) < 1e-10
    assert sparse.method != dense.method


def test_uncertainty_covers_the_error_and_is_not_idle():
    """Perturbing every entry by some roundings moves λ by less than the uncertainty, but by more than its 1e-4."""
    pencil = chain(friction=0.9)
    modes = solve_modes(pencil, Request(count=10))
    rng = np.random.default_rng(5)
    moved = []
    for _ in range(5):
        K = pencil.K.copy()
        K.data *= 1 + 4 * np.finfo(float).eps * rng.uniform(-1, 1, K.nnz)
        M = pencil.M.toarray()
        theta = la.eig(la.solve(M, K.toarray()))[0]
        lam = 1j * np.sqrt(theta.astype(complex))
        moved.append([np.abs(lam - x).min() for x in modes.lam])
    # LAPACK's own error on the full matrix (ε·radius²/2|λ|) is part of what moves.
    bound = modes.re_uncertainty + 20 * np.finfo(float).eps * 9 / (2 * np.abs(modes.lam))
    assert (np.max(moved, axis=0) < bound).all()
    assert modes.re_uncertainty.max() < 1e-10


def test_inertia_counts_the_modes_below_a_frequency(needs_pardiso):
    pencil = chain()
    omega = np.sqrt(la.eigvalsh(pencil.K.toarray(), pencil.M.toarray()))
    for limit in (0.01, 0.3, 1.0, 2.0):
        assert count_below(pencil, limit) == (omega < limit).sum()
    modes = solve_modes(pencil, Request(count=15))
    assert prove_completeness(pencil, modes).proven
    lost = modes.select(np.delete(np.arange(15), 4))
    result = prove_completeness(pencil, lost)
    assert (result.found, result.expected, result.proven) == (14, 15, False)


def test_a_missing_copy_of_the_highest_mode_is_counted(needs_pardiso):
    """With a highest frequency, above all that were found there is nothing else to part what is below from the rest."""
    theta = np.arange(1.0, N + 1)
    theta[18:20] = 19.5
    pencil = Pencil(sp.eye_array(N, format="csr"), sp.csr_array(np.diag(theta)), symmetric=True)
    limit = float(np.sqrt(20.3))
    modes = solve_modes(pencil, Request(max_frequency_hz=limit / (2 * np.pi)))
    assert prove_completeness(pencil, modes, limit=limit).proven and len(modes) == 20
    for found in (18, 19):
        result = prove_completeness(pencil, modes.select(np.arange(found)), limit=float(np.sqrt(19.7)))
        assert (result.found, result.expected, result.proven) == (found, 20, False)


@pytest.mark.parametrize("beside", [-1e-12, 0.0, 1e-12])
def test_rounding_does_not_decide_whether_a_mode_at_the_limit_is_counted(needs_pardiso, beside):
    """Its frequency came out above the highest one asked for, and the inertia may find it below."""
    pencil = Pencil(sp.eye_array(N, format="csr"), sp.csr_array(np.diag(np.arange(1.0, N + 1))), symmetric=True)
    limit = float(np.sqrt(20.0)) * (1 + beside)
    modes = solve_modes(pencil, Request(count=19))
    assert prove_completeness(pencil, modes, limit=limit).proven
    assert not prove_completeness(pencil, modes.select(np.arange(18)), limit=limit).proven


@pytest.mark.parametrize("mixed", [False, True])
def test_no_copy_of_a_multiple_eigenvalue_is_missing(solver, mixed):
    """θ = 1, 2, ..., each so many times: a Krylov space of one start vector has one copy, but for rounding."""
    n, copies, count = N, 40, 30
    theta = np.repeat(np.arange(1.0, n // copies + 2), copies)[:n]
    L = sp.csr_array(sp.eye_array(n) + (0.2 * sp.eye_array(n, k=1) if mixed else 0 * sp.eye_array(n)))
    pencil = Pencil(sp.csr_array(L.T @ L), sp.csr_array(L.T @ sp.diags_array(theta) @ L), symmetric=True)
    below = np.sqrt(theta[count] + 0.3)
    for request in (Request(count=count), Request(max_frequency_hz=below / (2 * np.pi))):
        modes = solve_modes(pencil, request)
        expected = theta[:count] if request.count else theta[theta < below**2]
        np.testing.assert_allclose(modes.lam.imag**2, expected, rtol=1e-10)
        gram = modes.right.T @ (pencil.M @ modes.right)
        assert np.abs(gram - np.eye(len(modes))).max() < 1e-9


@pytest.mark.parametrize(
    ("friction", "request_"),
    [
        (0.0, Request(count=5000)),
        pytest.param(0.0, Request(max_frequency_hz=1e3), marks=pytest.mark.slow),
        pytest.param(0.9, Request(count=5000), marks=pytest.mark.slow),
    ],
)
def test_more_modes_than_there_are(friction, request_):
    """All are returned, of so many unknowns too that some of them would come from a Krylov space."""
    pencil = chain(friction=friction, n=2 * DENSE_LIMIT + 10)
    expected = la.eigvals(la.solve(pencil.M.toarray(), pencil.K.toarray()))
    modes = solve_modes(pencil, request_)
    assert len(modes) == pencil.n and distance(expected, -(modes.lam**2)) < 1e-10


def test_modes_that_do_not_fit_into_memory_are_refused(monkeypatch):
    """As many modes as unknowns take full matrices, whose size is told."""
    pencil = chain(n=2 * DENSE_LIMIT + 10)
    monkeypatch.setattr(memory, "available_memory", lambda: 2**24)
    with pytest.raises(TooLargeError, match="MiB are free; ask for fewer modes"):
        solve_modes(pencil, Request(count=pencil.n))


def test_rigid_modes_are_zero_and_marginal():
    """A free chain has one rigid mode; the next are those of a free rod, ω_j = 2√(k/m) sin(jπ/2n)."""
    n = N
    k = np.ones(n - 1)
    diagonal = np.r_[1.0, 2 * np.ones(n - 2), 1.0]
    K = sp.diags_array([diagonal, -k, -k], offsets=[0, 1, -1]).tocsr()
    modes = solve_modes(Pencil(sp.eye_array(n, format="csr"), K, symmetric=True), Request(count=4))
    assert modes.lam[0] == 0 and modes.stability[0] == "marginal"
    np.testing.assert_allclose(modes.lam.imag[1:], 2 * np.sin(np.arange(1, 4) * np.pi / (2 * n)), rtol=1e-9)


def test_divergence_gives_two_real_eigenvalues():
    """K = diag(−4, 9), M = I: λ = ±2 and 3i."""
    pencil = Pencil(sp.eye_array(2, format="csr"), sp.csr_array(np.diag([-4.0, 9.0])), symmetric=True)
    modes = solve_modes(pencil, Request(count=3))
    np.testing.assert_allclose(modes.lam, [2, -2, 3j], atol=1e-12)
    assert modes.stability.tolist() == ["unstable", "stable", "marginal"]


def test_factors_solve_both_ways(solver):
    A = sp.csr_array(chain(friction=0.9).K - 0.7 * chain().M)
    b = np.random.default_rng(2).standard_normal((N, 3)) * (1 + 2j)
    factor = factorize(A, symmetric=False)
    for x, matrix in ((factor.solve(b), A), (factor.solve_transposed(b), A.T)):
        assert np.abs(matrix @ x - b).max() < 1e-11 * np.abs(x).max()
    Z = sp.csr_array(A + 0.3j * chain().M)
    solve, adjoint = factorize_complex(Z)
    assert np.abs(Z @ solve(b[:, 0]) - b[:, 0]).max() < 1e-10
    assert np.abs(Z.conj().T @ adjoint(b[:, 0]) - b[:, 0]).max() < 1e-10


def test_a_tolerance_that_cannot_be_met_is_reported_with_the_modes():
    with pytest.raises(NotConvergedError, match="tolerance") as caught:
        solve_modes(chain(), Request(count=5, tolerance=1e-30))
    assert len(caught.value.partial) == 5


@pytest.mark.parametrize(("friction", "blocks"), [(0.0, False), (0.9, False), (0.9, True)])
def test_modes_that_a_failed_search_has_found_are_handed_on(monkeypatch, friction, blocks):
    """ARPACK, and blocks, without restarts: some of 16 modes have converged."""
    pencil, number = chain(friction=friction), 12
    if blocks:
        monkeypatch.setattr(shift_invert, "_IN_BLOCKS", 0)
        monkeypatch.setattr(shift_invert, "_RESTARTS", 0)
    for name in ("eigs", "eigsh"):
        once = functools.partial(getattr(shift_invert, name), maxiter=1)
        monkeypatch.setattr(shift_invert, name, once)
    with pytest.raises(NotConvergedError, match="modes converged") as caught:
        solve_modes(pencil, Request(count=number))
    found = caught.value.partial
    assert isinstance(found, Modes) and number <= len(found) < number + 4 and found.left is None
    assert (np.diff(found.lam.imag) >= 0).all() and found.backward_error.max() < 1e-10
    assert distance(found.lam, reference(pencil)) < 1e-8
    np.testing.assert_allclose(np.einsum("ij,ij->j", found.right.conj(), pencil.M @ found.right), 1, rtol=1e-12)


def test_a_search_that_has_found_nothing_hands_on_nothing():
    """Without any mass there are no modes."""
    with pytest.raises(NotConvergedError) as caught:
        solve_modes(Pencil(sp.csr_array((N, N)), chain().K, symmetric=True), Request(count=3))
    assert caught.value.partial is None
