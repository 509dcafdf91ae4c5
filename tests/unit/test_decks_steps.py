"""Loads that steps of Abaqus decks take away, modes that they ask for, and sections without solids."""

from __future__ import annotations

import pytest
from deck_scenes import deck, written
from deck_texts import deck_of

from fe_squeal.decks.scene import draft_of
from meshes import box

BLOCK = deck_of(box("hex1", (2, 1, 1), (100.0, 50.0, 20.0), name="P"))
BLOCK += "*Solid Section, elset=P, material=S\n*Material, name=S\n*Elastic\n210000., 0.3\n*Density\n7.85e-9\n"
STEP = "*Step\n*Frequency\n{}\n*End Step\n"
FIRST = "*Step\n*Static\n*Dload\nP, P2, 1.\n*Dsload\ntop_P, P, 1.\n*End Step\n"


@pytest.mark.parametrize(("load", "left"), [
    ("*Dsload, op=NEW\nbottom_P, P, 2.", {"DLOAD_P_P2": 1e6, "bottom_P": 2e6}),
    ("*Dload, op=NEW\nP, P1, 2.", {"top_P": 1e6, "DLOAD_P_P1": 2e6}),
])  # fmt: skip
def test_new_loads_remove_those_of_their_keyword(tmp_path, load, left):
    text = BLOCK + FIRST + f"*Step\n*Static\n{load}\n*End Step\n" + STEP.format(10)
    (preload,) = [t for t in draft_of(written(tmp_path, text)).tables if t.path == ("effects", "preload")]
    assert preload.values["pressures"] == left


@pytest.mark.parametrize(("asked", "told"), [
    ("10, 2000.", "asks for modes above 2000"), ("10, , , 1.e6", "nearest to a shift point"),
    ("10, 0., 5000.", ""),
])  # fmt: skip
def test_modes_that_are_not_the_lowest_are_told(tmp_path, asked, told):
    draft = draft_of(written(tmp_path, BLOCK + STEP.format(asked)))
    found = [str(f) for f in draft.findings if f.what == "*Frequency"]
    assert len(found) == bool(told) and (not told or told in found[0])


def test_forces_in_turned_axes_are_left_out(tmp_path):
    """3 of the axes of *Transform is no pressure on the face, whatever its number."""
    forces = "*Step\n*Static\n*Cload\nN_top_P, 3, -10.\n*End Step\n"
    draft = draft_of(written(tmp_path, BLOCK + forces + STEP.format(10)))
    assert any(t.path == ("effects", "preload") for t in draft.tables)
    turned = "*Transform, nset=N_top_P\n0., 1., 0., 0., 0., 1.\n"
    draft = draft_of(written(tmp_path, BLOCK + turned + forces + STEP.format(10)))
    assert not any(t.path == ("effects", "preload") for t in draft.tables)
    assert any("*Cload" in line and "axes of *Transform are left out" in line for line in draft.told)


def test_sections_of_trusses_change_the_answer(tmp_path):
    truss = "*Element, type=T3D2, elset=ROD\n2001, 1, 7\n*Solid Section, elset=ROD, material=STEEL\n10.\n"
    draft = draft_of(written(tmp_path, deck() + truss))
    assert any("*Solid Section" in line and "trusses" in line for line in draft.told)
