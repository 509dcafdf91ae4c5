"""Scatter of two modes with gap δ and coupling μ, unstable where δ < 2μc: verdicts, probability and Sobol indices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.stats import binom

from fe_squeal.errors import SceneError
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.scene.study import Distribution
from fe_squeal.study.indices import first_order, total_order
from fe_squeal.study.points import Scatter, quantiles, sobol_points
from fe_squeal.study.scatter import scatter
from fe_squeal.study.solving import TRAINED, Solving
from tests.studies import STIFFNESS, two_modes

UNIFORM = {"mu": {"uniform": {"low": 0.0, "high": 0.1}}, "delta": {"uniform": {"low": 0.0, "high": 0.3}}}


@pytest.fixture(scope="module")
def result():
    return scatter(two_modes(), UNIFORM, samples=512, seed=3)


def test_every_verdict_is_that_of_the_closed_form(result):
    mu, delta = result.points.T
    exact = delta < 2 * mu
    grows = np.sqrt(STIFFNESS * (1 + delta / 2 + 1j * np.sqrt(np.maximum(mu**2 - delta**2 / 4, 0.0)))).imag
    frame = result.samples
    assert (frame["unstable"].to_numpy() == exact).all()
    assert frame["worst_re"].to_numpy() == pytest.approx(grows, rel=1e-6, abs=1e-6)
    assert list(frame.columns[:3]) == ["sample", "mu", "delta"]


def test_verdicts_of_two_damped_modes_are_those_of_the_hopf_curve():
    """With C = c √k modes grow where μ² − δ²/4 > c² (1 + δ/2)."""
    c = 0.02
    found = scatter(two_modes(damping=c), UNIFORM, samples=256, indices=False)
    mu, delta = found.points.T
    exact = mu**2 - delta**2 / 4 > c**2 * (1 + delta / 2)
    assert (found.samples["unstable"].to_numpy() == exact).all() and 0.2 < exact.mean() < 0.4
    theta = 1 + delta / 2 + 1j * np.sqrt((mu**2 - delta**2 / 4).astype(complex))
    grows = np.sqrt(STIFFNESS) * np.abs((-c + np.sqrt(c**2 - 4 * theta + 0j)).real) / 2
    assert found.samples["worst_re"].to_numpy()[exact] == pytest.approx(grows[exact], rel=1e-6)


def test_probability_lies_in_its_interval_and_is_nearly_exact(result):
    exact = 1 / 3  # of the rectangle 0.1 × 0.3 the triangle δ < 2μ has 0.1 · 0.2 / 2
    band = result.bands.iloc[-1]
    assert band["lower"] < exact < band["upper"]
    assert band["probability"] == pytest.approx(exact, abs=0.01)  # Sobol points: far less than 1/√512
    assert band["upper"] - band["lower"] < 0.1


def test_sobol_indices_are_those_of_the_closed_form(result):
    """Y = 1 where δ < 2μ: E[Y|μ] = 2μ/0.3, E[Y|δ] = 1 − δ/0.2 or 0; variances by integration."""
    mean = 1 / 3
    variance = mean * (1 - mean)
    by_mu = (2 / 3) ** 2 / 3 - mean**2
    by_delta = (0.2 / 0.3) / 3 - mean**2
    first = {"mu": by_mu / variance, "delta": by_delta / variance}
    total = {"mu": 1 - first["delta"], "delta": 1 - first["mu"]}
    rows = result.indices
    assert set(rows["output"]) >= {"unstable", "worst_re"}
    for row in rows[rows["output"] == "unstable"].to_dict("records"):
        assert row["first"] == pytest.approx(first[row["parameter"]], abs=1.5 * row["first_error"])
        assert row["total"] == pytest.approx(total[row["parameter"]], abs=1.5 * row["total_error"])
        assert 0.01 < row["first_error"] < 0.15 and 0.01 < row["total_error"] < 0.15


def test_indices_of_correlated_numbers():
    """Y = a + b with correlation r: Var(E[Y|a]) = (1 + r)², Var(Y) = 2 + 2r, E[Var(Y|b)] = 1 − r²."""
    r = 0.6
    tables = {n: Distribution.model_validate({"normal": {"mean": 0.0, "deviation": 1.0}}) for n in "ab"}
    whole = Scatter.of(tables, [("a", "b", r)])
    z = whole.normals(sobol_points(8192, 2, 4))
    changed = whole.redrawn(z, 0, np.random.default_rng(5).random(8192))
    first, total = first_order(z[:, 0], z.sum(axis=1)), total_order(z.sum(axis=1), changed.sum(axis=1))
    assert np.corrcoef(z.T)[0, 1] == pytest.approx(r, abs=0.01)
    assert first[0] == pytest.approx((1 + r) / 2, abs=0.02)
    assert total[0] == pytest.approx((1 - r) / 2, abs=0.02)


def test_distributions_have_the_quantiles_that_they_promise():
    u = (np.arange(200_000) + 0.5) / 200_000
    normal = {"mean": 1.0, "deviation": 0.5, "low": 0.5, "high": 2.0}
    cut = quantiles(Distribution.model_validate({"normal": normal}), u)
    assert cut.min() >= 0.5 and cut.max() <= 2.0
    assert cut.mean() == pytest.approx(1 + 0.5 * 0.22964, abs=1e-4)  # (φ(−1) − φ(2)) / (Φ(2) − Φ(−1)) = 0.22964
    wide = quantiles(Distribution.model_validate({"lognormal": {"median": 3.0, "factor": 1.5}}), u)
    assert np.mean((wide > 2.0) & (wide < 4.5)) == pytest.approx(0.6827, abs=1e-3)
    angle = quantiles(Distribution.model_validate({"triangular": {"low": 0.0, "mode": 1.0, "high": 4.0}}), u)
    assert angle.mean() == pytest.approx(5 / 3, abs=1e-4)
    assert np.mean(angle < 1.0) == pytest.approx(0.25, abs=1e-4)


def test_every_place_lies_in_the_box_of_the_model(monkeypatch):
    """The softest corner of the box is what the estimated errors rest on; no place may be beyond it."""
    seen = []

    class Watched(Solving):
        def __init__(self, problem, names, low, high, draw, **options):
            super().__init__(problem, names, low, high, draw, **options)
            seen.extend([low, high, *draw(0), *draw(1)])

        def places(self, stage, places):
            seen.extend(places)
            return super().places(stage, places)

    monkeypatch.setattr("fe_squeal.study.scatter.Solving", Watched)
    normal = {name: {"normal": {"mean": 0.2, "deviation": 0.02}} for name in ("mu", "delta")}
    scatter(two_modes(), normal, samples=16)
    low, high, *places = seen
    assert len(places) == 2 * TRAINED + 16 + 2 * 16
    assert (low <= np.array(places)).all() and (np.array(places) <= high).all()


def test_samples_do_not_depend_on_how_many_there_are(result):
    again = scatter(two_modes(), UNIFORM, samples=100, seed=3, indices=False)
    assert (again.points == result.points[:100]).all()
    assert np.isnan(again.indices["total"]).all() and np.isfinite(again.indices["first"]).all()


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"nu": {"uniform": {"low": 0.0, "high": 1.0}}}, "no parameter"),
        ({"mu": {"uniform": {"low": 1.0, "high": 0.5}}}, "low < high"),
        ({"mu": {"normal": {"mean": 0.3, "deviation": -1.0}}}, "deviation"),
        ({"mu": {"uniform": {"low": 0.0, "high": 1.0}, "values": [1.0, 2.0]}}, "one of"),
        ({"unused": {"uniform": {"low": 1.0, "high": 2.0}}}, "nothing in the problem depends"),
    ],
)
def test_bad_input_is_told(parameters, message):
    problem = two_modes()
    problem = type(problem)(problem.terms, {**problem.parameters, "unused": 1.0})
    with pytest.raises(SceneError, match=message):
        scatter(problem, parameters, samples=16)


@pytest.mark.parametrize("name", ["sample", "error", "method", "unstable_modes"])
def test_parameters_are_not_named_like_other_columns(name):
    """Before anything is solved: a table has no two columns of one name, and none is lost."""
    named = [replace(term, powers={name: 1} if term.powers else {}) for term in two_modes().terms]
    with pytest.raises(SceneError, match=f'given "{name}", which samples.csv has a column of its own for'):
        scatter(Problem(tuple(named), {name: 0.1}), {name: UNIFORM["mu"]}, 8, progress=lambda *_: pytest.fail("solved"))


def test_correlations_that_contradict_each_other_are_refused():
    tables = {n: {"normal": {"mean": 0.1, "deviation": 0.01}} for n in ("mu", "delta")}
    three = {**{n: Distribution.model_validate(t) for n, t in tables.items()}}
    three["c"] = three["mu"]
    with pytest.raises(SceneError, match="contradict"):
        Scatter.of(three, [("mu", "delta", 0.9), ("delta", "c", 0.9), ("mu", "c", -0.9)])


# Of 60 intervals that hold the truth with a probability of 95 %, fewer do once in a million times. Of intervals half as
# long, which hold it with 67 %, fewer do nine times in ten.
SURE = binom.ppf(1e-6, 60, 0.95) / 60
FAMILIES = {
    "linear": (0.8, lambda x: 2 * x[:, 0] + x[:, 1]),
    "without influence": (0.0, lambda x: x[:, 1]),
    "threshold at the end": (1.0, lambda x: x[:, 0] > 0.9),
    "steep": (1.0, lambda x: np.sin(40 * x[:, 0])),
    "two thresholds": (0.3 * 0.7 * 0.25 / (0.15 * 0.85), lambda x: (x[:, 0] < 0.3) & (x[:, 1] < 0.5)),
    "twenty values": (1.0, lambda x: np.sin(7 * np.floor(20 * x[:, 0]))),
}


@pytest.mark.parametrize("points", ["sobol", "independent"])
@pytest.mark.parametrize("kind", FAMILIES)
def test_intervals_of_first_order_indices_hold_the_truth(kind, points):
    """As often as 95 % intervals should, for smooth, steep, rare and discrete results alike.

    Sobol points that are neighbours in one number are far apart in the others.
    """
    true, y = FAMILIES[kind]
    held, widths = [], []
    for seed in range(60):
        x = np.random.default_rng([seed, 11]).random((600, 2)) if points != "sobol" else sobol_points(600, 2, seed)
        index, error = first_order(x[:, 0], y(x).astype(float))
        held.append(abs(index - true) <= error)
        widths.append(error)
    assert sum(held) >= SURE * len(held) and np.mean(widths) < 0.2


@pytest.mark.parametrize("kind", FAMILIES)
def test_first_order_indices_of_many_sobol_points_are_sharp(kind):
    true, y = FAMILIES[kind]
    x = sobol_points(4096, 3, 9)
    index, error = first_order(x[:, 0], y(x).astype(float))
    assert abs(index - true) <= error < 0.06


def test_a_first_order_index_of_a_few_samples_is_not_known():
    x = np.random.default_rng(3).random(1000)
    assert np.isnan(first_order(x, (x > 0.99).astype(float))).all()


TOTALS = {"linear": 0.8, "without influence": 0.0, "threshold at the end": 1.0, "steep": 1.0,
          "two thresholds": 0.3 * 0.7 * 0.5 / (0.15 * 0.85), "twenty values": 1.0}  # fmt: skip


@pytest.mark.parametrize("kind", FAMILIES)
def test_intervals_of_total_indices_hold_the_truth(kind):
    """As often as 95 % intervals should, rare results among them."""
    y, held = FAMILIES[kind][1], []
    for seed in range(60):
        x, changed = sobol_points(600, 2, seed), np.random.default_rng([seed, 12]).random((600, 1))
        index, error = total_order(y(x).astype(float), y(np.hstack([changed, x[:, 1:]])).astype(float))
        held.append(abs(index - TOTALS[kind]) <= error)
    assert sum(held) >= SURE * len(held)


def test_a_total_index_of_a_few_samples_is_not_known():
    """Where one of many is unstable, and none or one of those drawn anew, the index is 0 or 1, whatever the truth."""
    x, new = np.random.default_rng(3).random((2, 128))
    for above in (1.0, 0.99, 0.93):
        y = (x > 1 - 1e-9 - (x == x.max())).astype(float)
        assert y.sum() == 1 and np.isnan(total_order(y, (new > above).astype(float))).all()
    assert np.isfinite(total_order((x > 0.8).astype(float), (new > 0.8).astype(float))).all()


def test_samples_without_modes_leave_the_indices_of_the_others():
    """Y = 2 X1 + X2 has the index 0.8 of X1, whichever samples have no Y."""
    rng = np.random.default_rng(4)
    x, new, missing = rng.random((2000, 2)), rng.random(2000), rng.random((2, 2000)) < 0.1
    y = np.where(missing[0], np.nan, 2 * x[:, 0] + x[:, 1])
    changed = np.where(missing[1], np.nan, 2 * new + x[:, 1])
    for index, error in (first_order(x[:, 0], y), total_order(y, changed)):
        assert abs(index - 0.8) < error < 0.1
    assert np.isnan([first_order(x[:, 0], np.full(2000, np.nan)), total_order(np.full(2000, np.nan), changed)]).all()


def test_growth_in_a_range_that_some_samples_have_no_mode_in():
    """The lower one of the two modes has Im λ = Re √θ with θ = k (1 + δ/2 − √(δ²/4 − μ²))."""
    found = scatter(two_modes(), UNIFORM, samples=256, max_frequency=1640.0)
    mu, delta = found.points.T
    theta = STIFFNESS * (1 + delta / 2 - np.sqrt(delta**2 / 4 - mu**2 + 0j))
    empty = np.isnan(found.rows[:, 1])
    assert (empty == (np.sqrt(theta).real > 2 * np.pi * 1640.0)).all() and 0 < empty.sum() < 128
    indices = found.indices.set_index(["output", "parameter"])
    assert np.isfinite(indices.loc["worst_re"].to_numpy(float)).all()


def test_a_number_that_changes_no_sample_may_change_others():
    """With 0 of 64 changed, 4.6 % may be: 0.95 is the probability of seeing some then."""
    y = (np.arange(64) % 2).astype(float)
    index, error = total_order(y, y)
    assert index == 0.0 and error == pytest.approx(0.0457 / 2 / 0.25, rel=1e-2)


def test_bands_beyond_the_range_that_is_solved_are_not_called_safe():
    """Of two pairs the second one is unstable at 3.5 kHz: with two modes nothing is known above the first."""
    omega = 2 * np.pi * np.array([1000.0, 1100.0, 3500.0, 3500.0])
    push = np.zeros((4, 4))
    push[2, 3], push[3, 2] = 1e6, -1e6
    terms = (Term("mass", "M", sp.eye_array(4, format="csr"), True),
             Term("elastic", "K", sp.csr_array(sp.diags_array(omega**2)), True),
             Term("friction", "K", sp.csr_array(push), False, {"mu": 1}))  # fmt: skip
    box = {"mu": {"uniform": {"low": 0.1, "high": 0.2}}}
    problem, bands = Problem(terms, {"mu": 0.1}), [500.0, 1050.0, 2000.0, 4000.0]
    few, every = (scatter(problem, box, samples=16, indices=False, bands=bands, modes=m) for m in (2, 4))
    assert few.known_hz == pytest.approx(1100.0) and few.probability == 0
    assert few.bands["upper"].to_list()[1:3] == [1.0, 1.0] and few.bands["upper"].iloc[0] < 0.3
    assert every.bands["probability"].to_list() == [0.0, 0.0, 1.0, 1.0]
    assert every.bands["upper"].iloc[1] < 0.3
    # The row of all bands ends where knowledge does, and so says nothing of the pair above.
    assert few.bands.iloc[-1][["low_hz", "high_hz"]].to_list() == pytest.approx([500.0, 1100.0])
    assert few.bands["upper"].iloc[-1] < 0.3 and every.bands["high_hz"].iloc[-1] == 4000.0


def test_overdamped_motions_are_no_reason_to_call_what_is_above_known():
    """Of three motions one is overdamped, which is two real eigenvalues, one swings, and one grows above it."""
    terms = (Term("mass", "M", sp.eye_array(3, format="csr"), True),
             Term("elastic", "K", sp.csr_array(np.diag([1e6, 1e6, 4e6])), True),
             Term("dampers", "C", sp.csr_array(np.diag([1e4, 1.0, 0.0])), True),
             Term("drive", "C", sp.csr_array(np.diag([0.0, 0.0, -1.0])), True, {"c": 1}))  # fmt: skip
    box = {"c": {"uniform": {"low": 0.5, "high": 1.5}}}
    few, every = (scatter(Problem(terms, {"c": 1.0}), box, samples=16, indices=False, modes=m) for m in (1, 2))
    assert few.known_hz == pytest.approx(1000 / (2 * np.pi), rel=1e-3) and few.probability == 0
    assert np.isinf(every.known_hz) and every.probability == 1


@pytest.mark.parametrize(("given", "message"), [
    ({"bands": [4000.0, 2000.0, 1000.0]}, "edges that increase"), ({"bands": [1000.0]}, "bands"),
    ({"seed": -1}, "seed"),
])  # fmt: skip
def test_what_a_scene_would_not_allow_is_refused(given, message):
    with pytest.raises(SceneError, match=message):
        scatter(two_modes(), UNIFORM, samples=16, **given)


def test_samples_that_are_unstable_above_what_is_known_are_in_the_probability():
    """Of each sample one mode: its frequency, √(k (1 + δ/2)) of an unstable pair, is above that of a stable sample.

    All modes of every sample are known up to the least of these frequencies, which says little; the verdicts are right.
    """
    few = scatter(two_modes(), UNIFORM, samples=64, indices=False, modes=1)
    mu, delta = few.points.T
    unstable = delta < 2 * mu
    pairs = np.sqrt(STIFFNESS * (1 + delta[unstable] / 2)) / (2 * np.pi)  # where μ ≪ 1
    whole, (found, lower, upper) = few.bands.iloc[-1], few.found
    assert found == few.probability == unstable.mean() and lower < 1 / 3 and upper == 1.0
    known = np.count_nonzero(pairs <= few.known_hz * (1 + 1e-6)) / 64
    assert whole["probability"] == pytest.approx(known, abs=1.1 / 64) and whole["upper"] < found
    assert whole["high_hz"] == few.known_hz and scatter(two_modes(), UNIFORM, 64, indices=False).found[2] < 0.5


@pytest.mark.parametrize(("bands", "ends"), [
    ([2000.0, 3000.0], (0.0, 3000.0)), ([1000.0, 3000.0], (1000.0, 3000.0)), ([0.0, 10.0], (0.0, 1700.0)),
])  # fmt: skip
def test_the_whole_range_has_all_unstable_modes(bands, ends):
    """Those of two modes are at 1.6 to 1.7 kHz; it begins at no mode, but at the first edge of the bands, or at 0."""
    found = scatter(two_modes(), UNIFORM, samples=32, indices=False, bands=bands)
    last = found.bands.iloc[-1]
    assert last["low_hz"] == ends[0] and last["high_hz"] == pytest.approx(ends[1], rel=0.06)
    assert last["probability"] == found.probability > 0.2


def test_equal_places_are_solved_once():
    """Two numbers of two values each: four places, with the verdicts and modes of each sample, indices among them."""
    tables, asked = {"mu": {"values": [0.02, 0.05]}, "delta": {"values": [0.08, 0.03]}}, {}
    found = scatter(two_modes(), tables, 64, progress=lambda stage, done, total, rate: asked.update({stage: total}))
    assert {total for total in asked.values() if total} == {4} and len(asked) >= 3
    mu, delta = found.points.T
    assert len(found.points) == 64 and (found.samples["unstable"] == (delta < 2 * mu)).all()
    assert found.modes[:, 0].tolist() == np.flatnonzero(delta < 2 * mu).tolist()
    grows = np.sqrt(STIFFNESS * (1 + delta / 2 + 1j * np.sqrt(np.maximum(mu**2 - delta**2 / 4, 0.0)))).imag
    assert found.modes[:, 2] == pytest.approx(grows[delta < 2 * mu], rel=1e-6)
    for i, modes in enumerate(found.again_modes):
        assert modes[:, 0].tolist() == np.flatnonzero(found.again[i, :, 0]).tolist() and len(modes)


@pytest.mark.parametrize("spread", [4, 10_000])
def test_equal_places_have_the_results_that_they_would_have_alone(spread):
    """In any order, also where none are equal and where a place has several unstable modes or none."""
    places = np.random.default_rng(1).integers(0, spread, (50, 2)) / spread * np.array([0.1, 0.05])
    solving = Solving(two_modes(), ("mu", "delta"), np.zeros(2), np.array([0.1, 0.05]), lambda i: places)
    rows, modes = solving.places("samples", places)
    alone = [solving.solver.outcome(place) for place in places]
    assert (rows == np.array([o.row for o in alone])).all()
    assert (modes[:, 1:] == np.concatenate([o.modes for o in alone])).all()
    assert modes[:, 0].tolist() == np.repeat(np.arange(50), [len(o.modes) for o in alone]).tolist()
    assert all(table.shape[0] == 0 for table in solving.places("none", places[:0]))
