"""Friction of Abaqus decks that steps change, and words of contact that narrow down what is in contact."""

from __future__ import annotations

import re

import numpy as np
import pytest
from deck_scenes import deck, written

from fe_squeal.decks.scene import draft_of
from fe_squeal.errors import MeshError

CHANGE = "*Change Friction, interaction=PADS{}\n"


def tables(draft, *path):
    return [t.values for t in draft.tables if t.path == path]


def of(tmp_path, first, *changes):
    text = deck().replace("*Friction\n0.4\n", first).replace("*Motion", "".join(changes) + "*Motion")
    return draft_of(written(tmp_path, text))


@pytest.mark.parametrize(("first", "changes", "mu"), [
    ("*Friction\n0.4\n", [CHANGE.format(""), "*Friction\n0.1\n", CHANGE.format(", reset")], 0.4),
    ("", [CHANGE.format(""), "*Friction\n0.1\n", CHANGE.format(", reset")], None),
    ("*Friction, rough\n", [CHANGE.format(""), "*Friction\n0.3\n"], 0.3),
    ("*Friction, exponential decay\n0.4, 0.2, 1.e9\n", [CHANGE.format(""), "*Friction\n0.1\n"], 0.1),
    ("*Friction, exponential decay\n0.4, 0.2, 1.e9\n",
     [CHANGE.format(""), "*Friction\n0.1\n", CHANGE.format(", reset")], 0.2),
])  # fmt: skip
def test_the_friction_that_counts_is_the_last(tmp_path, first, changes, mu):
    draft = of(tmp_path, first, *changes)
    (contact,) = tables(draft, "contacts")
    assert contact.get("kind", "sliding") == ("sliding" if mu else "frictionless")
    assert [t["mu"] for t in tables(draft, "effects", "friction")] == ([mu] if mu else [])


def test_points_that_stop_slipping_are_tied(tmp_path):
    draft = of(tmp_path, "*Friction\n0.4\n", CHANGE.format(""), "*Friction, rough\n")
    assert [t["kind"] for t in tables(draft, "contacts")] == ["tied"]
    assert not tables(draft, "effects", "friction")


def test_friction_that_an_amplitude_stops_short_is_asked_for(tmp_path):
    table = "*Amplitude, name=A\n0., 0., 1., {}\n*Step\n*Static"
    for end, asked in ((0.5, True), (1.0, False)):
        text = deck().replace("*Step\n*Static", table.format(end), 1)
        text = text.replace("*Motion", CHANGE.format(", amplitude=A") + "*Friction\n0.1\n*Motion")
        draft = draft_of(written(tmp_path, text))
        assert any("*Change Friction" in line and "does not end at 1" in line for line in draft.missing) == asked


def test_a_limit_of_shear_is_told(tmp_path):
    draft = of(tmp_path, "*Friction, taumax=12.\n0.4\n")
    assert any("TAUMAX=12" in line for line in draft.told)


TRANSLATION = ("*Motion, rotation, type=VELOCITY\nN_top, 5., 0., 0., 0., 0., 0., 1.\n",
               "*Motion, type=VELOCITY\nN_top, 1, 1, -200.\n")  # fmt: skip
DECAY = "*Friction, exponential decay\n0.5, 0.3, 0.002,\n"
RATES = "*Friction\n0.5, 0.\n0.4, 100.\n0.3, 300., , \n"


def mean_speed():
    """Of the pad's face, 60 x 30 mm, on a disc that turns with 5 rad/s about z: m/s."""
    x, y = ((np.arange(400) + 0.5) / 400 * size + begin for size, begin in ((0.06, -0.03), (0.03, 0.07)))
    return 5 * np.hypot(*np.meshgrid(x, y)).mean()


@pytest.mark.parametrize(("law", "moved", "mu", "slope"), [
    (DECAY, False, lambda v: 0.3 + 0.2 * np.exp(-2 * v), lambda v: -0.4 * np.exp(-2 * v)),
    (DECAY, True, lambda v: 0.3 + 0.2 * np.exp(-0.4), lambda v: -0.4 * np.exp(-0.4)),
    (RATES, False, lambda v: 0.3, lambda v: None), (RATES, True, lambda v: 0.35, lambda v: -0.5),
], ids=["decay, turning", "decay, moving", "rates, turning", "rates, moving"])  # fmt: skip
def test_friction_is_that_at_the_sliding_speed(tmp_path, law, moved, mu, slope):
    """The deck counts mm; beyond the last slip rate the coefficient is constant."""
    text = deck().replace("*Friction\n0.4\n", law).replace(*(TRANSLATION if moved else ("", "")))
    draft = draft_of(written(tmp_path, text))
    speed = mean_speed()
    (friction,) = tables(draft, "effects", "friction")
    assert friction["mu"] == pytest.approx(mu(speed), rel=1e-5)
    (told,) = [f for f in draft.findings if f.what == "*Friction"]
    assert f"{0.2 if moved else speed:.3g} m/s" in told.text and told.weight == "changes"
    found = re.search(r"dmu/dv = (\S+) s/m, for \[effects\.falling_friction\] slope", told.text)
    assert (found and float(found[1])) == (slope(speed) and pytest.approx(slope(speed), rel=1e-2))


@pytest.mark.parametrize(("law", "sentence"), [
    (DECAY, "which the deck does not give: mu = 0.5 of the first row"),
    (RATES, "which the deck does not give: mu = 0.5 of the first row"),
])  # fmt: skip
def test_friction_at_a_speed_that_is_not_known_is_that_at_rest(tmp_path, law, sentence):
    text = deck().replace("*Friction\n0.4\n", law).replace(TRANSLATION[0], "")
    draft = draft_of(written(tmp_path, text))
    assert any(f.what == "*Friction" and sentence in f.text for f in draft.findings)
    assert [t["mu"] for t in tables(draft, "effects", "friction")] == [0.5]


@pytest.mark.parametrize("law", [
    "*Friction, user\n0.5\n", "*Friction, exponential decay, test data\n0.5\n0.4, 100.\n",
    "*Friction\n0.5, 0., , 20.\n0.4, 0., , 90.\n", "*Friction\n0.5, 0., 1.\n0.4, 100., 2.\n",
])  # fmt: skip
def test_other_laws_of_friction_are_told(tmp_path, law):
    draft = of(tmp_path, law)
    assert [t["mu"] for t in tables(draft, "effects", "friction")] == [0.5]
    assert sum(f.what == "*Friction" for f in draft.findings) == 1


def general(exclusion):
    return deck().replace("*Contact Pair, interaction=PADS\nbottom_pad, top\n",
        f"*Contact\n*Contact Exclusions\n{exclusion}\n*Contact Inclusions\nbottom_pad, top\n"
        "*Contact Property Assignment\n , , PADS\n")  # fmt: skip


def test_a_pair_that_is_excluded_is_none(tmp_path):
    for line in ("TOP, bottom_pad", ", top"):
        assert not tables(draft_of(written(tmp_path, general(line))), "contacts")
    for line in ("top, ", "top, top"):  # of the surface with itself
        assert len(tables(draft_of(written(tmp_path, general(line))), "contacts")) == 1
    draft = draft_of(written(tmp_path, general("bottom_pad, hub")))
    assert len(tables(draft, "contacts")) == 1
    assert any("*Contact Exclusions" in line for line in draft.told)


@pytest.mark.parametrize(("line", "mu", "is_told"), [
    ("top, , NONE", [0.4], True), ("top, TOP, NONE", [0.4], True), (", top, NONE", [], False),
    ("top, bottom_pad, NONE", [], False), (", , NONE", [], False),
])  # fmt: skip
def test_whose_contact_has_a_property(tmp_path, line, mu, is_told):
    """With the first surface blank that of the second with all, with the second one blank that of the first alone."""
    text = general("bottom_pad, hub") + "*Surface Interaction, name=NONE\n"
    draft = draft_of(written(tmp_path, text.replace(" , , PADS", f" , , PADS\n{line}")))
    assert [t["mu"] for t in tables(draft, "effects", "friction")] == mu
    assert any("top with itself" in line for line in draft.told) == is_told


def test_a_tie_of_some_nodes_is_asked_for(tmp_path):
    text = deck().replace("*Contact Pair, interaction=PADS", "*Tie, name=GLUE, tied nset=N_back_pad")
    assert any('"N_back_pad" alone' in line for line in draft_of(written(tmp_path, text)).missing)


@pytest.mark.parametrize(("asked", "solve", "told"), [
    ("20, 5000.", {"modes": 20}, ""), (", 5000.", {"max_frequency": 5000.0}, ""),
    ("20, 5000., 1.e6", {"modes": 20}, "nearest to a shift point"),
])  # fmt: skip
def test_subspace_iteration_has_fields_of_its_own(tmp_path, asked, solve, told):
    """Number, highest frequency, shift: by the fields of Lanczos 5000 would be the lowest, 1e6 the highest one."""
    text = deck().replace("*Complex Frequency\n12,", f"*Frequency, eigensolver=SUBSPACE\n{asked}")
    draft = draft_of(written(tmp_path, text))
    assert tables(draft, "solve") == [solve]
    found = [f.text for f in draft.findings if f.what == "*Frequency"]
    assert len(found) == bool(told) and all(told in text for text in found)


def test_whole_numbers_are_not_divided_where_releases_differ(tmp_path):
    def parameters(text):
        return deck().replace("*Material, name=STEEL", f"*Parameter\n{text}\n*Material, name=STEEL").replace(
            "\n0.4\n", "\n<mu>\n")  # fmt: skip

    for text, mu in (("n = 2\nmu = n/5.", 0.4), ("mu = (2**2/2)*0.1", 0.2), ("mu = 3/6.", 0.5)):
        (friction,) = tables(draft_of(written(tmp_path, parameters(text))), "effects", "friction")
        assert friction["mu"] == pytest.approx(mu, rel=1e-15)
    for text in ("mu = 1/2", "n = 2\nmu = n/5", "mu = 2**3/16"):
        with pytest.raises(MeshError, match="divides whole numbers, of which some releases of Abaqus take 0 "):
            draft_of(written(tmp_path, parameters(text)))
