"""The error of the mesh of a block that friction tips on its stop: μ moves matrices of both meshes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from test_preload import tipping

from fe_squeal import sweep
from fe_squeal.accuracy import refined
from fe_squeal.accuracy.discretisation import with_changes
from fe_squeal.accuracy.estimate import changes_by
from fe_squeal.assembly.assembly import Assembly
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.mesh.refining import refine
from fe_squeal.reduced import ReducedModel, TransferredModel

VALUES = [0.0, 0.25, 0.5, 0.8, 1.0]  # it opens from 0.48 on


@pytest.fixture(scope="module")
def swept():
    return sweep(tipping(0.3, load=(0.0, 1.0), height=0.35, cells=12), VALUES, modes=6, method="reduced")


@pytest.fixture(scope="module")
def own(swept):
    return refined.refine_problem(swept)


def elastic(lam, change):
    """Which modes deform the block. Others move it on the belt as it is, and their changes are rounding."""
    return np.isfinite(change) & (np.abs(change) > 1e-8 * np.abs(lam).max())


@pytest.mark.slow
def test_changes_are_those_of_the_refined_mesh(swept, own):
    """Where matrices are interpolated exactly: λ of the mesh and its change add up to λ assembled there alone."""
    assert isinstance(own.model, TransferredModel)
    changes = changes_by(swept, own)
    source = swept.problem.source
    fine = Assembly(source.scene, refine(source.loaded)).problem({})
    for value in (0.0, 0.5, 1.0):
        at = [p.value for p in swept.points].index(value)
        exact = solve_modes(fine.pencil({"mu": value}), Request(count=8)).lam
        lam, change = swept.points[at].modes.lam, changes.modes[at]
        known = elastic(lam, change)
        assert known.sum() >= 3
        off = np.abs((lam + change)[known, None] - exact).min(axis=1)
        assert (off <= 0.05 * np.abs(change[known]) + 1e-6 * np.abs(lam[known])).all()


@pytest.mark.slow
def test_errors_are_measured_by_the_stiffness_that_the_sweep_began_with(monkeypatch):
    """Where that is least, as where a stiff contact has opened; here it is told to begin at the last value."""
    monkeypatch.setattr("fe_squeal.reduced.model.softest_value", lambda problem, parameter, values: float(values[-1]))
    swept = sweep(tipping(0.3, load=(0.0, 1.0), height=0.35, cells=6), VALUES, modes=6, method="reduced")
    model = refined.refine_problem(swept).model
    assert isinstance(model, TransferredModel) and model.basis.problem.value("mu") == VALUES[-1]


@pytest.mark.slow
def test_a_model_of_its_own_gives_the_same(swept, own, monkeypatch):
    """Where the sweep's basis does not serve, a reduced model of the interpolated matrices is made."""
    monkeypatch.setattr(refined, "_NEAR", 0.0)
    other = refined.refine_problem(swept)
    assert isinstance(other.model, ReducedModel)
    for a, b, point in zip(*(changes_by(swept, r).modes for r in (own, other)), swept.points, strict=True):
        np.testing.assert_array_equal(np.isnan(a), np.isnan(b))
        known = elastic(point.modes.lam, a)
        assert known.sum() >= 3 and (np.abs(a - b)[known] <= 1e-3 * np.abs(b[known])).all()


@pytest.mark.slow
def test_what_is_begun_beside_the_sweep_is_the_same(monkeypatch):
    """Static states and interpolated matrices of the refined mesh, collected before there are modes."""
    problem = tipping(0.3, load=(0.0, 1.0), height=0.35, cells=4)
    ahead = refined.finer_mesh_ahead(problem, "mu", VALUES)
    result = sweep(problem, VALUES, modes=4, method="reduced")
    expected = refined.refine_problem(result).problem
    monkeypatch.setattr(refined.FinerMesh, "of", None)  # it is not made again
    found = refined.refine_problem(result, ahead=ahead).problem
    assert found.parameters == expected.parameters
    for term, other in zip(found.terms, expected.terms, strict=True):
        assert (term.name, term.slot, term.powers) == (other.name, other.slot, other.powers)
        assert abs(term.matrix - other.matrix).max() <= 1e-12 * abs(other.matrix).max()


@pytest.mark.slow
def test_bars_hold_where_matrices_are_interpolated():
    """Contacts open one after the other from 0.45 on, which no parabola follows: λ of the interpolated matrices are off
    by up to 10 %. The modes and the onset of the refined mesh, assembled there alone, lie within the bars."""
    values = [0.0, 0.25, 0.45, 0.55, 0.65]
    swept = sweep(tipping(0.3, load=(0.0, 1.0), height=0.35, cells=6), values, modes=6, method="reduced")
    changes = changes_by(swept, refined.refine_problem(swept))
    assert changes.interpolated is not None
    off = max(np.abs(x / p.modes.lam).max() for x, p in zip(changes.interpolated.modes, swept.points, strict=True))
    assert 0.01 < off < 0.2
    barred = with_changes(swept, changes)
    source = swept.problem.source
    fine = Assembly(source.scene, refine(source.loaded)).problem({})
    for point in barred.points:
        lam, value = point.modes.lam, point.value
        known = np.abs(lam) > 1e-3 * np.abs(lam).max()
        exact = solve_modes(fine.pencil({"mu": value}), Request(count=8)).lam
        rows, columns = linear_sum_assignment(np.abs(lam[:, None] - exact[None, :]))
        moved, slack = exact[columns] - lam[rows], 1e-9 * np.abs(lam)
        assert len(rows) == len(lam) and known.sum() >= 3
        assert (np.abs(moved.real) <= point.discretisation.real + slack)[known].all()
        assert (np.abs(moved.imag) <= point.discretisation.imag + slack)[known].all()
    (onset,) = (o for o in barred.onsets if o.direction == "into")
    (there,) = sweep(fine, values[2:4], modes=6, method="direct").onsets  # it lies between these
    assert there.direction == "into" and 1e-3 < abs(there.value - onset.value) < onset.discretisation < 1
