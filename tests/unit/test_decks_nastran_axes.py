"""Nastran decks whose grid points and bushes have axes of their own, and defaults of GRDSET."""

from __future__ import annotations

import re

import numpy as np
import pytest
from test_decks_nastran import deck, mesh
from test_decks_nastran_parameters import assert_same, changed, pencils, told, with_cards, written

from fe_squeal.decks.scene import draft_of, scene_of
from fe_squeal.errors import SceneError
from fe_squeal.mesh.readers.nastran.coordinates import System, axes_at, to_global

# Its x, y and z are the basic y, z and x.
CYCLIC = "CORD2R,7,,0.,0.,0.,1.,0.,0.\n,0.,1.,0.\n"
SKEW = "CORD2R,7,,0.,0.,0.,0.,0.,1.\n,0.8,0.6,0.\n"
SKEW_OF_GRIDS = "GRID,801,,0.,0.,0.\nGRID,802,,0.,0.,2.\nGRID,803,,8.,6.,0.\nCORD1R,7,801,802,803\n"


def turned(text, *grids):
    """A deck with CD = 7 at some grid points."""
    lines = []
    for line in text.splitlines():
        fields = line.split(",")
        if fields[0] == "GRID" and int(fields[1]) in grids:
            line = ",".join([*fields, "7"])
        lines.append(line)
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("kind", ["R", "C", "S"])
def test_axes_are_the_directions_in_which_coordinates_grow(kind):
    """Beside differences of positions, in a system that is defined in a cylindrical one."""
    outer = System("C", 0, np.array([[1.0, 2.0, 0.5], [1.0, 2.0, 3.0], [4.0, 2.5, 0.5]]))
    inner = System(kind, 3, np.array([[2.0, 40.0, 1.0], [2.5, 70.0, 3.0], [1.0, 10.0, 2.0]]))
    systems = {3: outer, 8: inner}
    place, step = np.array([[1.7, 35.0, 0.6]]), 1e-6
    point = to_global(place, 8, systems)
    steps = np.array([(to_global(place + step * e, 8, systems) - point)[0] for e in np.eye(3)])
    np.testing.assert_allclose(
        axes_at(point[0], 8, systems), steps / np.linalg.norm(steps, axis=1, keepdims=True), atol=1e-5
    )


def test_freedoms_are_counted_in_the_displacement_system(tmp_path):
    """The same springs, dampers and held rotations along y, z, x of CD as along x, y, z."""
    text, middle = deck()
    plain = with_cards(text, "SPC1,7,6,900\n")
    changes = [(f"CELAS1,43,6,{middle},3", f"CELAS1,43,6,{middle},2"),
               (f"CDAMP2,44,0.05,{middle},1", f"CDAMP2,44,0.05,{middle},3"),
               ("CELAS2,41,150.0,900,2", "CELAS2,41,150.0,900,1"), ("CELAS2,42,3.+5,900,4", "CELAS2,42,3.+5,900,6"),
               ("SPC1,7,6,900", "SPC1,7,5,900")]  # fmt: skip
    other = with_cards(turned(changed(plain, *changes), middle, 900), CYCLIC)
    (known, _), (scene, draft) = scene_of(written(tmp_path, plain)), scene_of(written(tmp_path, other))
    assert not told(draft) and scene.rigid[0].fixed == known.rigid[0].fixed == "rz"
    assert_same(*pencils(known, scene))


@pytest.mark.parametrize("system", [SKEW, SKEW_OF_GRIDS], ids=["CORD2R", "CORD1R"])
def test_springs_act_along_any_direction(tmp_path, system):
    text, middle = deck()
    draft = draft_of(written(tmp_path, with_cards(turned(text, middle), f"{system}CELAS2,50,80.,{middle},2\n")))
    assert not told(draft)
    values = next(t.values for t in draft.tables if t.values.get("name") == "CELAS2_50")
    np.testing.assert_allclose(values["direction"], [-0.6, 0.8, 0.0], atol=1e-12)
    text = with_cards(turned(text, middle), f"{system}CELAS2,50,80.,{middle},2,{middle + 1},2\n")
    with pytest.raises(SceneError, match=r"CELAS2 at line \d+: moves its ends along different directions"):
        scene_of(written(tmp_path, text))


def test_supports_in_a_polar_system(tmp_path):
    """Radial and tangential together are x and y; axial alone is z; radial alone is asked for."""
    polar = "CORD2C,7,,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\n"
    text, middle = deck()
    for freedoms, fixed in (("12", "xy"), ("3", "z"), ("123", "xyz")):
        cards = f"{polar}SPC1,7,{freedoms},{middle}\n"
        scene, draft = scene_of(written(tmp_path, with_cards(turned(text, middle), cards)))
        assert not told(draft)
        assert [s.fixed for s in scene.supports if str(middle) in s.nodes.split(", ")] == [fixed]
    with pytest.raises(SceneError, match=r"GRID at line \d+: is held in part .* other directions than x, y and z"):
        scene_of(written(tmp_path, with_cards(turned(text, middle), f"{polar}SPC1,7,1,{middle}\n")))
    with pytest.raises(SceneError, match=r"GRID at line \d+: acts along axes of coordinate system 7, which is not"):
        scene_of(written(tmp_path, with_cards(turned(text, middle), f"SPC1,7,1,{middle}\n")))


@pytest.mark.parametrize(("cid", "system"), [("7", CYCLIC), ("0", "")])
def test_bushes_act_along_their_system(tmp_path, cid, system):
    """At a grid point with another displacement system, which does not count for them; at the cap about axes, too."""
    text, middle = deck()
    sizes = {"0": "K,1.,2.,3.,5.,6.,7.", "7": "K,2.,3.,1.,6.,7.,5."}
    cap = f"PBUSH,70,{sizes[cid]}\nCBUSH,71,70,900,,,,,{cid}\n"
    bush = f"PBUSH,72,{sizes[cid].rsplit(',', 3)[0]}\nCBUSH,73,72,{middle},,,,,{cid}\n"
    known = "".join(f"CELAS2,{90 + i},{i}.,{middle},{i}\n" for i in (1, 2, 3))
    known += "".join(f"CELAS2,{80 + i},{k}.,900,{i}\n" for i, k in enumerate((1, 2, 3, 5, 6, 7), 1))
    grids = (middle,) if cid == "7" else ()
    unsprung = changed(text, (f"CELAS1,43,6,{middle},3\n", ""), (f"CDAMP2,44,0.05,{middle},1\n", ""))
    scene, draft = scene_of(written(tmp_path, with_cards(turned(unsprung, *grids), system + cap + bush)))
    assert not told(draft)
    assert_same(*pencils(scene_of(written(tmp_path, with_cards(unsprung, known)))[0], scene), "MK")


@pytest.mark.parametrize(("cards", "sentence"), [
    ("PBUSH,70,K,1.,2.,3.\nCBUSH,71,70,{middle}\n", "CBUSH at line .*acts along axes of its own"),
    ("PBUSH,70,K,1.,2.,3.\nCBUSH,71,70,{middle},,,,,55\n", "CBUSH at line .*system 55, which is not read"),
    ("PBUSH,70,K,RIGID\nCBUSH,71,70,{middle},,,,,0\n", "PBUSH at line .*ties grid points rigidly"),
    ("GRID,901,,90.,15.,10.\nSPC1,7,123456,901\nPBUSH,70,K,1.,1.,1.\nCBUSH,71,70,900,901,,,,0\n",
     "CBUSH at line .*acts off its grid point"),
    ("SPOINT,950\nCELAS2,50,3.,{middle},1,950\n", "CELAS2 at line .*acts on freedoms 1 and 0"),
])  # fmt: skip
def test_bushes_and_springs_in_doubt_are_asked_for(tmp_path, cards, sentence):
    text, middle = deck()
    with pytest.raises(SceneError, match=sentence):
        scene_of(written(tmp_path, with_cards(text, cards.format(middle=middle))))


@pytest.mark.parametrize(("cards", "sentence"), [
    ("CELAS2,50,3.,{middle},1,,,0.1\n", "CELAS2 at line .*: GE of springs"),
    ("PELAS,60,3.,0.1\nCELAS1,50,60,{middle},1\n", "CELAS1 at line .*: GE of springs"),
    ("PBUSH,60,K,3.,3.,3.\n,GE,0.1\nCBUSH,50,60,{middle},,,,,0\n", "PBUSH at line .*: GE of springs"),
    ("PBUSH,60,K,3.,3.,3.,,,\n,M,0.1\nCBUSH,50,60,{middle},,,,,0\n", "PBUSH at line .*: adds mass"),
])  # fmt: skip
def test_losses_and_masses_of_springs_are_told(tmp_path, cards, sentence):
    text, middle = deck()
    (line,) = told(draft_of(written(tmp_path, with_cards(text, cards.format(middle=middle)))))
    assert re.match(sentence, line)


def test_defaults_of_grid_points(tmp_path):
    """PS and CD of GRDSET hold where GRID has blanks; 0 does not take them."""
    text = deck()[0]
    drafts = []
    for held in ("GRDSET,,,,,,,3\n", f"SPC1,7,3,1,THRU,{mesh().p.shape[1]}\n"):
        other = changed(text, ("GRID,900,,80.0,15.0,10.0\n", "GRID,900,,80.0,15.0,10.0,,0\n"))
        drafts.append(draft_of(written(tmp_path, with_cards(other, held))))
    tables = [[t.values for t in draft.tables if t.path[0] in ("supports", "rigid", "springs")] for draft in drafts]
    assert tables[0] == tables[1] and any(t.get("fixed") == "z" for t in tables[0])
    text = with_cards(text, f"{CYCLIC}GRDSET,,,,,,7\n")
    values = [t.values for t in draft_of(written(tmp_path, text)).tables if t.path[0] in ("springs", "rigid")]
    assert [v["direction"] for v in values if v.get("name") == "CELAS1_43"] == [[1.0, 0.0, 0.0]]
    assert [s["direction"] for v in values for s in v.get("springs", []) if "direction" in s] == [[0.0, 0.0, 1.0]]
