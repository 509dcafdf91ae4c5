"""The rules by which changes on a refined mesh become bars, and what becomes of onsets that only one mesh has."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console
from scene_texts import write_scene

import fe_squeal
from fe_squeal.accuracy.bars import BARS, SHARE, Parts, bar_of, bar_of_parts, beyond, enveloped
from fe_squeal.accuracy.discretisation import near_onsets, with_changes, with_discretisation
from fe_squeal.accuracy.estimate import Changes, Interpolated, refined_changes
from fe_squeal.accuracy.largest_error import estimated_error
from fe_squeal.accuracy.pairs import bent_change, extrapolated, growth_beyond
from fe_squeal.report.tables import print_onsets
from meshes import box, make_problem


@pytest.mark.parametrize("order", [1, 2])
def test_a_bar_does_not_vanish_where_the_change_passes_through_zero(order):
    """Growth of 180 whose change happens to be 0 while the frequency moves by 40 rad/s."""
    change = np.array([0.0 - 40.0j, 3.0 - 40.0j])
    bars = bar_of(change, np.zeros(2, complex), np.array([False, False]), order)
    assert bars.imag == pytest.approx(BARS[order] * 40.0)
    assert (bars.real >= BARS[order] * SHARE * 40.0).all() and SHARE >= 0.1
    # A mode that is neutral on both meshes by symmetry has no bar of its growth.
    assert bar_of(change, np.zeros(2, complex), np.array([True, True]), order).real.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("rate", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("start", [900.0, 25.0, -25.0, -900.0])
def test_two_modes_that_nearly_meet_are_extrapolated_together(rate, start):
    """D = start on the mesh, falls in proportion to h^rate by 2000 in all; λ = i(1000 ± √D): growth where D < 0."""
    exact = start - 2000.0
    left = 2.0**-rate
    on = [start, exact + left * (start - exact), exact]

    def pair(D):
        root = np.sqrt(D + 0j)
        return 1j * (1000.0 + np.array([root, -root]))

    lam, refined, true = (pair(D) for D in on)
    order_of = np.argmin(np.abs(refined[:, None] - lam[None, :]), axis=0)
    change = refined[order_of] - lam if len(set(order_of)) == 2 else refined - lam
    bars = bar_of(change, bent_change(lam, lam + change, 2), np.zeros(2, bool), 2)
    for i in range(2):
        error = true - lam[i]
        holds = (np.abs(error.real) <= bars[i].real * (1 + 1e-9)) & (np.abs(error.imag) <= bars[i].imag * (1 + 1e-9))
        assert holds.any(), (lam, refined, true, bars)


@pytest.mark.parametrize("rate", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("exact", [1e4, 2e3, 1e2, -2e3, -1e4])
@pytest.mark.parametrize("couples", [True, False])
def test_a_mode_whose_frequency_falls_to_zero_may_diverge(rate, exact, couples):
    """−λ² = `exact` + 12000 on the mesh falls to `exact` in proportion to h^rate; beside it a mode far above."""
    start = exact + 12e3
    squares = [start, exact + 2.0**-rate * (start - exact), exact]
    lam, refined, true = (np.array([np.sqrt(-D + 0j), 5000j]) for D in squares)
    bent = bent_change(lam, refined, 2, may_couple=couples)
    bar, error = bar_of(refined - lam, bent, np.zeros(2, bool), 2), np.abs(true - lam)[0]
    assert abs((true - lam)[0].real) <= bar[0].real * (1 + 1e-9)
    assert abs((true - lam)[0].imag) <= bar[0].imag * (1 + 1e-9) and error > 0
    likely = extrapolated(lam, refined, 1 / (1 - 2.0**-rate), couples)
    np.testing.assert_allclose(likely, true, rtol=1e-9 if exact < 5e3 else 0.06)  # where it changes little, λ itself
    assert abs(bent[1]) < 1e-3 * abs(lam[1]) and not likely[1].real


@pytest.mark.parametrize("order", [1, 2])
def test_a_body_without_friction_never_diverges(order):
    """However much its frequencies fall as the mesh is refined: by a third with linear tetrahedra."""
    problem = make_problem(
        box("tet1", (2, 1, 1), (0.08, 0.04, 0.02)), order=order, bodies={"block": {"material": "m"}},
        materials={"m": {"youngs_modulus": 2e9, "poisson_ratio": 0.25, "density": 2600.0}},
        springs=[{"name": n, "surface": "left", "direction": d, "stiffness": 1e8}
                 for n, d in zip("xyz", np.eye(3).tolist(), strict=True)],
    )  # fmt: skip
    point = with_discretisation(fe_squeal.sweep(problem, [2600.0], "materials.m.density", modes=6)).points[0]
    assert not point.discretisation.real.any() and not point.extrapolated.real.any()
    assert (point.extrapolated.imag > 0).all()


def test_linear_extrapolation_alone_would_not_hold():
    """From D = 1200 over −800 at one halving to −2800 in truth: 2 Re Δλ is 56.6, the growth 52.9; from D = 1900, 100,
    −1700: no growth at all on either mesh, and 41 in truth."""
    lam, refined = (1j * (1000.0 + np.sqrt(D + 0j) * np.array([1, -1])) for D in (1900.0, 100.0))
    bent = bent_change(lam, refined, 2)
    assert np.abs((refined - lam).real).max() == 0 and bent.real.max() == pytest.approx(np.sqrt(1700.0))


@pytest.mark.parametrize("rates", [(4.0, 1.0), (2.0, 4.0), (3.0, 1.4)])
@pytest.mark.parametrize("seed", range(5))
def test_parts_that_fall_at_rates_of_their_own(rates, seed):
    """Errors e of groups fall by 2^-q, so that (1 − 2^-q) e is the part of each: bars hold within the limits of q."""
    rng = np.random.default_rng(seed)
    errors, singular = rng.standard_normal((8, 50)), np.arange(8) % 3 == 0
    left = 2.0 ** -np.where(singular, rates[1], rates[0])[:, None]
    seen, error = (1 - left) * errors, errors.sum(axis=0)
    parts, change = Parts.of(seen, singular), seen.sum(axis=0)
    assert (np.abs(error) <= bar_of_parts(change, parts, 2) * (1 + 1e-12)).all()
    shift, width = beyond(change, parts, 2)
    assert (np.abs(error - shift) <= width * (1 + 1e-12)).all()
    assert (width < bar_of_parts(change, parts, 2)).all()
    blind = Parts.of(seen, np.zeros(8, bool))
    if rates == (4.0, 1.0):  # the limits of regular parts do not hold where one of them is singular
        assert (np.abs(error - beyond(change, blind, 2)[0]) > beyond(change, blind, 2)[1]).any()


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("start", [3000.0, 900.0, 310.0])
def test_parts_of_a_growth_rate_are_those_of_its_square(start, sign):
    """a² = 3000, 900 or 310 on the mesh, and 300 in truth: a does not change linearly."""
    exact = 300.0
    errors, left = np.array([0.75, 0.25]) * (exact - start), 2.0 ** -np.array([4.0, 1.4])
    here, refined = (np.array([sign * np.sqrt(D)]) for D in (start, exact - (left * errors).sum()))
    seen = ((1 - left) * errors / (2 * here))[:, None]
    bar, likely, width = growth_beyond(here, refined, Parts.of(seen, np.array([False, True])), 2, np.array([True]))
    true = sign * np.sqrt(exact)
    assert abs(true - here[0]) <= bar[0] and abs(true - likely[0]) <= width[0] < bar[0]
    assert not np.isfinite(growth_beyond(here, refined, Parts.unknown(1), 2, np.array([False]))).any()


def test_neighbouring_values_share_their_bars_by_branch():
    branches = [np.array([1, 2]), np.array([2, 1]), np.array([1, 3])]
    bars = [np.array([1 + 1j, 5 + 5j]), np.array([0.1j, 2j]), np.array([9 + 0j, np.nan * (1 + 1j)])]
    first, second, third = enveloped(bars, branches)
    assert first.tolist() == [1 + 2j, 5 + 5j] and second.tolist() == [5 + 5j, 9 + 2j]
    assert third[0] == 9 + 2j and np.isnan(third[1])


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    scene = fe_squeal.load_scene(write_scene(tmp_path_factory.mktemp("bars")))
    return fe_squeal.sweep(fe_squeal.assemble(scene), np.linspace(0.0, 0.8, 5), modes=8)


@pytest.fixture(scope="module")
def changes(block):
    return refined_changes(block)


@pytest.mark.slow
def test_an_onset_that_vanishes_is_listed_as_such(block, changes):
    [onset] = block.onsets
    result = with_changes(block, replace(changes, onsets=(np.nan,)))
    assert result.onsets[0].discretisation == np.inf
    assert any("vanishes on the refined mesh" in d and f"{onset.value:.6g}" in d for d in result.warnings)
    console = Console(file=io.StringIO(), width=80)
    print_onsets(result.onsets_dataframe(), console)
    assert "vanishes" in console.file.getvalue()


@pytest.mark.slow
def test_an_onset_that_interpolated_matrices_lack_is_not_said_to_vanish(block, changes):
    """Where matrices are interpolated between values, those of the mesh itself may have no such onset either."""
    none = Interpolated(tuple(0 * c for c in changes.modes), np.array([np.nan]), (None,))
    result = with_changes(block, replace(changes, onsets=(np.nan,), interpolated=none))
    assert np.isnan(result.onsets[0].discretisation) and not any("vanishes" in w for w in result.warnings)
    assert any("is not known for the onset at" in w and "interpolated" in w for w in result.warnings)
    assert np.isnan(estimated_error(result))  # no target is met


@pytest.mark.slow
def test_an_onset_that_appears_is_listed_as_such(block, changes):
    new = replace(block.onsets[0], value=0.2, branch_a=0, branch_b=None, discretisation=np.inf)
    result = with_changes(block, replace(changes, appeared=(new,)))
    assert [o.value for o in result.onsets] == [0.2, block.onsets[0].value]
    assert np.isinf(result.onsets_dataframe()["discretisation"].iloc[0])
    assert any("mu = 0.2" in d and "appears on the refined mesh alone" in d for d in result.warnings)
    console = Console(file=io.StringIO(), width=80)
    print_onsets(result.onsets_dataframe(), console)
    assert "refined only" in console.file.getvalue()


def test_beside_an_onset_the_bar_holds_what_the_other_side_of_it_would_bring(block, changes):
    """A value closer to the onset than its error: the mode may grow there by c √(distance + error)."""
    [onset] = block.onsets
    near = replace(block.points[2], value=onset.value - 0.01)
    sure = replace(onset, discretisation=0.001)
    unsure = replace(onset, discretisation=0.05)
    none = np.zeros(len(near.modes), dtype=complex)
    assert not near_onsets(near, none, [sure]).real.any()
    bars = near_onsets(near, none, [unsure]).real
    own = np.isin(near.branches, [onset.branch_a, onset.branch_b])
    assert bars[own] == pytest.approx(onset.crossing_speed * np.sqrt(0.06)) and not bars[~own].any()


@pytest.mark.slow
def test_onsets_of_the_refined_mesh_alone_are_found():
    """A pad of one layer of elements: refined once, it has onsets that it had not, and they are in the range."""
    from meshes import BELT, box, make_problem

    problem = make_problem(
        box("hex1", (4, 3, 2), (0.08, 0.05, 0.03)), order=1,
        materials={"m": {"youngs_modulus": 2e9, "poisson_ratio": 0.3, "density": 2600.0}},
        bodies={"block": {"material": "m"}}, effects={"friction": {"mu": 0.3}},
        contacts=[{"name": "belt", "surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e11,
                   "sliding": BELT}],
        springs=[{"name": "piston", "surface": "top", "direction": [0.3, 0, 1], "stiffness": 2e7},
                 {"name": "a", "surface": "right", "direction": [1, 0, 0], "stiffness": 4e7},
                 {"name": "c", "surface": "right", "direction": [0, 1, 0], "stiffness": 4e7}],
    )  # fmt: skip
    plain = fe_squeal.sweep(problem, np.linspace(0.0, 1.0, 6), modes=12)
    result = with_discretisation(plain)
    new = [o for o in result.onsets if np.isinf(o.discretisation) and o.branch_a == 0]
    assert new and len(result.onsets) == len(plain.onsets) + len(new)
    assert sum("appears on the refined mesh alone" in d for d in result.warnings) == len(new)


def test_bars_of_a_sweep_follow_the_rules(block, changes):
    result = with_changes(block, changes)
    for point, change in zip(result.points, changes.modes, strict=True):
        known = np.isfinite(change)
        assert (point.discretisation.imag[known] >= BARS[1] * np.abs(change.imag[known])).all()
        assert (point.discretisation.real[known] >= BARS[1] * np.abs(change.real[known]) - 1e-9).all()
    assert isinstance(changes, Changes)


def test_bending_doublets_of_a_square_bar_are_no_onset_on_finer_meshes():
    """Tetrahedra part them by less the finer they are. Without friction nothing couples them, wherever that leads."""
    from meshes import box, make_problem

    problem = make_problem(box("tet1", (1, 1, 3), (0.02, 0.02, 0.1)), supports=[{"surface": "bottom", "fixed": "xyz"}])
    result = with_discretisation(fe_squeal.sweep(problem, [2.1e11], "materials.steel.youngs_modulus", modes=6))
    (point,) = result.points
    assert point.extrapolated is not None and point.discretisation is not None
    assert not point.extrapolated.real.any() and not point.discretisation.real.any()
    assert estimated_error(result, ["growth"]) == 0 and not any("onset" in w for w in result.warnings)
    finer = point.extrapolated.imag
    assert (finer < point.modes.lam.imag).all() and (finer > 0.8 * point.modes.lam.imag).all()
