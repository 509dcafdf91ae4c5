"""Parameters of contact keywords of Abaqus decks that change what a contact is: taken over or told."""

from __future__ import annotations

import pytest
from deck_scenes import deck, written

from fe_squeal.decks.scene import draft_of, scene_of

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
