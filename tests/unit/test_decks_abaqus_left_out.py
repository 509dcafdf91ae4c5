"""Elements of Abaqus decks that are no solids: taken over without a word, or left out and told once as that."""

from __future__ import annotations

import pytest
from deck_scenes import written
from test_decks_references import BLOCK, PHYSICS, REFERENCE, STEP, WHOLE

from fe_squeal.decks.scene import draft_of
from fe_squeal.mesh import load_mesh

SPRING = "*Element, type=SPRING1, elset=K\n2001, 900\n*Spring, elset=K\n1\n3.\n"
DASHPOT = "*Element, type=DASHPOT1, elset=D\n2002, 900\n*Dashpot, elset=D\n1\n3.\n"
MASS = "*Element, type=MASS, elset=M\n2003, 900\n*Mass, elset=M\n3.\n"
INERTIA = "*Element, type=ROTARYI, elset=I\n2004, 900\n*Rotary Inertia, elset=I\n1., 1., 1.\n"
OLD = "*Element, type=DCOUP3D, elset=C\n2005, 900\n*Distributing Coupling, elset=C\nN_top_P, 1.\n"


def drafted(tmp_path, text, coupling=WHOLE):
    path = written(tmp_path, BLOCK + REFERENCE + coupling + text + PHYSICS + STEP)
    return draft_of(path), load_mesh(path, "mm").notes


def weights(draft, *words):
    """Return the weights of the findings that speak of elements of some types."""
    return [f.weight for f in draft.findings if any(word in f"{f.what} {f.text}" for word in words)]


@pytest.mark.parametrize(("text", "coupling", "kind"), [
    (SPRING, WHOLE, "SPRING1"), (DASHPOT, WHOLE, "DASHPOT1"), (MASS, WHOLE, "MASS"), (INERTIA, WHOLE, "ROTARYI"),
    (OLD, "", "DCOUP3D"),
])  # fmt: skip
def test_what_is_taken_over_is_not_left_out(tmp_path, text, coupling, kind):
    draft, notes = drafted(tmp_path, text, coupling)
    assert not weights(draft, f"TYPE={kind}", "no solids", "of type") and not draft.told[1:]
    assert not [note for note in notes if kind in note]


@pytest.mark.parametrize(("text", "kind"), [
    (SPRING, "SPRING1"), (DASHPOT, "DASHPOT1"), (MASS, "MASS"), (INERTIA, "ROTARYI"), (OLD, "DCOUP3D"),
])  # fmt: skip
def test_elements_that_no_keyword_gives_a_number(tmp_path, text, kind):
    draft, _ = drafted(tmp_path, text[: text.index("*", 1)])
    (line,) = [line for line in draft.told if f"*Element, TYPE={kind}" in line]
    assert "for their set are left out" in line


@pytest.mark.parametrize("kind", ["B31", "GAPUNI", "CONN3D2", "T3D2", "S4R", "CSS8"])
def test_what_is_left_out_changes_the_answer(tmp_path, kind):
    text = f"*Element, type={kind}, elset=X\n2001, 1, 2\n2002, 2, 3\n*Element, type={kind}\n2003, 3, 4\n"
    draft, notes = drafted(tmp_path, text)
    assert weights(draft, kind) == ["changes"]
    line = (BLOCK + REFERENCE + WHOLE).count("\n") + 1
    assert f"*Element, TYPE={kind} at line {line}: no solids: 3 elements left out, with stiffness" in draft.told[-1]
    assert f"3 elements of type {kind} are no solids and no part of the mesh" in notes  # of a scene that takes the mesh


@pytest.mark.parametrize("kind", ["SFM3D4", "CPS4"])
def test_surface_elements_have_no_mass(tmp_path, kind):
    draft, _ = drafted(tmp_path, f"*Element, type={kind}, elset=X\n2001, 1, 2, 3, 4\n")
    assert weights(draft, kind) == ["harmless"]


def test_elements_of_a_mesh_without_sections(tmp_path):
    text = BLOCK + "*Element, type=T3D2, elset=LINE\n2001, 1, 2\n"
    assert weights(draft_of(written(tmp_path, text)), "T3D2") == ["harmless"]


def test_each_group_without_a_section_with_its_number(tmp_path):
    """The sentence names what the user can write: all groups of solids that have no section, with their numbers."""
    parts = "*Elset, elset=V1\n1\n*Elset, elset=V2\n2\n"
    one = written(tmp_path, BLOCK + parts + PHYSICS.replace("elset=P", "elset=V1"))
    (sentence,) = draft_of(one).missing
    assert sentence.endswith('1 solid element (2) has none; give [bodies.V2] with groups = ["V2"] and a material')
    (sentence,) = draft_of(written(tmp_path, BLOCK + parts)).missing
    assert sentence.startswith("*Solid Section: 2 solid elements (1, 2) have none; give bodies of these groups, each")
    assert sentence.endswith('with a material (number of elements): "P" (2), "V1" (1), "V2" (1)')
