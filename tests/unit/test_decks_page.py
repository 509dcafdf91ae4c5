"""docs/decks.md says what the program does, and CalculiX's decks give what they gave."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from calculix import PROGRAM, asks_for_frequencies, compare, decks_folder, run_calculix, unpack
from deck_texts import deck_of

import fe_squeal
from fe_squeal.decks.abaqus.keywords import BECOMES, HANDLERS, LEFT_OUT, SILENT
from fe_squeal.decks.abaqus.materials import SUBOPTIONS
from fe_squeal.decks.scene import draft_of, scene_of
from meshes import box

ROOT = Path(__file__).parents[2]


def page():
    spec = importlib.util.spec_from_file_location("benchmark_decks", ROOT / "benchmarks/decks.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_keywords_of_the_page_are_those_of_the_program():
    text = (ROOT / "docs/decks.md").read_text(encoding="utf-8")
    assert all(table() in text for table in (page().keyword_tables, page().card_tables, page().command_tables))


def test_every_keyword_stands_in_one_table():
    of_the_mesh = {"PARAMETER", "INCLUDE", "SURFACE"}
    taken = {word.strip("* ").upper() for key in BECOMES for word in key.split(",")} - of_the_mesh
    assert taken <= set(HANDLERS) and set(HANDLERS) - taken - SUBOPTIONS == {"END STEP"}
    assert not set(LEFT_OUT) & set(HANDLERS) and not SILENT & (set(HANDLERS) | set(LEFT_OUT))


installed = pytest.mark.skipif(decks_folder() is None, reason="calculix-ccx-test is not installed; see .ci/run")
solver = pytest.mark.skipif(PROGRAM is None, reason="calculix-ccx is not installed; see .ci/run")


@installed
@pytest.mark.slow
def test_decks_of_calculix(tmp_path):
    """Every fourth is drafted or refused in a sentence; beams on C3D20R agree to 0.5 % (here 27 nodes)."""
    decks = unpack(decks_folder(), tmp_path)
    assert len(decks) > 300
    drafted = 0
    for deck in decks[::4]:
        try:
            draft_of(deck)
            drafted += 1
        except fe_squeal.errors.InputError as error:
            assert "\n" not in str(error)
    assert drafted >= 45
    names = {deck.stem: deck for deck in decks if asks_for_frequencies(deck)}
    for name in ("beamf", "beamdy1", "beamfsh1"):
        outcome = compare(names[name])
        assert outcome.state == "compared" and abs(outcome.off).max() < 5e-3, name
    assert compare(names["segment"]).state == "asked" and compare(names["shellf"]).state == "refused"


PLATE = """*Material, name=STEEL
*Density
7.8E-9
*Elastic
2.1E5, 0.3
*Solid Section, elset=block, material=STEEL
"""
CLAMPED = """*Boundary
N_left, 1, 3
"""
SPRING = """*Element, type=SPRING1, elset=S
9001, 1
9002, 2
*Spring, elset=S
3
5000.
"""
FREQUENCY = "*Step\n*Frequency\n10\n*End Step\n"


@solver
@pytest.mark.slow
@pytest.mark.parametrize("held", ["", CLAMPED, CLAMPED + SPRING], ids=["free", "clamped", "clamped and sprung"])
def test_calculix_solves_the_same_deck(tmp_path, held):
    """Quadratic tetrahedra with CalculiX's mass of 4 integration points: the same matrices, frequencies to 1e-5.

    CalculiX prints seven digits of ω². Rigid motions come out as frequencies of rounding and are left out.
    """
    import scipy.linalg as la
    import skfem
    from skfem.helpers import dot

    mesh = box("tet2", (4, 2, 1), (0.1, 0.04, 0.01))
    deck = tmp_path / "plate.inp"
    deck.write_text("*Heading\n" + deck_of(mesh, 1e3) + PLATE + held + FREQUENCY)
    known = run_calculix(deck)
    scene, draft = scene_of(deck)
    assert not [f for f in draft.findings if f.weight != "harmless"]
    problem = fe_squeal.assemble(scene)
    space, K = problem.discretisation.space, problem.pencil().K
    basis = skfem.Basis(space.mesh, skfem.ElementVector(skfem.ElementTetP2()), intorder=2)
    assert basis.X.shape[1] == 4
    M = 7800.0 * skfem.BilinearForm(lambda u, v, _: dot(u, v)).assemble(basis)
    place = np.empty(3 * space.nodes, int)
    scalar = skfem.Basis(space.mesh, skfem.ElementTetP2(), intorder=2)
    for c in range(3):
        place[3 * scalar.element_dofs + c] = basis.element_dofs[c::3]
    M = M[place][:, place][space.free][:, space.free]
    # Four points leave a mass that is only semidefinite; shifted below zero the stiffness is definite, free bodies too.
    shift, n = (2 * np.pi * 50) ** 2, len(M.indptr) - 1
    A, subset = (K + shift * M).toarray(), [n - len(known), n - 1]
    inverse = la.eigh(M.toarray(), A, eigvals_only=True, subset_by_index=subset)
    theta = 1 / inverse[::-1] - shift
    found = np.sqrt(np.maximum(theta, 0)) / (2 * np.pi)
    oscillating = known > 1e-3 * known.max()
    assert oscillating.sum() >= 4
    np.testing.assert_allclose(found[oscillating], known[oscillating], rtol=1e-5)
