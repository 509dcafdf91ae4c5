"""MUMPS through petsc4py: factors, inertia, definite matrices, a sweep; `make test-mpi` has petsc4py."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import psutil
import pytest
import scipy.sparse as sp
from chains import chain
from scene_texts import replaced

from fe_squeal import assemble, parse_scene, sweep
from fe_squeal.eigen.linear import column_parts, mumps
from fe_squeal.eigen.linear.choice import choose, factorize_definite
from fe_squeal.eigen.linear.factor import SingularError
from fe_squeal.eigen.linear.mumps import MumpsDefinite, MumpsFactor, has_mumps, told_of
from fe_squeal.eigen.linear.petsc import MumpsOptions
from fe_squeal.errors import NotConvergedError, TooLargeError

pytestmark = pytest.mark.skipif(not has_mumps(), reason="no petsc4py with MUMPS; see make test-mpi")
N = 400


def matrix(symmetric, imaginary=False, seed=1):
    rng = np.random.default_rng(seed)
    A = sp.random_array((N, N), density=0.01, random_state=rng)
    if imaginary:
        A = A + 1j * sp.random_array((N, N), density=0.01, random_state=rng)
    A = A + A.T if symmetric else A
    return sp.csr_array(A + sp.diags_array(rng.uniform(-1, 1, N)))


@pytest.mark.parametrize("imaginary", [False, True])
@pytest.mark.parametrize("symmetric", [False, True])
def test_solves_in_all_three_ways(symmetric, imaginary):
    """Residuals of A, Aᵀ and Aᴴ, for one right-hand side and a block, real and complex; A itself stays as it is."""
    A = matrix(symmetric, imaginary)
    before = A.copy()
    factor = MumpsFactor(A, symmetric)
    rng = np.random.default_rng(2)
    for b in (rng.standard_normal(N), rng.standard_normal((N, 5)), rng.standard_normal((N, 3)) * (1 + 2j)):
        for apply, way in ((factor.solve, A), (factor.solve_transposed, A.T), (factor.solve_adjoint, A.conj().T)):
            x = apply(b)
            assert x.shape == b.shape
            np.testing.assert_allclose(way @ x, b, atol=1e-9 * np.abs(b).max())
    if not symmetric:  # what would not be told apart by a symmetric matrix
        assert np.abs(factor.solve(b) - factor.solve_transposed(b)).max() > 1e-3
    assert abs(A - before).max() == 0


@pytest.mark.parametrize("failures", [1, 2, 3])
def test_more_workspace_is_given_where_pivoting_takes_more(failures, monkeypatch):
    """As MUMPS asks for with its error −9; not more than three times, and not where the scene says how much."""
    A, asked, factorized = matrix(True), [], mumps._factorized

    def short(*given, analyse_only):
        asked.append(given[-1].memory_relaxation)
        told = factorized(*given, analyse_only=analyse_only)
        return replace(told, error=-9) if len(asked) <= failures else told

    monkeypatch.setattr(mumps, "_factorized", short)
    if failures < 3:
        factor = MumpsFactor(A, True)
        np.testing.assert_allclose(A @ factor.solve(np.ones(N)), 1.0, atol=1e-9)
        assert asked == [None, 50, 200][: failures + 1]
        return
    with pytest.raises(TooLargeError, match="MUMPS: the factors of 400 unknowns need about"):
        MumpsFactor(A, True)
    assert asked == [None, 50, 200]
    asked.clear()
    with pytest.raises(TooLargeError):
        MumpsFactor(A, True, options=MumpsOptions(memory_relaxation=30))
    assert asked == [30]


@pytest.mark.parametrize("imaginary", [False, True])
def test_many_right_hand_sides_are_solved_in_pieces(imaginary, monkeypatch):
    """MPI counts to 2³¹ − 1 numbers."""
    A = matrix(False, imaginary)
    factor = MumpsFactor(A, False)
    b = np.random.default_rng(2).standard_normal((N, 7))
    x, sent = factor.solve(b), []
    monkeypatch.setattr(column_parts, "_MOST", 5 * N - 1)
    step = mumps.together
    monkeypatch.setattr(mumps, "together", lambda *a, **what: sent.append(a[1].size) or step(*a, **what))
    np.testing.assert_allclose(factor.solve(b), x, rtol=0, atol=1e-7 * np.abs(x).max())
    assert len(sent) > 1 and max(sent) < 5 * N


@pytest.mark.parametrize("seed", range(3))
def test_inertia_is_the_number_of_negative_eigenvalues(seed):
    A = matrix(True, seed=seed)
    assert MumpsFactor(A, True).negative_pivots == np.count_nonzero(np.linalg.eigvalsh(A.toarray()) < 0)
    assert MumpsFactor(A, False).negative_pivots is None


@pytest.mark.parametrize("symmetric", [False, True])
def test_a_singular_matrix_is_told(symmetric):
    K = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(N, N)).tolil()
    K[0, 0] = K[-1, -1] = 1.0  # a chain that nothing holds
    with pytest.raises(SingularError, match="singular"):
        MumpsFactor(sp.csr_array(K), symmetric)


def test_several_matrices_live_beside_each_other():
    """Also while others are given up in between."""
    matrices = [matrix(False, seed=s) for s in range(4)]
    factors = [MumpsFactor(A, False) for A in matrices]
    del factors[1], matrices[1]
    b = np.random.default_rng(0).standard_normal(N)
    for A, factor in zip(matrices, factors, strict=True):
        np.testing.assert_allclose(A @ factor.solve(b), b, atol=1e-9)


def test_factors_that_are_given_up_take_no_memory():
    """Of twenty matrices of 8 000 unknowns one after the other, with 10 MB of factors each, no more than two stay."""
    T = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(20, 20))
    one = sp.eye_array(20)
    A = sp.csr_array(sp.kron(sp.kron(T, one), one) + sp.kron(sp.kron(one, T), one) + sp.kron(sp.kron(one, one), T))
    own, b = psutil.Process(), np.ones(8000)

    def taken(count):
        for _ in range(count):
            MumpsFactor(A, False).solve(b)
        return own.memory_info().rss

    before = taken(3)
    assert taken(20) - before < 60e6


def test_half_solves_have_the_inverse_as_covariance():
    """ZᵀAZ = 1 to the 2 % that samples need, for units that differ by 10⁶; what is not definite is refused."""
    rng = np.random.default_rng(3)
    d = sp.diags_array(10 ** rng.uniform(-3, 3, N))
    A = matrix(False)
    A = sp.csr_array(d @ (A @ A.T + 1e-3 * sp.eye_array(N)) @ d)
    factor = factorize_definite(A, "mumps")
    assert isinstance(factor, MumpsDefinite)
    Z = factor.half_solve(np.eye(N))
    np.testing.assert_allclose(Z.T @ (A @ Z), np.eye(N), atol=0.02)
    with pytest.raises(NotConvergedError, match="not positive definite"):
        factorize_definite(sp.csr_array(sp.diags_array([1.0, 0.5, 1.0], offsets=[-1, 0, 1], shape=(N, N))), "mumps")


def test_what_cannot_fit_is_refused_beforehand(monkeypatch):
    from fe_squeal.eigen import memory
    from fe_squeal.eigen.linear import mumps

    monkeypatch.setattr(mumps, "_FORECAST", 100)
    monkeypatch.setattr(memory, "available_memory", lambda: 10)
    with pytest.raises(TooLargeError, match="need"):
        MumpsFactor(matrix(False), False)


def test_memory_is_that_of_the_factors():
    """MUMPS tells whole megabytes: of a cube of 20³ nodes the factors have 4 to 40 MB."""
    T = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(20, 20))
    one = sp.eye_array(20)
    A = sp.csr_array(sp.kron(sp.kron(T, one), one) + sp.kron(sp.kron(one, T), one) + sp.kron(sp.kron(one, one), T))
    told = choose("mumps").memory(A, True)
    assert 4e6 <= told <= 80e6 and choose("mumps").memory(A, False) >= told


def test_analysis_tells_files_and_operations():
    """Operations of LDLᵀ are half of LU's, and at least two for each entry of its factors."""
    A = matrix(True)
    A = sp.csr_array(sp.kron(A, np.ones((3, 3))) + 1e-3 * sp.eye_array(3 * N))
    half, whole = (told_of(A, symmetric, False) for symmetric in (True, False))
    assert half.operations == pytest.approx(whole.operations / 2, rel=0.2)
    assert half.operations > 2 * half.files / 8 > 2 * A.nnz / 2
    assert half.largest <= half.total


@pytest.mark.parametrize("method", ["direct", "reduced"])
@pytest.mark.parametrize("effects", [(), ("damper", "slip damping"), ("loss",)], ids=["undamped", "damped", "complex"])
def test_a_sweep_is_that_of_another_solver(effects, method):
    values = np.linspace(0.0, 0.9, 4)
    expected = sweep(chain(*effects, n=450), values, modes=8, method=method, linear_solver="superlu")
    found = sweep(chain(*effects, n=450), values, modes=8, method=method, linear_solver="mumps")
    for a, b in zip(found.points, expected.points, strict=True):
        np.testing.assert_allclose(a.modes.lam, b.modes.lam, rtol=0, atol=1e-8 * np.abs(b.modes.lam).max())
    assert [o.kind for o in found.onsets] == [o.kind for o in expected.onsets]
    for a, b in zip(found.onsets, expected.onsets, strict=True):
        assert a.value == pytest.approx(b.value, rel=1e-8)
    if not effects:
        assert found.onsets


def test_a_scene_asks_for_it():
    text = replaced("modes = 8", 'modes = 8\nlinear_solver = "mumps"', replaced('file = "block.msh"\n', ""))
    found = sweep(assemble(parse_scene(tomllib.loads(text))), [0.0, 0.3], modes=4, linear_solver="mumps")
    assert choose("mumps").name.startswith("MUMPS (PETSc)") and len(found.points) == 2
