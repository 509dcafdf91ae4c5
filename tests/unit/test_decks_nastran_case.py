"""What the case control of Nastran decks selects, subcase by subcase, and loads that are not pressures."""

from __future__ import annotations

import re

import numpy as np
import pytest
from test_decks_nastran import HEX, SIZE, deck, mesh, order_of_corners
from test_decks_nastran_parameters import changed, told, with_cards, written

import fe_squeal
from fe_squeal.decks.scene import draft_of, scene_of
from fe_squeal.errors import MeshError, SceneError
from fe_squeal.mesh import load_mesh

CASE = "SPC = 7\nMETHOD = 3\nLOAD = 5\n"
FACE = order_of_corners(mesh())[0][:4] + 1  # of the first element
A, B = FACE[[0, 2]]
# Of sets that hold another grid point, and press otherwise on the first element, and ask for other modes.
OTHERS = f"SPC1,17,123,3\nPLOAD4,15,1,9.,,,,{A},{B}\nEIGRL,13,,,2\nEIGC,4,,,,,,3\n"


def drafted(tmp_path, case, cards=OTHERS):
    return draft_of(written(tmp_path, with_cards(changed(deck()[0], (CASE, case)), cards)))


def chosen(draft):
    """Nodes that are held, pressures, and modes of a draft."""
    values = {t.path: t.values for t in draft.tables}
    held = [t.values["nodes"] for t in draft.tables if t.path == ("supports",)]
    return held, list(values["effects", "preload"]["pressures"]), values["solve",].get("modes")


@pytest.mark.parametrize(("case", "modes", "sentences"), [
    ("SPC = 7\nSUBCASE 1\nLOAD = 5\nSUBCASE 2\nMETHOD = 3\n", 6, []),
    ("SUBCASE 1\nSPC = 17\nLOAD = 5\nSUBCASE 2\nSPC = 7\nMETHOD = 3\n", 6,
     ["SPC: subcases select 7, 17; 7 counts for SUBCASE 2"]),
    ("SUBCASE 1\nSPC = 7\nMETHOD = 3\nLOAD = 5\nSUBCASE 2\nSPC = 17\n", 6,
     ["SPC: subcases select 7, 17; 7 counts for SUBCASE 1"]),
    ("SPC = 7\nSUBCASE 1\nLOAD = 15\nSUBCASE 2\nLOAD = 5\nSUBCASE 3\nMETHOD = 3\n", 6,
     ["LOAD: subcases select 5, 15; 5 counts for SUBCASE 3"]),
    ("SPC = 7\nSUBCASE 1\nLOAD = 5\nSUBCASE 2\nLOAD = 15\nSUBCASE 3\nSTATSUB(PRELOAD) = 1\nMETHOD = 3\n", 6,
     ["LOAD: subcases select 5, 15; 5 counts for SUBCASE 3"]),
    ("SPC = 7\nLOAD = 5\nSUBCASE 1\nMETHOD = 13\nSUBCASE 2\nMETHOD = 13\nCMETHOD = 4\n", 3, []),
    ("SPC = 7\nMETHOD = 3\nSUBCASE 1\nANALYSIS = STATICS\nLOAD = 5\nSUBCASE 2\nANALYSIS = MODES\n", 6, []),
    ("SPC = 17\nSUBCASE 1\nSPC = 7\nSTEP 1\nLOAD = 5\nSTEP 2\nMETHOD = 3\n", 6, []),
])  # fmt: skip
def test_the_subcase_that_asks_for_modes_counts(tmp_path, case, modes, sentences):
    draft = drafted(tmp_path, case)
    assert chosen(draft) == (chosen(drafted(tmp_path, CASE))[0], ["PLOAD4_5"], modes)
    found = told(draft)
    assert len(found) == len(sentences)
    assert all(line.startswith(sentence) for line, sentence in zip(found, sentences, strict=True))


def test_supports_of_other_subcases_alone_are_asked_for(tmp_path):
    case = changed(deck()[0], (CASE, "SUBCASE 1\nSPC = 7\nLOAD = 5\nSUBCASE 2\nMETHOD = 3\n"))
    with pytest.raises(SceneError, match="SPC: SUBCASE 2, which the scene is made of, selects none, and others do: 7"):
        scene_of(written(tmp_path, case))


def test_supports_that_nothing_selects_are_told(tmp_path):
    (line,) = told(drafted(tmp_path, "METHOD = 3\nLOAD = 5\n", ""))
    assert line == "SPC: the case control selects none of 7, 8: all are taken"


@pytest.mark.parametrize(("cards", "sentence"), [
    (f"PLOAD4,5,1,3.,,,,{A},{B}\n,0,1.,0.,0.\n", r"PLOAD4 at line \d+: acts along a direction of its own"),
    (f"PLOAD4,5,1,2.,,,,{A},{B}\n,,,,,SURF,X\n", r"PLOAD4 at line \d+: acts along a direction of its own"),
    (f"CQUAD4,70,71,{','.join(map(str, FACE))}\nPSHELL,71\nPLOAD4,5,70,2.\n",
     r"PLOAD4 at line \d+: acts on a shell and is left out"),
])  # fmt: skip
def test_pressures_along_normals_of_solids_alone_are_taken(tmp_path, cards, sentence):
    known, draft = drafted(tmp_path, CASE, ""), drafted(tmp_path, CASE, cards)
    (line,) = told(draft)
    assert re.match(sentence, line)
    assert [t.values for t in draft.tables] == [t.values for t in known.tables]


def pressures(draft):
    (table,) = [t for t in draft.tables if t.path == ("effects", "preload")]
    return table.values["pressures"]


@pytest.mark.parametrize(("case", "cards", "factors", "sentences"), [
    ("LOAD = 30\n", "LOAD,30,2.,3.,5\n", {5: 6.0}, []),
    ("LOAD = 30\n", "LOAD,30,2.,3.,5,-.5,15\nLOAD,31,1.,1.,5\n", {5: 6.0, 15: -1.0}, []),
    ("LOAD = 30\n", "LOAD,30,1.,1.,5,1.,15,1.5,5\n", {5: 2.5, 15: 1.0}, []),
    ("LOAD = 30\n", "LOAD,30,2.,3.,5,1.,77,1.,78\n,2.,79\nFORCE,77,1,,1.,1.,0.,0.\n", {5: 6.0},
     ["LOAD: combines loads that are not simulated, sets 77, 78, 79: ", "FORCE: is a load that is not"]),
    ("LOAD = 5\n", "LOAD,30,2.,3.,5\n", {5: 1.0}, []),
    ("", "LOAD,30,2.,3.,5\n", {5: 1.0, 15: 1.0}, ["LOAD: is selected by no case control and left out"]),
])  # fmt: skip
def test_combined_loads(tmp_path, case, cards, factors, sentences):
    """LOAD S, S1, L1, ... presses with S S1 times the pressures of set L1, which are 2 MPa of 5 and 9 MPa of 15."""
    draft = drafted(tmp_path, CASE.replace("LOAD = 5\n", case), OTHERS + cards)
    expected = {f"PLOAD4_{sid}": {5: 2e6, 15: 9e6}[sid] * factor for sid, factor in factors.items()}
    assert pressures(draft) == pytest.approx(expected)
    found = [re.sub(r" at line \d+:", ":", line) for line in told(draft)]
    assert [line[: len(s)] for line, s in zip(found, sentences, strict=True)] == sentences


@pytest.mark.parametrize("card", ["LOAD,30,2.,,5\n", "LOAD,30,,1.,5\n", "LOAD,30,2.,1.\n"])
def test_combined_loads_need_factors(tmp_path, card):
    with pytest.raises(MeshError, match=r"LOAD 30 has a set without a factor, or a factor without a set"):
        drafted(tmp_path, CASE.replace("LOAD = 5", "LOAD = 30"), card)


def test_directed_loads_are_a_surface_group_of_their_own(tmp_path):
    cards = f"PLOAD4,5,1,2.,,,,{A},{B}\n,0,1.,0.,0.\n"
    path = written(tmp_path, with_cards(deck()[0], cards))
    boundaries = load_mesh(path).mesh.boundaries
    assert len(boundaries["PLOAD4_5_directed"]) == 1 and len(boundaries["PLOAD4_5"]) == 6


@pytest.mark.parametrize(("material", "sentences"), [("", []), ("2,1.5", ["PSHELL names a material: shells are"])])
def test_shells_with_a_material_are_told(tmp_path, material, sentences):
    """Others are surfaces there, too."""
    shell = f"CQUAD4,70,71,{','.join(map(str, FACE))}\nPSHELL,71,{material}\n"
    found = [re.sub(r" at line \d+:", "", line) for line in told(drafted(tmp_path, CASE, shell))]
    assert [line[: len(s)] for line, s in zip(found, sentences, strict=True)] == sentences


def test_pressures_that_are_given_again_add_up(tmp_path):
    """On all pressed faces by their other diagonals, on one of them a third time, and with another pressure."""
    m, again = mesh(), []
    for e, row in enumerate(order_of_corners(m), 1):
        faces = [row[list(face)] + 1 for face in HEX]
        again += [f"PLOAD4,5,{e},2.,,,,{f[1]},{f[3]}\n" for f in faces if np.allclose(m.p[2, f - 1], SIZE[2])]
    more = "".join(again) + again[0] + again[0].replace(",2.,", ",1.,")
    loads = []
    for cards in ("", more):
        scene, draft = scene_of(written(tmp_path, with_cards(deck()[0], cards)))
        assert not told(draft)
        loads.append(fe_squeal.assemble(scene).discretisation.static_state.load[2])
    assert loads[1] == pytest.approx(loads[0] * (2 + 1.5 / len(again)), rel=1e-12) and len(again) == 6


@pytest.mark.parametrize(("case", "what"), [
    ("SPC = 9\nMETHOD = 3\nLOAD = 5\n", "SPC: the case control selects set 9"),
    ("SPC = 7\nMETHOD = 3\nLOAD = 9\n", "LOAD: the case control selects set 9"),
])  # fmt: skip
def test_sets_that_are_selected_and_not_there_are_asked_for(tmp_path, case, what):
    missing = drafted(tmp_path, case).missing
    assert [line for line in missing if line.startswith(what) and "which the deck does not have" in line]
    assert not any("selects set" in line for line in drafted(tmp_path, CASE).missing)
