"""What Nastran decks select in short words, of several sets, and of modes that are not the lowest."""

from __future__ import annotations

import pytest
import test_decks_nastran_contacts as contacts
from test_decks_nastran_case import CASE, OTHERS, chosen, drafted
from test_decks_nastran_parameters import changed, told, with_cards, written

from fe_squeal.decks.scene import draft_of
from fe_squeal.errors import MeshError

SETS = [*contacts.SURFACES, ("BCTSET", 5, 1, 2, 0.4), ("BCTSET", 6, 1, 2, 0.2)]


def frictions(tmp_path, select, cards=SETS):
    path = tmp_path / "brake.bdf"
    path.write_text(contacts.deck(select, cards))
    draft = draft_of(path)
    return [t.values["mu"] for t in draft.tables if t.path == ("effects", "friction")], draft


@pytest.mark.parametrize(("select", "mu"), [
    ("BCSET = 6", 0.2), ("SUBCASE 1\n  BCSET = 5\nSUBCASE 2\n  BCSET = 6\n  METHOD = 1", 0.2), ("BCSE = 5", 0.4),
    ("BCSET = 9", 0.2),
])  # fmt: skip
def test_the_contact_set_that_is_selected_counts(tmp_path, select, mu):
    found, draft = frictions(tmp_path, select, [*SETS, ("BCTADD", 9, 6)])
    assert found == [mu] and sum(t.path == ("contacts",) for t in draft.tables) == 1


@pytest.mark.parametrize(("select", "sentence"), [
    ("", "BCSET in the case control selects none of 5, 6: all are taken"),
    ("BCSET = 7", "BCSET in the case control selects none of the deck's sets"),
])  # fmt: skip
def test_contact_sets_that_are_not_selected_are_told(tmp_path, select, sentence):
    _, draft = frictions(tmp_path, select)
    assert any(sentence in line for line in told(draft))
    assert any(sentence in line for line in draft.missing) == bool(select)


@pytest.mark.parametrize("case", [
    "SPC = 7\nMETH = 13\nLOAD = 5\n",
    "SPC = 7\nSUBC 1\nANAL = STATICS\nLOAD = 15\nLOAD = 5\nSUBC 2\nANAL = MODES\nMETH = 13\n",
    "SPC = 7\nMETHOD(STRUCTURE) = 13\nMETHOD(FLUID) = 3\nLOAD = 5\n",
])  # fmt: skip
def test_four_letters_of_a_command_are_enough(tmp_path, case):
    """The modes are those of EIGRL 13, although EIGRL 3 stands before it."""
    draft = drafted(tmp_path, case)
    assert chosen(draft) == (*chosen(drafted(tmp_path, CASE))[:2], 2) and not told(draft)


def test_complex_modes_are_those_of_their_own_card(tmp_path):
    """EIGRL and EIGC may have the same number: 20 real modes, of which 3 complex ones are made."""
    case = "SPC = 7\nLOAD = 5\nMETHOD = 4\nCMETHOD = 4\n"
    for card in ("EIGC,4,CLAN,,,,,3\n", "EIGC,4,CLAN\n,,,,,,,3\n"):
        draft = drafted(tmp_path, case, OTHERS.replace("EIGC,4,,,,,,3\n", f"EIGRL,4,,,20\n{card}"))
        assert chosen(draft)[2] == 3 and not told(draft)


def test_complex_modes_without_a_number_are_as_many_as_the_real_ones(tmp_path):
    case = "SPC = 7\nLOAD = 5\nMETHOD = 3\nCMETHOD = 4\n"
    for card in ("EIGC,4,CLAN\n", "EIGC,4,CLAN,,,,,0\n"):
        draft = drafted(tmp_path, case, OTHERS.replace("EIGC,4,,,,,,3\n", f"EIGC,5,CLAN,,,,,3\n{card}"))
        assert chosen(draft)[2] == 6 and not told(draft)


@pytest.mark.parametrize(("old", "new"), [
    ("EIGRL,13,,,2\n", "EIGRL,13,800.,9000.,20\n"), ("EIGRL,13,,,2\n", "EIGR,13,LAN,800.,9000.,,20\n"),
])  # fmt: skip
def test_modes_that_are_not_the_lowest_are_told(tmp_path, old, new):
    draft = drafted(tmp_path, CASE.replace("METHOD = 3", "METHOD = 13"), changed(OTHERS, (old, new)))
    assert chosen(draft)[2] == 20
    assert any(line.startswith("EIGR") and "from 800. on" in line for line in told(draft))


def test_matrices_that_a_deck_adds_are_asked_for(tmp_path):
    draft = drafted(tmp_path, f"K2PP = KF\n{CASE}", "DMIG,KF,0,1,1,0\nDMIG,KF,5,1,,6,3,1.+5\n")
    assert any(line.startswith("DMIG") for line in draft.missing)


def test_ranges_of_grid_points_in_rbe3_are_refused(tmp_path):
    text = with_cards(contacts.deck("", []), "GRID,900,,15.,10.,40.\nRBE3,9,,900,123456,1.,123,100,101\n,THRU,110\n")
    with pytest.raises(MeshError, match='RBE3 9 has "THRU" among its grid points'):
        draft_of(written(tmp_path, text))
