"""Free bodies whose points are tied to each other by links far stiffer than they are, as multi-point constraints by
penalties: several of their pivots are small and right, and beside them one is zero but for rounding."""

import os

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from variations import require_pardiso

from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes

BOX = 9, 8, 7  # points along each axis


def free_grid(rng: np.random.Generator) -> tuple[sp.csr_array, sp.csr_array]:
    """Return K and M of points, one unknown each, that springs join to their neighbours and nothing to the ground."""
    index = np.arange(np.prod(BOX)).reshape(BOX)
    pairs = [(np.take(index, range(size - 1), axis), np.take(index, range(1, size), axis))
             for axis, size in enumerate(BOX)]  # fmt: skip
    a, b = (np.concatenate([pair[side].ravel() for pair in pairs]) for side in (0, 1))
    rows = np.arange(len(a))
    B = sp.csr_array((np.repeat([1.0, -1.0], len(a)), (np.tile(rows, 2), np.append(a, b))), (len(a), index.size))
    mass = sp.csr_array(sp.diags_array(rng.uniform(0.5, 2, index.size)))
    return sp.csr_array(B.T @ sp.diags_array(rng.uniform(0.5, 2, len(a))) @ B), mass


def links(count: int, n: int, rng: np.random.Generator) -> np.ndarray:
    """Return rows (count, n): in each, one point moves like the mean of some others."""
    rows = np.zeros((count, n))
    for row in rows:
        chosen = rng.choice(n, rng.integers(2, 8), replace=False)
        row[chosen] = -1 / (len(chosen) - 1)
        row[chosen[0]] = 1.0
    return rows


@pytest.mark.parametrize("linear_solver", ["pardiso", "superlu"])
@pytest.mark.parametrize(("stiffness", "rel"), [(1e6, 1e-5), (1e8, 1e-7), (1e10, 1e-5), (1e12, 1e-3)])
@pytest.mark.parametrize("seed", range(3))
def test_links_hold_and_take_nothing_else_with_them(seed, stiffness, rel, linear_solver):
    """Rigid links leave the modes of K in the null space of their rows, to 1/stiffness; rounding of the entries of K
    adds 1e-16 · stiffness."""
    if linear_solver == "pardiso":
        require_pardiso(os.environ)
    rng = np.random.default_rng(seed)
    K, M = free_grid(rng)
    rows = links(8, K.shape[0], rng)
    stiff = sp.csr_array(rows)
    tied = sp.csr_array(K + stiffness * (stiff.T @ stiff))
    tied = sp.csr_array((tied + tied.T) / 2)
    Z = la.null_space(rows)
    expected = np.sqrt(la.eigh(Z.T @ (K @ Z), Z.T @ (M @ Z), eigvals_only=True)[1:12])
    found = solve_modes(Pencil(M, tied, symmetric=True), Request(count=12), linear_solver=linear_solver)
    assert found.lam[0] == 0
    np.testing.assert_allclose(found.lam[1:].imag, expected, rtol=rel)
