"""Abaqus decks as scenes: each beside the same scene by hand, in the dialects in which preprocessors write."""

from __future__ import annotations

import numpy as np
import pytest
from deck_scenes import assert_same_matrices, by_hand, deck, matrices, written

import fe_squeal
from fe_squeal.decks.scene import scene_of


@pytest.mark.parametrize("kind", ["hex1", pytest.param("tet2", marks=pytest.mark.slow)])
def test_deck_is_the_scene_by_hand(tmp_path, kind):
    path = written(tmp_path, deck(kind))
    scene, draft = scene_of(path)
    assert not [f for f in draft.findings if f.weight != "harmless"]
    assert scene.sweep.grid[-1] == 0.4 and scene.solve.modes == 12
    assert_same_matrices(matrices(fe_squeal.parse_scene(by_hand(path))), matrices(scene))


def _upper(text):
    return "\n".join(line.upper() if line.startswith("*") else line for line in text.split("\n"))


DIALECTS = {
    "capitals": lambda t: _upper(t).replace("NAME=BOTTOM_PAD", "name=Bottom_Pad"),
    "HyperMesh's comments": lambda t: t.replace("*Material", '**\n**HM_comp_by_property "steel" 3\n*MATERIAL'),
    "keywords over two lines": lambda t: t.replace("*Elastic, type=ENG", "*Elastic,\n  type=ENG"),
    "Windows": lambda t: t.replace("\n", "\r\n"),
    "D exponents": lambda t: t.replace("7.8E-9", "7.8D-09").replace("2.1E5", " 0.21d+6"),
    "exponents without E": lambda t: t.replace("7.8E-9", "7.8-9").replace("2.1E5", "2.1+5"),
    "blank fields": lambda t: t.replace("N_back_pad, 2\n", "N_back_pad, 2,,\n").replace("12,\n", "12,,,,\n"),
    "blanks and tabs": lambda t: t.replace(", ", " ,\t").replace("*Surface Interaction", "*SURFACE  INTERACTION"),
    "quoted names": lambda t: t.replace("STEEL", '"cast steel"'),
    "steps with OP=NEW": lambda t: t.replace(
        "*Static\n", "*Static\n*Boundary, op=NEW\nN_hub, 1, 3\nN_left_pad, XSYMM\nN_back_pad, 2, 2\n"),
    "internal sets": lambda t: t.replace("*Boundary\nN_hub, ENCASTRE", "*Nset, nset=_PickedSet5, internal\nN_hub\n"
                                         "*Boundary\n_PickedSet5, 1, 6"),
    "an amplitude": lambda t: t.replace(
        "*Step\n*Static", "*Amplitude, name=RAMP\n0., 0., 1., 1.\n*Step\n*Static").replace(
        "*Dsload", "*Dsload, amplitude=RAMP"),
    "friction in a later step": lambda t: t.replace("*Friction\n0.4", "*Friction\n0.").replace(
        "*Motion", "*Change Friction, interaction=PADS\n*Friction\n0.4\n*Motion"),
    "the moving side named first": lambda t: t.replace("bottom_pad, top\n", "top, bottom_pad\n"),
    "general contact": lambda t: t.replace("*Contact Pair, interaction=PADS\nbottom_pad, top\n",
        "*Contact\n*Contact Inclusions\nbottom_pad, top\n*Contact Property Assignment\n , , NONE\n, top, PADS\n"),
    "pressure on faces of elements": lambda t: t.replace("*Dsload\ntop_pad, P, 1.5\n", "*Dload\n"
        + t.split("name=top_pad, type=ELEMENT\n")[1].split("*")[0].replace("S", "P").replace("\n", ", 1.5\n")),
    "turned axes": lambda t: t.replace(
        "*Boundary\n", "*Nset, nset=TURNED_NODES\nN_left_pad, N_back_pad\n*Transform, nset=TURNED_NODES\n"
        "0., 1., 0., -1., 0., 0.\n*Boundary\n").replace(
        "N_left_pad, 1, 1\nN_back_pad, 2", "N_left_pad, 2, 2\nN_back_pad, 1"),
    "parameters": lambda t: t.replace("*Material, name=STEEL", "*Parameter\nE = 2.1e5  # MPa\nhalf = 0.2\nmu = 2*half\n"
                                      "*Material, name=STEEL").replace("2.1E5,", "<E>,").replace("\n0.4\n", "\n<mu>\n"),
}  # fmt: skip


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return matrices(scene_of(written(tmp_path_factory.mktemp("plain"), deck()))[0])


FAST = ("keywords over two lines", "exponents without E", "steps with OP=NEW", "parameters")


@pytest.mark.parametrize("dialect", [d if d in FAST else pytest.param(d, marks=pytest.mark.slow) for d in DIALECTS])
def test_dialects_say_the_same(tmp_path, plain, dialect):
    text = DIALECTS[dialect](deck())
    assert text != deck()
    assert_same_matrices(plain, matrices(scene_of(written(tmp_path, text))[0]))


@pytest.mark.parametrize(("name", "length", "mass", "time"), [
    ("m, kg, s", 1.0, 1.0, 1.0), ("mm, t, s", 1e-3, 1e3, 1.0), ("mm, kg, ms", 1e-3, 1.0, 1e-3),
    ("mm, g, ms", 1e-3, 1e-3, 1e-3), ("mm, kg, s", 1e-3, 1.0, 1.0),
])  # fmt: skip
def test_units(tmp_path, name, length, mass, time):
    """The same structure in other consistent units is the same scene."""
    pressure, density = mass / (length * time**2), mass / length**3
    text = f"""*Material, name=STEEL
*Density
{7800 / density!r}
*Elastic
{2.1e11 / pressure!r}, 0.3
*Damping, alpha={10 * time!r}, beta={1e-7 / time!r}
*Solid Section, elset=disc, material=STEEL
*Solid Section, elset=pad, material=STEEL
*Element, type=SPRINGA, elset=S
90001, 10001, 1
*Spring, elset=S

{4e6 / (mass / time**2)!r}
*Surface Interaction, name=I
*Surface Behavior, pressure-overclosure=LINEAR
{1e12 / (pressure / length)!r}
*Contact Pair, interaction=I
bottom_pad, top
*Boundary
N_hub, PINNED
*Step
*Frequency
, , {5000 * time!r}
*End Step
"""
    path = written(tmp_path, deck(physics=text, scale=1 / length))
    scene, draft = scene_of(path)
    assert name in draft.head[1]
    assert scene.contacts[0].kind == "frictionless" and scene.contacts[0].normal_stiffness == pytest.approx(1e12)
    assert scene.springs[0].stiffness == pytest.approx(4e6) and scene.springs[0].to == "1"
    assert scene.bodies["pad"].rayleigh.alpha == pytest.approx(10) and scene.solve.max_frequency == pytest.approx(5000)
    way = np.array(scene.springs[0].direction)
    np.testing.assert_allclose(way, np.array([0.08, -0.07, -0.01]) / np.linalg.norm([0.08, 0.07, 0.01]), atol=1e-12)
    assert scene.materials["STEEL"].youngs_modulus == pytest.approx(2.1e11)


def test_orthotropic_stiffness_and_its_engineering_constants_are_one(tmp_path, plain):
    """TYPE=ORTHOTROPIC with the stiffness of these constants gives the same scene."""
    e, (n12, n13, n23) = np.array([6000.0, 5000.0, 1500.0]), (0.2, 0.15, 0.1)
    S = np.array([[1 / e[0], -n12 / e[0], -n13 / e[0]], [-n12 / e[0], 1 / e[1], -n23 / e[1]],
                  [-n13 / e[0], -n23 / e[1], 1 / e[2]]])  # fmt: skip
    D = np.linalg.inv(S)
    numbers = [D[0, 0], D[0, 1], D[1, 1], D[0, 2], D[1, 2], D[2, 2], 2000.0, 1000.0, 900.0]
    rows = ", ".join(map(repr, map(float, numbers[:8]))) + f"\n{numbers[8]}"
    text = deck().replace("type=ENGINEERING CONSTANTS\n6000., 5000., 1500., 0.2, 0.15, 0.1, 2000., 1000.\n900.",
                          f"type=ORTHOTROPIC\n{rows}")  # fmt: skip
    other = written(tmp_path, text, "other.inp")
    assert_same_matrices(plain, matrices(scene_of(other)[0]), 1e-11)
