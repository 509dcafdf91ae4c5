"""Nastran decks as scenes: beside the same scene by hand, in free, small and large fields."""

from __future__ import annotations

import numpy as np
import pytest
import skfem

import fe_squeal
from fe_squeal.decks.scene import scene_of
from fe_squeal.errors import MeshError, SceneError
from fe_squeal.mesh.elements import FACES
from fe_squeal.mesh.readers.nastran.text import read_cards
from meshes import box

SIZE = (0.06, 0.03, 0.02)
HEX = FACES["hexahedron"]


def free_field(*fields):
    """A card with commas."""
    lines = [",".join(map(str, fields[:9]))]
    lines += ["," + ",".join(map(str, fields[i : i + 8])) for i in range(9, len(fields), 8)]
    return "\n".join(lines) + "\n"


def small_field(*fields):
    """A card in columns of 8."""
    text = [str(f) for f in fields]
    lines = ["".join(f"{t:<8}" for t in text[:9])]
    lines += [" " * 8 + "".join(f"{t:<8}" for t in text[i : i + 8]) for i in range(9, len(text), 8)]
    return "\n".join(line.rstrip() for line in lines) + "\n"


def large_field(*fields):
    """A card in columns of 16, four in a line."""
    text = [str(f) for f in fields]
    lines = [f"{text[0] + '*':<8}" + "".join(f"{t:<16}" for t in text[1:5])]
    lines += ["*       " + "".join(f"{t:<16}" for t in text[i : i + 4]) for i in range(5, len(text), 4)]
    return "\n".join(line.rstrip() for line in lines) + "\n"


def mesh():
    return box("hex1", (3, 2, 1), SIZE)


def order_of_corners(m):
    """Corners of each hexahedron, as Nastran and VTK count them."""
    from fe_squeal.mesh.elements import REFERENCE, matching

    return m.t.T[:, matching(REFERENCE["hexahedron"], np.asarray(skfem.MeshHex1.elem().doflocs))]


def deck(card=free_field, extra=""):
    """A block in mm, t and s, held at the left, sprung, with a rigid cap and a pressure; `card` writes a card."""
    m = mesh()
    text = "SOL 107\nCEND\nSPC = 7\nMETHOD = 3\nLOAD = 5\nBEGIN BULK\n$ANSA_NAME_COMMENT;4;PSOLID;Lining block;;NO;\n"
    for i, x in enumerate(m.p.T, 1):
        text += card("GRID", i, "", *(f"{1e3 * v:.6g}" if v else "0." for v in x))
    corners = order_of_corners(m)
    for e, row in enumerate(corners, 1):
        text += card("CHEXA", e, 4, *(row + 1))
    text += card("PSOLID", 4, 2) + card("MAT1", 2, "2.1+5", "", 0.3, "7.8-9", "", "", 0.02)
    left, right = (np.flatnonzero(np.abs(m.p[0] - x) < 1e-9) + 1 for x in (0, SIZE[0]))
    text += card("SPC1", 7, 123, *left[:4]) + card("SPC", 7, left[4], 123, 0.0, left[5], 123, 0.0)
    text += card("SPC1", 8, 123456, 1, "THRU", 20)  # of a set that is not selected
    text += card("GRID", 900, "", 80.0, 15.0, 10.0) + card("RBE2", 31, 900, 123456, *right)
    text += card("CONM2", 32, 900, "", "2.-4", "", "", "", "", 0.2, -0.01, 0.3, 0.0, 0.0, 0.4)
    text += card("CELAS2", 41, 150.0, 900, 2) + card("CELAS2", 42, "3.+5", 900, 4)
    middle = int(np.argmin(np.linalg.norm(m.p.T - [0.02, 0.015, 0.02], axis=1))) + 1
    text += card("PELAS", 6, 70.0) + card("CELAS1", 43, 6, middle, 3) + card("CDAMP2", 44, 0.05, middle, 1)
    text += card("PBUSH", 9, "K", 11.0, 11.0, 11.0) + card("CBUSH", 45, 9, middle, "", "", "", "", 0)
    for e, row in enumerate(corners, 1):
        for face in HEX:
            if np.allclose(m.p[2][row[list(face)]], SIZE[2]):
                text += card("PLOAD4", 5, e, 2.0, "", "", "", row[face[0]] + 1, row[face[2]] + 1)
    return text + card("EIGRL", 3, "", "", 6) + extra + "ENDDATA\n", middle


def by_hand(path, middle):
    springs = [{"name": "a", "nodes": str(middle), "direction": [0, 0, 1], "stiffness": 7e4},
               {"name": "b", "nodes": str(middle), "direction": [1, 0, 0], "damping": 50.0}]  # fmt: skip
    springs += [{"name": c, "nodes": str(middle), "direction": d, "stiffness": 1.1e4}
                for c, d in (("k", [1, 0, 0]), ("l", [0, 1, 0]), ("m", [0, 0, 1]))]  # fmt: skip
    left, right = (np.flatnonzero(np.abs(mesh().p[0] - x) < 1e-9) + 1 for x in (0, SIZE[0]))
    return {
        "mesh": {"file": str(path), "length_unit": "mm"}, "bodies": {"b": {"material": "s", "groups": ["4"]}},
        "materials": {"s": {"youngs_modulus": 2.1e11, "poisson_ratio": 0.3, "density": 7800.0, "loss_factor": 0.02}},
        "supports": [{"nodes": ", ".join(map(str, left)), "fixed": "xyz"}],
        "springs": springs,
        "rigid": [{"name": "cap", "nodes": ", ".join(map(str, right)), "reference": [0.08, 0.015, 0.01], "mass": 0.2,
                   "inertia": [2e-4, 3e-4, 4e-4, 1e-5, 0.0, 0.0],
                   "springs": [{"direction": [0, 1, 0], "stiffness": 1.5e5}, {"axis": [1, 0, 0], "stiffness": 300.0}]}],
        "effects": {"preload": {"pressures": {"PLOAD4_5": 2e6}}, "structural_damping": {}}, "solve": {"modes": 6},
    }  # fmt: skip


@pytest.mark.parametrize("card", [free_field, small_field, large_field])
def test_deck_is_the_scene_by_hand(tmp_path, card):
    text, middle = deck(card)
    path = tmp_path / "block.bdf"
    path.write_text(text)
    scene, draft = scene_of(path)
    assert not [f for f in draft.findings if f.weight != "harmless"] and "mm, t, s" in draft.head[1]
    assert list(scene.bodies) == ["Lining_block"] and scene.solve.modes == 6
    hand = fe_squeal.parse_scene(by_hand(path, middle))
    problems = [fe_squeal.assemble(s) for s in (hand, scene)]
    pencils = [p.pencil() for p in problems]
    for name in ("M", "C", "K"):
        A, B = (getattr(p, name) for p in pencils)
        assert abs(A - B).max() <= 1e-12 * abs(A).max(), name
    loads = [p.discretisation.static_state.load for p in problems]
    np.testing.assert_allclose(*loads, rtol=1e-12)
    assert loads[0][2] == pytest.approx(-2e6 * SIZE[0] * SIZE[1])


def test_orthotropic_cards_are_one_material(tmp_path):
    """MAT9 of the stiffness that MAT11's constants give."""
    e, (n12, n13, n23), (g12, g13, g23) = (6e3, 5e3, 1.5e3), (0.2, 0.15, 0.1), (2e3, 1e3, 900.0)
    S = np.array([[1 / e[0], -n12 / e[0], -n13 / e[0]], [-n12 / e[0], 1 / e[1], -n23 / e[1]],
                  [-n13 / e[0], -n23 / e[1], 1 / e[2]]])  # fmt: skip
    C = np.zeros((6, 6))
    C[:3, :3] = np.linalg.inv(S)
    C[[3, 4, 5], [3, 4, 5]] = g12, g23, g13  # xy, yz, zx
    found = []
    for card in (("MAT11", 2, *e, n12, n13, n23, g12, g13, g23, "2.5-9"),
                 ("MAT9", 2, *(f"{v:.15g}" if v else "0." for v in C[np.triu_indices(6)]), "2.5-9")):  # fmt: skip
        text = deck()[0]
        start = text.index("MAT1,")
        (tmp_path / "a.bdf").write_text(text[:start] + free_field(*card) + text[text.index("\n", start) + 1 :])
        found.append(scene_of(tmp_path / "a.bdf")[0].materials["mat_2"])
    for key in ("youngs_modulus", "poisson_ratio", "shear_modulus"):
        np.testing.assert_allclose(getattr(found[0], key), getattr(found[1], key), rtol=1e-12)
    assert found[0].youngs_modulus == [6e9, 5e9, 1.5e9] and found[0].shear_modulus == [0.9e9, 1e9, 2e9]


@pytest.mark.parametrize(("extra", "sentence"), [
    ("RBAR,77,1,2,123456,,,123456\n", r"RBAR at line \d+: ties grid points"),
    ("BCTABLE,1,,,1\n", r"BCTABLE at line \d+: contact: not of the form"),
    ("CHEXA,99,8,1,2,3,4,5,6,\n,7,8\n", None),
])  # fmt: skip
def test_what_is_missing_is_asked_for(tmp_path, extra, sentence):
    (tmp_path / "a.bdf").write_text(deck(extra=extra)[0])
    with pytest.raises((SceneError, MeshError), match=sentence):
        scene_of(tmp_path / "a.bdf")


@pytest.mark.parametrize(("change", "sentence"), [
    (("SPC1,7,123,", "SPC1,7,12a,"), 'holds "12a"'),
    (("MAT1,2,2.1+5", "MAT1,2,often"), '"often" where a number is expected'),
    (("CELAS1,43,6,", "CELAS1,43,66,"), "property 66, which does not exist"),
    (("RBE2,31,900,", "RBE2,31,901,"), "GRID 901, which does not exist"),
    (("PLOAD4,5,1,", "PLOAD4,5,2,"), "names no face of a solid"),
    (("PSOLID,4,2\n", ""), "property 4, which has no PSOLID"),
])  # fmt: skip
def test_bad_decks_are_refused_in_a_sentence(tmp_path, change, sentence):
    text = deck()[0]
    assert change[0] in text
    (tmp_path / "a.bdf").write_text(text.replace(*change))
    with pytest.raises((SceneError, MeshError), match=sentence):
        scene_of(tmp_path / "a.bdf")


def test_a_mark_of_continuation_before_the_tenth_field():
    """A free field that is a mark goes on in the next line, as in the tenth field; numbers with a sign are none."""
    text = ["SPC1,1,3,1,2,+", "+,3,5,6", "SPC1,2,3,+7,-8", "RBE2,8,9,123,13,14,15,16,+A", "+A,17,18"]
    cards = list(read_cards([(line, f"line {i}") for i, line in enumerate(text, 1)]))
    assert [[f for f in card.fields if f] for card in cards] == [
        ["1", "3", "1", "2", "3", "5", "6"], ["2", "3", "+7", "-8"],
        ["8", "9", "123", "13", "14", "15", "16", "17", "18"],
    ]  # fmt: skip
    assert cards[0].fields[8] == "3"  # the first of the second line, whatever the first one leaves blank
