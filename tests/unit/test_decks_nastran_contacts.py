"""Contact of Nastran decks in the dialects of NX and MSC, beside the same scene by hand."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from test_decks_nastran import free_field, order_of_corners, small_field

import fe_squeal
from fe_squeal.decks.scene import draft_of
from fe_squeal.errors import MeshError
from fe_squeal.mesh.elements import FACES
from meshes import box

STIFFNESS = 10 * 5e9 / 0.01  # 10 E/h of the softer block, whose facets of 10 mm are as large as the other's
BODIES = (("BCBODY", 11, "3D", "DEFORM", 1), ("BCBODY", 12, "3D", "", 2))
BODIES1 = (("BCBODY1", 11, "", "", "DEFORM", 1), ("BCBODY1", 12, "", "", "", 2))
SURFACES = (("BSURF", 1, 1, "THRU", 6, "BY", 1), ("BSURF", 2, 101, 102, 103, 104, 105, 106))
BLANK = ("",) * 4
GROUP = (*BLANK, "SLAVE", 11, "", "", 0.4, "", "", "", "MASTER", 12)
DIALECTS = {
    "NX, solids": ("", [*SURFACES, ("BCTSET", 5, 1, 2, 0.4)]),
    "NX, shells": ("", [("BSURF", 1, 201, "THRU", 206), ("BSURF", 2, 301, "THRU", 306), ("BCTSET", 5, 1, 2, 0.4)]),
    "BCTABLE": ("BCONTACT = 3", [*SURFACES, *BODIES, ("BCTABLE", 0, 11, 12, 0), ("BCTABLE", 3, "", "", 1, *GROUP)]),
    "BCONECT": ("BCONTACT = 3", [
        *SURFACES, *BODIES1, ("BCTABL1", 3, 57, "THRU", 60), ("BCONECT", 58, 7, 8, 11, 12),
        ("BCONECT", 60, "", 8, "", "", "", "", "", "SECNDRY", 12, "", "", "", "", "", "", "PRIMARY", 11),
        ("BCONECT", 57, "", 8, 11, 12), ("BCONPRG", 7, "", "ICOORD", 1),
        ("BCONPRP", 8, "", "FRIC", 0.4, "FNTOL", 1.0)]),
}  # fmt: skip


def deck(select, cards, card=free_field):
    """A soft block of 30 x 20 x 10 mm on a stiff one that is held below; shells on the faces in touch."""
    text = f"SOL 107\nCEND\n{select}\nBEGIN BULK\n"
    for pid, (bottom, E) in enumerate(((0.01, "5000."), (0.0, "2.1+5")), 1):
        m = box("hex1", (3, 2, 1), (0.03, 0.02, 0.01), corner=(0.0, 0.0, bottom))
        grid, first = 100 * pid, 1 + 100 * (pid - 1)
        for i, x in enumerate(m.p.T):
            text += card("GRID", grid + i, "", *(f"{1e3 * v:.6g}" if v else "0." for v in x))
        for e, row in enumerate(order_of_corners(m)):
            text += card("CHEXA", first + e, pid, *(row + grid))
            for face in FACES["hexahedron"]:
                if np.allclose(m.p[2][row[list(face)]], 0.01):
                    text += card("CQUAD4", 201 + first // 100 * 100 + e, 8, *(row[list(face)] + grid))
        text += card("PSOLID", pid, pid) + card("MAT1", pid, E, "", 0.3, "7.8-9")
        if pid == 2:
            text += card("SPC1", 7, 123, *(np.flatnonzero(m.p[2] < 1e-9)[:6] + grid))
    return text + "".join(card(*fields) for fields in cards) + "ENDDATA\n"


def scene(path, **values):
    """The scene of a deck, its open keys given as they are suggested, the motion along x."""
    lines = draft_of(path).text().splitlines()
    given = {"# normal_stiffness", "# sliding"}
    text = "\n".join(line[2:] if line.split(" = ")[0] in given else line for line in lines)
    table = tomllib.loads(text)
    table["mesh"]["file"] = str(path)
    for contact in table["contacts"]:
        contact |= {key: value for key, value in values.items() if key in contact}
    return table


def matrices(table):
    pencil = fe_squeal.assemble(fe_squeal.parse_scene(table)).pencil()
    return [getattr(pencil, name) for name in ("M", "K")]


@pytest.mark.slow
@pytest.mark.parametrize("card", [free_field, small_field])
@pytest.mark.parametrize("name", DIALECTS)
def test_contact_is_the_scene_by_hand(tmp_path, name, card):
    path, plain = tmp_path / "a.bdf", tmp_path / "b.bdf"
    path.write_text(deck(*DIALECTS[name], card=card))
    draft = draft_of(path)
    assert [f.what for f in draft.findings if f.weight == "missing"] == [] and len(draft.missing) == 2
    sliding = {"direction": [1, 0, 0], "speed": 2.0}
    table = scene(path, sliding=sliding)
    assert table["effects"]["friction"]["mu"] == 0.4
    plain.write_text(deck("", [("BSURFS", side, "", "", "", *faces_in_touch(side)) for side in (1, 2)]))
    by_hand = {
        "mesh": {"file": str(plain), "length_unit": "mm"},
        "materials": {n: {"youngs_modulus": E, "poisson_ratio": 0.3, "density": 7800.0}
                      for n, E in (("soft", 5e9), ("stiff", 2.1e11))},
        "bodies": {"soft": {"material": "soft", "groups": ["1"]}, "stiff": {"material": "stiff", "groups": ["2"]}},
        "supports": table["supports"],
        "contacts": [{"surface": "BSURFS_1", "counterface": "BSURFS_2", "sliding": sliding,
                      "normal_stiffness": STIFFNESS}],
        "effects": {"friction": {"mu": 0.4}},
    }  # fmt: skip
    table["contacts"][0]["normal_stiffness"] = STIFFNESS
    for A, B in zip(matrices(by_hand), matrices(table), strict=True):
        assert abs(A - B).max() <= 1e-12 * abs(A).max()
    assert abs(B - B.T).max() > 1e-3 * abs(B).max()  # friction is there


def faces_in_touch(side):
    """Element and three corners of its face in touch, for each element."""
    m = box("hex1", (3, 2, 1), (0.03, 0.02, 0.01), corner=(0.0, 0.0, 0.01 if side == 1 else 0.0))
    for e, row in enumerate(order_of_corners(m)):
        face = next(f for f in FACES["hexahedron"] if np.allclose(m.p[2][row[list(f)]], 0.01))
        yield from (1 + 100 * (side - 1) + e, *(row[list(face[:3])] + 100 * side))


def test_stiffness_is_suggested_and_glue_is_tied(tmp_path):
    path = tmp_path / "a.bdf"
    path.write_text(deck(*DIALECTS["NX, shells"]))
    assert scene(path)["contacts"][0]["normal_stiffness"] == pytest.approx(STIFFNESS)
    select, cards = DIALECTS["BCONECT"]
    path.write_text(deck(select, [("BCONPRG", 7, "", "IGLUE", 1) if c[0] == "BCONPRG" else c for c in cards
                                  if c[:2] not in (("BCONECT", 60), ("BCONECT", 57))]))  # fmt: skip
    contact = scene(path)["contacts"][0]
    assert contact["kind"] == "tied" and contact["normal_stiffness"] == pytest.approx(10 * STIFFNESS)


@pytest.mark.parametrize(("name", "old", "new", "sentence"), [
    ("BCTABLE", "SLAVE,11", "TOUCHES,11", "not of the form"),
    ("BCTABLE", "BCTABLE,3,,,1", "BCTABLE,3,,,2", "not of the form"),
    ("BCTABLE", ",,,0.4,", ",,,4,", "FRIC 4 is a table"),
    ("BCTABLE", "BCONTACT = 3", "BCONTACT = 4", "selects none of the deck's"),
    ("BCTABLE", "3D,DEFORM,1", "3D,RIGID,1", "counterface = \"rigid\""),
    ("BCTABLE", "BCBODY,11,3D,DEFORM,1", "BCBODY,11,3D,DEFORM,9", "region 9 is no BSURF"),
    ("BCONECT", "BCONECT,57,,8,11,12", "BCONECT,57,,,11,12", "paired twice, and differently"),
    ("BCONECT", "BCONPRG,7,,ICOORD", "BCONPRG,7,,FRIC", "FRIC belongs to BCONPRP"),
    ("NX, solids", "BCTSET,5,1,2,0.4", "BGSET,5,1,2", "contact: give"),
])  # fmt: skip
def test_what_is_in_doubt_is_asked_for(tmp_path, name, old, new, sentence):
    text = deck(*DIALECTS[name])
    assert old in text
    (tmp_path / "a.bdf").write_text(text.replace(old, new, 1))
    assert any(sentence in line for line in draft_of(tmp_path / "a.bdf").missing)


@pytest.mark.parametrize(("name", "old", "new", "sentence"), [
    ("NX, solids", "BSURF,2,101", "BSURF,2,999", "BSURF 2 names element 999"),
    ("NX, shells", "BSURF,1,201,THRU,206", "BSURF,1,201,THRU", "BSURF 1 is not readable"),
    ("BCTABLE", "MASTER,12", "MASTER,13", "names body 13, which no BCBODY"),
    ("BCTABLE", ",,,0.4,", ",,,much,", '"much" where a number is expected'),
    ("BCONECT", "BCONECT,58,7,8", "BCONECT,58,7,9", "refers to BCONPRP 9, which does not exist"),
    ("BCONECT", "BCTABL1,3,57,THRU", "BCTABL1,3,56,57,THRU", "names BCONECT 56"),
])  # fmt: skip
def test_bad_contacts_are_refused_in_a_sentence(tmp_path, name, old, new, sentence):
    text = deck(*DIALECTS[name])
    assert old in text
    (tmp_path / "a.bdf").write_text(text.replace(old, new, 1))
    with pytest.raises(MeshError, match=sentence):
        draft_of(tmp_path / "a.bdf")
