"""PARAM of Nastran decks: mass from weight, damping of the whole, and what is listed."""

from __future__ import annotations

import re

import pytest
from test_decks_nastran import deck

import fe_squeal
from fe_squeal.decks.scene import draft_of, scene_of
from fe_squeal.errors import MeshError, SceneError


def written(tmp_path, text):
    (tmp_path / "block.bdf").write_text(text)
    return tmp_path / "block.bdf"


def with_cards(text, cards, case=""):
    """A deck with cards before its end, and lines of case control."""
    return text.replace("ENDDATA\n", f"{cards}ENDDATA\n").replace("BEGIN BULK\n", f"{case}BEGIN BULK\n")


def changed(text, *changes):
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


def told(draft):
    return [str(f) for f in draft.findings if f.weight != "harmless"]


def pencils(*scenes):
    return [fe_squeal.assemble(scene).pencil() for scene in scenes]


def assert_same(A, B, names=("M", "C", "K")):
    for name in names:
        assert abs(getattr(A, name) - getattr(B, name)).max() <= 1e-12 * abs(getattr(A, name)).max(), name


@pytest.mark.parametrize("place", ["bulk data", "case control"])
def test_weights_become_masses(tmp_path, place):
    """kg and kg/mm^3 beside N and MPa, with WTMASS = 0.001: the scene of the deck in tonnes."""
    known, _ = scene_of(written(tmp_path, deck()[0]))
    cap = ("2.-4,,,,\n,0.2,-0.01,0.3,0.0,0.0,0.4", "0.2,,,,\n,200.,-10.,300.,0.0,0.0,400.")
    weights = changed(deck()[0], ("7.8-9", "7.8-6"), cap)
    parameter = "PARAM,WTMASS,1.-3\n"
    text = with_cards(weights, parameter) if place == "bulk data" else with_cards(weights, "", parameter)
    scene, draft = scene_of(written(tmp_path, text))
    assert any("densities and masses are multiplied by 0.001" in line for line in draft.told) and not told(draft)
    assert "mm, t, s" in draft.text()
    assert_same(*pencils(known, scene))


def test_inches_and_pounds_keep_their_numbers(tmp_path):
    """Steel of 0.283 lbf/in^3: no unit is recognised, and masses are weights over 386.1 in/s^2."""
    text = with_cards(changed(deck()[0], ("7.8-9", "0.283"), ("2.1+5", "3.+7")), "PARAM,WTMASS,2.59-3\n")
    draft = draft_of(written(tmp_path, text))
    table = next(t for t in draft.tables if t.path[0] == "materials")
    assert draft.units == "any" and table.values["density"] == pytest.approx(0.283 / 386.1, rel=1e-3)
    assert table.values["youngs_modulus"] == 3e7


def test_damping_of_the_whole(tmp_path):
    """G adds to GE, 0.02 in the deck; ALPHA1 is of the mass, ALPHA2 of the stiffness, in 1/s and s."""
    cards = "PARAM,G,0.04\nPARAM,ALPHA1,10.\nPARAM,ALPHA2,1.-6\n"
    scene, draft = scene_of(written(tmp_path, with_cards(deck()[0], cards)))
    assert scene.materials["mat_2"].loss_factor == pytest.approx(0.06)
    rayleigh = next(t for t in draft.tables if t.path == ("effects", "rayleigh"))
    assert rayleigh.values == {"alpha": 10.0, "beta": 1e-6}
    assert [line.split(" at ")[0] for line in told(draft)] == ["PARAM G", "PARAM ALPHA1", "PARAM ALPHA2"]


def test_without_springs_the_bodies_are_the_whole(tmp_path):
    """C = ALPHA1 M + ALPHA2 K, K has the loss factor G + GE, and nothing is left to tell."""
    left_out = ("CELAS", "CDAMP", "CBUSH", "CONM2", ",0.2,-0.01")
    text = "\n".join(line for line in deck()[0].splitlines() if not line.startswith(left_out)) + "\n"
    cards = "PARAM,G,0.04\nPARAM,ALPHA1,10.\nPARAM,ALPHA2,1.-6\n"
    scene, draft = scene_of(written(tmp_path, with_cards(text, cards)))
    assert not told(draft)
    pencil = fe_squeal.assemble(scene).pencil()
    K = pencil.K.real
    assert abs(pencil.C - (10.0 * pencil.M + 1e-6 * K)).max() <= 1e-9 * abs(pencil.C).max()
    assert abs(pencil.K.imag - 0.06 * K).max() <= 1e-12 * abs(K).max()


@pytest.mark.parametrize(("cards", "sentences"), [
    ("PARAM,POST,-1\nPARAM,AUTOSPC,YES\nPARAM,COUPMASS,1\nPARAM,K6ROT,100.\nPARAM,GRDPNT,0\nPARAM,BAILOUT,-1\n", []),
    ("PARAM,LGDISP,-1\nPARAM,INREL,0\nPARAM,CM1,1.\n", []),
    ("PARAM,LGDISP,1\n", ["PARAM LGDISP at line"]),
    ("PARAM,VMOPT,2\nPARAM,INREL,-2\n", ["PARAM VMOPT at line", "PARAM INREL at line"]),
    ("PARAM,G,0.01\nPARAM,G,0.03\n", ["PARAM G .* 2 times, differently; 0.03 is taken", "PARAM G .* damps"]),
])  # fmt: skip
def test_every_other_parameter_is_listed_but_output_and_numerics(tmp_path, cards, sentences):
    found = told(scene_of(written(tmp_path, with_cards(deck()[0], cards)))[1])
    assert len(found) == len(sentences)
    assert all(re.match(sentence, line) for sentence, line in zip(sentences, found, strict=True))


@pytest.mark.parametrize(("cards", "sentence"), [
    ("PARAM,CK1,2.\n", r"PARAM CK1 at line \d+: multiplies"),
    ("PARAM,WTMASS,0.\n", "PARAM WTMASS is 0; expected a number above 0"),
    ("PARAM,G,-1.\n", "PARAM G is -1; expected a number from 0 on"),
    ("PARAM,ALPHA1,often\n", '"often" where a number is expected'),
])  # fmt: skip
def test_parameters_without_which_the_structure_is_another(tmp_path, cards, sentence):
    with pytest.raises((SceneError, MeshError), match=sentence):
        scene_of(written(tmp_path, with_cards(deck()[0], cards)))


def test_suggested_density_is_in_the_units_of_the_deck(tmp_path):
    """Steel in MPa without a density: 7.8e-9 t/mm^3, since the numbers stay as they are."""
    draft = draft_of(written(tmp_path, changed(deck()[0], ("7.8-9", ""))))
    table = next(t for t in draft.tables if t.path[0] == "materials")
    assert draft.units == "any" and table.values["youngs_modulus"] == 2.1e5
    assert [suggestion for suggestion, _ in table.open] == ["density = 7.8e-09"]
