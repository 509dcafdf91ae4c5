"""*Cload on the reference node of a coupling: an even pressure on its surface where that is the same."""

from __future__ import annotations

import numpy as np
import pytest
from deck_scenes import written
from deck_texts import deck_of

from fe_squeal.assembly.assembly import Assembly
from fe_squeal.assembly.bodies import read_mesh
from fe_squeal.decks.scene import draft_of, scene_of
from fe_squeal.effects.preload import pressure_load
from meshes import box

BLOCK = deck_of(box("hex1", (2, 1, 1), (100.0, 50.0, 20.0), name="P"))
DECK = """*Node
900, {place}
*Coupling, constraint name=C, ref node=900, surface=top_P
*{kind}
*Solid Section, elset=P, material=S
*Material, name=S
*Elastic
210000., 0.3
*Density
7.85e-9
*Boundary
N_bottom_P, 1, 3
{held}*Step
*Static
*Cload
900, {force}
*End Step
*Step
*Frequency
10
*End Step
"""
ABOVE, BESIDE = "50., 25., 60.", "62., 25., 60."  # the middle of the top, 100 by 50 at a height of 20, and 12 beside


def deck(force="3, -1000.", place=ABOVE, kind="Distributing", held="", block=BLOCK):
    return block + DECK.format(force=force, place=place, kind=kind, held=held)


def pressures(draft):
    return next((t.values["pressures"] for t in draft.tables if t.path == ("effects", "preload")), {})


@pytest.mark.parametrize("kind", ["Distributing", "Kinematic"])
@pytest.mark.parametrize(("place", "held"), [(ABOVE, ""), (ABOVE, "900, 1, 2\n"), (BESIDE, "900, 4, 6\n")])
def test_forces_through_the_middle(tmp_path, kind, place, held):
    """The pressure does the work of the force at the reference in each motion of the part."""
    scene, draft = scene_of(written(tmp_path, deck(kind=kind, place=place, held=held)))
    assert pressures(draft) == {"top_P": pytest.approx(1000.0 / 5e-3)}
    assembly = Assembly(scene, read_mesh(scene))
    space = assembly.space
    surface = space.surface(np.asarray(space.mesh.boundaries["top_P"]))
    load, resultant = pressure_load(space, surface, pressures(draft)["top_P"])
    np.testing.assert_allclose(resultant, [0.0, 0.0, -1000.0], rtol=0, atol=1e-9)
    (tie,) = space.ties
    work = space.reference(tie).T @ np.array([0.0, 0.0, -1000.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(load, work, rtol=0, atol=1e-9 * abs(load).max())


@pytest.mark.parametrize(("force", "place", "held", "told"), [
    ("1, -1000.", ABOVE, "", "is not along the normal of its surface, into it; "),
    ("3, 1000.", ABOVE, "", "is not along the normal of its surface, into it; "),
    ("3, -1000.\n900, 1, 300.", ABOVE, "", "the force of 1044 N on"),
    ("3, -1000.", BESIDE, "", "acts 0.012 m beside the middle of its surface; "),
    ("3, -1000.", BESIDE, "900, 4, 4\n", "acts 0.012 m beside the middle of its surface; "),
    ("4, 500.", ABOVE, "", 'moments on "900" are left out'),
])  # fmt: skip
def test_forces_that_are_no_pressure(tmp_path, force, place, held, told):
    """They are left out and told, with the area and the pressure of the same sum."""
    draft = draft_of(written(tmp_path, deck(force, place, held=held)))
    (line,) = [line for line in draft.told if "*Cload" in line]
    assert not pressures(draft) and told in line
    if "1000." in force:
        pressure = np.sqrt(1 + 0.3**2 * ("300" in force)) * 2e5
        assert f'on "top_P" of 0.005 m^2 is {pressure:.4g} Pa' in line


def test_forces_on_other_nodes(tmp_path):
    """Of nodes without a face their sum is said: two with 2 N each."""
    text = deck().replace("900, 3, -1000.", "SOME, 3, -2.").replace("*Solid", "*Nset, nset=SOME\n5, 6\n*Solid")
    (line,) = [line for line in draft_of(written(tmp_path, text)).told if "*Cload" in line]
    assert 'forces on "SOME", 4 N in all, are left out: [effects.preload] takes pressures on surfaces' in line


def test_a_force_comes_on_top_of_a_pressure(tmp_path):
    text = deck().replace("*Cload", "*Dsload\ntop_P, P, 0.3\n*Cload")
    assert pressures(draft_of(written(tmp_path, text))) == {"top_P": pytest.approx(3e5 + 2e5)}


def test_surfaces_that_are_not_flat(tmp_path):
    """The top, raised by 40 of 100 in the middle, has two halves whose normals are not along the force."""
    lines = []
    for line in BLOCK.splitlines(keepends=True):
        fields = [part.strip() for part in line.split(",")]
        is_node = len(fields) == 4 and "." in line and fields[3] == "20.0"
        lines.append(", ".join([*fields[:3], "60.0"]) + "\n" if is_node and fields[1] == "50.0" else line)
    draft = draft_of(written(tmp_path, deck(block="".join(lines))))
    assert not pressures(draft) and any("is not along the normal of its surface" in line for line in draft.told)
