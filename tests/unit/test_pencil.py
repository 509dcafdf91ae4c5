"""Sizes of the entries of matrices, which backward errors are measured in: any pattern, any type, little memory."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal.eigen.pencil import Modes, Pencil


def _random(n: int, density: float, symmetric: bool, seed: int = 3) -> sp.csr_array:
    rng = np.random.default_rng(seed)
    count = int(density * n**2)
    i, j = rng.integers(n, size=(2, count), dtype=np.int32)
    A = sp.csr_array(sp.coo_array((rng.standard_normal(count), (i, j)), shape=(n, n)))
    D = sp.diags_array(rng.uniform(1.0, 1e6, n), format="csr")
    return sp.csr_array(A + A.T + D if symmetric else A + D)


def _by_definition(A: np.ndarray) -> np.ndarray:
    sizes = np.zeros(A.shape)
    for i, j in np.ndindex(*A.shape):
        if A[i, j] or A[j, i]:
            sizes[i, j] = max(abs(A[i, j]), np.sqrt(abs(A[i, i] * A[j, j])))
    return sizes


@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("kind", ["sparse", "complex", "unsorted", "full"])
def test_magnitude_is_by_its_definition(symmetric, kind):
    n = 40
    K, M = _random(n, 0.1, symmetric), _random(n, 0.05, symmetric, seed=4)
    exact = _by_definition(K.toarray())
    if kind == "complex":
        K = sp.csr_array(K * (1 + 0.5j))
        exact = _by_definition(K.toarray())
    elif kind == "unsorted":
        order = np.concatenate([np.arange(*K.indptr[i : i + 2])[::-1] for i in range(n)])
        K = sp.csr_array((K.data[order], K.indices[order], K.indptr), shape=K.shape)
    pencil = Pencil(M, K)
    if kind == "full":
        pencil = pencil.dense()
    u = np.random.default_rng(5).standard_normal((n, 3))
    expected = exact @ np.abs(u) + _by_definition(M.toarray()) @ np.abs(u) * 4.0
    assert pencil.magnitude(np.full(3, 2j), u) == pytest.approx(expected, rel=1e-14)


def test_sizes_take_no_more_memory_than_another_copy_of_the_matrices():
    K, M = _random(5000, 0.008, True), _random(5000, 0.008, True, seed=4)
    pencil, u = Pencil(M, K), np.ones((5000, 1))
    tracemalloc.start()
    try:
        pencil.magnitude(np.array([1j]), u)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 1.1 * sum(A.data.nbytes + A.indices.nbytes for A in (K, M))


@pytest.mark.parametrize(
    ("lam", "count"),
    [
        ([2j, 3j], 4),
        ([0, 0, 2j], 6),
        ([0, -5.0, 2j], 4),  # a free motion that is damped: s(s + 5) = 0
        ([0, 0, -5.0, 2j], 6),  # one of two is damped
        ([-5.0, -0.1, 2j], 4),  # an overdamped mode
        ([4.0, -4.0, 2j], 4),
        ([0, 4.0, -4.0, 2j], 6),  # a mode that diverges beside one that is free without damping
        ([0, 4.0, -4.0 + 1e-9, 2j], 6),  # the same, rounded
        ([0, 4.0, -5.0, 2j], 5),
        ([0, 0, 4.0, -4.0, -5.0, 2j], 8),
    ],
)
def test_how_many_eigenvalues_modes_stand_for(lam, count):
    """Each λ with Im λ > 0 has a conjugate; a free motion has the roots 0, 0 of λ², or 0, −c of λ² + cλ."""
    lam = np.array(lam, complex)
    modes = Modes(lam, np.zeros((0, len(lam))), None, *(np.full(len(lam), 1e-8) for _ in range(3)))
    assert modes.eigenvalue_count == count
