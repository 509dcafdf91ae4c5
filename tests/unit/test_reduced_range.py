"""How many modes a reduced model begins with, and where its range ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from chains import rising_oscillators, stiffening_chain

from fe_squeal import sweep
from fe_squeal.eigen.block_lanczos import lowest_modes
from fe_squeal.eigen.linear.choice import factorize_definite
from fe_squeal.eigen.request import Request
from fe_squeal.errors import NotConvergedError
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.reduced import ReducedModel


@pytest.mark.parametrize("lumped", [False, True])
@pytest.mark.parametrize("sigma", [-1e-8, -0.03])
def test_as_many_modes_as_the_mass_has_rank(lumped, sigma):
    """Of a mass without full rank no motions without mass come along, however many modes are asked for.

    Where unknowns have no mass, or three of them that of their mean alone.
    """
    n = 160
    M, K = np.eye(n), 3 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    if lumped:
        M[10:13, 10:13], M[40:43, 40:43] = 1 / 3, 1 / 3
    else:
        M[5::9, 5::9] = 0
    inverse = la.eigvals(la.solve(K, M)).real
    exact = np.sort(1 / inverse[inverse > 1e-10])
    M, K = sp.csr_array(M), sp.csr_array(K)
    theta, x = lowest_modes(factorize_definite(sp.csr_array(K - sigma * M)), M, sigma, n, 1e-4)
    np.testing.assert_allclose(theta, exact, rtol=1e-9)
    assert np.abs(K @ x - (M @ x) * theta).max() <= 1e-6
    model = ReducedModel(
        Problem((Term("m", "M", M, True, {}), Term("k", "K", K, True, {"mu": 1})), {"mu": 1.0}), "mu",
        np.array([1.0, 1.1]), Request(count=2 * n),
    )  # fmt: skip
    np.testing.assert_allclose(model.modes(1.1).lam.imag ** 2, 1.1 * exact, rtol=1e-8)


@pytest.mark.parametrize("count", [8, 30])
def test_frequencies_that_rise_leave_no_mode_out(count):
    """All stiffness grows tenfold, so that the modes asked for leave the range of those at the start."""
    meets = 8.0
    problem, theta = stiffening_chain(60, meets, {"p": 3})
    found = sweep(problem, np.linspace(1.0, 10.0, 10), "p", modes=count, method="reduced")
    assert [len(p.modes) for p in found.points] == [count] * 10 and not found.warnings
    assert [o.value for o in found.onsets] == [pytest.approx(meets, rel=1e-8)]
    assert [int(np.count_nonzero(p.modes.stability == "unstable")) for p in found.points] == [0] * 8 + [1] * 2
    alone = np.delete(theta[:count], [6, 7])
    for point in found.points:
        swing = np.sort(point.modes.lam.imag)
        exact = np.sqrt(point.value * alone)
        assert np.abs(swing[:, None] - exact[None, :]).min(axis=0).max() <= 1e-8 * exact.max()


def test_modes_above_the_range_of_the_start_do_not_count():
    """Of 21 modes at the start 15 rise past its highest one, 1.7, where others, which do not rise, are missing."""
    rising, still = 1 + 0.002 * np.arange(15), 1.2 + 0.1 * np.arange(31)
    problem = rising_oscillators(rising, still, {1: 1.0})
    for point in sweep(problem, np.linspace(1.0, 4.0, 7), "p", modes=10, method="reduced").points:
        exact = np.sort(np.append(rising * point.value**0.5, still))[:10]
        np.testing.assert_allclose(np.sort(point.modes.lam.imag), exact, rtol=1e-8)


def test_fewer_modes_than_are_asked_for_may_rise():
    """There are as many as masses; a wider range would have no others."""
    frequencies, masses = np.arange(1.0, 41.0), np.r_[np.ones(6), np.zeros(34)]
    problem = rising_oscillators(frequencies, np.zeros(0), {1: 1.0})
    mass = replace(problem.terms[0], matrix=sp.csr_array(sp.diags_array(masses)))
    found = sweep(Problem((mass, *problem.terms[1:]), {"p": 1.0}), [1.0, 4.0, 16.0], "p", modes=10, method="reduced")
    for point in found.points:
        np.testing.assert_allclose(np.sort(point.modes.lam.imag), frequencies[:6] * point.value**0.5, rtol=1e-8)


@pytest.mark.slow
def test_a_range_that_grows_too_far_is_left_to_direct_solves():
    """Stiffness that grows a million times would ask for all modes at the start."""
    n = 2400
    K = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n)).tocsr()
    push = sp.csr_array(([1e-9], ([0], [1])), shape=(n, n))
    terms = (Term("m", "M", sp.eye_array(n, format="csr"), True), Term("k", "K", K, True, {"p": 1}),
             Term("f", "K", push, False))  # fmt: skip
    problem, values = Problem(terms, {"p": 1.0}), [1.0, 1e3, 1e6]
    with pytest.raises(NotConvergedError, match=r"at p = .* the reduced model has fewer than 6 modes in the range"):
        sweep(problem, values, "p", modes=6, method="reduced")
    found = sweep(problem, [*values, 2e6, 3e6], "p", modes=6)
    assert [len(p.modes) for p in found.points] == [6] * 5
    assert [w for w in found.warnings if "solved directly at every value" in w]
