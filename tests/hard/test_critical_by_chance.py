"""Equal gyroscopic parts at just the value of the parameter, or within rounding of it, at which they lose stability."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from selection import some

import fe_squeal
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term

FIRST, SECOND = 1.05, 1.25


def turning_parts(parts: int, stiffer: float = 0.0) -> Problem:
    """Return M = 1, G = 2 [[0, 1], [−1, 0]], K = diag(1.05 − p, 1.25 − p) of each part, the constants 1 + `stiffer`
    times as large. Each diverges between the two values."""
    turning = np.kron(np.eye(parts), [[0.0, 2.0], [-2.0, 0.0]])
    terms = [Term("m", "M", sp.eye_array(2 * parts, format="csr"), True),
             Term("k", "K", sp.diags_array(np.tile([FIRST, SECOND], parts) * (1 + stiffer)).tocsr(), True),
             Term("soft", "K", sp.csr_array(-np.eye(2 * parts)), True, {"p": 1}),
             Term("g", "C", sp.csr_array(turning), False, skew=True)]  # fmt: skip
    return Problem(tuple(terms), {"p": 0.0})


@pytest.mark.parametrize("parts", [1, 2, 3, 4, 6])
@pytest.mark.parametrize("away", [0.0, 2.2e-16, -2.2e-16, 1e-15, -1e-15, 1e-14, -1e-14, 1e-10, -1e-10])
def test_modes_where_stiffness_is_all_rounding(parts, away):
    """(λ² + k)(λ² + 0.2) + 4λ² = 0 with k of some roundings: λ² = −k/21 but for k², once for each part."""
    pencil = turning_parts(parts).at({"p": FIRST + away}).pencil()
    k = pencil.K.diagonal()[0]
    modes = solve_modes(pencil, Request(count=2 * parts))
    assert modes.backward_error.max() <= (1e-12 if parts < 6 else 1e-8)
    slow = modes.lam[np.abs(modes.lam) < 1]
    exact = np.sqrt(complex(-k / 21))
    expected = [exact, -exact] if k < 0 else [exact]  # of a pair ±iω the one above the axis is listed
    expected = np.repeat(expected, parts)
    assert len(slow) == len(expected)
    for value in expected:
        assert np.abs(slow - value).min() <= 1e-6 * abs(value)
    assert [np.count_nonzero(np.abs(slow - v) <= 1e-6 * abs(v)) for v in expected] == [parts] * len(expected)
    fast = modes.lam[np.abs(modes.lam) >= 1]
    assert np.abs(fast - 1j * 4.2**0.5).max() < 1e-9
    assert modes.re_uncertainty[np.abs(modes.lam) >= 1].max() < 1e-12


@pytest.mark.parametrize("stiffer", [0.0, 1e-16, 2e-16, -2e-16, 1e-15, -1e-15])
@pytest.mark.parametrize(
    ("method", "parts"),
    some([("direct", 1), ("direct", 2), ("direct", 3), ("direct", 4), ("direct", 6), ("reduced", 1), ("reduced", 2),
          ("reduced", 3)], lambda *case: case in [("direct", 2), ("reduced", 1)]),
)  # fmt: skip
def test_onsets_at_values_of_the_sweep(method, parts, stiffer):
    """A value of the sweep that is critical, or the middle of a step, hides no onset of any of the parts."""
    for values in (np.array([0.0, 0.5, FIRST, SECOND, 2.0, 3.0]), np.linspace(0, 2 * FIRST, 3),
                   np.linspace(0, 2 * SECOND, 3), np.linspace(0, 3, 11)):  # fmt: skip
        result = fe_squeal.sweep(turning_parts(parts, stiffer), values, "p", modes=2 * parts, method=method)
        for critical in (FIRST, SECOND):
            there = [o for o in result.onsets if abs(o.value - critical) <= 1e-6]
            assert [o.direction for o in there] == ["into" if critical == FIRST else "out of"] * parts
            assert all(abs(o.value - critical) <= o.uncertainty + 1e-14 for o in there)
