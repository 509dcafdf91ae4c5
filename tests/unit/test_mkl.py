"""Products by the Math Kernel Library: SciPy's, or a refusal where it does not know the types."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal.eigen import blocks, mkl
from fe_squeal.eigen.linear.pardiso import has_pardiso
from fe_squeal.eigen.pencil import FreeMotions
from fe_squeal.problem.forms import project
from fe_squeal.problem.interpolation import interpolate
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term


@pytest.fixture
def matrix() -> sp.csr_array:
    rng = np.random.default_rng(1)
    return sp.csr_array(np.where(rng.random((300, 200)) < 0.05, rng.random((300, 200)), 0.0))


@pytest.mark.skipif(not has_pardiso(), reason="PARDISO, which MKL comes with, is not installed")
@pytest.mark.parametrize("kind", [np.float64, np.float32])
@pytest.mark.parametrize("k", [1, 2, 15, 16, 17, 70])
def test_products_are_scipys_whatever_was_in_the_result(matrix, kind, k):
    A, out = matrix.astype(kind), np.full((300, k), np.nan, kind)
    X = np.random.default_rng(2).standard_normal((200, k)).astype(kind)
    assert mkl.multiply(A, X, out)
    np.testing.assert_allclose(out, A @ X, rtol=10 * np.finfo(kind).eps, atol=10 * np.finfo(kind).eps)


@pytest.mark.skipif(not has_pardiso(), reason="PARDISO, which MKL comes with, is not installed")
def test_rows_and_matrices_without_entries():
    X = np.ones((4, 3))
    one = np.zeros((6, 4))
    one[5, 1] = 2.0
    for A in (sp.csr_array((6, 4)), sp.csr_array(one)):
        out = np.full((6, 3), np.nan)
        assert mkl.multiply(A, X, out)
        assert (out == A @ X).all()


def test_types_that_it_does_not_know_are_refused(matrix):
    long = sp.csr_array((matrix.data, matrix.indices.astype(np.int64), matrix.indptr.astype(np.int64)), matrix.shape)
    X, out = np.ones((200, 2)), np.zeros((300, 2))
    assert not mkl.multiply(long, X, out)
    assert not mkl.multiply(matrix.astype(complex), X + 0j, out + 0j)
    assert not mkl.multiply(matrix, X.astype(np.float32), out.astype(np.float32))
    assert not out.any()


def test_arrays_with_gaps_are_refused(matrix):
    """SciPy's real part of a complex matrix is a view of every second number."""
    A = sp.csr_array((matrix * (1 + 2j)).real)
    X = np.random.default_rng(4).standard_normal((200, 6))
    if A.data.flags.c_contiguous:
        A.data = np.repeat(A.data, 2)[::2]
    assert not A.data.flags.c_contiguous
    assert not mkl.multiply(A, X, np.zeros((300, 6)))
    assert not mkl.multiply(matrix, np.asfortranarray(X), np.zeros((300, 6)))
    assert not mkl.multiply(matrix, X, np.zeros((300, 12))[:, ::2])


def test_shapes_that_do_not_belong_together_are_an_error(matrix):
    for X, out in ((np.ones((199, 2)), np.ones((300, 2))), (np.ones((200, 2)), np.ones((300, 3)))):
        with pytest.raises(ValueError, match="do not belong together"):
            mkl.multiply(matrix, X, out)


@pytest.mark.parametrize("kind", ["long", "complex", "mixed", "gaps"])
def test_such_products_are_made_without_it(kind):
    n = blocks._TALL + 3
    A = sp.csr_array(sp.diags_array([np.arange(1.0, n + 1), np.ones(n - 1)], offsets=[0, 1]))
    X = np.random.default_rng(3).standard_normal((n, 4))
    if kind == "long":
        A = sp.csr_array((A.data, A.indices.astype(np.int64), A.indptr.astype(np.int64)), A.shape)
    elif kind == "complex":
        A, X = sp.csr_array(A * (1 + 2j)), X + 1j
    elif kind == "gaps":
        A = sp.csr_array((A * (1 + 2j)).imag)
    else:
        X = X.astype(np.float32)
    found = blocks.times(A, X)
    assert found.dtype == (complex if kind == "complex" else float)
    np.testing.assert_allclose(found, A @ X, rtol=1e-14)


def test_interpolated_complex_problems_have_terms_without_gaps():
    """Their products with blocks are those of the matrices, whatever does them."""
    n = blocks._TALL + 1
    rng = np.random.default_rng(5)
    one, loss = (sp.csr_array(sp.diags_array(rng.uniform(1, 2, n))) for _ in range(2))
    terms = (Term("m", "M", one, True), Term("k", "K", one, True), Term("l", "K", loss, True, imaginary=True))

    class Moving:
        def check(self, values):
            pass

        def number(self, path):
            return 9.0

        def problem(self, values):
            factor = 1 + values["p"] ** 2
            moved = [replace(t, matrix=t.matrix * factor) if t.slot == "K" else t for t in terms]
            return Problem(tuple(moved), {}, changed=values, source=self, free=lambda _: FreeMotions.none(n))

    moving = Problem(terms, {}, source=Moving(), free=lambda _: FreeMotions.none(n))
    V = rng.standard_normal((n, 3))
    projected = project(interpolate(moving, "p", 0.0, 2.0), V)
    whole = V.T @ (one @ V) + 1j * (V.T @ (loss @ V))
    for p in (0.0, 0.7, 2.0):
        K = projected.pencil({"p": p}).K.toarray()
        np.testing.assert_allclose(K, (1 + p**2) * whole, rtol=1e-9, atol=1e-8 * n)


def test_without_the_library(matrix, monkeypatch):
    monkeypatch.setattr(mkl, "library", lambda: None)
    assert not mkl.multiply(matrix, np.ones((200, 2)), np.zeros((300, 2)))
