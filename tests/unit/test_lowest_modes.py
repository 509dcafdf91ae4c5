"""The search for the lowest modes of a projection against LAPACK, and its proof that none is missing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import scipy.linalg as la

from fe_squeal.eigen.dense import solve_dense
from fe_squeal.eigen.pencil import FreeMotions, Pencil
from fe_squeal.eigen.request import Request, select_wanted
from fe_squeal.reduced.lowest import Blocks, KnownModes, lowest_modes

N, ASKED = 160, 12  # θ = 1, 4, 9 ... without friction
HIGHEST = 25.0


@dataclass
class Matrices:
    """What `lowest_modes` takes of a projection."""

    M: np.ndarray
    K: np.ndarray
    C: np.ndarray | None = None
    has_slow: bool = False

    def matrices(self, place):
        return self.M, self.C, self.K, False

    def free_motions(self, place):
        return FreeMotions.none(len(self.M))

    @property
    def modes(self):
        pencil = Pencil(self.M, self.K, self.C, free=self.free_motions(0.0))
        return solve_dense(pencil, HIGHEST)


def matrices(friction, alone=()):
    """Matrices with θ = 1, 4, 9 ... but for friction, which joins neighbours; and unknowns that nothing else moves."""
    rng = np.random.default_rng(3)
    T = np.eye(N) + 0.3 * rng.standard_normal((N, N)) / np.sqrt(N)
    K = np.diag(np.arange(1.0, N + 1) ** 2)
    for i in range(N - 1):
        coupling = friction * (i + 1) * (1.0 if i % 2 else 0.1)
        K[i, i + 1], K[i + 1, i] = coupling, -coupling
    K[30:, :30] += 20 * friction * rng.standard_normal((N - 30, 30))  # right modes differ from left ones
    M, K = T.T @ T, T.T @ K @ T
    return Matrices(la.block_diag(M, *np.ones(len(alone))), la.block_diag(K, *alone))


REQUESTS = [Request(None, (ASKED + 0.5) / (2 * np.pi), 1e-8), Request(ASKED, None, 1e-8)]


@pytest.mark.parametrize("request_", REQUESTS, ids=["frequency", "count"])
@pytest.mark.parametrize("friction", [0.1, 1.0, 2.0])
def test_modes_from_rough_ones_are_those_of_lapack(request_, friction):
    here, rng = matrices(friction), np.random.default_rng(1)
    blocks = Blocks.of(here.modes, request_)
    right, left = (x + 0.03 * rng.standard_normal(x.shape) for x in (blocks.right, blocks.left))
    found = lowest_modes(here, (0.0,), request_, HIGHEST, Blocks(right, left, blocks.square))
    assert found is not None
    found, exact = (select_wanted(m, request_, np.inf) for m in (found, here.modes))
    assert len(found) == len(exact) >= ASKED - 1
    assert (found.stability == exact.stability).all() and ("unstable" in exact.stability) == (friction > 1)
    assert np.abs(found.lam / exact.lam - 1).max() < 5e-6  # about the square of angles after three steps
    for a, b in ((found.right, exact.right), (found.left, exact.left)):
        cosine = np.abs(np.einsum("ij,ij->j", a.conj(), b)) / la.norm(a, axis=0) / la.norm(b, axis=0)
        assert (cosine > 1 - 1e-4).all()


@pytest.mark.parametrize("request_", REQUESTS, ids=["frequency", "count"])
@pytest.mark.parametrize("theta", [20.0, 140.0, -3.0, "double"])
def test_a_mode_that_the_start_lacks_is_noticed(request_, theta):
    """Inverse iteration never finds an unknown that nothing else moves, where all vectors of its start are zero."""
    known = matrices(1.0)
    theta = -float((known.modes.lam[5] ** 2).real) if theta == "double" else theta
    here = matrices(1.0, [theta])
    assert lowest_modes(here, (0.0,), request_, HIGHEST, Blocks.of(known.modes, request_)) is None
    found = lowest_modes(here, (0.0,), request_, HIGHEST, Blocks.of(here.modes, request_))
    near = np.abs(found.lam**2 + theta) < 1e-8
    assert near.sum() == (np.abs(here.modes.lam**2 + theta) < 1e-8).sum() > 0
    beyond = matrices(1.0, [300.0])  # not asked for
    assert lowest_modes(beyond, (0.0,), request_, HIGHEST, Blocks.of(known.modes, request_)) is not None


def test_fewer_modes_than_asked_for_are_no_answer():
    here = matrices(1.0)
    near = Blocks.of(here.modes, REQUESTS[1])
    assert lowest_modes(here, (0.0,), REQUESTS[1], HIGHEST, near) is not None
    assert lowest_modes(here, (0.0,), REQUESTS[1], 3.5, near) is None


def test_damped_problems_are_left_to_lapack():
    here = matrices(1.0)
    near = Blocks.of(here.modes, REQUESTS[0])
    assert lowest_modes(Matrices(here.M, here.K, 0.01 * here.M), (0.0,), REQUESTS[0], HIGHEST, near) is None


def test_the_nearest_place_counts_in_widths_of_the_box():
    blocks = [Blocks(np.eye(2), np.eye(2), float(i)) for i in range(2)]
    known = KnownModes(np.array([1.0, 1e9]), {(0.0, 0.0): blocks[0], (1.0, 1e9): blocks[1]})
    assert known.nearest((0.2, 4e8)) is blocks[0] and known.nearest((0.8, 4e8)) is blocks[1]
    assert known.nearest((1.0, 1e9)) is blocks[1] and KnownModes(np.ones(2)).nearest((0.0, 0.0)) is None
