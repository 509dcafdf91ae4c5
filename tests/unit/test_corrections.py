"""Solves on the refined mesh that are shared: conjugate gradients against LU, and each correction made once."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import eigsh, splu

from fe_squeal import assemble, parse_scene, sweep
from fe_squeal.accuracy import corrected, quantities, two_level
from fe_squeal.accuracy.corrected import CorrectedModel, _main_columns
from fe_squeal.accuracy.corrections import right_corrections, solved
from fe_squeal.accuracy.discretisation import with_discretisation
from fe_squeal.accuracy.estimate import changes_by
from fe_squeal.accuracy.quantities import split_changes
from fe_squeal.accuracy.refined import refine_problem
from fe_squeal.accuracy.two_level import TwoLevelSolver
from fe_squeal.assembly.assembly import Assembly
from fe_squeal.eigen.pencil import Modes
from fe_squeal.errors import NotConvergedError
from fe_squeal.mesh.refining import refine
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
    other = TwoLevelSolver(refined.P * unit, refined.prolongation, lambda R: coarse(R) / R.dtype.type(unit), None)
    exact = splu(refined.P.tocsc()).solve(B) / unit
    for X, factor in ((refined.solver.solve(B), unit), (other.solve(B), 1.0)):
        wrong = X / factor - exact
        energy, left_over = (np.einsum("ij,ij->j", x, refined.P @ x) for x in (exact, wrong))
        assert (left_over <= 0.05 * energy).all()


def test_what_is_negligible_ends_the_iteration(monkeypatch, case):
    _, refined, _ = case
    monkeypatch.setattr(two_level, "_SETTLED", 1e-6)
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


@pytest.mark.parametrize(("share", "kept"), [(0.02, 1), (0.1, 2)])
def test_faint_parts_of_corrections_are_left_out(share, kept):
    """By their part of the energy: in units of P in which one unknown is a million times as stiff as another."""
    P = sp.csr_array(np.diag([1.0, 1e6, 1.0]))
    z = np.array([[5.0, 0.0, 0.0]]).T + 1j * share * np.array([[0.0, 5e-3, 0.0]]).T
    energies = np.array([25 * (1 + share**2)])
    found = _main_columns(z, energies, SimpleNamespace(P=P))
    assert found.shape == (3, kept) and np.linalg.matrix_rank(np.hstack([found, z.real])) == kept
    np.testing.assert_array_equal(_main_columns(z.real, energies, SimpleNamespace(P=P)), z.real)


def test_what_faint_parts_change_is_within_what_corrections_are_good_for(monkeypatch):
    """Of light Rayleigh damping with friction: vectors are saved, and changes of λ are the same within 2.5 %."""
    problem = make_problem(
        box("hex1", (3, 2, 2), (0.08, 0.05, 0.03)), order=1,
        materials={"m": {"youngs_modulus": 2e9, "poisson_ratio": 0.3, "density": 2600.0}},
        supports=[{"surface": "left", "fixed": "xyz"}],
        contacts=[{"name": "belt", "surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e11,
                   "sliding": BELT}], effects={"friction": {"mu": 0.3}, "rayleigh": {"beta": 2e-7}},
    )  # fmt: skip
    result = sweep(problem, [0.0, 0.2, 0.4], modes=6)
    refined = refine_problem(result)
    corrections, sizes, changes = right_corrections(result, refined), [], []
    for faint in (0.0, corrected._FAINT):
        monkeypatch.setattr(corrected, "_FAINT", faint)
        sizes.append(len(CorrectedModel(refined, corrections).basis))
        changes.append(np.concatenate(changes_by(result, refined, corrections=corrections).modes))
    assert sizes[1] < sizes[0]
    known = np.isfinite(changes[0])  # two modes that meet on the refined mesh alone have no change of their own
    np.testing.assert_array_equal(np.isfinite(changes[1]), known)
    assert known.sum() >= 15
    assert (np.abs(changes[1] - changes[0]) <= 0.025 * np.abs(changes[0]))[known].all()


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


def change_ratios(problem, modes=6):
    """Return estimated over true changes of frequencies where every element is cut into eight, and the solver."""
    result = sweep(problem, [0.0], modes=modes)
    refined = refine_problem(result)
    estimated = np.abs(changes_by(result, refined).modes[0].imag)
    finer = Assembly(problem.source.scene, refine(problem.source.loaded)).problem({})
    own, true = (r.points[0].modes.lam.imag for r in (result, sweep(finer, [0.0], modes=modes)))
    return estimated / np.abs(own - true), refined.solver


def sheet(height, counts=(4, 3, 1), order=2, nu=0.3, **body):
    material = {"youngs_modulus": 2e11, "poisson_ratio": nu, "density": 7800.0}
    return make_problem(
        box(f"hex{min(order, 2)}", counts, (0.04, 0.03, height)), order=order, materials={"m": material},
        bodies={"block": {"material": "m", **body}}, supports=[{"surface": "left", "fixed": "xyz"}],
    )  # fmt: skip


@pytest.mark.parametrize(("problem", "is_exact"), [
    (sheet(0.01), False), (sheet(0.004), False), (sheet(0.0005), True), (sheet(0.0001), True),
    (sheet(0.01, nu=0.499, formulation="mixed"), True),
    pytest.param(sheet(0.001, (3, 2, 1), order=3), True, marks=pytest.mark.slow),
], ids=["thick", "flat", "thin", "foil", "mixed", "thin, cubic"])  # fmt: skip
def test_changes_are_those_of_the_refined_mesh_however_thin(problem, is_exact):
    """A clamped plate, elements 1 to 100 times as wide as thick; where iterations fail P is factorised.

    Single precision has no energy left of the soft modes of thin plates, and iterations that broke down there once
    counted as settled, with changes 25 times too small.
    """
    ratios, solver = change_ratios(problem)
    assert solver.is_exact == is_exact
    np.testing.assert_allclose(ratios, 1.0, atol=0.03 if is_exact else 0.12)


def test_factors_are_taken_where_iterations_do_not_settle(monkeypatch, case):
    _, refined, _ = case
    B = np.random.default_rng(8).standard_normal((refined.P.shape[0], 2))
    monkeypatch.setattr(two_level, "_ITERATIONS", 3)
    exact = splu(refined.P.tocsc())
    solver = TwoLevelSolver(refined.P, refined.prolongation, refined.solver._coarse, lambda: exact.solve)
    np.testing.assert_allclose(solver.solve(B), exact.solve(B), rtol=1e-12)
    assert solver.is_exact and not refined.solver.is_exact


def test_a_mesh_without_modes_says_that_its_error_is_not_known():
    problem = sheet(0.01)
    result = sweep(problem, [0.0], max_frequency=1.0)
    with pytest.raises(NotConvergedError, match="no mode was found on the mesh"):
        right_corrections(result, refine_problem(result))


@pytest.mark.parametrize(("thickness", "limit", "count"), [
    (1.5e-3, 5080.0, 1), (1.5e-3, 2580.0, 0), (6e-3, 18000.0, 1), (6e-3, 17500.0, 0), (6e-3, 28000.0, 1),
])  # fmt: skip
def test_modes_that_a_finer_mesh_brings_into_the_range_are_told(thickness, limit, count):
    """Of the thick plate the modes at 18.2 and 28.1 kHz have 17.62 and 27.69 kHz on the refined mesh.

    The last mode below the limit may be far below it, and the next one just above.
    """
    scene = parse_scene({
        "mesh": {"block": {"length": 0.04, "width": 0.03, "height": thickness, "size": 0.01}},
        "materials": {"m": {"youngs_modulus": 2e11, "poisson_ratio": 0.3, "density": 7800.0}},
        "bodies": {"block": {"material": "m"}}, "supports": [{"surface": "left", "fixed": "xyz"}],
        "solve": {"max_frequency": limit},
    })  # fmt: skip
    result = sweep(assemble(scene), [0.0], max_frequency=limit)
    pencil = refine_problem(result).problem.pencil()
    theta = eigsh(pencil.K.tocsc(), 8, pencil.M.tocsc(), sigma=0.0, return_eigenvectors=False)
    refined = np.sort(np.sqrt(theta)) / (2 * np.pi)
    assert np.count_nonzero(refined < limit) == len(result.points[0].modes) + count
    found = with_discretisation(result)
    told = [re.search(r"below it on the refined mesh, (\d+) down to (\S+) Hz", text) for text in found.warnings]
    frequencies = [(int(m[1]), float(m[2])) for m in told if m]
    assert len(frequencies) == count, found.warnings
    for number, frequency in frequencies:
        assert number == 1
        np.testing.assert_allclose(frequency, refined[len(result.points[0].modes)], rtol=2e-3)
