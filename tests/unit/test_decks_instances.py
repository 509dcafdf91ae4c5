"""Abaqus parts in an assembly: names belong to their part, and axes of a part turn with each of its instances."""

from __future__ import annotations

import numpy as np
import pytest
from deck_scenes import written
from deck_texts import deck_of

from fe_squeal.decks.scene import draft_of
from fe_squeal.errors import MeshError
from meshes import box

BLOCK = deck_of(box("hex1", (2, 1, 1), (100.0, 50.0, 20.0), name="P"))
STEEL = "*Solid Section, elset=P, material=S\n"
LINING = "*Solid Section, elset=P, material=L, orientation=Ori-1\n"
REFERENCE = "*Node\n900, 50., 25., 60.\n*Nset, nset=REF\n900\n"
MATERIALS = """*Material, name=S
*Elastic
210000., 0.3
*Density
7.85e-9
*Material, name=L
*Elastic, type=ENGINEERING CONSTANTS
2000., 1000., 500., .2, .2, .2, 300., 200.,
100.
*Density
2.6e-9
"""
STEP = "*Step\n*Frequency\n10\n*End Step\n"
TURNED = "0., 0., 0.\n0., 0., 0., 0., 0., 1., 90.\n"  # about z: the part's x is along y, its y along -x


def assembly(parts, places=None, more="", history=""):
    """Return a deck with an instance A-1 of part A, ..., at its place, and what the assembly and the model have."""
    text = "".join(f"*Part, name={name}\n{BLOCK}{own}*End Part\n" for name, own in parts.items())
    text += "*Assembly, name=ALL\n"
    for i, name in enumerate(parts):
        place = (places or {}).get(name, f"0., 0., {100 * i}.\n")
        text += f"*Instance, name={name}-1, part={name}\n{place}*End Instance\n"
    return text + more + "*End Assembly\n" + MATERIALS + history + STEP


def tables(tmp_path, text, kind):
    draft = draft_of(written(tmp_path, text))
    return [table.values for table in draft.tables if table.path[0] == kind], draft


def orientation(first, second):
    return f"*Orientation, name=Ori-1\n{', '.join(map(str, first + second))}\n1, 0.\n"


X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def test_orientations_of_one_name(tmp_path):
    """Each part means its own, and that of the assembly where it has none."""
    parts = {"A": orientation(X, Y) + LINING, "B": orientation(Y, Z) + LINING}
    bodies, _ = tables(tmp_path, assembly(parts), "bodies")
    assert "axes" not in bodies[0] and bodies[1]["axes"] == [list(Y), list(Z)]
    parts = {"A": LINING, "B": orientation(Y, Z) + LINING}
    bodies, _ = tables(tmp_path, assembly(parts, more=orientation(Z, X)), "bodies")
    assert [body["axes"] for body in bodies] == [[list(Z), list(X)], [list(Y), list(Z)]]
    with pytest.raises(MeshError, match=r'no \*Orientation "Ori-1" in the deck for this part'):
        tables(tmp_path, assembly(parts), "bodies")


def spring(stiffness, node, more=""):
    text = "*Element, type=SPRING1, elset=Springs-1\n{1}\n*Spring, elset=Springs-1{2}\n1\n{0}\n"
    return text.format(stiffness, f"1001, {node}", more)


def test_springs_of_one_name(tmp_path):
    springs, _ = tables(tmp_path, assembly({"A": spring(100.0, 1) + STEEL, "B": spring(7000.0, 2) + STEEL}), "springs")
    assert [(s["nodes"], s["stiffness"]) for s in springs] == [("A-1.1", 1e5), ("B-1.2", 7e6)]


def test_springs_of_a_part_are_in_each_of_its_instances(tmp_path):
    text = assembly({"A": spring(100.0, 1) + STEEL}, more="*Instance, name=A-2, part=A\n0., 0., 300.\n*End Instance\n")
    springs, _ = tables(tmp_path, text, "springs")
    assert [(s["nodes"], s["stiffness"]) for s in springs] == [("A-1.1", 1e5), ("A-2.1", 1e5)]


def test_springs_of_the_assembly(tmp_path):
    """Their nodes have the instance in front; so has the set of a part that the assembly names."""
    more = spring(100.0, "A-1.1")
    springs, _ = tables(tmp_path, assembly({"A": STEEL}, more=more), "springs")
    assert [(s["nodes"], s["stiffness"]) for s in springs] == [("A-1.1", 1e5)]
    own = "*Element, type=SPRING1, elset=S\n1001, 1\n"
    more = "*Spring, elset=B-1.S\n1\n100.\n*Spring, elset=A-1.S\n1\n200.\n"
    springs, _ = tables(tmp_path, assembly({"A": own + STEEL, "B": own + STEEL}, more=more), "springs")
    assert sorted((s["nodes"], s["stiffness"]) for s in springs) == [("A-1.1", 2e5), ("B-1.1", 1e5)]


def mass(value):
    tie = "*Coupling, constraint name=C, ref node=REF, surface=top_P\n*Kinematic\n"
    return f"{REFERENCE}*Element, type=MASS, elset=M-1\n1001, 900\n*Mass, elset=M-1\n{value}\n{tie}{STEEL}"


def test_masses_of_one_name(tmp_path):
    rigid, _ = tables(tmp_path, assembly({"A": mass(1e-3), "B": mass(5e-3)}), "rigid")
    assert [(r["surface"], r["mass"]) for r in rigid] == [("A-1.top_P", 1.0), ("B-1.top_P", 5.0)]


def test_couplings_of_a_part_are_in_each_of_its_instances(tmp_path):
    """Each has its own reference node, at its own place, and all that acts on it."""
    own = mass(1e-3) + "*Boundary\nREF, 1, 2\n"
    text = assembly({"A": own}, more="*Instance, name=A-2, part=A\n0., 0., 300.\n*End Instance\n")
    rigid, draft = tables(tmp_path, text, "rigid")
    assert not draft.missing
    assert [(r["surface"], r["mass"], r["fixed"]) for r in rigid] == [(f"A-{i}.top_P", 1.0, "x y") for i in (1, 2)]
    assert [r["reference"] for r in rigid] == [[0.05, 0.025, 0.06], [0.05, 0.025, 0.36]]
    assert len({r["name"] for r in rigid}) == 2


@pytest.mark.parametrize(("axes", "more", "direction"), [
    (orientation(X, Y), ", orientation=Ori-1", list(Y)), (orientation(Y, Z), ", orientation=Ori-1", [-1.0, 0.0, 0.0]),
    ("", "", list(X)),
])  # fmt: skip
def test_springs_turn_with_their_instance(tmp_path, axes, more, direction):
    """As their *Orientation does; without one their freedoms are along the global axes."""
    text = assembly({"A": axes + spring(100.0, 1, more) + STEEL}, {"A": TURNED})
    springs, _ = tables(tmp_path, text, "springs")
    assert springs[0]["direction"] == direction


def test_axes_of_the_assembly_do_not_turn(tmp_path):
    text = assembly({"A": STEEL}, {"A": TURNED}, orientation(X, Y) + spring(100.0, "A-1.1", ", orientation=Ori-1"))
    springs, _ = tables(tmp_path, text, "springs")
    assert springs[0]["direction"] == list(X)


@pytest.mark.parametrize(("kind", "points", "freedom", "fixed"), [
    ("R", "0., 0., 1., 1., 0., 0.", 2, "y"), ("R", "0., 1., 0., -1., 0., 0.", 1, "x"),
    ("C", "0., 0., 0., 0., 1., 0.", 3, "x"), ("C", "0., 0., 0., 1., 0., 0.", "1, 2", "xz"),
    ("C", "0., 0., 0., 0., 0., 1.", 1, "y"), ("S", "-10., 0., 0., -10., 0., 1.", 2, "x"),
])  # fmt: skip
def test_transforms_turn_with_their_instance(tmp_path, kind, points, freedom, fixed):
    """Of a node at x = 100 of the part, which is at y = 100 here."""
    node = next(line.split(",")[0] for line in BLOCK.splitlines() if line.endswith(", 100.0, 0.0, 0.0"))
    own = f"*Nset, nset=BC\n{node}\n*Transform, nset=BC, type={kind}\n{points}\n{STEEL}"
    text = assembly({"A": own}, {"A": TURNED}, history=f"*Boundary\nA-1.BC, {freedom}\n")
    supports, draft = tables(tmp_path, text, "supports")
    assert [s["fixed"] for s in supports] == [fixed] and not draft.missing


def test_inertia_turns_with_its_part(tmp_path):
    """Without an *Orientation it is about the axes of the part, two of which are turned into each other here."""
    own = mass(1e-3) + "*Element, type=ROTARYI, elset=RI\n1002, 900\n*Rotary Inertia, elset=RI\n1., 2., 3., .5\n"
    rigid, _ = tables(tmp_path, assembly({"A": own}, {"A": TURNED}), "rigid")
    np.testing.assert_allclose(rigid[0]["inertia"], np.array([2.0, 1.0, 3.0, -0.5, 0.0, 0.0]) * 1e-3, atol=1e-18)


def test_inertia_turns_with_its_orientation(tmp_path):
    """1, 2, 3 about y, z, x; in a part that is turned about z by 90 degrees, about -x, z, y."""
    inertia = "*Element, type=ROTARYI, elset=RI\n1002, 900\n*Rotary Inertia, elset=RI, orientation=Ori-1\n"
    own = mass(1e-3) + orientation(Y, Z) + inertia + "1., 2., 3., .5\n"
    plain, _ = tables(tmp_path, assembly({"A": own}), "rigid")
    np.testing.assert_allclose(plain[0]["inertia"], np.array([3.0, 1.0, 2.0, 0.0, 0.0, 0.5]) * 1e-3)
    turned, _ = tables(tmp_path, assembly({"A": own}, {"A": TURNED}), "rigid")
    np.testing.assert_allclose(turned[0]["inertia"], np.array([1.0, 3.0, 2.0, 0.0, -0.5, 0.0]) * 1e-3, atol=1e-18)
