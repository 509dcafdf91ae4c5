"""Abaqus decks as scenes: each beside the same scene by hand, in the dialects in which preprocessors write."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from deck_texts import deck_of

import fe_squeal
from fe_squeal.cli import main
from fe_squeal.decks.scene import draft_of, scene_of
from fe_squeal.errors import MeshError, SceneError
from meshes import annulus, box

SMALL_BRAKE = Path(__file__).parents[2] / "examples" / "small_brake.inp"

# A pad (a block of 80 x 40 x 20 mm) on a disc, in mm, t and s. Its spring is of 3 N/mm at each of two nodes.
PHYSICS = """*Material, name=STEEL
*Density
7.8E-9
*Elastic
2.1E5, 0.3
*Material, name=LINING
*Density
2.5E-9
*Elastic, type=ENGINEERING CONSTANTS
6000., 5000., 1500., 0.2, 0.15, 0.1, 2000., 1000.
900.
*Damping, alpha=10., beta=1.E-7
*Solid Section, elset=disc, material=STEEL
*Solid Section, elset=pad, material=LINING, orientation=TURNED
*Orientation, name=TURNED, system=RECTANGULAR
0., 1., 0., -1., 0., 0.
3, 0.
*Element, type=SPRING1, elset=GUIDES
90001, 10001
90002, 10002
*Element, type=DASHPOT1, elset=DAMPERS
90003, 10003
*Spring, elset=GUIDES
2
3.
*Dashpot, elset=DAMPERS
1
0.02
*Surface Interaction, name=PADS
*Friction
0.4
*Surface Behavior, pressure-overclosure=LINEAR
1500.
*Contact Pair, interaction=PADS
bottom_pad, top
*Boundary
N_hub, ENCASTRE
N_left_pad, 1, 1
N_back_pad, 2
*Step
*Static
*Dsload
top_pad, P, 1.5
*Motion, rotation, type=VELOCITY
N_top, 5., 0., 0., 0., 0., 0., 1.
*End Step
*Step
*Complex Frequency
12,
*End Step
"""


def mesh(kind="hex1"):
    disc = annulus(kind, (1, 12, 1), 0.05, 0.12, 0.01)
    return disc, box(kind, (3, 2, 1), (0.06, 0.03, 0.02), (-0.03, 0.07, 0.01), name="pad")


def deck(kind="hex1", physics=PHYSICS, scale=1e3):
    disc, pad = mesh(kind)
    return "*Heading\n" + deck_of(disc, scale) + deck_of(pad, scale, first=10000) + physics


def by_hand(path):
    """The scene that PHYSICS means, in SI."""
    return {
        "mesh": {"file": str(path), "length_unit": "mm"},
        "materials": {
            "steel": {"youngs_modulus": 2.1e11, "poisson_ratio": 0.3, "density": 7800.0},
            "lining": {"youngs_modulus": [6e9, 5e9, 1.5e9], "poisson_ratio": [0.1, 0.15, 0.2],
                       "shear_modulus": [0.9e9, 1e9, 2e9], "density": 2500.0}},
        "bodies": {"disc": {"material": "steel"}, "pad": {"material": "lining", "axes": [[0.0, 1.0, 0.0], [-1.0, 0, 0]],
                                                          "rayleigh": {"alpha": 10.0, "beta": 1e-7}}},
        "supports": [{"surface": "hub", "fixed": "xyz"}, {"surface": "left_pad", "fixed": "x"},
                     {"surface": "back_pad", "fixed": "y"}],
        "springs": [{"name": "a", "nodes": "10001", "direction": [0, 1, 0], "stiffness": 3000.0},
                    {"name": "b", "nodes": "10002", "direction": [0, 1, 0], "stiffness": 3000.0},
                    {"name": "c", "nodes": "10003", "direction": [1, 0, 0], "damping": 20.0}],
        "contacts": [{"surface": "bottom_pad", "counterface": "top", "normal_stiffness": 1.5e12,
                      "sliding": {"axis": [0, 0, 1], "speed": 5.0}}],
        "effects": {"friction": {"mu": 0.4}, "preload": {"pressures": {"top_pad": 1.5e6}}},
        "solve": {"modes": 12},
    }  # fmt: skip


def matrices(scene):
    """M, C and K + mu K_f of a scene at its numbers."""
    pencil = fe_squeal.assemble(scene).pencil()
    return [A for A in (pencil.M, pencil.C, pencil.K) if A is not None]


def assert_same_matrices(a, b, tolerance=1e-12):
    assert len(a) == len(b)
    for A, B in zip(a, b, strict=True):
        assert A.shape == B.shape
        assert abs(A - B).max() <= tolerance * abs(A).max()


def written(tmp_path, text, name="brake.inp"):
    (tmp_path / name).write_text(text)
    return tmp_path / name


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
1, 10001, 1
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


@pytest.mark.parametrize(("change", "sentence"), [
    (("pressure-overclosure=LINEAR\n1500.", "pressure-overclosure=HARD"),
     r"contacts.bottom_pad_on_top: \*Surface Behavior at line \d+: hard contact; give normal_stiffness .*10 E/h ="),
    (("*Density\n7.8E-9\n", ""), "materials.STEEL: the deck has no density"),
    (("*Motion, rotation, type=VELOCITY\nN_top, 5., 0., 0., 0., 0., 0., 1.\n", ""), r"friction but no \*Motion"),
    (("*Solid Section, elset=disc, material=STEEL\n", ""), r"\*Solid Section: 12 solid elements .* have none"),
    (("*Step\n*Static", "*Equation\n2\n1, 1, 1., 2, 1, -1.\n*Step\n*Static"), r"\*Equation at line \d+: ties parts"),
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
    tomllib.loads(text)
    assert "# TO BE GIVEN" in text or "# Not taken over, and needed:" in text
    assert "to be given there before it runs: 1" in capsys.readouterr().out


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


def test_new_keeps_what_is_there(tmp_path, capsys):
    path = written(tmp_path, deck())
    (tmp_path / "s.toml").write_text("mine")
    assert main(["new", str(path), "-o", str(tmp_path / "s.toml")]) == 2
    assert "exists already" in capsys.readouterr().err
    assert (tmp_path / "s.toml").read_text() == "mine"


def test_template_of_a_mesh(tmp_path, capsys):
    """Bodies and groups of a mesh without physics; what has to be given is counted."""
    import meshio

    meshio.write(tmp_path / "a.vtu", meshio.Mesh(
        60 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]), [("tetra", [[0, 1, 2, 3]])],
        cell_data={"part": [np.array([3])]}))  # fmt: skip
    assert main(["new", str(tmp_path / "a.vtu"), "-o", str(tmp_path / "sub.toml")]) == 0
    scene = tomllib.loads((tmp_path / "sub.toml").read_text())
    assert scene["mesh"] == {"file": "a.vtu", "length_unit": "mm", "order": 2}
    assert list(scene["bodies"]) == ["part_3"] and scene["bodies"]["part_3"]["groups"] == ["part:3"]
    assert "to be given there before it runs: 3" in capsys.readouterr().out


def test_small_brake_is_read(tmp_path):
    """The example: two pads of one part, springs of both, the turned axes of the second, friction of a later step."""
    scene, draft = scene_of(SMALL_BRAKE)
    assert not draft.missing and scene.effects.on["friction"].mu == 0.5
    assert {b.material for b in scene.bodies.values()} == {"CAST_IRON", "LINING", "STEEL"}
    assert scene.bodies["PAD-2_LINING"].axes == ((-1, 0, 0), (0, 1, 0))
    assert {s.name: s.stiffness for s in scene.springs} == {"ABUTMENTS": 6e7, "GUIDES": 1e7}
    assert main(["new", str(SMALL_BRAKE), "-o", str(tmp_path / "s.toml")]) == 0
    again = fe_squeal.load_scene(tmp_path / "s.toml")
    assert again.model_dump(exclude={"mesh"}) == scene.model_dump(exclude={"mesh"})
    assert again.mesh_path.resolve() == SMALL_BRAKE.resolve()


@pytest.mark.slow
def test_small_brake_runs(tmp_path):
    """The example squeals at 4.3 kHz; `fe-squeal run examples/small_brake.inp` has 0.046174774 and 4303.54 Hz."""
    scene, _ = scene_of(SMALL_BRAKE)
    sweep = fe_squeal.sweep(fe_squeal.assemble(scene), [0.02, 0.06], modes=18)
    (onset,) = [o for o in sweep.onsets if abs(o.frequency_hz - 4303.54) < 1]
    assert onset.value == pytest.approx(0.046174774, rel=1e-6)




def test_two_parts_of_one_body_may_touch(tmp_path):
    """A deck has one section for several parts; a part that touches itself is refused all the same."""
    lower, upper = box("hex1", (2, 1, 1), (0.02, 0.01, 0.01)), box("hex1", (2, 1, 1), (0.02, 0.01, 0.01), (0, 0, 0.01))
    upper = replace(upper, _boundaries={"under": upper.boundaries["bottom"]})
    text = "*Heading\n" + deck_of(lower, 1e3) + deck_of(upper, 1e3, first=100)
    text += """*Material, name=STEEL
*Density
7.8E-9
*Elastic
2.1E5, 0.3
*Solid Section, elset=block, material=STEEL
*Tie, name=GLUE
under, top
*Step
*Frequency
4
*End Step
"""
    scene, draft = scene_of(written(tmp_path, text))
    assert list(scene.bodies) == ["block"] and scene.contacts[0].kind == "tied" and scene.contacts[0].name == "GLUE"
    assert [f.what for f in draft.findings if f.weight == "changes"] == ["*Tie"]
    # 100 E/h of an element's face of 10 mm by 10 mm
    assert scene.contacts[0].normal_stiffness == pytest.approx(100 * 2.1e11 / 0.01)
    glued = fe_squeal.assemble(scene).pencil()
    assert glued.free.motions.shape[1] == 6
    with pytest.raises(SceneError, match="both lie on body block"):
        fe_squeal.assemble(scene_of(written(tmp_path, text.replace("under, top", "bottom, top")))[0])


REFERENCE = """*Node
80001, -50., 15., 10.
80002, 200., 15., 10.
80003, 200., 15., 20.
*Nset, nset=REF
80001
*Element, type=MASS, elset=WEIGHT
70001, 80001
*Element, type=ROTARYI, elset=TURN
70002, 80001
*Element, type=SPRING1, elset=SR
70003, 80001
*Element, type=SPRING1, elset=ST
70004, 80001
*Element, type=SPRING2, elset=SG
70005, 80002, 80003
*Mass, elset=WEIGHT
1.5E-4
*Rotary Inertia, elset=TURN
0.2, 0.3, 0.4, 0., 0.01, 0.
*Spring, elset=SR
2
150.
*Spring, elset=ST
4
2.E5
*Spring, elset=SG
1, 1
700.
%s
*Boundary
REF, 3, 3
REF, 5, 6
80003, 1, 6
*Solid Section, elset=block, material=STEEL
*Material, name=STEEL
*Density
7.8E-9
*Elastic
2.1E5, 0.3
*Step
*Frequency
6
*End Step
"""
COUPLING = "*Coupling, constraint name=LEFT, ref node=REF, surface=left\n*{}\n"
RIGHT = "*Rigid Body, nset=N_right, ref node=80002\n"
SPELLINGS = {
    "rigid": COUPLING.format("Kinematic") + RIGHT, "averaged": COUPLING.format("Distributing") + RIGHT,
    "old rigid": "*Kinematic Coupling, ref node=80001\nN_left, 1, 6\n" + RIGHT,
    "beams": "*MPC\nBEAM, N_left, 80001\n" + RIGHT,
}


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_reference_nodes(tmp_path, spelling):
    """Mass, inertia, springs and held freedoms of a reference node come along, whichever keyword ties it."""
    block = box("hex1", (3, 2, 1), (0.06, 0.03, 0.02))
    path = written(tmp_path, "*Heading\n" + deck_of(block, 1e3) + REFERENCE % SPELLINGS[spelling])
    scene, draft = scene_of(path)
    assert not [f for f in draft.findings if f.weight != "harmless"]
    left = {"name": "LEFT", "surface": "left", "reference": [-0.05, 0.015, 0.01], "mass": 0.15,
            "inertia": [2e-4, 3e-4, 4e-4, 0.0, 1e-5, 0.0], "fixed": "z ry rz",
            "springs": [{"direction": [0, 1, 0], "stiffness": 1.5e5},
                        {"axis": [1, 0, 0], "stiffness": 200.0}]}  # fmt: skip
    right = {"name": "r", "surface": "right", "reference": [0.2, 0.015, 0.01],
             "springs": [{"direction": [1, 0, 0], "stiffness": 7e5}]}  # fmt: skip
    hand = {"mesh": {"file": str(path), "length_unit": "mm"}, "bodies": {"block": {"material": "steel"}},
            "materials": {"steel": {"youngs_modulus": 2.1e11, "poisson_ratio": 0.3, "density": 7800.0}},
            "rigid": [right], "solve": {"modes": 6}}  # fmt: skip
    if spelling == "averaged":
        hand["averaged"] = [left]
    else:
        hand["rigid"] = [left, right]
    found = [fe_squeal.assemble(s).pencil() for s in (fe_squeal.parse_scene(hand), scene)]
    values = [np.linalg.eigvals(np.linalg.solve(p.M.toarray(), p.K.toarray())).real for p in found]
    np.testing.assert_allclose(*(np.sort(v)[:20] for v in values), rtol=1e-8, atol=1e-8 * values[0].max())
    assert found[0].K.shape == found[1].K.shape
