"""Nodes very near to known ones, and Newton's method that ends when a root is certain enough."""

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal.eigen.dense import solve_dense
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.sweep.balance import Census
from fe_squeal.sweep.newton import find_coalescence
from fe_squeal.sweep.step import Step

_N = 8
_ASIDE = 1e-5


def _problem(damped: bool) -> Problem:
    """Return a problem whose lowest two modes flutter from p = 1 on without dampers: θ = 2 ± √(1 − p²)."""
    pair = np.zeros((_N, _N))
    pair[0, 1], pair[1, 0] = 1.0, -1.0
    stiffness = np.diag([1.0, 3.0, *np.linspace(5.0, 20.0, _N - 2)])
    terms = [
        Term("mass", "M", sp.csr_array(np.eye(_N)), True), Term("springs", "K", sp.csr_array(stiffness), True),
        Term("friction", "K", sp.csr_array(pair), False, {"p": 1}),
    ]  # fmt: skip
    if damped:
        rough = np.random.default_rng(3).standard_normal((_N, _N))
        terms.append(Term("damper", "C", sp.csr_array(0.01 * rough @ rough.T / _N), True))
    return Problem(tuple(terms), {"p": 0.0})


def _step(damped: bool) -> Step:
    problem, ends = _problem(damped), (0.5, 1.5)
    modes = tuple(solve_dense(problem.pencil({"p": p})) for p in ends)
    return Step(problem, "p", ends, (modes[0], modes[1]), None, "auto")


@pytest.mark.parametrize("damped", [False, True])
def test_a_moved_node_has_the_eigenvalues_of_its_own_value(damped: bool) -> None:
    """Nothing is left out of a basis of all modes, so that only rounding near the double eigenvalue remains."""
    step = _step(damped)
    for start in (0.7, 1 - _ASIDE, 1.3):
        moved, own = step.between(start).moved(start + 2 * _ASIDE), step.between(start + 2 * _ASIDE)
        assert moved is not None
        assert np.abs(moved.v[:, None] - own.v[None, :]).min(axis=1).max() <= 1e-10
        assert np.abs(moved.v[:, None] - own.v[None, :]).min(axis=0).max() <= 1e-10
        assert len(Census.of_node(moved).lam) == len(Census.of_node(own).lam)


def test_a_moved_node_shows_the_onset_between() -> None:
    """One mode grows behind p = 1 and none before, whichever side the modes were solved for on."""
    step = _step(damped=False)
    before, behind = step.between(1 - _ASIDE), step.between(1 + _ASIDE)
    pairs = (before, before.moved(1 + _ASIDE)), (behind.moved(1 - _ASIDE), behind)
    for first, second in pairs:
        assert first is not None and second is not None
        assert [len(Census.of_node(n).lam) for n in (first, second)] == [0, 1]


def test_a_moved_node_counts_growing_modes_that_are_real() -> None:
    """Divergence with dampers: rounding of complex modes leaves no imaginary part, on which side it may be."""
    terms = (*_problem(damped=True).terms, Term("load", "K", sp.csr_array(np.diag([-1.0] * _N)), True, {"p": 4}))
    problem, ends = Problem(terms, {"p": 0.0}), (1.9, 2.0)  # θ of the springs up to 11 is below the load
    modes = tuple(solve_dense(problem.pencil({"p": p})) for p in ends)
    step = Step(problem, "p", ends, (modes[0], modes[1]), None, "auto")
    for start in (1.91, 1.95):
        moved = step.between(start).moved(start + 2 * _ASIDE)
        own = step.between(start + 2 * _ASIDE)
        growing = Census.of_node(own).lam
        assert moved is not None
        assert np.count_nonzero(growing.imag == 0) >= 3
        assert len(Census.of_node(moved).lam) == len(growing)


def test_newton_ends_as_soon_as_a_root_is_certain_enough() -> None:
    """The last step is the uncertainty; the root is far nearer, since Newton's method converges quadratically."""
    x, y = (np.eye(_N)[0] + sign * np.eye(_N)[1] for sign in (1, -1))
    rough, fine = (
        find_coalescence(_problem(damped=False), "p", 1.0001, 2.0, x, y, 0.1, enough=enough) for enough in (1e-2, 0.0)
    )
    assert abs(fine.value - 1) <= fine.uncertainty + 1e-12
    assert fine.uncertainty < 1e-9 < rough.uncertainty < 1e-2
    assert abs(rough.value - 1) <= 0.1 * rough.uncertainty
