"""Sweeps with a value at which a mode diverges just there: λ = 0, and no eigenvalue to follow from or to it."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from scipy.stats import ortho_group

from fe_squeal import stability_map, sweep
from fe_squeal.errors import NotConvergedError
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.report.branches import collect_branches
from fe_squeal.report.growth import growth_curves
from fe_squeal.sweep import roots

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


def bisected(monkeypatch):
    """Let Newton's methods fail, so that every onset is found by bisection."""
    def fails(*_args, **_options):
        raise NotConvergedError("not today")

    for name in ("find_zero", "find_crossing", "find_coalescence"):
        monkeypatch.setattr(roots, name, fails)


def growth_at(problem, value, hz):
    """Re λ of the mode that grows with about a frequency, at one value."""
    point = sweep(problem, np.array([value, value + 1e-6]), "p", modes=12).points[0]
    growing = point.modes.lam[point.modes.lam.real > 0]
    return growing[np.argmin(np.abs(growing.imag - 2 * np.pi * hz))].real


@pytest.mark.parametrize("by", ["newton", "bisection"])
@pytest.mark.parametrize("kind", KINDS)
def test_growth_behind_an_onset_follows_its_law(kind, by, monkeypatch):
    """Flutter and divergence: c√d without dampers, gyroscopic forces or not, and c d with them, d behind the onset."""
    with monkeypatch.context() as patch:
        if by == "bisection":
            bisected(patch)
        onsets = sweep(chain(kind), np.array([0, 0.3, 0.8, 1.3]), "p", modes=8).onsets
    assert [o.kind for o in onsets] == ["flutter", "divergence"]
    for onset in onsets:
        assert onset.law == ("linear" if kind == "damped" else "root")
        true = growth_at(chain(kind), onset.value + 1e-5, onset.frequency_hz)
        assert onset.growth_within(1e-5) == pytest.approx(true, rel=0.1)  # a bisection measures a step's 1e-3 aside


def parting(kind):
    """A mode that grows from the start on: at p = 0.5 it becomes two that do not swing; all of them grow."""
    K, f, C = np.diag([1.0, 9.0]), np.diag([-1.5, 0.0]), np.diag([-1.0, 0.4])
    if kind == "undamped":  # θ = −1 ± √(p − 0.5)
        K, f = np.array([[-1.0, 0.5], [-1.0, -1.0]]), np.array([[0.0, 0.0], [2.0, 0.0]])
    terms = [Term("m", "M", sp.eye_array(2, format="csr"), True), Term("k", "K", sp.csr_array(K), False),
             Term("f", "K", sp.csr_array(f), False, {"p": 1})]  # fmt: skip
    if kind == "damped":
        terms.append(Term("c", "C", sp.csr_array(C), True))
    return Problem(tuple(terms), {"p": 0.0})


@pytest.mark.parametrize("by", ["newton", "bisection"])
@pytest.mark.parametrize("kind", ["undamped", "damped"])
def test_growing_modes_that_part_are_no_beginning_of_growth(kind, by, monkeypatch):
    """λ is 1 or 0.5 there, which no value of the new branch tells: the law says so, and no curve begins at zero."""
    if by == "bisection":
        bisected(monkeypatch)
    result = sweep(parting(kind), np.linspace(0, 0.6, 4), "p", modes=2)
    [onset] = result.onsets
    assert (onset.law, onset.direction) == ("parting", "into") and onset.value == pytest.approx(0.5, abs=1e-6)
    assert np.isnan(onset.crossing_speed) == (by == "bisection")
    branches = collect_branches(result.to_dataframe(), result.onsets_dataframe())
    [branch, *mirror] = [b for b in branches if b.passing.any()]
    at = int(np.flatnonzero(branch.passing)[0])
    assert branch.onset[at] == 0 and branch.unstable[at] and branch.grows and branch.peak == at + 1
    assert np.isnan(branch.re[at]) and branch.unstable_segments()[at] and branch.swings.all()
    assert not any((curve[:, 1] == 0).any() for curve in growth_curves(branch))
    assert len(mirror) == (kind == "undamped") and not any(b.grows for b in mirror)


@pytest.mark.parametrize("kind", ["undamped", "damped"])
def test_growing_modes_that_part_are_no_boundary_of_a_map(kind):
    """At every place of it something grows: θ = q − 1 ± √(p − 1/2), and λ² − λ + 1 − 3p/2 + q = 0."""
    problem = parting(kind)
    beside = Term("g", "K", sp.eye_array(2, format="csr"), True, {"q": 1})
    problem = Problem((*problem.terms, beside), {"p": 0.0, "q": 0.0})
    axes = ({"parameter": n, "from": 0.0, "to": high, "points": 4} for n, high in (("p", 0.6), ("q", 0.1)))
    found = stability_map(problem, *axes, modes=2)
    assert (found.grid["unstable"] > 0).all()
    assert found.told == [] and not len(found.boundaries)


def test_growth_goes_on_where_a_branch_parts_from_another():
    """Known on both sides, it is interpolated, and has no threshold at which it is zero."""
    modes = pd.DataFrame({
        "parameter": "mu", "value": [0.0, 0.4, 0.6, 1.0], "branch": 1, "re": [20.0, 30.0, 50.0, 60.0],
        "frequency_hz": [8.0, 2.0, 0.0, 0.0], "stability": "unstable", "re_uncertainty": 0.0,
    })  # fmt: skip
    onset = {"value": 0.5, "frequency_hz": 0.0, "kind": "divergence", "direction": "into", "crossing_speed": 9.0,
             "branch_a": 1, "branch_b": np.nan, "law": "parting"}  # fmt: skip
    [branch] = collect_branches(modes, pd.DataFrame([onset]))
    assert branch.re.tolist() == [20.0, 30.0, 40.0, 50.0, 60.0] and branch.unstable_segments().all()
    assert min(curve[:, 1].min() for curve in growth_curves(branch)) == 20.0
