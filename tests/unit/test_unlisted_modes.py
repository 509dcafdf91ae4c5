"""Steps whose ends do not list the modes that decay and hardly swing, as solvers of overdamped problems do not."""

import numpy as np
import scipy.sparse as sp

from fe_squeal.eigen.dense import solve_dense
from fe_squeal.eigen.pencil import Modes
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.sweep.onsets import find_step_onsets
from fe_squeal.sweep.step import Step

_ENDS = (0.0, 1.0)


def _problem(dip: float) -> Problem:
    """Return a mode that swings, one that creeps, and one that hardly swings.

    The stiffness of the second is 1 − dip·p²(1 − p)², of which the ends have neither value nor slope.
    """
    terms = [
        Term("m", "M", sp.eye_array(3, format="csr"), True),
        Term("k", "K", sp.csr_array(np.diag([30.0, 1.0, 2.0])), True),
        Term("c", "C", sp.csr_array(np.diag([0.1, 10.0, 2.5])), True),
    ]  # fmt: skip
    for power, factor in ((2, -1.0), (3, 2.0), (4, -1.0)):
        terms.append(Term(f"k{power}", "K", sp.csr_array(np.diag([0.0, dip * factor, 0.0])), True, {"p": power}))
    return Problem(tuple(terms), {"p": 0.0})


def _swinging(modes: Modes) -> Modes:
    return modes.select(np.flatnonzero(modes.lam.imag > -modes.lam.real))


def _ends(problem: Problem) -> tuple[Modes, Modes]:
    first, second = (solve_dense(problem.pencil({"p": p})) for p in _ENDS)
    return first, second


def test_between_ends_that_list_swinging_modes_alone_these_and_growing_ones_are_listed() -> None:
    problem = _problem(dip=32.0)
    whole = _ends(problem)
    part = (_swinging(whole[0]), _swinging(whole[1]))
    assert len(part[0]) == 1 and len(whole[0]) == 4
    lam = Step(problem, "p", _ENDS, part, None, "auto").listed(0.5).lam
    assert sorted(np.round(lam[lam.imag >= 0].imag, 3)) == [0.0, 5.477]  # √(30 − 0.05²)
    assert lam.real.max() > 0  # the one that does not swing grows
    all_of_them = Step(problem, "p", _ENDS, whole, None, "auto")
    np.testing.assert_array_equal(all_of_them.listed(0.5).lam, all_of_them.between(0.5).lam)
    assert len(all_of_them.listed(0.5)) > len(lam)


def test_onsets_of_a_mode_that_is_not_listed_at_the_ends() -> None:
    """It creeps there, and grows where its stiffness is negative half way: p(1 − p) = 1/√32."""
    for dip, exact in ((32.0, np.sort(np.roots([1, -1, 1 / 32**0.5]).real)), (8.0, np.zeros(0))):
        problem = _problem(dip)
        first, second = _ends(problem)
        modes = (_swinging(first), _swinging(second))
        found = find_step_onsets(problem, "p", _ENDS, modes, (np.array([1]), np.array([1])), 6.0)
        np.testing.assert_allclose(sorted(o.value for o in found.onsets), exact, rtol=1e-9)
        assert not found.warnings and not found.missing


def test_both_of_a_gyroscopic_pair_are_listed_that_grows_faster_than_it_swings() -> None:
    """λ² = k − g²/2 ± g√(g²/4 − k) of two unstable springs −k, coupled by a gyroscopic force g < 2√k: ±λ and ±λ*."""
    g, k = 0.5, 4.0
    spin = sp.csr_array(np.array([[0.0, g], [-g, 0.0]]))
    terms = (
        Term("m", "M", sp.eye_array(2, format="csr"), True),
        Term("k", "K", sp.csr_array(-k * np.eye(2)), True),
        Term("g", "C", spin, False, skew=True),
        Term("p", "K", sp.eye_array(2, format="csr"), True, {"p": 1}),
    )
    problem = Problem(terms, {"p": 0.0})
    ends = _ends(problem)
    first, second = (modes.select(np.flatnonzero(modes.lam.real > 0)) for modes in ends)
    lam = Step(problem, "p", _ENDS, (first, second), None, "auto").listed(0.5).lam
    root = np.sqrt(k - 0.5 - g**2 / 2 + g * np.sqrt(g**2 / 4 - (k - 0.5) + 0j))
    assert abs(root.real) > abs(root.imag)
    expected = np.array([s * x for s in (1, -1) for x in (root, root.conjugate())])
    np.testing.assert_allclose(np.sort_complex(lam), np.sort_complex(expected), rtol=1e-9)
