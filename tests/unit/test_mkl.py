"""Products by the Math Kernel Library: SciPy's, or a refusal where it does not know the types."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal.eigen import blocks, mkl
from fe_squeal.eigen.linear.pardiso import has_pardiso


@pytest.fixture
def matrix() -> sp.csr_array:
    return sp.csr_array(sp.random_array((300, 200), density=0.05, rng=np.random.default_rng(1), format="csr"))


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


@pytest.mark.parametrize("kind", ["long", "complex", "mixed"])
def test_such_products_are_made_without_it(kind):
    n = blocks._TALL + 3
    A = sp.csr_array(sp.diags_array([np.arange(1.0, n + 1), np.ones(n - 1)], offsets=[0, 1]))
    X = np.random.default_rng(3).standard_normal((n, 4))
    if kind == "long":
        A = sp.csr_array((A.data, A.indices.astype(np.int64), A.indptr.astype(np.int64)), A.shape)
    elif kind == "complex":
        A, X = sp.csr_array(A * (1 + 2j)), X + 1j
    else:
        X = X.astype(np.float32)
    found = blocks.times(A, X)
    assert found.dtype == (complex if kind == "complex" else float)
    np.testing.assert_allclose(found, A @ X, rtol=1e-14)


def test_without_the_library(matrix, monkeypatch):
    monkeypatch.setattr(mkl, "library", lambda: None)
    assert not mkl.multiply(matrix, np.ones((200, 2)), np.zeros((300, 2)))
