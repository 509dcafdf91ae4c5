"""Sweeps with a value at which a mode diverges just there: λ = 0, and no eigenvalue to follow from or to it."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from scipy.stats import ortho_group

from fe_squeal import sweep
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term

KINDS = ("undamped", "damped", "gyroscopic")
_DAMPING = 0.05


def chain(kind: str, met: float = 0.5, n: int = 12) -> Problem:
    """θ = 10, 20, … of unit masses, turned; at p = 1 the first is zero, at `met` the fifth and sixth meet."""
    Q = ortho_group.rvs(n, random_state=1)
    moved = np.zeros((n, n))
    moved[0, 0], moved[4, 5], moved[5, 4] = -10.0, 5.0 / met, -5.0 / met

    def turned(A: np.ndarray) -> sp.csr_array:
        return sp.csr_array(Q @ A @ Q.T)

    springs = np.diag(10.0 * np.arange(1, n + 1))
    terms = [
        Term("m", "M", sp.csr_array(np.eye(n)), True), Term("k", "K", turned(springs), True),
        Term("f", "K", turned(moved), False, {"p": 1}),
    ]  # fmt: skip
    if kind == "damped":
        terms.append(Term("c", "C", sp.csr_array(_DAMPING * np.eye(n)), True))
    if kind == "gyroscopic":  # where K is singular does not depend on it
        G = np.zeros((n, n))
        G[0, 2], G[7, 8] = 0.3, 0.5
        terms.append(Term("g", "C", turned(G - G.T), False, skew=True))
    return Problem(tuple(terms), {"p": 0.0})


def flutter(kind: str, met: float = 0.5) -> float:
    """With λ = iω: ω² = 55, and 5 √((p/met)² − 1) = cω."""
    c = _DAMPING if kind == "damped" else 0.0
    return met * np.sqrt(1 + 55 * c**2 / 25)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "values", [[0, 1, 2], [0, 0.5, 1, 1.5, 2], [0, 0.3, 1, 1.1], [0, 0.9, 1.1], [0, 0.99, 1, 1.01]]
)
def test_a_value_inside_the_sweep(kind, values):
    result = sweep(chain(kind), np.array(values, float), "p", modes=8)
    first, second = result.onsets
    assert not result.warnings
    for onset, value, frequency in (first, flutter(kind), np.sqrt(55) / (2 * np.pi)), (second, 1.0, 0.0):
        assert abs(onset.value - value) <= onset.uncertainty + 1e-12 and onset.uncertainty < 1e-6
        assert onset.direction == "into"
        assert onset.kind == ("flutter" if frequency else "divergence")
        assert onset.frequency_hz == pytest.approx(frequency, rel=1e-4)
    assert [point.value for point in result.points] == values
    count = [int(np.sum(point.modes.stability == "unstable")) for point in result.points]
    assert count == [int(p > flutter(kind)) + int(p > 1) for p in values]
    # One branch has λ = 0 at p = 1, and it is the one that diverges.
    for point in result.points:
        if point.value == 1:
            assert point.branches[point.modes.lam == 0].tolist() == [second.branch_a]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("met", [0.5, 0.98])
def test_the_last_value(kind, met):
    """Whether the mode grows is not known, and that is said; an onset close before it is found."""
    result = sweep(chain(kind, met), np.array([0, 0.25, 0.75, 1]), "p", modes=8)
    (onset,) = result.onsets
    assert onset.kind == "flutter" and abs(onset.value - flutter(kind, met)) <= onset.uncertainty + 1e-12
    (warning,) = result.warnings
    assert "1 of the modes has λ = 0 at p = 1, the last value" in warning
    assert "not looked for between 0.999975 and 1" in warning
    assert result.unsettled == (warning,)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("met", [0.5, 1.02])
def test_the_first_value(kind, met):
    """An onset close behind it is found; there is none where the mode diverges."""
    result = sweep(chain(kind, met), np.array([1, 1.5, 2]), "p", modes=8)
    assert [o.kind for o in result.onsets] == ["flutter"] * (met > 1)
    assert all(abs(o.value - flutter(kind, met)) <= o.uncertainty + 1e-12 for o in result.onsets)
    assert [int(np.sum(point.modes.stability == "unstable")) for point in result.points] == [int(met < 1), 2, 2]
    (warning,) = result.unsettled
    assert "1 of the modes has λ = 0 at p = 1, the first value" in warning
    assert "not looked for between 1 and 1.00005" in warning


@pytest.mark.parametrize("method", ["direct", "reduced"])
def test_a_spring_whose_stiffness_begins_at_zero(method):
    """What nothing holds at the first value swings at all others: nothing about onsets is left open."""
    n = 40
    k = np.append(0.0, np.append(np.exp(np.random.default_rng(1).uniform(0, 3, n - 1)), 0.0))
    K = sp.csr_array(sp.diags_array([k[:-1] + k[1:], -k[1:-1], -k[1:-1]], offsets=[0, 1, -1]))
    spring = sp.csr_array(([1.0], ([3], [3])), shape=(n, n))
    terms = (
        Term("m", "M", sp.csr_array(sp.eye_array(n)), True), Term("k", "K", K, True),
        Term("s", "K", spring, True, {"s": 1}),
    )  # fmt: skip
    result = sweep(Problem(terms, {"s": 0.0}), np.array([0.0, 0.5, 1.0]), "s", modes=6, method=method)
    assert not result.onsets and not result.unsettled
    for point in result.points:
        exact = np.sqrt(np.maximum(la.eigvalsh(K.toarray() + point.value * spring.toarray())[:6], 0.0))
        np.testing.assert_allclose(point.modes.lam.imag, exact, rtol=1e-8, atol=1e-6)
        assert point.branches.tolist() == list(range(1, 7))


def test_free_motions_are_no_critical_values():
    """Two bodies that nothing holds have λ = 0 at every value."""
    K = sp.csr_array(np.kron(np.array([[1.0, -1.0], [-1.0, 1.0]]), np.diag([1.0, 2.0])))
    terms = (Term("m", "M", sp.csr_array(np.eye(4)), True), Term("k", "K", K, True, {"p": 1}))
    result = sweep(Problem(terms, {"p": 1.0}), np.array([1.0, 1.5, 2.0]), "p", modes=4)
    assert not result.onsets and not result.unsettled
    (warning,) = result.warnings
    assert "rigid motions of frequency 0" in warning


def line(kind: str, seed: int, n: int = 40) -> Problem:
    """A chain of springs, some of which turn soft with p; the damped one has overdamped modes of any |λ|."""
    rng = np.random.default_rng(seed)
    k = np.exp(rng.uniform(0, 3, n + 1))
    K = sp.csr_array(sp.diags_array([k[:-1] + k[1:], -k[1:-1], -k[1:-1]], offsets=[0, 1, -1]))
    patch = np.zeros((n, n))
    at = n // 3 + np.arange(6)
    patch[at, at] = -1.0 - 0.3 * np.arange(6)
    patch[at[:-1], at[1:]], patch[at[1:], at[:-1]] = 0.4, -0.3
    terms = [
        Term("m", "M", sp.csr_array(sp.diags_array(rng.uniform(0.5, 1.5, n))), True), Term("k", "K", K, True),
        Term("f", "K", sp.csr_array(patch), False, {"p": 1}),
    ]  # fmt: skip
    if kind == "damped":
        terms.append(Term("c", "C", sp.csr_array(0.01 * K), True))
    if kind == "gyroscopic":
        G = sp.diags_array([np.full(n // 2, 0.05)], offsets=[n // 2], shape=(n, n))
        terms.append(Term("g", "C", sp.csr_array(G - G.T), False, skew=True))
    return Problem(tuple(terms), {"p": 0.0})


@pytest.mark.parametrize("method", ["direct", "reduced"])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_a_value_that_is_critical_up_to_rounding(kind, seed, method):
    """det K changes its sign there: λ is zero, or so small that rounding says whether it is real."""
    problem = line(kind, seed)
    K, change = (next(t for t in problem.terms if t.name == name).matrix.toarray() for name in "kf")
    theta = la.inv(K) @ -change  # K + p change is singular where 1/p is one of its eigenvalues
    critical = 1 / max(v.real for v in la.eigvals(theta) if v.imag == 0)
    result = sweep(problem, np.array([0, critical / 2, critical, 1.5 * critical]), "p", modes=6, method=method)
    (found,) = [o for o in result.onsets if o.kind == "divergence"]
    assert abs(found.value - critical) <= found.uncertainty + 1e-12 * critical
    assert found.direction == "into"
    assert all("came into the range" in w for w in result.warnings)  # the seventh mode, which grows from p = 0 on
