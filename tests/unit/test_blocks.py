"""Products by parts of rows are those of the whole, on any number of threads."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal.eigen import blocks
from fe_squeal.eigen.blocks import combine, cross, cross_in, lift, projected, put_combined, times
from fe_squeal.eigen.columns import LocalStore


@pytest.fixture(params=[1, 3])
def threads(request, monkeypatch):
    monkeypatch.setattr(blocks, "thread_count", lambda: request.param)


@pytest.mark.parametrize("n", [40, blocks._TALL + 7])
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.usefixtures("threads")
def test_products(n, order):
    rng = np.random.default_rng(3)
    A = sp.csr_array(sp.diags_array([rng.standard_normal(n), rng.standard_normal(n - 2)], offsets=[0, 2]))
    X, Y = (np.asarray(rng.standard_normal((n, k)), order=order) for k in (5, 3))
    y = rng.standard_normal((5, 2))
    assert (np.abs(times(A, X) - A @ X) <= 4 * np.finfo(float).eps * (abs(A) @ np.abs(X))).all()  # sums may cancel
    np.testing.assert_allclose(cross(X, Y), X.T @ Y, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(combine(X, y), X @ y, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("k", [0, 5, blocks._PIECE + 3])
@pytest.mark.usefixtures("threads")
def test_products_in_some_rows(k, order):
    rng = np.random.default_rng(6)
    n, rows = 50, np.array([3, 4, 17, 49])
    X, Y = np.asarray(rng.standard_normal((n, k)), order=order), rng.standard_normal((n, 2))
    for chosen in (rows, None):
        some = slice(None) if chosen is None else chosen
        found = cross_in(X, chosen, Y[some], Y[some] + 1j)
        for product, block in zip(found, (Y[some], Y[some] + 1j), strict=True):
            np.testing.assert_allclose(product, X[some].T @ block, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("n", [40, blocks._TALL + 7])
@pytest.mark.parametrize("share", [0.05, 0.5, 1.0])
@pytest.mark.parametrize("sign", [-1, 0, 1])
@pytest.mark.usefixtures("threads")
def test_matrices_are_projected_in_the_rows_in_which_they_act(n, share, sign):
    """Of symmetric and skew-symmetric ones half the products are formed, and mirrored."""
    rng = np.random.default_rng(11)
    V = np.asarray(rng.standard_normal((n, blocks._PIECE + 6)), order="F")
    rows = np.sort(rng.choice(n, int(share * n), replace=False))
    diagonals = rng.standard_normal(len(rows)), rng.standard_normal(len(rows) - 1)
    A = sp.diags_array(diagonals, offsets=[0, 1]).tocsr()
    A = A + sign * A.T if sign else A
    place = sp.csr_array((np.ones(len(rows)), (rows, np.arange(len(rows)))), shape=(n, len(rows)))
    A = sp.csr_array(place @ A @ place.T)
    A.eliminate_zeros()
    found, expected = projected(V, A, sign), V.T @ (A @ V)
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.usefixtures("threads")
def test_columns_are_combined_where_they_are(monkeypatch):
    """A few rows after the others, in place of the columns that are combined."""
    monkeypatch.setattr(blocks, "_ROWS", 16)
    rng = np.random.default_rng(8)
    X, y = rng.standard_normal((50, 6)), rng.standard_normal((4, 3))
    store = LocalStore(50, 8)
    store.put(0, X)
    put_combined(store, 2, store.columns(6)[:, 2:], y)
    np.testing.assert_allclose(store.columns(5), np.hstack([X[:, :2], X[:, 2:] @ y]), rtol=1e-12, atol=1e-13)
    other = LocalStore(50, 5)
    put_combined(other, 0, store.columns(5))
    np.testing.assert_array_equal(other.columns(5), store.columns(5))


@pytest.mark.usefixtures("threads")
def test_matrices_with_empty_rows_and_no_columns():
    n = blocks._TALL + 1
    A = sp.csr_array(([1.0], ([n - 1], [0])), shape=(n, 4))
    X = np.arange(8.0).reshape(4, 2)
    assert (times(A, X)[-1] == X[0]).all() and not times(A, X)[:-1].any()
    assert times(A, X[:, :0]).shape == (n, 0)
    assert cross(np.zeros((n, 0)), np.ones((n, 2))).shape == (0, 2)
    assert not combine(np.zeros((n, 0)), np.zeros((0, 2))).any()


@pytest.mark.parametrize("n", [40, blocks._TALL + 7])
@pytest.mark.parametrize("shape", [(5,), (5, 0), (5, 3)])
@pytest.mark.usefixtures("threads")
def test_complex_vectors_are_lifted_in_real_parts(n, shape):
    """By a real matrix, sparse or not, in any order of the entries; a real column stays real."""
    rng = np.random.default_rng(5)
    V = rng.standard_normal((n, 5))
    y = rng.standard_normal(shape) + 1j * rng.standard_normal(shape)
    for columns in (y, np.asfortranarray(y), y.real, y.real + 0j):
        for matrix in (V, sp.csr_array(V)):
            lifted = lift(matrix, columns)
            assert lifted.shape == (n, *shape[1:]) and lifted.dtype == columns.dtype
            np.testing.assert_allclose(lifted, V @ columns, rtol=1e-12, atol=1e-13)
            assert columns.imag.any() or not lifted.imag.any()


@pytest.mark.parametrize("n", [40, blocks._TALL + 7])
@pytest.mark.usefixtures("threads")
def test_complex_columns_beside_real_ones(n):
    rng = np.random.default_rng(4)
    X, Y = rng.standard_normal((n, 5)), rng.standard_normal((n, 3)) + 1j * rng.standard_normal((n, 3))
    for A, B in ((X, Y), (X, np.asfortranarray(Y)), (X, Y[:, ::2]), (Y, X), (Y, Y)):
        np.testing.assert_allclose(cross(A, B), A.T @ B, rtol=1e-11, atol=1e-11)
    assert cross(X, Y[:, :0]).shape == (5, 0)
