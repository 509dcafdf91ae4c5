"""Finite-element models of the lumped systems against the lumped systems, through the whole path."""

import numpy as np
import pytest
from selection import some

from fe_squeal.compare import SETUPS, compare_case
from fe_squeal.compare.table import lumped_modes, rotations


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
    if name == "uncoupled-disc":
        [(_, onsets, _)] = rows["number of onsets"]
        [(_, drift, _)] = rows["change of λ over μ"]
        assert onsets == 0 and drift < 1e-10
        return
    count = {"nine-dof": 3}.get(name, 1)
    assert len(rows["critical μ"]) == count
    for lumped, found, difference in rows["critical μ"]:
        if name == "minimal-sprung-at-top":
            assert lumped < 0.6 and np.isnan(found)
        else:
            assert difference < 1e-4


def test_rotations_are_set_apart():
    """Nine of the nine-dof scene's modes are the lumped ones; its three pads rotate besides."""
    setup = SETUPS["nine-dof"]
    case = setup.make()
    problem = case.problem(setup.modulus)
    assert len(lumped_modes(case, problem, 0.5)) == 9
    # A pad on springs k over its whole height turns with ω² = k_x/m: k1 + k8/2 for the first two, k10/2 for the third.
    found = dict(rotations(case, problem))
    assert found == pytest.approx({"pad_1": 1.5**0.5, "pad_2": 1.5**0.5, "pad_3": 0.5**0.5}, rel=5e-3)
