"""Elements by body, direction and place, and how far the parts of a change spread over them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import splu

from fe_squeal import sweep
from fe_squeal.accuracy.bars import bar_of_parts
from fe_squeal.accuracy.corrected import CorrectedModel
from fe_squeal.accuracy.corrections import right_corrections
from fe_squeal.accuracy.discretisation import with_changes
from fe_squeal.accuracy.estimate import changes_by
from fe_squeal.accuracy.groups import PLACES, element_groups, element_places, split_dataframe
from fe_squeal.accuracy.largest_error import estimated_error
from fe_squeal.accuracy.pairs import growth_beyond
from fe_squeal.accuracy.quantities import split_changes
from fe_squeal.accuracy.rates import onset_factor
from fe_squeal.accuracy.refined import refine_problem
from fe_squeal.accuracy.spread import parts_of
from meshes import BELT, box, make_problem


def pad(kind="hex", order=2, cells=(2, 1, 1), **effects):
    """A pad on a belt that squeals from a friction coefficient below one on."""
    return make_problem(
        box(f"{kind}1", cells, (0.08, 0.05, 0.03)), order=order,
        materials={"m": {"youngs_modulus": 2e9, "poisson_ratio": 0.3, "density": 2600.0}},
        bodies={"block": {"material": "m"}}, effects={"friction": {"mu": 0.3}, **effects},
        contacts=[{"name": "belt", "surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e11,
                   "sliding": BELT}],
        springs=[{"name": "piston", "surface": "top", "direction": [0.3, 0, 1], "stiffness": 3e7},
                 {"name": "a", "surface": "right", "direction": [1, 0, 0], "stiffness": 4e7},
                 {"name": "c", "surface": "front", "direction": [0, 1, 0], "stiffness": 3e7}],
    )  # fmt: skip


def test_places_of_elements():
    """Of four layers the lowest touches the belt; in front of the clamp some touch its edge, and some do not."""
    problem = make_problem(
        box("hex1", (3, 3, 4), (0.08, 0.05, 0.03)), order=1,
        materials={"m": {"youngs_modulus": 2e9, "poisson_ratio": 0.3, "density": 2600.0}},
        bodies={"block": {"material": "m"}}, supports=[{"surface": "left", "fixed": "xyz"}],
        contacts=[{"name": "belt", "surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e11,
                   "sliding": BELT}],
    )  # fmt: skip
    assembly = problem.source
    place = np.array(PLACES)[element_places(assembly)]
    x, y, z = assembly.loaded.mesh.p[:, assembly.loaded.mesh.t].mean(axis=1)
    around = np.maximum(abs(y - 0.025) / 0.025, abs(z - 0.015) / 0.015) > 0.5
    expected = np.where(z < 0.0075, "contact", "elsewhere")
    expected = np.where(x < 0.03, np.where(around, "edge", "support"), expected)
    np.testing.assert_array_equal(place, expected)
    names, groups = element_groups(assembly)
    assert len(names) == 3 * len(PLACES) and (groups.sum(axis=0) == 1).all()


@pytest.mark.parametrize(("kind", "order", "effects"), [
    ("hex", 2, {}),
    pytest.param("tet", 1, {}, marks=pytest.mark.slow),
    pytest.param("hex", 1, {"rayleigh": {"alpha": 20.0, "beta": 4e-8}}, marks=pytest.mark.slow),
])  # fmt: skip
def test_parts_from_the_corrected_basis_are_those_of_the_refined_matrices(kind, order, effects):
    """At the last value, by two ways: P⁻¹r of each mode by LU, and by the corrections of the sweep's ends."""
    result = sweep(pad(kind, order, **effects), np.linspace(0.0, 1.2, 5), modes=6)
    refined = refine_problem(result)
    split = split_changes(result, replace(refined, solver=Exact(refined.P))).of(("growth",))
    changes = changes_by(result, refined)
    table = split_dataframe(split, refined.coarse)
    by_parts = table.assign(size=table["part"].abs()).groupby("quantity", sort=False)["size"].sum()
    np.testing.assert_allclose(table.groupby("quantity", sort=False)["part"].sum(), split.changes, rtol=1e-9)
    found = changes.parts[-1]
    here = found.known
    assert here.sum() == len(split.names) >= 1
    np.testing.assert_allclose(np.sort(found.sizes.sum(axis=0)[here]), np.sort(by_parts), rtol=0.1)
    rules_hold(result, changes, order)


def test_a_divergence_has_no_mode_that_swings_and_is_not_given_that_of_another():
    result = sweep(pad(order=1), np.linspace(0.0, 1.2, 5), modes=6)
    refined = refine_problem(result)
    onset, modes = result.onsets[0], refined.model.modes(result.onsets[0].value)
    k, factor = onset_factor(refined, onset, modes)
    assert modes.lam[k].imag == pytest.approx(2 * np.pi * onset.frequency_hz, rel=1e-3) and factor
    assert onset_factor(refined, replace(onset, frequency_hz=0.0, kind="divergence"), modes) is None
    still = replace(result, onsets=(replace(onset, frequency_hz=0.0, kind="divergence"),))
    _, found = parts_of(still, refined, CorrectedModel(refined, right_corrections(result, refined)), [])
    assert found.known.tolist() == [False]


def test_a_divergence_grows_as_any_other_mode():
    """What refining changes in its growth has parts, and its bar counts: an inclined spring and friction push it."""
    problem = make_problem(
        box("hex1", (2, 1, 1), (0.08, 0.05, 0.03)), order=2,
        materials={"m": {"youngs_modulus": 2e9, "poisson_ratio": 0.3, "density": 2600.0}},
        bodies={"block": {"material": "m"}}, effects={"friction": {"mu": 0.3}},
        contacts=[{"name": "belt", "surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e9,
                   "sliding": BELT}],
        springs=[{"name": "side", "surface": "right", "direction": [1, 0, 1], "stiffness": 5e7},
                 {"name": "guide", "surface": "right", "direction": [0, 1, 0], "stiffness": 1e7}],
    )  # fmt: skip
    result = sweep(problem, np.array([0.0, 1.08]), modes=6)
    refined = refine_problem(result)
    corrections = right_corrections(result, refined)
    changes = changes_by(result, refined, corrections=corrections)
    last, change = result.points[-1], changes.modes[-1]
    lam = last.modes.lam
    diverging = np.flatnonzero((lam.imag == 0) & (last.modes.stability == "unstable"))
    split = split_changes(result, replace(refined, solver=Exact(refined.P))).of(("growth",))
    found = {name: (scale, own) for name, scale, own in zip(split.names, split.scales, split.changes, strict=True)}
    assert len(diverging) == 1 and lam.real.max() == lam.real[diverging]
    scale, own = found["growth of a divergence at mu = 1.08"]
    assert scale == lam.real.max() and own == pytest.approx(change[diverging].real, rel=0.1)
    wide = with_changes(result, changes)
    relative = wide.points[-1].discretisation.real[diverging] / lam.real[diverging]
    assert estimated_error(wide, ("growth",)) >= relative > 1e-3


def test_modes_of_equal_frequency_are_quantities_of_their_own():
    """A bar of square section bends alike in both directions; parts by name add up to the change of each mode."""
    problem = make_problem(
        box("hex1", (3, 1, 1), (0.1, 0.02, 0.02)), order=2,
        materials={"m": {"youngs_modulus": 2e9, "poisson_ratio": 0.3, "density": 2600.0}},
        bodies={"block": {"material": "m"}}, supports=[{"surface": "left", "fixed": "xyz"}],
    )  # fmt: skip
    result = sweep(problem, np.array([2600.0]), "materials.m.density", modes=6)
    refined = refine_problem(result)
    split = split_changes(result, refined)
    table = split_dataframe(split, refined.coarse)
    by_name = table.groupby("quantity", sort=False)
    assert len(by_name) == len(split.names) == 6 and any(name.endswith(" Hz (2)") for name in split.names)
    np.testing.assert_allclose(by_name["part"].sum(), by_name["change"].first(), rtol=1e-9)
    np.testing.assert_allclose(by_name["change"].first(), split.changes, rtol=1e-12)


class Exact:
    """P⁻¹ by a factorisation of P, instead of conjugate gradients that end early."""

    def __init__(self, P):
        self.solve = splu(P.tocsc()).solve


def rules_hold(result, changes, order):
    """Bars of growing modes and of onsets are at least what changes and parts make them."""
    wide = with_changes(result, changes)
    for point, change, parts, (lam, _, near) in zip(
        wide.points, changes.modes, changes.parts, changes.spectra, strict=True
    ):
        known, here = np.isfinite(change) & parts.known, lam[near].real
        undamped = np.full(len(here), not result.problem.is_damped)
        least, _, width = growth_beyond(here, here + change.real, parts, order, undamped)
        assert (point.discretisation.real[known] >= least[known] * (1 - 1e-12)).all()
        assert (point.extrapolated_discretisation.real[known] >= width[known] * (1 - 1e-12)).all()
        assert ((point.modes.stability == "unstable") & (point.modes.lam.imag > 0) == parts.known).all()
    assert wide.onsets
    bars = bar_of_parts(np.array(changes.onsets), changes.onset_parts, order)
    same = [o.discretisation for o in wide.onsets if o.branch_a]
    np.testing.assert_allclose(same, np.where(np.isnan(bars), np.inf, bars))
