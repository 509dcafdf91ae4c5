"""What corrections add to a basis, and what is kept of it: against projections made directly."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from chains import CLASSES, MODES, chain
from selection import some

from fe_squeal.eigen.linear import choice
from fe_squeal.eigen.request import Request
from fe_squeal.problem.terms import Term
from fe_squeal.reduced import ReducedModel, mode_corrections
from fe_squeal.reduced.vectors import thin_svd

VALUES = np.linspace(0.0, 0.9, 7)


@pytest.fixture(scope="module")
def model():
    return ReducedModel(chain("damper", "slip damping"), "mu", VALUES, Request(count=MODES))


def inside(basis, X):
    """Coordinates (r, k) of the part of X inside a basis, and the lengths (k,) of the rest, all in the P-norm."""
    P = sum(c * t.matrix for c, t in zip(basis.metric, basis.problem.terms, strict=True))
    y = basis.V.T @ (P @ X)
    rest = X - basis.V @ y
    return y, np.sqrt(np.einsum("ij,ij->j", rest, P @ rest)), np.sqrt(np.einsum("ij,ij->j", X, P @ X))


def terms_are_projected(basis):
    for term, A in zip(basis.problem.terms, basis._projected, strict=True):
        exact = basis.V.T @ (term.matrix @ basis.V)
        # The rounding of a sum of n products is at most n ε of their sizes.
        size = np.abs(basis.V).T @ (abs(term.matrix) @ np.abs(basis.V))
        assert np.abs(A - exact).max() <= len(basis.V) * np.finfo(float).eps * size.max()


def test_coordinates_span_what_was_added(model):
    """Columns outside the basis, inside it, nearly inside it, and twice the same one."""
    basis, rng = model.basis.copy(), np.random.default_rng(7)
    outside = rng.standard_normal((len(basis.V), 3))
    within = basis.V @ rng.standard_normal((len(basis), 2))
    nearly = basis.V @ rng.standard_normal((len(basis), 1)) + 1e-3 * rng.standard_normal((len(basis.V), 1))
    X = np.hstack([outside, within, nearly, outside[:, :1]])
    before = len(basis)
    coordinates = basis.extend(X)
    assert len(basis) == before + 4 and coordinates.shape[0] == len(basis)
    y, rest, length = inside(basis, X)
    assert (rest <= 1e-9 * length).all()
    span = la.orth(coordinates)
    missed = y - span @ (span.T @ y)
    assert (np.linalg.norm(missed, axis=0) <= 1e-8 * np.linalg.norm(y, axis=0)).all()
    terms_are_projected(basis)


def test_short_parts_are_left_out_of_the_basis_alone(model):
    """Their parts inside the basis count among what was spanned."""
    basis, rng = model.basis.copy(), np.random.default_rng(8)
    own = basis.V @ rng.standard_normal((len(basis), 2))
    before = len(basis)
    coordinates = basis.extend(own + 1e-6 * rng.standard_normal(own.shape), threshold=1.0)
    assert len(basis) == before
    y = inside(basis, own)[0]
    span = la.orth(coordinates)
    assert np.linalg.norm(y - span @ (span.T @ y)) <= 1e-4 * np.linalg.norm(y)


def test_a_narrowed_basis_is_that_of_its_vectors(model):
    """Same modes, errors and projections as of a basis to which the kept directions were added by themselves."""
    wide, rng = model.basis.copy(), np.random.default_rng(9)
    count = len(wide)
    wide.extend(rng.standard_normal((len(wide.V), 6)))
    U = la.orth(rng.standard_normal((6, 2)))
    kept = wide.V[:, count:] @ U
    plain = model.basis.copy()
    narrow = wide.narrowed(count, U)
    assert len(narrow) == count + 2
    np.testing.assert_allclose(narrow.V[:, count:], kept, atol=1e-12)
    np.testing.assert_array_equal(narrow.V[:, :count], model.basis.V)
    terms_are_projected(narrow)
    plain.append(kept)
    a, b = (x.modes(0.5, model.highest) for x in (narrow, plain))
    np.testing.assert_allclose(a.lam, b.lam, rtol=1e-9)
    for x, y in zip(narrow.errors(0.5, a, model.highest), plain.errors(0.5, b, model.highest), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-4, atol=1e-12)


def test_modes_without_lifted_vectors(model):
    W = la.orth(np.random.default_rng(10).standard_normal((len(model.basis), len(model.basis) - 3)))
    lifted, bare = (model.basis.restricted(W, whether) for whether in (True, False))
    assert lifted.V.shape == (len(model.basis.V), W.shape[1]) and bare.V.shape == (0, W.shape[1])
    a, b = (x.modes(0.5, model.highest) for x in (lifted, bare))
    np.testing.assert_array_equal(a.lam, b.lam)
    for x, y in zip(lifted.errors(0.5, a, model.highest), bare.errors(0.5, b, model.highest), strict=True):
        np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize("kind", some(["quadratic", "gyroscopic", "complex with C"], lambda kind: kind == "quadratic"))
def test_factors_serve_more_than_one_value(kind, monkeypatch):
    """Fewer matrices are factorised than values whose modes are added, and every estimate meets the tolerance."""
    own = []  # values whose modes are added
    add = ReducedModel._add_modes

    def noted(self, value):
        own.append(value)
        add(self, value)

    monkeypatch.setattr(ReducedModel, "_add_modes", noted)
    monkeypatch.setattr(mode_corrections, "_FAST", 0.0)  # factors of P serve for one correction at most
    model = ReducedModel(chain(*CLASSES[kind]), "mu", np.linspace(0.0, 0.9, 31), Request(count=MODES))
    assert len(own) > 1 and model.worst <= 1e-8
    assert model.factorizations < 1 + len(own)  # one is P
    assert model._corrections._last is model._corrections.definite is None  # none are kept when the model is made


@pytest.mark.parametrize("kind", some(list(CLASSES), lambda kind: kind == "complex with C"))
def test_factors_of_p_serve_at_all_values_where_they_are_fast(kind):
    """Weak friction and damping change little: no other matrix is factorised, but one whose inertia counts modes."""
    model = ReducedModel(chain(*CLASSES[kind]), "mu", np.linspace(0.0, 0.05, 7), Request(count=MODES))
    assert model.factorizations == 2 and model.worst <= 1e-8


def test_indices_of_terms_are_short():
    """SciPy's products have long indices, which a sum with a large matrix would take over."""
    A = sp.csr_array(np.eye(3))
    A.indices, A.indptr = A.indices.astype(np.int64), A.indptr.astype(np.int64)
    term = Term("spring", "K", A, True)
    assert term.matrix.indices.dtype == term.matrix.indptr.dtype == np.int32
    assert np.shares_memory(term.matrix.data, A.data) and (term.matrix != A).nnz == 0


@pytest.mark.parametrize("kind", some(list(CLASSES), lambda kind: kind == "quadratic"))
def test_corrections_in_blocks_give_the_same_eigenvalues(kind, monkeypatch):
    """Large models solve for a few modes at a time, which takes less memory."""
    problem, values = chain(*CLASSES[kind]), np.linspace(0.0, 0.9, 7)
    whole = ReducedModel(problem, "mu", values, Request(count=MODES))
    monkeypatch.setattr(mode_corrections, "_MOST", 3 * 8 * problem.unknowns)
    parts = ReducedModel(problem, "mu", values, Request(count=MODES))
    assert parts.worst <= 1e-8
    for p in values.tolist():
        np.testing.assert_allclose(parts.modes(p).lam, whole.modes(p).lam, rtol=3e-8)


def test_singular_values_are_found_where_divide_and_conquer_fails(monkeypatch):
    """QR iteration takes the place of a failing gesdd, with the same answer."""
    X = np.random.default_rng(5).standard_normal((30, 6))
    svd, drivers = la.svd, []

    def failing(*arguments, lapack_driver="gesdd", **options):
        drivers.append(lapack_driver)
        if lapack_driver == "gesdd":
            raise la.LinAlgError("SVD did not converge")
        return svd(*arguments, lapack_driver=lapack_driver, **options)

    known = thin_svd(X)[1]
    monkeypatch.setattr("fe_squeal.reduced.vectors.la.svd", failing)
    U, s, V = thin_svd(X)
    assert drivers == ["gesdd", "gesvd"]
    np.testing.assert_allclose(s, known, rtol=1e-13)
    np.testing.assert_allclose((U * s) @ V, X, atol=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["nonsymmetric", "quadratic"])
def test_corrections_that_modes_do_not_need_are_given_up(kind, monkeypatch):
    """Many rounds by factors that do little: the basis stays narrower, and the modes are the same."""
    solved, correct, widest = mode_corrections.ModeCorrections._solved, mode_corrections.ModeCorrections.correct, [0, 0]

    def roughly(self, *how):
        X = solved(self, *how)
        return X * (1 + 0.3 * np.random.default_rng(X.shape[1]).standard_normal(X.shape))

    monkeypatch.setattr(mode_corrections.ModeCorrections, "_solved", roughly)
    models = []
    for i, narrowed in enumerate((lambda wide, size, W: (wide, W), mode_corrections._narrowed)):

        def noted(self, basis, *more, i=i):
            found = correct(self, basis, *more)
            widest[i] = max(widest[i], len(basis))
            return found

        monkeypatch.setattr(mode_corrections.ModeCorrections, "correct", noted)
        monkeypatch.setattr(mode_corrections, "_narrowed", narrowed)
        models.append(ReducedModel(chain(*CLASSES[kind]), "mu", VALUES, Request(count=MODES)))
    assert widest[1] < widest[0]
    for value in VALUES:
        one, two = (m.modes(float(value)).lam for m in models)
        np.testing.assert_allclose(one, two, rtol=2e-8)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["nonsymmetric", "quadratic"])
def test_a_large_problem_keeps_factors_without_friction(kind, monkeypatch, needs_pardiso):
    """As long as the corrections that are left suffice with them: others take more memory. The modes are the same."""
    monkeypatch.setattr(mode_corrections, "_FAST", 0.0)
    monkeypatch.setattr(mode_corrections, "_FASTER", 0.0)
    monkeypatch.setattr(mode_corrections, "_FEW", 0)
    problem, models = chain(*CLASSES[kind]), []
    for entries in (choice._MANY, 1.0):
        monkeypatch.setattr(choice, "_MANY", entries)
        models.append(ReducedModel(problem, "mu", VALUES, Request(count=MODES)))
    assert [m._corrections.definite_suffices for m in models] == [False, True]
    assert models[1].factorizations < models[0].factorizations
    for value in VALUES:
        one, two = (m.modes(float(value)).lam for m in models)
        np.testing.assert_allclose(one, two, rtol=2e-8)
