"""Matrices with their rows on all processes: each operation against that of SciPy's, their assembly, and sweeps.

Without mpiexec one process has all rows, and does every step with them; `make test-mpi` runs these on 1, 2 and 3.
"""

from __future__ import annotations

import copy
import gc
import pickle
import threading

import numpy as np
import pytest
import scipy.sparse as sp
from hard_problems import LINING, SMALL, brake
from mixed_cases import lining
from numpy.testing import assert_allclose
from selection import some

from fe_squeal import sweep
from fe_squeal.eigen.linear import column_parts, matrix_parts
from fe_squeal.eigen.linear.choice import choose
from fe_squeal.eigen.linear.half import inverse_root
from fe_squeal.eigen.linear.mumps import has_mumps
from fe_squeal.eigen.linear.spread_matrix import Part, Partition, SpreadMatrix, largest, sizes_times
from fe_squeal.eigen.pencil import _scale_of_entries, _times
from fe_squeal.fem import row_assembly
from fe_squeal.problem.terms import is_finite
from meshes import STEEL

N = 103
TIED = {"rigid": [{"name": "plate", "surface": "top_pad", "mass": 0.1, "inertia": [1e-4, 1e-4, 1e-4, 0.0, 0.0, 0.0]}]}
MIXED: dict = {
    "materials": {"steel": STEEL, "lining": lining(0.4995)},
    "bodies": {"belt": {"material": "steel"}, "pad": {"material": "lining", "formulation": "mixed"}},
}


@pytest.fixture
def spread(monkeypatch):
    """Bodies are assembled on all processes, however small."""
    monkeypatch.setattr(row_assembly, "are_spread", lambda n, processes: True)


def pair(seed=0, friction=True, second=-0.5):
    """A matrix, not symmetric if there is friction, and the same one with two symmetric summands on all processes."""
    rng = np.random.default_rng(seed)
    A, B = (sp.random_array((N, N), density=0.05, random_state=rng, format="csr") for _ in range(2))
    A, B = (sp.csr_array(X + X.T + 5 * sp.eye_array(N)) for X in (A, B))
    R = sp.csr_array((rng.standard_normal(9), rng.integers(0, N, (2, 9))), shape=(N, N)) if friction else None
    partition = Partition.by(rng.permutation(N))
    found = SpreadMatrix([(2.0, Part.of(partition, A)), (second, Part.of(partition, B))], R)
    whole = 2.0 * A + second * B
    return sp.csr_array(whole if R is None else whole + R), found


def same(spread, expected):
    assert isinstance(spread, SpreadMatrix)
    assert_allclose(spread.toarray(), expected.toarray(), atol=1e-14)


@pytest.mark.parametrize("most", [2**27, 3 * N])
@pytest.mark.parametrize("friction", [False, True])
@pytest.mark.parametrize("second", [-0.5, 1.5 - 0.7j, 0.3j])
def test_products_are_those_of_scipy(friction, most, second, monkeypatch):
    """In one piece, and in several where all at once is too much; with vectors and blocks, real and complex."""
    monkeypatch.setattr(column_parts, "_MOST", most)
    A, S = pair(friction=friction, second=second)
    X = np.random.default_rng(1).standard_normal((N, 4))
    before = SpreadMatrix.whole_count
    for x in (X, X[:, 0], X + 2j * X[::-1], (1j * X)[:, 1], X[:, :0], np.asfortranarray(X), X.astype(np.float32)):
        assert_allclose(S @ x, A @ x, atol=1e-12)
        assert_allclose(S.T @ x, A.T @ x, atol=1e-12)
        assert_allclose(x.T @ S, x.T @ A, atol=1e-12)
    assert_allclose(S.diagonal(), A.diagonal(), atol=1e-14)
    bound = sizes_times(S, np.abs(X))
    assert (bound >= (1 - 1e-12) * (abs(A) @ np.abs(X))).all()
    assert (bound <= 3 * (abs(A) @ np.abs(X)) + 10).all()
    assert SpreadMatrix.whole_count == before
    with pytest.raises(ValueError, match="do not belong together"):
        S @ X[:-1]


def test_sums_and_multiples_stay_on_all_processes():
    A, S = pair()
    B = S * 0.25 + S.T
    D = sp.diags_array(np.arange(float(N)))
    before = SpreadMatrix.whole_count
    results = [
        S * 3.0, 3.0 * S, -S, S / 4.0, S + B, S - B, S + D, D.tocsr() + S, S - D, D.tocsr() - S, S.T, S.conj(), S.real,
        np.float64(2.0) * S, (S + S.T) / 2,
    ]  # fmt: skip
    assert SpreadMatrix.whole_count == before
    other = A * 0.25 + A.T
    expected = [
        A * 3.0, 3.0 * A, -A, A / 4.0, A + other, A - other, A + D, D + A, A - D, D - A, A.T, A.conj(), A.real, 2.0 * A,
        (A + A.T) / 2,
    ]  # fmt: skip
    for found, right in zip(results, expected, strict=True):
        same(found, right)
    assert len((S - S).parts) == 2 and abs(S - S).max() == 0  # the same matrices, not four of them


@pytest.mark.parametrize("real", [0.0, 1.0])
def test_complex_sums_stay_on_all_processes(real):
    """Sums with factors and with matrices of this process, their parts, and what is made of these."""
    A, S = pair(second=2.0)
    D = sp.csr_array(sp.diags_array(np.arange(float(N))))
    before = SpreadMatrix.whole_count
    Z, T = real * S + S * (0.5 + 2j) - S.T / 3j + 1j * D, S + 0.0j * S
    found = [Z, Z.T, Z.conj(), Z.real, Z.imag, (Z.conj() + Z) / 2, -Z, T, S + 1j * D, D * 1j + S, S - 1j * S]
    assert SpreadMatrix.whole_count == before
    C = real * A + A * (0.5 + 2j) - A.T / 3j + 1j * D
    right = [
        C, C.T, C.conj(), C.real, C.imag, C.real.astype(complex), -C, A.astype(complex), A + 1j * D, D * 1j + A,
        A - 1j * A,
    ]  # fmt: skip
    for one, other in zip(found, right, strict=True):
        same(one, other)
        assert np.iscomplexobj(one) == np.iscomplexobj(other)
    assert S.imag.nnz == 0 and not np.iscomplexobj(Z.real) and not np.iscomplexobj(Z.imag)
    assert largest(Z) == pytest.approx(abs(C).max(), rel=1e-14)
    assert is_finite(Z) and not is_finite(Z + sp.csr_array(([1j * np.inf], ([2], [5])), shape=(N, N)))


@pytest.mark.parametrize("second", [-0.5, 1.0 + 0.5j])
def test_some_rows(second):
    A, S = pair(second=second)
    before = SpreadMatrix.whole_count
    wanted = np.array([N - 1, 0, 50, 51, 3])
    for rows in (wanted, np.zeros(0, int), np.arange(N), np.arange(N) % 3 == 0, slice(2, 60, 7), np.array([-1, 2, -N])):
        assert_allclose(S[rows].toarray(), A[rows].toarray(), atol=1e-14)
    with pytest.raises(IndexError):
        S[np.array([N])]
    assert SpreadMatrix.whole_count == before
    assert_allclose(S[wanted][:, wanted].toarray(), A[wanted][:, wanted].toarray(), atol=1e-14)
    assert S[3, 3] == pytest.approx(A[3, 3])


def test_everything_else_is_that_of_the_whole_matrix():
    """What SciPy does is right, though the matrix is brought to one process for it."""
    A, S = pair()
    X = sp.random_array((N, 3), density=0.3, random_state=np.random.default_rng(3), format="csr")
    D = sp.diags_array(np.arange(1.0, N + 1))
    before = SpreadMatrix.whole_count
    for found, right in (
        (abs(S), abs(A)), (sp.csr_array(S), A), (S.tocsc(), A.tocsc()), (S.astype(complex), A),
        (S @ X, A @ X), (X.T @ S, X.T @ A), (D @ S @ D, D @ A @ D),
        (S.multiply(S.T), A.multiply(A.T)),
        (sp.block_array([[S, None], [None, S]]), sp.block_array([[A, None], [None, A]])), (sp.triu(S), sp.triu(A)),
        (pickle.loads(pickle.dumps(S)), A), (sp.vstack([S, S]), sp.vstack([A, A])),
        (sp.csr_array(S * 1j), A * 1j), (sp.block_array([[S * 1j]]), sp.block_array([[A * 1j]])),
    ):  # fmt: skip
        assert not isinstance(found, SpreadMatrix)
        assert_allclose(found.toarray(), right.toarray(), atol=1e-13)
    assert SpreadMatrix.whole_count > before
    assert_allclose(S.sum(axis=1), A.sum(axis=1), atol=1e-13)
    assert S.max() == pytest.approx(A.max()) and S.sum() == pytest.approx(A.sum())
    assert sp.issparse(S) and S.shape == A.shape and S.dtype == A.dtype and S.format == "csr"


def test_nothing_that_is_written_is_lost():
    """What cannot be kept raises: there is no array that it could be written to."""
    A, S = pair()
    for array in (S.data, S.indices, S.indptr):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    with pytest.raises(TypeError, match="cannot be changed"):
        S[3, 3] = 1.0
    assert_allclose(S.toarray(), A.toarray(), atol=1e-14)
    copied = copy.deepcopy(S)
    assert_allclose(copied @ np.ones(N), S @ np.ones(N), atol=1e-13)
    del copied
    gc.collect()
    pair(3)
    assert_allclose(S @ np.ones(N), A @ np.ones(N), atol=1e-13)


@pytest.mark.parametrize("friction", [False, True])
def test_the_largest_entry(friction):
    """Where friction adds to what is on all processes, and elsewhere; and of a difference that is nothing."""
    A, S = pair(friction=friction)
    before = SpreadMatrix.whole_count
    assert largest(S) == pytest.approx(abs(A).max(), rel=1e-14) and largest(A) == abs(A).max()
    assert largest(S - S) == 0
    if friction:
        R = sp.csr_array(([1e9], ([2], [5])), shape=(N, N))
        assert largest(S + R) == pytest.approx(1e9 + A[2, 5])
    assert SpreadMatrix.whole_count == before


def test_a_number_that_is_not_finite_is_seen():
    """On the diagonal of what is on all processes, and anywhere in what is here."""
    _, S = pair()
    with np.errstate(invalid="ignore"):
        assert is_finite(S) and not is_finite(S * np.inf)
    assert not is_finite(S + sp.csr_array(([np.inf], ([2], [5])), shape=(N, N)))


@pytest.mark.parametrize("friction", [False, True])
@pytest.mark.parametrize("second", [-0.5, 1.0 + 0.5j])
def test_the_size_of_what_cancels(friction, second):
    """As that of a matrix of one process, where friction has entries at (i, j) alone, too."""
    A, S = pair(friction=friction, second=second)
    x = np.random.default_rng(4).uniform(size=(N, 3))
    A.sum_duplicates()
    assert_allclose(_times(_scale_of_entries(S), x), _times(_scale_of_entries(A), x), rtol=1e-12)


@pytest.mark.skipif(not has_mumps(), reason="no petsc4py with MUMPS; see make test-mpi")
@pytest.mark.parametrize("friction", [False, True])
@pytest.mark.parametrize("second", [-0.5, 1.0 + 0.5j])
def test_factors(friction, second):
    """Solves both ways, inertia, and the inverse root of a definite matrix, without the whole matrix here."""
    A, S = pair(friction=friction, second=second)
    before = SpreadMatrix.whole_count
    factor = choose("mumps").factorize(S, not friction)
    for b in (np.random.default_rng(5).standard_normal((N, 3)) * (1 + 2j), np.arange(float(N))):
        assert_allclose(A @ factor.solve(b), b, atol=1e-9)
        assert_allclose(A.T @ factor.solve_transposed(b), b, atol=1e-9)
        assert_allclose(A.conj().T @ factor.solve_adjoint(b), b, atol=1e-9)
    assert SpreadMatrix.whole_count == before
    if friction or np.iscomplexobj(A):
        return
    assert factor.negative_pivots == np.count_nonzero(np.linalg.eigvalsh(A.toarray()) < 0)
    shift = 1 - np.linalg.eigvalsh(A.toarray())[0]
    definite = choose("mumps").factorize_definite(S + shift * sp.eye_array(N))
    Z = definite.half_solve(np.eye(N))
    exact = np.linalg.inv((A + shift * sp.eye_array(N)).toarray())
    assert np.linalg.norm(Z @ Z.T - exact, 2) < 0.05 * np.linalg.norm(exact, 2)
    assert SpreadMatrix.whole_count == before


def test_a_bound_of_the_largest_eigenvalue_serves_the_inverse_root():
    """On one process too: Z Zᵀ = A⁻¹ of a chain whose eigenvalues are known."""
    K = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(60, 60)).tocsr()
    dense = np.linalg.inv(K.toarray())
    Z = inverse_root(K, lambda b: np.linalg.solve(K.toarray(), b), lambda A: lambda b: np.linalg.solve(A.toarray(), b))
    root = Z(np.eye(60))
    assert np.linalg.norm(root @ root.T - dense, 2) < 0.05 * np.linalg.norm(dense, 2)


def test_rows_are_forgotten_with_the_last_matrix():
    _, S = pair()
    handles = [part.handle for _, part in S.parts]
    twice = 2.0 * S
    del S
    gc.collect()
    pair(1)
    assert set(handles) <= set(matrix_parts._rows)
    del twice
    gc.collect()
    pair(2)
    assert not set(handles) & set(matrix_parts._rows)


@pytest.mark.parametrize("kind", some(["hex2", "hex1", "tet2", "tet1"], lambda kind: kind == "tet2"))
@pytest.mark.parametrize("more", [{}, TIED, MIXED], ids=["plain", "tied", "mixed"])
def test_bodies_are_those_of_one_process(kind, more, spread, request):
    """Element by element summed where the rows are; supports, a rigid part, and the bubbles of mixed elements."""
    order = {} if kind.endswith("2") else {"order": 1}
    more = dict(more)
    found = brake(kind=kind, **more, **order)
    request.getfixturevalue("monkeypatch").undo()
    expected = brake(kind=kind, **more, **order)
    count = 0
    for a, b in zip(found.terms, expected.terms, strict=True):
        assert a.name == b.name and a.symmetric == b.symmetric and a.powers == b.powers
        assert abs(a.matrix - b.matrix).max() <= 1e-14 * abs(b.matrix).max()
        if a.name.startswith(("mass.", "elastic.")):
            assert isinstance(a.matrix, SpreadMatrix) and not isinstance(b.matrix, SpreadMatrix)
            count += 1
    assert count >= 4


def test_other_threads_assemble_alone(spread):
    """The processes do one thing at a time: a mesh that is prepared beside a sweep belongs to this process."""
    found = []
    thread = threading.Thread(target=lambda: found.append(brake(((2, 1, 1), (1, 1, 1)))))
    thread.start()
    thread.join()
    assert not any(isinstance(t.matrix, SpreadMatrix) for t in found[0].terms)


@pytest.mark.slow
@pytest.mark.parametrize("swept", ["materials.lining.poisson_ratio", "materials.lining.youngs_modulus"])
def test_a_sweep_that_makes_matrices_anew(swept, spread, request):
    """The stiffness of one body at each value of a table; a modulus that multiplies."""
    values = {"materials.lining.poisson_ratio": [0.2, 0.3], "materials.lining.youngs_modulus": [4e9, 6e9]}[swept]
    solver, effects = "mumps" if has_mumps() else "auto", {"rayleigh": {"alpha": 1.0, "beta": 0.0}}
    how = {"parameter": swept, "modes": 6, "method": "reduced", "linear_solver": solver}
    found = sweep(brake(SMALL, effects=dict(effects)), values, **how)
    request.getfixturevalue("monkeypatch").undo()
    expected = sweep(brake(SMALL, effects=dict(effects)), values, **how)
    for a, b in zip(found.points, expected.points, strict=True):
        assert_allclose(a.modes.lam, b.modes.lam, rtol=0, atol=1e-8 * np.abs(b.modes.lam).max())


@pytest.mark.slow
def test_descriptions_of_modes_of_mixed_bodies(spread, request):
    """Shares of energy and motion along the normal, with bubbles in the mixed body."""
    how = {"modes": 6, "method": "reduced", "linear_solver": "mumps" if has_mumps() else "auto"}
    for more in ({}, MIXED):
        found = sweep(brake(kind="tet2", **more), [0.0, 0.4], **how).points[-1]
        request.getfixturevalue("monkeypatch").undo()
        expected = sweep(brake(kind="tet2", **more), [0.0, 0.4], **how).points[-1]
        assert found.description.keys() == expected.description.keys() and "out_of_plane" in found.description
        for name in ("out_of_plane",):
            assert_allclose(found.description[name], expected.description[name], atol=1e-6)
        request.getfixturevalue("monkeypatch").setattr(row_assembly, "are_spread", lambda n, processes: True)


@pytest.mark.parametrize("method", ["reduced", "direct"])
@pytest.mark.parametrize("effects", some(
    [{}, {"rayleigh": {"alpha": 30.0, "beta": 1e-8}}, {"structural_damping": {}}], lambda effects: not effects
), ids=["friction", "damped", "loss"])  # fmt: skip
def test_a_sweep_of_spread_matrices(effects, method, spread, request):
    """The same λ and onsets; a reduced sweep brings no whole matrix here."""
    solver = "mumps" if has_mumps() else "auto"
    values, how = [0.0, 0.4, 0.8], {"modes": 8, "method": method, "linear_solver": solver}
    materials = {"steel": STEEL, "lining": {**LINING, "loss_factor": 0.02}}
    before = SpreadMatrix.whole_count
    found = sweep(brake(effects=dict(effects), materials=materials), values, **how)
    if method == "reduced" and has_mumps():
        assert SpreadMatrix.whole_count == before
    request.getfixturevalue("monkeypatch").undo()
    expected = sweep(brake(effects=dict(effects), materials=materials), values, **how)
    for a, b in zip(found.points, expected.points, strict=True):
        assert_allclose(a.modes.lam, b.modes.lam, rtol=0, atol=1e-8 * np.abs(b.modes.lam).max())
    assert [o.kind for o in found.onsets] == [o.kind for o in expected.onsets]
    for a, b in zip(found.onsets, expected.onsets, strict=True):
        assert a.value == pytest.approx(b.value, rel=1e-7)
    assert found.completeness == expected.completeness and found.completeness.proven == (not effects)
