"""Columns with their rows on all processes: each product against that of an array, and sweeps on such a basis.

Without mpiexec one process has all rows, and does every step with them; `make test-mpi` runs these on 1, 2 and 3.
"""

from __future__ import annotations

import gc
import mmap

import numpy as np
import psutil
import pytest
import scipy.sparse as sp
from chains import chain
from numpy.testing import assert_allclose, assert_array_equal
from selection import some

from fe_squeal import sweep
from fe_squeal.eigen import block_lanczos, columns, memory
from fe_squeal.eigen.block_lanczos import lowest_modes
from fe_squeal.eigen.blocks import combine, cross, form, lift, put_combined
from fe_squeal.eigen.columns import LocalStore, SpreadColumns, SpreadStore, transposed
from fe_squeal.eigen.linear import column_parts
from fe_squeal.eigen.linear.choice import factorize_definite
from fe_squeal.errors import TooLargeError
from fe_squeal.process.ranks import process_count
from fe_squeal.reduced import ReducedModel, basis, begun

N, R = 101, 7


@pytest.fixture
def spread(monkeypatch):
    """Every basis is spread, however small."""
    for module in (block_lanczos, basis):
        monkeypatch.setattr(module, "store_for", lambda n: SpreadStore)


def pair(seed=0):
    """The same columns as an array and spread, with room for more."""
    V = np.random.default_rng(seed).standard_normal((N, R))
    store = SpreadStore(N, 2 * R)
    store.put(0, V)
    return V, store.columns(R)


@pytest.mark.parametrize("most", [2**27, 3 * N])
def test_products_are_those_of_an_array(most, monkeypatch):
    """In one piece, and in several where all at once is too much."""
    monkeypatch.setattr(column_parts, "_MOST", most)
    V, spread = pair()
    rng = np.random.default_rng(1)
    A = sp.random_array((N, N), density=0.1, random_state=rng, format="csr")
    y, X = rng.standard_normal((R, 5)), rng.standard_normal((N, 5))
    assert spread.shape == V.shape and len(spread) == N
    assert_allclose(combine(spread, y), V @ y, atol=1e-13)
    assert_allclose(cross(spread, X), V.T @ X, atol=1e-13)
    assert_allclose(cross(spread, X + 2j * X[::-1]), V.T @ (X + 2j * X[::-1]), atol=1e-12)
    for z in (y, y[:, 0], y - 3j * y[::-1], (1j * y)[:, 1], np.zeros((R, 0))):
        assert_allclose(lift(spread, z), V @ z, atol=1e-13)
    assert_allclose(form(spread, A, spread), V.T @ (A @ V), atol=1e-12)
    assert_array_equal(np.asarray(spread), V)
    assert_array_equal(transposed(spread), V.T)
    assert_array_equal(transposed(V), V.T)


def test_parts_of_columns():
    V, spread = pair()
    rows = np.array([N - 1, 0, 50, 51, 3])
    assert_array_equal(spread[rows], V[rows])
    assert_array_equal(spread[np.zeros(0, int)], V[:0])
    for few in (slice(2, 5), slice(3, None), slice(None, 4), slice(5, 5)):
        assert_array_equal(np.asarray(spread[:, few]), V[:, few])
        assert spread[:, few].shape == V[:, few].shape
    assert_array_equal(np.asarray(spread[:, 2:6][:, 1:3]), V[:, 3:5])
    assert_array_equal(np.asarray(SpreadStore.of(V.T).columns(R)), V)


def test_columns_are_put_behind_others():
    """Combined where they are, in place as well; columns that are there stay."""
    V, spread = pair()
    W = np.random.default_rng(2).standard_normal((R - 2, 3))
    other, kept = SpreadStore(N, 5), spread.store
    put_combined(other, 0, spread[:, :5])
    assert_array_equal(np.asarray(other.columns(5)), V[:, :5])
    put_combined(kept, 2, spread[:, 2:], W)
    assert_allclose(np.asarray(kept.columns(5)), np.hstack([V[:, :2], V[:, 2:] @ W]), atol=1e-13)
    assert_array_equal(np.asarray(other.columns(5)), V[:, :5])
    local = LocalStore(N, 6)
    put_combined(local, 0, V[:, :4])
    put_combined(local, 4, V[:, 2:], W[:, :2])
    assert_allclose(local.columns(6), np.hstack([V[:, :4], V[:, 2:] @ W[:, :2]]), atol=1e-13)


def test_rows_are_forgotten_with_the_last_columns():
    """With the next step: until then the other processes know nothing of it."""
    V, spread = pair()
    few, handle = spread[:, 1:3], spread.store.handle
    del spread
    gc.collect()
    SpreadStore(3)
    assert handle in column_parts._parts
    assert_array_equal(np.asarray(few), V[:, 1:3])
    del few
    gc.collect()
    SpreadStore(3)
    assert handle not in column_parts._parts


def test_small_problems_are_not_spread():
    assert columns.store_for(columns._LEAST - 1) is LocalStore
    assert columns.store_for(columns._LEAST) is (SpreadStore if process_count() > 1 else LocalStore)


def test_lowest_modes_on_spread_columns(spread):
    """A chain of equal masses: θ = 4 sin²(iπ / (2n + 2)); room is found for more vectors than expected."""
    K = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(300, 300)).tocsr()
    M = sp.eye_array(300, format="csr")
    theta, vectors = lowest_modes(factorize_definite(K, "auto"), M, 0.0, 20, 1e-6)
    assert_allclose(theta, 4 * np.sin(np.arange(1, 21) * np.pi / 602) ** 2, rtol=1e-10)
    assert_allclose(vectors.T @ vectors, np.eye(20), atol=1e-10)


@pytest.mark.parametrize("effects", some(
    [((),), (("damper", "slip damping"),), (("loss",),)], lambda effects: "damper" not in effects
), ids=["undamped", "damped", "complex"])  # fmt: skip
def test_a_sweep_on_a_spread_basis(effects, spread, request):
    """The same λ and onsets, and shapes whose backward error is as small."""
    values, how = np.linspace(0.0, 0.9, 4), {"modes": 8, "method": "reduced", "keep_shapes": True}
    found = sweep(chain(*effects, n=450), values, **how)
    model = found.reduced_model
    assert isinstance(model.basis.V, SpreadColumns)
    arrays, numbers = model.stored()
    again = ReducedModel.restored(model.problem, "mu", values, model.request, arrays, numbers)
    assert isinstance(again.basis.V, SpreadColumns)
    assert_array_equal(np.asarray(again.basis.V), np.asarray(model.basis.V))
    assert_allclose(again.modes(0.3).lam, model.modes(0.3).lam, rtol=1e-12)
    request.getfixturevalue("monkeypatch").undo()
    expected = sweep(chain(*effects, n=450), values, **how)
    assert isinstance(expected.reduced_model.basis.V, np.ndarray)
    for a, b in zip(found.points, expected.points, strict=True):
        assert_allclose(a.modes.lam, b.modes.lam, rtol=0, atol=1e-9 * np.abs(b.modes.lam).max())
        for i in b.shapes:
            u, v = (x / np.linalg.norm(x) for x in (a.shapes[i], b.shapes[i]))
            assert np.abs(np.vdot(u, v)) > 1 - 1e-6
    assert [o.kind for o in found.onsets] == [o.kind for o in expected.onsets]
    for a, b in zip(found.onsets, expected.onsets, strict=True):
        assert a.value == pytest.approx(b.value, rel=1e-8)


@pytest.mark.skipif(not hasattr(mmap, "MADV_DONTNEED"), reason="the system takes back memory as a whole only")
@pytest.mark.parametrize("kind", [LocalStore, SpreadStore])
def test_memory_behind_the_columns_that_are_kept_is_given_back(kind):
    """Without a copy of those, which would take as much again; what is put there later is kept."""
    n, room, kept = 200_000, 40, 3
    store = kind(n, room)
    for i in range(room):
        store.put(i, np.full((n, 1), float(i)))
    before = psutil.Process().memory_info().rss
    store.keep(kept)
    own = n / process_count() if kind is SpreadStore else n
    assert before - psutil.Process().memory_info().rss > 0.8 * 8 * own * (room - kept)
    assert_array_equal(np.asarray(store.columns(kept))[:: n // 7], np.tile(np.arange(3.0), (8, 1)))
    store.put(kept, np.full((n, 1), 9.0))
    assert_array_equal(np.asarray(store.columns(kept + 1))[:: n // 7, -1], np.full(8, 9.0))


@pytest.mark.parametrize(("least", "here", "quarters"), [(0, 1, 1), (0, 3, 3), (0, 4, 4), (10**6, 1, 4)])
def test_each_machine_needs_room_for_its_own_rows(least, here, quarters, monkeypatch):
    """Of the vectors that a reduced model begins with, on four processes; all where they are not spread."""
    n, modes = 450, 8

    def require(unknowns, vectors, size, *part):
        assert (unknowns, size) == (n, 8) and vectors > 5 * modes
        asked = n * vectors * size * quarters // 4
        for free in (asked, asked - 1):
            monkeypatch.setattr(memory, "available_memory", lambda free=free: free)
            fitted.append(free)
            memory.require_vectors(unknowns, vectors, size, *part)

    fitted = []
    monkeypatch.setattr(columns, "_LEAST", least)
    monkeypatch.setattr(columns, "process_count", lambda: 4)
    monkeypatch.setattr(columns, "local_count", lambda: here)
    monkeypatch.setattr(begun, "require_vectors", require)
    on = " on this machine" if quarters < 4 else ""
    with pytest.raises(TooLargeError, match=rf"vectors that the modes .* need [\d.]+ MiB of memory{on}, .* are free"):
        sweep(chain(n=n), [0.0, 0.1], modes=modes, method="reduced")
    assert len(fitted) == 2
