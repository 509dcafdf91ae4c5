"""Abaqus decks that miss something, or are wrong: asked for, or refused in a sentence."""

from __future__ import annotations

import re
import tomllib

import pytest
from deck_scenes import deck, written

from fe_squeal.cli import main
from fe_squeal.decks.scene import draft_of, scene_of
from fe_squeal.errors import MeshError, SceneError


@pytest.mark.slow
@pytest.mark.parametrize(("change", "sentence"), [
    (("pressure-overclosure=LINEAR\n1500.", "pressure-overclosure=HARD"),
     r"contacts.bottom_pad_on_top: \*Surface Behavior at line \d+: hard contact; give normal_stiffness .*10 E/h ="),
    (("*Density\n7.8E-9\n", ""), "materials.STEEL: the deck has no density"),
    (("*Motion, rotation, type=VELOCITY\nN_top, 5., 0., 0., 0., 0., 0., 1.\n", ""), r"friction but no \*Motion"),
    (("*Solid Section, elset=disc, material=STEEL\n", ""), r"\*Solid Section: 12 solid elements .* have none"),
    (("*Step\n*Static", "*Equation\n2\n1, 1, 1., 2, 1, -1.\n*Step\n*Static"), r"\*Equation at line \d+: ties freedoms"),
    (("*Contact Pair, interaction=PADS\nbottom_pad, top\n", "*Contact\n*Contact Inclusions, ALL EXTERIOR\n"),
     r"\*Contact Inclusions at line \d+: surfaces of general contact"),
    (("*Boundary\n", "*Transform, nset=N_top, type=C\n0., 0., 0., 0., 0., 1.\n*Boundary\nN_top, 1\n"),
     r'\*Boundary at line \d+: holds "N_top" in axes of \*Transform'),
    (("system=RECTANGULAR", "system=CYLINDRICAL"), r"\*Orientation at line \d+: SYSTEM=CYLINDRICAL"),
    (("2\n3.\n", "5\n3.\n"), r"\*Spring at line \d+: acts on degrees of freedom \[5\]"),
])  # fmt: skip
def test_what_is_missing_is_asked_for(tmp_path, capsys, change, sentence):
    """Not run on the fly, and a line in the scene that is written; nothing is guessed."""
    path = written(tmp_path, deck().replace(*change))
    with pytest.raises(SceneError, match=sentence):
        scene_of(path)
    assert main(["new", str(path), "-o", str(tmp_path / "s.toml")]) == 0
    text = (tmp_path / "s.toml").read_text()
    asked = tomllib.loads(text).get("unsettled", [])
    assert "# TO BE GIVEN" in text or (len(asked) == 1 and re.search(sentence, asked[0]))
    with pytest.raises(SceneError):
        scene_of(tmp_path / "s.toml")
    assert "to be given there before it runs: 1" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize(("change", "sentence"), [
    (("N_hub, ENCASTRE", "N_hubb, ENCASTRE"), r'"N_hubb" refers to node set "N_hubb", .* did you mean "N_hub"\?'),
    (("N_hub, ENCASTRE", "N_hub, CLAMPED"), '"CLAMPED" is no degree of freedom'),
    (("N_hub, ENCASTRE", "N_hub"), "names no degree of freedom"),
    (("N_back_pad, 2", "N_back_pad, 2, 1"), "degrees of freedom 2 to 1"),
    (("2.1E5, 0.3", "2.1E5, abc"), r'"abc" in a data line of \*Elastic is not a number'),
    (("interaction=PADS\nbottom", "interaction=PADSS\nbottom"), r'interaction "PADSS", .* did you mean "PADS"\?'),
    (("elset=pad, material=LINING", "elset=pad, material=LINNING"), '"LINNING", which the deck does not define'),
    (("beta=1.E-7", "beta=often"), r'"often" behind a parameter of \*Damping is not a number'),
    (("90001, 10001", "90001, 777777"), "777777"),
])  # fmt: skip
def test_bad_decks_are_refused_in_a_sentence(tmp_path, capsys, change, sentence):
    path = written(tmp_path, deck().replace(*change))
    with pytest.raises(MeshError, match=sentence):
        scene_of(path)
    assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_parameters_are_arithmetic_and_nothing_else(tmp_path):
    """Python of a deck is not run."""
    for line in ("x = __import__('os').system('true')", "x = open('/etc/passwd')", "x = 9**9**9**9", "x = 1 .real"):
        path = written(tmp_path, deck().replace("*Material, name=STEEL", f"*Parameter\n{line}\n*Material, name=STEEL"))
        with pytest.raises(MeshError, match="is no parameter that is understood"):
            draft_of(path)


def test_suggested_density_is_in_the_units_of_the_deck(tmp_path):
    """Without any density nothing is converted to SI: in a mesh of millimetres with MPa steel has 7.8e-9 t/mm^3."""
    text = deck().replace("*Density\n7.8E-9\n", "").replace("*Density\n2.5E-9\n", "")
    draft = draft_of(written(tmp_path, text))
    asked = [suggestion for table in draft.tables for suggestion, _ in table.open]
    assert draft.units == "any" and asked == ["density = 7.8e-09"] * 2
    assert all("mm, t, s (N, MPa), steel has 7.8e-09, which is 7800 kg/m^3" in text for text in draft.missing)
    one = draft_of(written(tmp_path, text.replace("*Elastic\n2.1E5", "*Density\n7.8E-9\n*Elastic\n2.1E5")))
    asked = [suggestion for table in one.tables for suggestion, _ in table.open]
    assert one.units == "SI" and asked == ["density = 7800.0"]
