"""Reduced sweeps over a parameter with a negative power: stiffness is least where the parameter is largest."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from scipy.optimize import linear_sum_assignment

from fe_squeal import sweep
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.reduced.corners import softest_value

SIDE = 8  # masses along each side of a plate; of two plates, the second one softens


def plate(rng: np.random.Generator) -> np.ndarray:
    """Return the stiffness of masses in a grid with random springs between neighbours, held along one edge."""
    at = np.arange(SIDE**2).reshape(SIDE, SIDE)
    pairs = [(at[:-1], at[1:]), (at[:, :-1], at[:, 1:]), (at[:-1, :-1], at[1:, 1:])]
    K = np.zeros((SIDE**2, SIDE**2))
    for a, b in ((a.ravel(), b.ravel()) for a, b in pairs):
        k = rng.uniform(0.5, 1.5, len(a))
        np.add.at(K, (a, a), k), np.add.at(K, (b, b), k), np.add.at(K, (a, b), -k), np.add.at(K, (b, a), -k)
    return K + np.diag((np.arange(SIDE**2) < SIDE).astype(float))


def two_plates(seed: int) -> tuple[Problem, np.ndarray, np.ndarray, np.ndarray]:
    """Return a problem with K = A + B/p, and M, A and B (n, n): a plate and a contact that soften with p."""
    rng = np.random.default_rng(seed)
    h = SIDE**2
    A, B = np.zeros((2, 2 * h, 2 * h))
    A[:h, :h], B[h:, h:] = plate(rng), plate(rng)
    friction = np.zeros_like(A)
    for i in rng.choice(h, 20, replace=False):
        B[np.ix_([i, h + i], [i, h + i])] += 0.3 * np.array([[1, -1], [-1, 1]])
        j = (i + 1) % h
        friction[np.ix_([j, h + j], [i, h + i])] += 0.1 * np.array([[1, -1], [-1, 1]])
    M = np.diag(rng.uniform(0.5, 1.5, 2 * h))
    parts = [("mass", "M", M, True, {}), ("one", "K", A, True, {}), ("two", "K", B, True, {"p": -1}),
             ("friction", "K", friction, False, {"p": -1})]  # fmt: skip
    terms = tuple(Term(name, slot, sp.csr_array(X), symmetric, powers) for name, slot, X, symmetric, powers in parts)
    return Problem(terms, {"p": 1.0}), M, A, B + friction


def test_the_model_begins_where_motions_are_softest():
    problem = two_plates(1)[0]
    values = np.array([1.0, 3.0, 9.0])
    assert softest_value(problem, "p", values) == 9.0
    assert softest_value(problem, "p", -values[::-1]) == -1.0  # where −B has most weight
    assert softest_value(problem, "p", np.array([-1.0, 0.5, 9.0])) == 0.5


@pytest.mark.slow
@pytest.mark.parametrize("last", [30.0, 1000.0])
def test_errors_are_within_what_is_told(last):
    """The errors of a model that begins where the plates are stiff were up to 1 100 times what it told of them."""
    problem, M, A, B = two_plates(3)
    found = sweep(problem, np.geomspace(1.0, last, 4), "p", modes=10, tolerance=1e-6, method="reduced")
    for point in found.points:
        lam = point.modes.lam
        exact = 1j * np.sqrt(1 / la.eigvals(la.solve(A + B / point.value, M)).astype(complex))
        exact = np.where(exact.imag < 0, -exact, exact)
        _, nearest = linear_sum_assignment(np.abs(lam[:, None] - exact[None, :]))
        off = np.abs(lam - exact[nearest])
        assert (off <= 1e-6 * np.abs(lam)).all() and (off <= 3 * point.modes.re_uncertainty).all()
        highest = lam.imag.max()
        assert np.count_nonzero(exact.imag < highest * (1 - 1e-6)) == np.count_nonzero(lam.imag < highest * (1 - 1e-6))
