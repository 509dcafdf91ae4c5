"""Where scene and mesh do not fit together: what `check` says, exit code 2."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scene_texts import CONTACTS, HEAD, SCENE, replaced, without, write_scene

from fe_squeal.cli import main

MESHES = Path(__file__).parents[2] / "meshes"
SLIDING = "sliding = { direction = [1, 0, 0], speed = 1.0 }"
# The block above a belt of its own, and both as one glued body.
PAIR = HEAD.replace('file = "block.msh"\n', "").replace("size = 0.02", "size = 0.02\nbelt_thickness = 0.02") + (
    '[bodies.belt]\nmaterial = "steel"\n'
)
CUBE = """*NODE
1, 0, 0, 0
2, 1, 0, 0
3, 1, 1, 0
4, 0, 1, 0
5, 0, 0, 1
6, 1, 0, 1
7, 1, 1, 1
8, 0, 1, 1
9, 0, 0, 2
10, 1, 0, 2
11, 1, 1, 2
12, 0, 1, 2
*ELEMENT, TYPE=C3D8, ELSET=block
1, 1, 2, 3, 4, 5, 6, 7, 8
2, 5, 6, 7, 8, 9, 10, 11, 12
"""
CUBE_SCENE = HEAD[: HEAD.index("[mesh.block]")].replace("block.msh", "cube.inp") + HEAD[HEAD.index("[materials") :]


def check(capsys: pytest.CaptureFixture[str], path: Path) -> tuple[int, str, str]:
    code = main(["check", str(path)])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('surface = "bottom"', 'surface = "botom"',
         'contacts[0].surface: no surface group "botom" in block.msh; did you mean "bottom"?'),
        ('surface = "front"', 'surface = "frnt"',
         'springs[0].surface: no surface group "frnt" in block.msh; did you mean "front"?'),
        ('surface = "front"', 'surface = "front"\nto = "bck"',
         'springs[0].to: no surface group "bck" in block.msh; did you mean "back"?'),
        ("[[contacts]]", '[[supports]]\nsurface = "lft"\nfixed = "x"\n[[contacts]]',
         'supports[0].surface: no surface group "lft" in block.msh; did you mean "left"?'),
        ("[bodies.block]", "[bodies.blok]",
         'bodies.blok: no volume group "blok" in block.msh; did you mean "block"?'),
        ("[bodies.block]", '[bodies.all]\ngroups = ["top"]',
         'bodies.all.groups: no volume group "top" in block.msh: that is a surface group; valid: block'),
        ("[bodies.block]", '[bodies.one]\ngroups = ["block"]\nmaterial = "steel"\n[bodies.block]',
         "bodies.block: 8 elements belong to body one as well; expected one body each"),
        ('material = "steel"', 'material = "stele"',
         'bodies.block.material: no material "stele"; did you mean "steel"?'),
        ('counterface = "rigid"', 'counterface = "top"', 'contacts[0].surface: "bottom" and the counterface "top" both'
         " lie on body block; expected a surface of the pad and one of the moving body"),
        ("modes = 8", "modes = 91", "solve.modes: given 91; expected at most 90, the number of unknowns"),
    ],
    ids=lambda text: text.split(":")[0] if ": " in text else "",
)  # fmt: skip
def test_block(tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, message: str) -> None:
    path = write_scene(tmp_path, replaced(old, new))
    code, out, err = check(capsys, path)
    assert (code, out) == (2, "")
    assert err == f"error: {path}: {message}\n"


def test_volume_group_where_a_surface_is_wanted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_scene(tmp_path, replaced('surface = "bottom"', 'surface = "block"'))
    code, _, err = check(capsys, path)
    assert code == 2
    assert f'{path}: contacts[0].surface: no surface group "block" in block.msh: that is a volume group' in err


def test_supports_that_hold_everything(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One element long, held at both ends: no node is left."""
    held = "".join(f'[[supports]]\nsurface = "{end}"\nfixed = "xyz"\n' for end in ("left", "right"))
    short = HEAD.replace('file = "block.msh"\n', "").replace("size = 0.02", "size = 0.08")
    code, _, err = check(capsys, write_scene(tmp_path, short + held))
    assert code == 2
    assert "supports: every displacement is held; expected at least one free unknown" in err


@pytest.mark.parametrize(("surface", "counterface"), [("top", "belt_top"), ("left", "belt_left")])
def test_surfaces_that_do_not_touch(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], surface: str, counterface: str
) -> None:
    contact = CONTACTS.replace('"bottom"', f'"{surface}"').replace('"rigid"', f'"{counterface}"')
    path = write_scene(tmp_path, PAIR + contact)
    code, _, err = check(capsys, path)
    assert code == 2
    assert f"{path}: contacts[0]" in err
    assert "do not touch" in err and "gap_tolerance = 0.0004 m" in err


def test_gap_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Disc and pad 5 mm apart; default tolerance 2 % of the mean facet size, which is some 3 cm here."""
    text = PAIR[PAIR.index("[materials") : PAIR.index("[bodies")] + (
        "[mesh]\norder = 1\n[mesh.disc_pad]\ninner_radius = 0.07\nouter_radius = 0.13\nthickness = 0.012\npads = 1\n"
        "pad_inner_radius = 0.085\npad_outer_radius = 0.128\npad_angle_deg = 50.0\npad_thickness = 0.011\nsize = 0.03\n"
        'gap = 0.005\n[bodies.disc]\nmaterial = "steel"\n[bodies.pad_1]\nmaterial = "steel"\n'
    )
    contact = CONTACTS.replace('"bottom"', '"pad_face_1"').replace('"rigid"', '"disc_face_1"')
    path = write_scene(tmp_path, text + contact)
    code, _, err = check(capsys, path)
    assert code == 2
    assert f"{path}: contacts[0]" in err
    assert "0.005 m" in err and "gap_tolerance = 0.0007" in err
    # Within a tolerance that allows for it, the gap is closed.
    path = write_scene(tmp_path, text + contact.replace("speed = 1.0 }", "speed = 1.0 }\ngap_tolerance = 0.006"))
    assert check(capsys, path)[0] == 0


def test_body_without_material_and_its_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_scene(tmp_path, without(r"\[bodies.belt\].*", PAIR))
    code, _, err = check(capsys, path)
    assert code == 2
    assert err.endswith("belong to no body and so have no material; add [bodies.belt] with material = ...\n")
    assert '8 elements of geometry.msh (volume group "belt")' in err


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("2, 5, 6, 7, 8, 9,", "2, 5, 8, 7, 6, 9,",
         'element 2 is inverted or too distorted (negative Jacobian) (group "block"); check the node order'),
        ("2, 5, 6, 7, 8, 9, 10, 11, 12", "2, 5, 6, 7, 8, 6, 5, 8, 7", "element 2 has the same node twice"),
        ("9, 0, 0, 2\n10, 1, 0, 2\n11, 1, 1, 2\n12, 0, 1, 2", "9, 0, 0, 1\n10, 1, 0, 1\n11, 1, 1, 1\n12, 0, 1, 1",
         'element 2 has zero volume (group "block")'),
        ("12, 0, 1, 2", "12, 0, nan, 2", "the coordinates of node 12 are not finite numbers"),
        ("12, 0, 1, 2", "12, 0, 1e400, 2", "the coordinates of node 12 are not finite numbers"),
    ],
    ids=["inverted", "collapsed", "flat", "nan", "overflow"],
)  # fmt: skip
def test_bad_elements(tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, message: str) -> None:
    (tmp_path / "cube.inp").write_text(replaced(old, new, CUBE))
    code, out, err = check(capsys, write_scene(tmp_path, CUBE_SCENE))
    assert (code, out) == (2, "")
    assert "cube.inp: " + message in err
    assert err.count("\n") == 1


def test_good_cube(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What the bad elements differ from: 12 nodes are 36 unknowns."""
    (tmp_path / "cube.inp").write_text(CUBE)
    code, out, err = check(capsys, write_scene(tmp_path, CUBE_SCENE))
    assert (code, err) == (0, "")
    assert "36 (order 1)" in out


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("garbage.msh", bytes(range(256)), "garbage.msh: not a readable .msh mesh"),
        ("garbage.vtu", b"hello", "garbage.vtu: not a readable .vtu mesh"),
        ("empty.msh", b"", "empty.msh: the file is empty; expected a mesh"),
        ("scene.toml", b"a = 1", 'scene.toml: no mesh format is known by the suffix ".toml"'),
        ("scene.toml", b"a = 1", ", .fem, .cdb, .unv, .vtu, "),
        ("none.msh", None, "none.msh: no such file; make it with: fe-squeal mesh"),
        (".", None, "this is a folder; expected a mesh file"),
        ("n" * 300, None, "File name too long"),
    ],
)
def test_bad_mesh_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, content: bytes | None, message: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    code, _, err = check(capsys, write_scene(tmp_path, replaced("block.msh", name)))
    assert code == 2
    assert message in err
    assert err.count("\n") == 1


def test_missing_mesh_without_geometry_names_a_neighbour(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = replaced("block.msh", "blok.msh", without(r"\[mesh.block\].*?(?=\[materials)"))
    code, _, err = check(capsys, write_scene(tmp_path, text))
    assert code == 2
    assert 'blok.msh: no such mesh file; did you mean "block.msh"?' in err


@pytest.mark.slow
def test_disc_in_the_wrong_unit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The committed disc with its coordinates in millimetres, read as metres, is 260 m across."""
    lines = (MESHES / "disc_pad.msh").read_text().splitlines()
    first, last = lines.index("$Nodes"), lines.index("$EndNodes")
    for i in range(first + 2, last):
        words = lines[i].split()
        if len(words) == 3:
            lines[i] = " ".join(repr(1000 * float(w)) for w in words)
    (tmp_path / "block.msh").write_text("\n".join(lines) + "\n")
    groups = ("disc", "pad_1", "pad_2", "back_plate_1", "back_plate_2")
    bodies = f'[bodies.brake]\nmaterial = "steel"\ngroups = {json.dumps(groups)}\n'
    text = HEAD[: HEAD.index("[mesh.block]")] + HEAD[HEAD.index("[materials") : HEAD.index("[bodies")] + bodies
    text += '[[supports]]\nsurface = "hub"\nfixed = "xyz"\n[solve]\nmodes = 2\n[output]\nshapes = "none"\n'
    code, _, err = check(capsys, write_scene(tmp_path, text))
    assert code == 2
    assert "bodies.brake: 260 m long" in err and 'if the mesh is in mm, write length_unit = "mm"' in err
    code, out, _ = check(capsys, write_scene(tmp_path, 'units = "any"\n' + text))  # no check of magnitudes
    assert code == 0
    assert "across" not in out
    # A mesh in metres, read as millimetres, is allowed: so small things exist.
    right = (MESHES / "disc_pad.msh").read_bytes()
    (tmp_path / "block.msh").write_bytes(right)
    in_mm = replaced("order = 1", 'order = 1\nlength_unit = "mm"', text)
    code, out, _ = check(capsys, write_scene(tmp_path, in_mm))
    assert code == 0 and "block.msh: the model is 0.00026 m across; is length_unit right?" in out
    (tmp_path / "block.msh").write_text("\n".join(lines) + "\n")
    # In the right unit nothing is said.
    code, out, _ = check(capsys, write_scene(tmp_path, in_mm))
    assert code == 0
    assert "across" not in out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("order", "support", "held"),
    [
        # 4 x 2 x 1 elements: 5 x 3 x 2 nodes of first order, 9 x 5 x 3 of second; the left end has 3 x 2 and 5 x 3.
        (1, "", 0),
        (1, '[[supports]]\nsurface = "left"\nfixed = "xyz"\n', 3 * 3 * 2),
        (2, '[[supports]]\nsurface = "left"\nfixed = "xz"\n', 2 * 5 * 3),
        # Two supports that share an edge of two nodes.
        (1, '[[supports]]\nsurface = "left"\nfixed = "z"\n[[supports]]\nsurface = "front"\nfixed = "z"\n', 6 + 10 - 2),
    ],
)
def test_check_counts_unknowns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], order: int, support: str, held: int
) -> None:
    nodes = np.prod([order * n + 1 for n in (4, 2, 1)])
    text = replaced("order = 1", f"order = {order}").replace("[[contacts]]", support + "[[contacts]]")
    code, out, err = check(capsys, write_scene(tmp_path, text))
    assert (code, err) == (0, "")
    assert f"unknowns {3 * nodes - held} (order {order})" in " ".join(out.split())


def test_check_shows_what_is_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = check(capsys, write_scene(tmp_path, SCENE))
    assert code == 0
    words = " ".join(out.split())
    for text in (
        "body block 8 elements of steel",
        "spring normal_1 left",
        "contact belt 0.0032 m2 closed, 100 % of the surface",
        "volume groups block",
        "effects on friction",
        "problem class nonsymmetric",
    ):
        assert text in words
    code, out, _ = check(capsys, write_scene(tmp_path, HEAD))
    words = " ".join(out.split())
    assert "effects on none" in words
    assert "problem class symmetric" in words
