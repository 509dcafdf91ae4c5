"""Parameters of contact keywords of Abaqus decks that change what a contact is: taken over or told."""

from __future__ import annotations

import re

import pytest
from deck_scenes import deck, written

import fe_squeal
from fe_squeal.decks.scene import draft_of, scene_of
from fe_squeal.errors import SceneError

PAIR = "*Contact Pair, interaction=PADS\nbottom_pad, top\n"
SECOND = "*Surface Interaction, name=BACK\n*Surface Behavior, pressure-overclosure=LINEAR\n1500.\n"
SECOND += "*Contact Pair, interaction=BACK\nback_pad, hub\n"


def changes(draft):
    return [f.what for f in draft.findings if f.weight == "changes"]


def test_tied_contact_pairs_are_ties(tmp_path):
    """As *Tie has them, and without the friction of their interaction."""
    tied = deck().replace(PAIR, PAIR.replace("PADS", "PADS, TIED"))
    scene, draft = scene_of(written(tmp_path, tied))
    by_tie, _ = scene_of(written(tmp_path, deck().replace(PAIR, "*Tie, name=T\nbottom_pad, top\n"), "tie.inp"))
    assert scene.contacts[0].kind == "tied" and scene.effects.on.keys() == by_tie.effects.on.keys()
    assert scene.contacts[0].normal_stiffness == by_tie.contacts[0].normal_stiffness
    assert changes(draft) == ["*Contact Pair, TIED"]


@pytest.mark.parametrize(("pair", "closed"), [
    ("*Contact Pair, interaction=PADS, adjust=0.8", 0.8e-3), ("*Tie, name=T, position tolerance=0.8", 0.8e-3),
    ("*Contact Pair, interaction=PADS, adjust=0.01", None), ("*Contact Pair, interaction=PADS, adjust=N_top", None),
    ("*Contact Pair, interaction=PADS", None),
])  # fmt: skip
def test_gaps_that_a_deck_closes_are_closed(tmp_path, pair, closed):
    """The two meshes are 0.6 mm apart, more than 2 % of a facet of 15 mm by 20 mm; 0.01 mm would be less than that."""
    text = deck().replace("*Contact Pair, interaction=PADS", pair)
    scene, _ = scene_of(written(tmp_path, text))
    assert scene.contacts[0].gap_tolerance == closed
    apart = re.sub(r"^(1\d{4}, [^,]+, [^,]+, )([\d.]+)$", lambda m: f"{m[1]}{float(m[2]) + 0.6}", text, flags=re.M)
    scene, _ = scene_of(written(tmp_path, apart, "apart.inp"))
    if closed:
        fe_squeal.assemble(scene).pencil()
    else:
        with pytest.raises(SceneError, match="do not touch"):
            fe_squeal.assemble(scene).pencil()


def test_contacts_without_separation_stay_closed(tmp_path):
    """`lift_off` is of all contacts: false where all are so, told where only some are."""
    text = deck().replace("pressure-overclosure=LINEAR", "pressure-overclosure=LINEAR, NO SEPARATION")
    scene, draft = scene_of(written(tmp_path, text))
    assert scene.effects.on["preload"].lift_off is False and not changes(draft)
    assert scene_of(written(tmp_path, deck(), "plain.inp"))[0].effects.on["preload"].lift_off is True
    draft = draft_of(written(tmp_path, text.replace(PAIR, PAIR + SECOND), "two.inp"))
    assert changes(draft) == ["*Surface Behavior, NO SEPARATION"]


@pytest.mark.parametrize(("friction", "told"), [("0.4, 0.4", []), ("0.4, 0.1", ["*Friction, ANISOTROPIC"])])
def test_two_coefficients_of_friction_are_told(tmp_path, friction, told):
    text = deck().replace("*Friction\n0.4", f"*Friction, anisotropic\n{friction}")
    scene, draft = scene_of(written(tmp_path, text))
    assert scene.effects.on["friction"].mu == 0.4 and changes(draft) == told


def test_friction_of_a_connector_is_not_that_of_a_contact(tmp_path):
    """The keyword between ends the interaction that stood before it."""
    connector = "*Connector Behavior, name=CB\n*Connector Friction\n*Friction\n0.9\n"
    scene, draft = scene_of(written(tmp_path, deck().replace(PAIR, PAIR + connector)))
    assert scene.effects.on["friction"].mu == 0.4
    assert changes(draft) == ["*Connector Behavior", "*Connector Friction", "*Friction"]
