"""Finite-element models of the lumped systems against the lumped systems, through the whole path."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from selection import some

from fe_squeal.compare import SETUPS, compare_case
from fe_squeal.compare import table as comparing
from fe_squeal.compare.table import lumped_modes, onset_rows, rotations, spectrum_difference
from fe_squeal.sweep.onset import Onset


@pytest.fixture(scope="module", params=some(SETUPS, lambda name: name != "nine-dof"))
def table(request):
    """Rows of one case, quantity to the list of (lumped, finite elements, difference)."""
    rows = {}
    for _, quantity, *values in compare_case(request.param):
        rows.setdefault(quantity, []).append(values)
    return request.param, rows


def test_friction_matrix_on_rigid_motions(table):
    """Rᵀ K_f R is the lumped friction matrix, every entry, to 1e-9 of the largest."""
    [(lumped, found, difference)] = table[1]["K_f, largest entry (N/m)"]
    assert lumped > 0 and found == pytest.approx(lumped, rel=1e-9) and difference < 1e-9


def test_spectra_agree(table):
    """Every eigenvalue within 1e-4; what is left falls with the first power of 1/E."""
    name, rows = table
    spectra = [values for quantity, values in rows.items() if quantity.startswith("|λ|")]
    assert len(spectra) == len(SETUPS[name].values)
    assert all(difference < 1e-4 for [(_, _, difference)] in spectra)
    if spectra:
        [(_, order, _)] = rows["order in 1/E"]
        assert order == pytest.approx(1.0, abs=0.05)


def test_critical_friction_agrees(table):
    """Within 1e-4 where the lumped model flutters; not at all where the springs act off the centre of mass."""
    name, rows = table
    count = {"nine-dof": 3, "uncoupled-disc": 0}.get(name, 1)
    assert len(rows.get("critical μ", [])) == count
    assert len(rows.get("onsets of deformations", [])) == (name == "minimal")  # which the lumped model leaves out
    [(lumped, found, _)] = rows["number of onsets"]
    assert lumped == count and found == (0 if name == "minimal-sprung-at-top" else count)
    if name == "uncoupled-disc":
        [(_, drift, _)] = rows["change of λ over μ"]
        assert drift < 1e-10
        return
    for lumped, found, difference in rows["critical μ"]:
        if name == "minimal-sprung-at-top":
            assert lumped < 0.6 and np.isnan(found)
        else:
            assert difference < 1e-4


def test_a_mode_that_is_missing_beside_another_is_found_out(monkeypatch):
    """Of two near modes one is lost: the other one does not stand for both."""
    setup = SETUPS["minimal"]
    case = setup.make()
    problem = case.problem(setup.modulus)
    whole = case.model.eigenvalues(0.5)
    whole = whole[whole.imag > 0]
    model = replace(case, model=SimpleNamespace(eigenvalues=lambda mu: np.append(whole, 1.0001 * whole[:1])))
    difference, _, found = spectrum_difference(model, problem, 0.5)
    assert difference == np.inf and np.isnan(found)
    assert spectrum_difference(case, problem, 0.5)[0] < 1e-4


def test_onsets_are_paired_once_and_counted():
    """One of two near onsets is lost, and one is there besides."""
    rows = onset_rows("case", np.array([0.3, 0.301, 2.0]), np.array([0.3005, 5.0, 2.0]))
    assert sorted(row[3] for row in rows[:2]) == [0.3005, 5.0] and rows[2][2:] == (2.0, 2.0, 0.0)
    assert max(row[4] for row in rows) > 10
    rows = onset_rows("case", np.array([0.3, 0.301]), np.array([0.3009]))
    assert np.isnan(rows[0][3]) and rows[0][4] == np.inf and rows[2][2:] == (2.0, 1.0, 1.0)
    rows = onset_rows("case", np.array([0.3]), np.array([0.3, 0.9]))
    assert [row[1:] for row in rows] == [("critical μ", 0.3, 0.3, 0.0), ("number of onsets", 1.0, 2.0, 1.0)]


def test_rotations_are_set_apart():
    """Nine of the nine-dof scene's modes are the lumped ones; its three pads rotate besides."""
    setup = SETUPS["nine-dof"]
    case = setup.make()
    problem = case.problem(setup.modulus)
    assert len(lumped_modes(case, problem, 0.5)) == 9
    # A pad on springs k over its whole height turns with ω² = k_x/m: k1 + k8/2 for the first two, k10/2 for the third.
    found = dict(rotations(case, problem))
    assert found == pytest.approx({"pad_1": 1.5**0.5, "pad_2": 1.5**0.5, "pad_3": 0.5**0.5}, rel=5e-3)


def test_where_growing_modes_part_is_none_of_the_onsets(monkeypatch):
    onsets = [Onset("mu", 0.3, 1.0, "flutter", "into", 1.0, 1, 2, 1e-9, law="root"),
              Onset("mu", 0.5, 0.0, "divergence", "into", 1.0, 1, None, 1e-9, law="parting")]  # fmt: skip
    monkeypatch.setattr(comparing, "sweep", lambda *_, **__: SimpleNamespace(onsets=onsets))
    model = SimpleNamespace(eigenvalues=lambda _: np.array([10.0j]), critical_mu=lambda: [0.3])
    setup = SimpleNamespace(interval=(0.0, 1.0, 3))
    rows = comparing._onset_rows("case", SimpleNamespace(model=model), SimpleNamespace(unknowns=2), setup, "auto")
    assert rows == [("case", "critical μ", 0.3, 0.3, 0.0), ("case", "number of onsets", 1.0, 1.0, 0.0)]
