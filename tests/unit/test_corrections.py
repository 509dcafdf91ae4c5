"""Solves on the refined mesh that are shared: conjugate gradients against LU, and each correction made once."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse.linalg import splu

from fe_squeal import sweep
from fe_squeal.accuracy import quantities
from fe_squeal.accuracy.corrections import right_corrections, solved
from fe_squeal.accuracy.estimate import changes_by
from fe_squeal.accuracy.quantities import split_changes
from fe_squeal.accuracy.refined import refine_problem
from fe_squeal.accuracy.two_level import TwoLevelSolver
from fe_squeal.eigen.pencil import Modes
from meshes import box, make_problem

BELT = {"direction": [1, 0, 0], "speed": 1.0}


@pytest.fixture(scope="module")
def case():
    problem = make_problem(
        box("hex1", (3, 2, 2), (0.08, 0.05, 0.03)), order=1,
        materials={"m": {"youngs_modulus": 2e9, "poisson_ratio": 0.3, "density": 2600.0}},
        supports=[{"surface": "left", "fixed": "xyz"}],
        contacts=[{"name": "belt", "surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e11,
                   "sliding": BELT}], effects={"friction": {"mu": 0.3}},
    )  # fmt: skip
    result = sweep(problem, np.linspace(0.0, 1.2, 5), modes=6)
    refined = refine_problem(result)
    return result, refined, right_corrections(result, refined)


def test_corrections_are_those_by_lu(case):
    """At both ends and at every onset, within the few per cent of the energy norm that conjugate gradients leave."""
    result, refined, corrections = case
    assert {0.0, 1.2, *(o.value for o in result.onsets)} == set(corrections) and result.onsets
    factors = splu(refined.P.tocsc())
    for value, own in corrections.items():
        modes = own.modes
        pencil = refined.problem.pencil({refined.parameter: value})
        phi = refined.prolongation @ (refined.model.basis.V @ modes.right)
        r = pencil.apply(modes.lam, phi)
        exact = factors.solve(np.ascontiguousarray(r.real)) + 1j * factors.solve(np.ascontiguousarray(r.imag))
        wrong = own.right - exact
        energy, left_over = (np.real(np.einsum("ij,ij->j", x.conj(), refined.P @ x)) for x in (exact, wrong))
        assert (left_over <= 0.05 * energy).all()
        np.testing.assert_allclose(own.energies, energy, rtol=0.05)


def test_real_and_imaginary_parts_are_solved_for_apart_and_zeros_not_at_all(case):
    _, refined, _ = case
    rng = np.random.default_rng(3)
    r = rng.standard_normal((refined.P.shape[0], 3)) + 0j
    r[:, 1] *= 1j
    r[:, 2] = 0
    z, energies = solved(refined.solver, r)
    assert not z[:, 0].imag.any() and not z[:, 1].real.any() and not z[:, 2].any() and energies[2] == 0
    before = refined.solver.iterations
    assert not solved(refined.solver, 0 * r)[0].any() and refined.solver.iterations == before


@pytest.mark.parametrize("unit", [1e-12, 1e15])
def test_solves_in_single_precision_do_not_depend_on_units(case, unit):
    """Neither on those of the matrix nor on those of the right-hand sides, far beyond what single precision holds."""
    refined = case[1]
    B = np.random.default_rng(6).standard_normal((refined.P.shape[0], 3)) * [1e-60, 1.0, 1e60]
    coarse = refined.solver._coarse
    other = TwoLevelSolver(refined.P * unit, refined.prolongation, lambda R: coarse(R) / R.dtype.type(unit))
    exact = splu(refined.P.tocsc()).solve(B) / unit
    for X, factor in ((refined.solver.solve(B), unit), (other.solve(B), 1.0)):
        wrong = X / factor - exact
        energy, left_over = (np.einsum("ij,ij->j", x, refined.P @ x) for x in (exact, wrong))
        assert (left_over <= 0.05 * energy).all()


def test_what_is_negligible_ends_the_iteration(case):
    _, refined, _ = case
    B = np.random.default_rng(4).standard_normal((refined.P.shape[0], 2))
    steps = []
    for negligible in (0.0, np.inf):
        before = refined.solver.iterations
        refined.solver.solve(B, negligible)
        steps.append(refined.solver.iterations - before)
    assert steps[1] < steps[0]


def test_shared_corrections_change_nothing(case):
    result, refined, corrections = case
    np.testing.assert_allclose(
        split_changes(result, refined, corrections).changes, split_changes(result, refined).changes, rtol=1e-10
    )
    shared, own = changes_by(result, refined, "auto", corrections), changes_by(result, refined)
    np.testing.assert_allclose(shared.onsets, own.onsets, rtol=1e-8)


def test_growth_that_is_not_sure_is_no_quantity(monkeypatch):
    """A real λ = 300 ± 300 1/s, of which loss factors say nothing, beside flutter of 30 and of 20 ± 25 1/s."""
    lam = np.array([300.0, 30.0 + 6000.0j, 20.0 + 8000.0j])
    one = np.ones(3)
    modes = Modes(lam, np.eye(3), np.eye(3), one, np.array([300.0, 1e-3, 25.0]), one)
    result = SimpleNamespace(points=[SimpleNamespace(modes=modes)], parameter="mu")
    monkeypatch.setattr(quantities, "by_eigenvalue", lambda *_: one)
    asked = quantities._asked(result, SimpleNamespace(values=np.array([0.5])), 0.5, modes, [])
    assert [(a.kind, a.scale, a.column) for a in asked] == [
        ("frequencies", abs(lam[1]), 1), ("growth", 30.0, 1), ("frequencies", abs(lam[2]), 2)]  # fmt: skip
