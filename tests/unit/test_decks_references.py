"""What acts on reference nodes of Abaqus decks, and parameters of couplings: taken over, told or asked for."""

from __future__ import annotations

import pytest
from deck_scenes import written
from deck_texts import deck_of

from fe_squeal.decks.scene import draft_of
from meshes import box

BLOCK = deck_of(box("hex1", (2, 1, 1), (100.0, 50.0, 20.0), name="P"))
REFERENCE = "*Node\n900, 0., 0., 20.\n901, 0., 0., 90.\n*Nset, nset=REF\n900\n"
PHYSICS = """*Solid Section, elset=P, material=S
*Material, name=S
*Elastic
210000., 0.3
*Density
7.85e-9
"""
STEP = "*Step\n*Frequency\n10\n*End Step\n"
COUPLING = "*Coupling, constraint name=C, ref node=REF, surface=top_P{}\n*Kinematic\n"
WHOLE = COUPLING.format("")


def rigid(tmp_path, text, coupling=WHOLE, history=""):
    """Return [[rigid]] of a block with a reference node, and the draft."""
    draft = draft_of(written(tmp_path, BLOCK + REFERENCE + coupling + text + PHYSICS + history + STEP))
    (table,) = [table for table in draft.tables if table.path == ("rigid",)]
    return table.values, draft


@pytest.mark.parametrize(("transform", "freedoms", "fixed"), [
    ("R\n1., 0., 0., 0., 0., 1.", "2", "z"), ("R\n1., 0., 0., 0., 0., 1.", "5, 6", "ry rz"),
    ("R\n0., 0., 1., 1., 0., 0.", "1, 2", "x z"), ("C\n0., 0., 0., 0., 1., 0.", "1", "z"),
    ("C\n0., 0., 0., 0., 0., 1.", "1, 2", "x y"), ("R\n1., 1., 0., -1., 1., 0.", "ENCASTRE", "x y z rx ry rz"),
])  # fmt: skip
def test_references_are_held_in_their_own_axes(tmp_path, transform, freedoms, fixed):
    """The last but one lies on the axis of its cylinder: the plane across it is held all the same."""
    text = f"*Transform, nset=REF, type={transform}\n"
    values, draft = rigid(tmp_path, text, history=f"*Boundary\nREF, {freedoms}\n")
    assert values["fixed"] == fixed and not draft.missing


def test_oblique_axes_of_references_are_asked_for(tmp_path):
    text = "*Transform, nset=REF\n1., 1., 0., -1., 1., 0.\n"
    values, draft = rigid(tmp_path, text, history="*Boundary\nREF, 1\n")
    assert "fixed" not in values and "*Boundary: holds node 900 in axes of *Transform" in draft.missing[0]


@pytest.mark.parametrize("held", ["1, 1", "2, 2"])
def test_ground_is_held_along_a_spring(tmp_path, held):
    """A spring along z between the reference and a node that is held along 1 of its own axes, which is z."""
    text = "*Transform, nset=G\n0., 0., 1., 1., 0., 0.\n*Nset, nset=G\n901\n"
    text += "*Element, type=SPRING2, elset=S\n1001, 900, 901\n*Spring, elset=S\n3, 3\n100.\n"
    values, draft = rigid(tmp_path, text, history=f"*Boundary\n901, {held}\n")
    if held[0] == "1":
        assert values["springs"] == [{"direction": [0.0, 0.0, 1.0], "stiffness": 1e5}] and not draft.missing
    else:
        assert "springs" not in values and "ends at a node that neither" in draft.missing[0]


@pytest.mark.parametrize(("radius", "missing"), [(1.0, True), (112.0, False)])
def test_influence_radius(tmp_path, radius, missing):
    """The surface of 100 by 50 is coupled as a whole, or its nodes within the radius are asked for."""
    _, draft = rigid(tmp_path, "", COUPLING.format(f", influence radius={radius}"))
    assert bool(draft.missing) == missing
    assert not missing or "INFLUENCE RADIUS" in draft.missing[0]


def masses(*lines):
    text = "".join(f"*Element, type={kind}, elset=M{i}\n{1000 + i}, 900\n" for i, (kind, _) in enumerate(lines))
    return text + "".join(keyword.format(f"elset=M{i}") for i, (_, keyword) in enumerate(lines))


def test_masses_of_one_node_add_up(tmp_path):
    values, draft = rigid(tmp_path, masses(
        ("MASS", "*Mass, {}\n1.\n"), ("MASS", "*Mass, {}\n2.\n"), ("ROTARYI", "*Rotary Inertia, {}\n1., 2., 3.\n"),
        ("ROTARYI", "*Rotary Inertia, {}\n1., 1., 1., .5\n")))  # fmt: skip
    assert values["mass"] == 3000.0 and values["inertia"] == pytest.approx([2e-3, 3e-3, 4e-3, 5e-4, 0.0, 0.0])
    assert not [f for f in draft.findings if f.weight != "harmless"]


def test_masses_that_are_not_simulated(tmp_path):
    """Masses that differ by direction are asked for, their own damping is told."""
    values, draft = rigid(tmp_path, masses(("MASS", "*Mass, {}, type=ANISOTROPIC\n1., 2., 3.\n")))
    assert "mass" not in values and "*Mass, TYPE=ANISOTROPIC" in draft.missing[0]
    values, draft = rigid(tmp_path, masses(("MASS", "*Mass, {}, type=ANISOTROPIC\n1., 1., 1.\n")))
    assert values["mass"] == 1000.0 and not draft.missing
    for alpha, told in ((100.0, True), (0.0, False)):
        values, draft = rigid(tmp_path, masses(("MASS", f"*Mass, {{}}, alpha={alpha}\n1.\n")))
        assert values["mass"] == 1000.0 and any("damping of a single mass" in line for line in draft.told) == told


def test_rigid_bodies(tmp_path):
    """All node sets are taken; a reference at the centre of mass and element sets are asked for."""
    body = "*Rigid Body, ref node=900, tie nset=N_top_P, pin nset=N_left_P{}\n"
    values, draft = rigid(tmp_path, "", body.format(""))
    assert values["nodes"] == "N_top_P, N_left_P" and not draft.missing
    _, draft = rigid(tmp_path, "", body.format(", position=CENTER OF MASS"))
    assert "*Rigid Body, POSITION" in draft.missing[0]
    _, draft = rigid(tmp_path, "", body.format(", elset=P"))
    assert 'of element set "P" is not read' in draft.missing[0]


def test_equations_in_turned_axes_are_asked_for(tmp_path):
    face = [line.split(",")[0] for line in BLOCK.splitlines() if line.endswith(", 20.0") and line.count(",") == 3]
    terms = "".join(f"{node}, 1, {-1 / len(face)!r}\n" for node in face)
    equation = f"*Equation\n{len(face) + 1}\n900, 1, 1.\n{terms}"
    transform = "*Transform, nset=REF\n0., 1., 0., -1., 0., 0.\n"
    for text, missing in ((equation, False), (equation + transform, True)):
        draft = draft_of(written(tmp_path, BLOCK + REFERENCE + text + PHYSICS + STEP))
        assert any("axes of *Transform" in sentence for sentence in draft.missing) == missing
