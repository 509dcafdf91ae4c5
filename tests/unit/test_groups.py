"""Which eigenvalues of a step belong to one group, and the changes of stability of pairs that are left out of all."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

import fe_squeal
from fe_squeal.eigen.dense import solve_dense
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.sweep import bordered, newton
from fe_squeal.sweep.clusters import groups
from fe_squeal.sweep.nodes import node_of


def problem_of(*stiffnesses):
    """Return M = 1 with K = Σ pⁱ Kᵢ."""
    one = sp.csr_array(np.eye(len(stiffnesses[0])))
    terms = [Term(f"k{i}", "K", sp.csr_array(A), False, {"p": i} if i else {}) for i, A in enumerate(stiffnesses)]
    return Problem((Term("m", "M", one, True), *terms), {"p": 0.0})


def node(problem, value):
    modes = solve_dense(problem.pencil({"p": value}))
    return node_of(problem, "p", value, modes, (modes.right, modes.left))


def test_alike_shapes_of_modes_that_never_meet_make_no_group():
    """Triangular matrices: eigenvalues are on the diagonal, 10 % apart, and move by 1 %; right shapes are far from
    orthogonal."""
    rng = np.random.default_rng(5)
    theta = 1e8 * 1.1 ** np.arange(12)
    K = np.diag(theta) + np.triu(rng.uniform(0.5, 1.0, (12, 12)), 1) * 1e8
    problem = problem_of(K, np.diag(0.01 * theta))
    first, second = node(problem, 0.0), node(problem, 1.0)
    likeness = np.abs(first.right.conj().T @ second.right) ** 2
    assert np.count_nonzero(likeness - np.diag(likeness.diagonal()) > 0.3) > 12
    assert groups(first, second) == []


def window(centre, half):
    """Return a problem with (θ₁ − θ₂)²/4 = g²(half² − (p − centre)²): a growing pair but for |p − centre| < half."""
    w, g = 1e8, 1e5
    fixed = np.array([[w, g], [g * (half**2 - centre**2), w]])
    return problem_of(fixed, np.array([[0, 0], [2 * g * centre, 0]]), np.array([[0, 0], [-g, 0]]))


@pytest.mark.parametrize("centre", [0.13, 0.5, 0.77])
@pytest.mark.parametrize("half", [1e-1, 1e-3])
def test_a_pair_that_parts_and_meets_again_between_two_values_is_followed(centre, half):
    result = fe_squeal.sweep(window(centre, half), [0.0, 1.0], parameter="p", modes=2)
    assert [o.direction for o in result.onsets] == ["out of", "into"]
    found = np.array([o.value for o in result.onsets])
    np.testing.assert_allclose(found, [centre - half, centre + half], atol=1e-7)


def test_a_pair_far_from_meeting_is_left_out():
    """D = −g² − small changes: a pair that grows throughout. A third eigenvalue is far away."""
    K = np.array([[1e8, 1e6, 0], [-1e6, 1e8, 0], [0, 0, 9e8]])
    change = np.array([[1e3, 0, 0], [2e3, 0, 0], [0, 0, 0]])
    problem = problem_of(K, change)
    assert groups(node(problem, 0.0), node(problem, 1.0)) == []


def test_newton_on_full_arrays_is_newton_on_sparse_matrices(monkeypatch):
    rng = np.random.default_rng(2)
    turn = np.linalg.qr(rng.standard_normal((12, 12)))[0]
    fixed, moving = np.diag(1e8 * (1 + np.arange(12.0))), np.zeros((12, 12))
    moving[0, 1], moving[1, 0] = 1e8, -1e8  # θ = 1.5e8 ± ½√(1 − 4p²): they meet at p = 1/2
    problem = problem_of(turn @ fixed @ turn.T, turn @ moving @ turn.T)
    x, y = turn @ np.r_[1.0, 0.8, np.zeros(10)], turn @ np.r_[1.0, -0.8, np.zeros(10)]
    roots = []
    for full in (bordered._FULL, 0):
        monkeypatch.setattr(bordered, "_FULL", full)
        roots.append(newton.find_coalescence(problem, "p", 0.49, 1.5e8, x, y, 0.1))
    for root in roots:
        assert root.value == pytest.approx(0.5, abs=1e-9)
        assert root.theta == pytest.approx(1.5e8, rel=1e-9)
        assert root.coefficient_sign == 1
    assert roots[0].coefficient == pytest.approx(roots[1].coefficient, rel=1e-8)
