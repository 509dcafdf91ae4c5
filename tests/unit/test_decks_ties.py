"""What ties parts and reference nodes of Abaqus decks together, beside the same scene by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from deck_scenes import written
from deck_texts import deck_of

import fe_squeal
from fe_squeal.decks.scene import draft_of, scene_of
from fe_squeal.errors import SceneError
from meshes import box


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


@pytest.mark.slow
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


@pytest.mark.parametrize(("freedoms", "missing"), [((1, 2, 3), False), ((1,), True)])
def test_equations_of_means(tmp_path, freedoms, missing):
    """A node that follows the mean of a face by *Equation: averaged, wherever it lies, or asked for beside a spring."""
    block = box("hex1", (3, 2, 1), (0.06, 0.03, 0.02))
    face = block.p.T[np.unique(block.facets[:, block.boundaries["left"]])]
    nodes = [int(n) + 1 for n in np.unique(block.facets[:, block.boundaries["left"]])]
    terms = [f"{n}, {{0}}, {-1 / len(nodes):.6f}" for n in nodes]
    lines = [", ".join(["80001, {0}, 1.", *terms[:3]]), ", ".join(terms[3:])]
    text = "".join(f"*Equation\n{len(nodes) + 1}\n" + "\n".join(lines).format(f) + "\n" for f in freedoms)
    path = written(tmp_path, "*Heading\n" + deck_of(block, 1e3) + (REFERENCE % text).replace(
        "REF, 3, 3\nREF, 5, 6\n80003, 1, 6", "80001, 3, 3").replace("ST\n4\n2.E5", "ST\n3\n0.").replace(
        "*Element, type=SPRING2, elset=SG\n70005, 80002, 80003\n", "").replace(
        "*Spring, elset=SG\n1, 1\n700.\n", "").replace(
        "*Rotary Inertia, elset=TURN\n0.2, 0.3, 0.4, 0., 0.01, 0.\n", ""))  # fmt: skip
    if missing:
        with pytest.raises(SceneError, match=r"ties \[1\] of node 80001 alone"):
            scene_of(path)
        return
    hand = {"mesh": {"file": str(path), "length_unit": "mm"}, "bodies": {"block": {"material": "steel"}},
            "materials": {"steel": {"youngs_modulus": 2.1e11, "poisson_ratio": 0.3, "density": 7800.0}},
            "averaged": [{"name": "a", "nodes": ", ".join(map(str, nodes)), "reference": face.mean(axis=0).tolist(),
                          "mass": 0.15, "fixed": "z", "springs": [{"direction": [0, 1, 0], "stiffness": 1.5e5}]}],
            "solve": {"modes": 6}}  # fmt: skip
    pencils = [fe_squeal.assemble(s).pencil() for s in (fe_squeal.parse_scene(hand), scene_of(path)[0])]
    values = [np.sort(np.linalg.eigvals(np.linalg.solve(p.M.toarray(), p.K.toarray())).real) for p in pencils]
    np.testing.assert_allclose(values[0][:20], values[1][:20], rtol=1e-8, atol=1e-8 * values[0].max())


SURFACE = "*Surface, type=NODE, name=S\nSOME,\n"


@pytest.mark.parametrize("kind", ["Kinematic\n1, 6", "Distributing"])
def test_couplings_of_surfaces_of_nodes_take_all_their_nodes(tmp_path, kind):
    """The nodes of a face with one beside it: the face alone would be another coupling, weighted by areas."""
    block = box("hex1", (3, 2, 1), (0.06, 0.03, 0.02))
    face = np.unique(block.facets[:, block.boundaries["left"]])
    beside = int(np.argmax(block.p[0]))
    text = f"*Nset, nset=SOME\n{', '.join(str(n + 1) for n in [*face, beside])}\n" + SURFACE
    text += f"*Node, nset=R\n80001, -50., 15., 10.\n*Coupling, ref node=R, surface=S\n*{kind}\n"
    draft = draft_of(written(tmp_path, "*Heading\n" + deck_of(block, 1e3) + text))
    (table,) = [t.values for t in draft.tables if t.path in (("rigid",), ("averaged",))]
    assert table["nodes"] == "S" and "surface" not in table


@pytest.mark.parametrize(("more", "asked"), [((), False), ((2,), True)])
def test_ties_of_surfaces_of_nodes_ask_where_faces_have_not_all_of_them(tmp_path, more, asked):
    a = box("hex1", (2, 1, 1), (0.04, 0.02, 0.02), name="a")
    b = box("hex1", (2, 1, 1), (0.04, 0.02, 0.02), (0.0, 0.0, 0.02), name="b")
    face = np.unique(a.facets[:, a.boundaries["top_a"]])
    others = np.setdiff1d(np.arange(a.p.shape[1]), face)[list(more)]
    text = f"*Nset, nset=SOME\n{', '.join(str(n + 1) for n in [*face, *others])}\n" + SURFACE
    text += "*Tie, name=T\nS, bottom_b\n"
    draft = draft_of(written(tmp_path, "*Heading\n" + deck_of(a, 1e3) + deck_of(b, 1e3, first=1000) + text))
    assert any("on no whole face" in f.text for f in draft.findings) is asked
