"""Freedoms of a reference that *Distributing and RBE3 release: what acts on these does not act on the part."""

from __future__ import annotations

import numpy as np
import pytest
from deck_scenes import written
from deck_texts import deck_of

import fe_squeal
from fe_squeal.decks.released import drop_released
from fe_squeal.decks.scene import draft_of, scene_of
from fe_squeal.errors import MeshError
from meshes import box

BLOCK = deck_of(box("hex1", (2, 1, 1), (100.0, 50.0, 20.0), name="P"))
DECK = """*Node
900, 40., 25., 60.
*Nset, nset=REF
900
{more}*Coupling, constraint name=C, ref node=REF, surface=top_P{axes}
*Distributing
{lines}*Boundary
REF, {held}
*Solid Section, elset=P, material=S
*Material, name=S
*Elastic
210000., 0.3
*Density
7.85e-9
*Step
*Frequency
10
*End Step
"""
TURNED = "*Orientation, name=O\n0., 1., 0., -1., 0., 0.\n"  # x of it is y, y is -x
OBLIQUE = "*Orientation, name=O\n1., 1., 0., -1., 1., 0.\n"
SPRING = "*Element, type=SPRING1, elset=K\n1001, 900\n*Spring, elset=K{}\n{}\n5.e6\n"
INERTIA = "*Element, type=ROTARYI, elset=I\n1002, 900\n*Rotary Inertia, elset=I\n{}\n"


def averaged(tmp_path, lines, more="", held="1, 6", axes=""):
    """Return [[averaged]] of a block whose top is coupled to a reference above it, and the draft."""
    draft = draft_of(written(tmp_path, BLOCK + DECK.format(lines=lines, more=more, held=held, axes=axes)))
    (table,) = [table for table in draft.tables if table.path == ("averaged",)]
    return table.values, draft


def free_motions(scene):
    """Return the number of motions of a scene that nothing holds."""
    pencil = fe_squeal.assemble(scene).pencil()
    values = np.linalg.eigvals(np.linalg.solve(pencil.M.toarray(), pencil.K.toarray())).real
    return int((values < 1e-9 * values.max()).sum())


@pytest.mark.parametrize(("lines", "released"), [
    ("", 0), ("1, 6\n", 0), ("1, 3\n", 3), ("1, 4\n", 2), ("1, 3\n6, 6\n", 2), ("1, 3\n5, 6\n", 1),
])  # fmt: skip
def test_released_rotations_are_free(tmp_path, lines, released):
    """A block whose reference is held in all six freedoms turns about it in each way that the coupling releases."""
    path = written(tmp_path, BLOCK + DECK.format(lines=lines, more="", held="ENCASTRE", axes=""))
    scene, draft = scene_of(path)
    assert free_motions(scene) == released
    assert bool([f for f in draft.findings if "do not act on the part" in f.text]) == bool(released)


def test_translations_are_always_tied(tmp_path):
    values, draft = averaged(tmp_path, "4, 5\n")
    assert values["fixed"] == "x y z rx ry" and "releases none" in draft.told[-1]
    with pytest.raises(MeshError, match=r"\*Distributing: degrees of freedom 4 to 3; expected a first one of 1 to 6"):
        averaged(tmp_path, "4, 3\n")


@pytest.mark.parametrize(("orientation", "lines", "fixed"), [
    (TURNED, "1, 4\n", "x y z ry"), (TURNED, "1, 3\n5, 5\n", "x y z rx"), (OBLIQUE, "1, 3\n", "x y z"),
    (OBLIQUE, "1, 5\n", "x y z rx ry"), (OBLIQUE, "1, 4\n", None),
])  # fmt: skip
def test_freedoms_are_along_the_orientation(tmp_path, orientation, lines, fixed):
    values, draft = averaged(tmp_path, lines, orientation, axes=", orientation=O")
    if fixed is None:
        assert "releases rotations of node REF in axes that are not along x, y and z" in draft.missing[0]
    else:
        assert values["fixed"] == fixed and not draft.missing


def test_what_acts_on_released_rotations(tmp_path):
    """Springs and moments of inertia about them are left out, what couples them with others is asked for."""
    values, draft = averaged(tmp_path, "1, 4\n", SPRING.format("", 5) + INERTIA.format("1., 2., 3."), "6, 6")
    assert values["inertia"] == pytest.approx([1e-3, 0, 0, 0, 0, 0]) and not {"springs", "fixed"} & set(values)
    assert not draft.missing
    values, draft = averaged(tmp_path, "1, 4\n", SPRING.format("", 4), "1, 1")
    assert values["springs"] == [{"axis": [1.0, 0.0, 0.0], "stiffness": 5e3}] and not draft.missing
    for more, key in ((OBLIQUE + SPRING.format(", orientation=O", 5), "springs"),
                      (INERTIA.format("1., 2., 3., 0.1"), "inertia")):  # fmt: skip
        values, draft = averaged(tmp_path, "1, 4\n", more)
        assert key in values and draft.missing[0].endswith(f"acts on its other freedoms as well: {key}")
        values, draft = averaged(tmp_path, "1, 3\n", more)
        assert key not in values and not draft.missing


def test_tables_of_released_freedoms():
    values = {"fixed": "x y rx", "mass": 1.0, "springs": [{"direction": [0.0, 1.0, 0.0], "stiffness": 1.0}]}
    assert drop_released(values, {1}) == (["fixed", "springs"], ["mass"])
    assert values == {"fixed": "x", "mass": 1.0}


def bulk(refc, system="", more=""):
    """Return a deck of Nastran with a cube of 1 m whose top an RBE3 ties to a grid point that is held and sprung."""
    corners = [(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    text = "SOL 103\nCEND\nSPC = 1\nBEGIN BULK\nCORD2R,7,,0.,0.,0.,0.,0.,1.\n,0.,1.,0.\n"
    text += "CORD2R,8,,0.,0.,0.,0.,0.,1.\n,1.,1.,0.\n"
    text += "".join(f"GRID,{i},,{x}.,{y}.,{z}.\n" for i, (x, y, z) in enumerate(corners, 1))
    text += "CHEXA,1,1,1,2,3,4,5,6\n,7,8\nPSOLID,1,1\nMAT1,1,2.1+11,,.3,7800.\n"
    text += f"GRID,9,,.5,.5,2.,{system}\nRBE3,10,,9,{refc},1.,123,5,6\n,7,8\nSPC1,1,123456,9\n"
    return text + more + "EIGRL,3,,,9\nENDDATA\n"


@pytest.mark.parametrize(("refc", "released"), [("123456", 0), ("123", 3), ("1234", 2), ("35", 4)])
def test_components_of_rbe3(tmp_path, refc, released):
    scene, draft = scene_of(written(tmp_path, bulk(refc), "cube.bdf"))
    assert free_motions(scene) == released and not draft.missing


def test_components_of_rbe3_in_axes_of_their_own(tmp_path):
    """REFC counts in the displacement system of the reference: 4 is about y in system 7, and about neither in 8."""
    for system, fixed in (("7", "x y z ry"), ("8", None)):
        draft = draft_of(written(tmp_path, bulk("1234", system), "cube.bdf"))
        (table,) = [table for table in draft.tables if table.path == ("averaged",)]
        if fixed:
            assert table.values["fixed"] == fixed and not draft.missing
        else:
            assert "ties freedoms of GRID 9 in a system that is not along x, y and z" in draft.missing[0]


def test_what_acts_on_both(tmp_path):
    draft = draft_of(written(tmp_path, bulk("13", more="CONM2,11,9,,2.\n"), "cube.bdf"))
    assert draft.missing[0].startswith("RBE3 at line 22: ties [1, 3] of GRID 9 alone")
    assert draft.missing[0].endswith("acts on its other freedoms as well: mass")
    for refc in ("", "1237"):
        with pytest.raises(MeshError, match=rf'RBE3 10 has "{refc}" as freedoms of its reference \(REFC\)'):
            draft_of(written(tmp_path, bulk(refc), "cube.bdf"))
