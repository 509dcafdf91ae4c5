"""What `check` says without solving: missing supports, groups, every fault of a scene."""

import json
import re

import numpy as np
import pytest

from fe_squeal.cli import main
from fe_squeal.run.free import free_motion_warnings, rigid_part
from tests.meshes import BELT, box, join, make_problem
from tests.scene_texts import HEAD, SCENE, replaced, without, write_scene


def checked(capsys, *arguments):
    code = main(["check", *map(str, arguments)])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def two_blocks(**tables):
    lower = box("hex1", (2, 2, 1), (0.1, 0.1, 0.02), name="disc")
    upper = box("hex1", (1, 1, 1), (0.04, 0.04, 0.02), (0.03, 0.03, 0.02), name="pad")
    contact = {"surface": "bottom_pad", "counterface": "top_disc", "normal_stiffness": 1e12, "sliding": BELT}
    return make_problem(join(lower, upper), order=1, contacts=[contact], **tables)


def test_bodies_that_nothing_holds_are_named_with_their_motions():
    """A pad pressed on a held disc is free in the plane; the disc free as well: six motions together and three."""
    held = [{"surface": "bottom_disc", "fixed": "xyz"}]
    [text] = free_motion_warnings(two_blocks(supports=held, effects={"friction": {"mu": 0.3}}))
    assert "3 motions, modes of frequency 0: body pad moves along x, moves along y, turns about z; expected" in text
    assert "disc" not in text
    [text] = free_motion_warnings(two_blocks())
    assert "9 motions, modes of frequency 0: body disc moves along x, moves along y, moves along z, turns" in text
    # A spring along (1, 1, 0) on two opposite sides holds that direction and the turning.
    spring = [{"name": s, "surface": s, "direction": [1, 1, 0], "stiffness": 1e6} for s in ("left_pad", "right_pad")]
    [text] = free_motion_warnings(two_blocks(supports=held, springs=spring))
    assert re.search(r"1 motion, .*: body pad moves along \((0.707, -0.707|-0.707, 0.707), 0\);", text)
    across = [{"surface": "left_pad", "fixed": "xyz"}]
    assert free_motion_warnings(two_blocks(supports=held + across)) == []


def test_parts_of_one_body_are_told_apart():
    """A body of two blocks that share no nodes, one held and one free."""
    mesh = join(box("hex1", (1, 1, 1), name="a"), box("hex1", (1, 1, 1), corner=(2.0, 0.0, 0.0), name="b"))
    both = {"all": {"material": "steel", "groups": ["a", "b"]}}
    held = [{"surface": "left_a", "fixed": "xyz"}, {"surface": "left_b", "fixed": "xy"}]
    [text] = free_motion_warnings(make_problem(mesh, order=1, bodies=both, supports=held))
    assert "1 motion, modes of frequency 0: body all (its part around 2.5, 0.5, 0.5 m) moves along z;" in text


def test_the_motions_are_those_of_the_matrices():
    """The number is that of the zero eigenvalues of K, counted by LAPACK."""
    problem = two_blocks(supports=[{"surface": "bottom_disc", "fixed": "xyz"}])
    theta = np.linalg.eigvalsh(problem.pencil().K.toarray())
    assert np.count_nonzero(theta < 1e-9 * theta[-1]) == 3
    assert problem.free_motions().motions.shape[1] == 3


def test_rigid_part_of_a_pure_strain_is_nothing():
    rng = np.random.default_rng(3)
    x = rng.normal(size=(40, 3))
    x = np.vstack([x, -x])
    strain = np.diag([1.0, -0.5, 0.2])
    assert np.abs(rigid_part(x, (x @ strain)[:, :, None])[:3]).max() < 1e-12


def test_check_warns_of_missing_supports_and_says_nothing_where_all_is_held(tmp_path, capsys):
    code, out, _ = checked(capsys, write_scene(tmp_path, SCENE))
    assert code == 0 and re.search(r"free motions +none", out) and "warning" not in out
    loose = without(r"\[\[springs\]\]\nname = \"across\".*?(?=\[\[contacts)")
    code, out, _ = checked(capsys, write_scene(tmp_path, loose))
    assert code == 0
    assert re.search(r"free motions +[1-9]", out) and "body block " in out and "expected [[supports]]" in out


LONG = "pad_contact_surface_with_a_name_of_more_than_eighty_characters_" + 40 * "x"


@pytest.mark.parametrize("columns", ["80", "30"])
def test_no_name_is_shortened(tmp_path, capsys, monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", columns)
    scene = write_scene(tmp_path)
    text = (tmp_path / "block.msh").read_text().replace('"bottom"', f'"{LONG}"')
    (tmp_path / "block.msh").write_text(text)
    text = SCENE.replace('surface = "bottom"', f'surface = "{LONG}"')
    scene.write_text(text.replace('name = "belt"', f'name = "{LONG}"'))
    code, out, _ = checked(capsys, scene, "--groups")
    assert code == 0 and "…" not in out
    listed, described = out[: out.index("body block")], out[out.index("body block") :]
    [row] = [line for line in listed.splitlines() if LONG in line]
    assert "0.0032" in row and "0, 0, -1" in row
    assert f"contact {LONG}" in described and f"{LONG}, " in described.replace("\n", "")


def test_groups_of_a_bare_mesh_file(tmp_path, capsys):
    write_scene(tmp_path)
    code, out, err = checked(capsys, tmp_path / "block.msh", "--groups")
    assert (code, err) == (0, "")
    assert re.search(r"bottom +surface +\d+ +0\.0032 ", out) and re.search(r"block +volume +8 ", out)
    code, _, err = checked(capsys, tmp_path / "none.msh", "--groups")
    assert code == 2 and "no such mesh file" in err


INVERTED = """*NODE
1, 0., 0., 0.
2, 1., 0., 0.
3, 1., 1., 0.
4, 0., 1., 0.
5, 0., 0., 1.
6, 1., 0., 1.
7, 1., 1., -0.4
8, 0., 1., 1.
*ELEMENT, TYPE=C3D8, ELSET=PAD
1, 1, 2, 3, 4, 5, 6, 7, 8
*SURFACE, NAME=BACK
PAD, S1
"""


def test_groups_are_listed_where_elements_are_inverted(tmp_path, capsys):
    """The list of names is what one needs to find the bad elements; then what is wrong with them."""
    path = tmp_path / "bad.inp"
    path.write_text(INVERTED)
    scene = tmp_path / "bad.toml"
    scene.write_text(HEAD.replace("block.msh", "bad.inp"))
    for file in (path, scene):
        code, out, err = checked(capsys, file, "--groups")
        assert code == 2
        assert re.search(r"PAD +volume +1 ", out) and re.search(r"BACK +surface +1 ", out)
        assert "element" in err and "PAD" in err


def test_all_faults_of_a_scene_are_shown(tmp_path, capsys):
    text = replaced("density =", "densty =").replace("modes = 8", "mode = 8").replace("mu = 0.3", 'mu = "a"')
    text = text.replace('fixed = "xyz"', 'fixed = "w"').replace("order = 1", "order = 4")
    code, _, err = checked(capsys, write_scene(tmp_path, text))
    assert code == 2 and "more)" not in err and err.count("\n") == 1
    keys = ("materials.steel.densty", "solve.mode: unknown", 'effects.friction.mu: given "a"', "mesh.order: given 4")
    for key in keys:
        assert key in err


def test_all_unknown_groups_of_a_scene_are_shown(tmp_path, capsys):
    text = replaced('surface = "bottom"', 'surface = "botom"').replace('surface = "left"', 'surface = "lefd"', 1)
    text = text.replace('material = "steel"', 'material = "stel"')
    code, _, err = checked(capsys, write_scene(tmp_path, text))
    assert code == 2
    assert 'contacts[0].surface: no surface group "botom"' in err and 'no surface group "lefd"' in err
    assert 'bodies.block.material: no material "stel"; did you mean "steel"?' in err


@pytest.mark.slow
def test_class_and_terms_are_those_that_the_sweep_has(tmp_path, capsys):
    """The scene itself is without friction and symmetric; the sweep is not, in the table as in run.json."""
    path = write_scene(tmp_path, replaced("[effects.friction]\nmu = 0.3", "[effects.friction]\nmu = 0.0"))
    code, out, _ = checked(capsys, path)
    assert code == 0 and re.search(r"problem class +nonsymmetric", out)
    assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 0
    record = json.loads((tmp_path / "out/run.json").read_text())
    assert record["problem_class"] == "nonsymmetric"
    assert any(term["powers"].get("mu") for term in record["terms"])


def test_files_of_measured_frequencies_are_read(tmp_path, capsys):
    """A file that a run would refuse in its end is refused here."""
    path = write_scene(tmp_path, SCENE + '[[measured]]\nfile = "squeal.csv"\n')
    for text in (None, "hz\n650\n"):
        if text is not None:
            (tmp_path / "squeal.csv").write_text(text)
        code, _, err = checked(capsys, path)
        assert code == 2 and "squeal.csv" in err and err.count("\n") == 1
    (tmp_path / "squeal.csv").write_text("frequency_hz\n650\n")
    assert checked(capsys, path)[0] == 0


def test_names_of_mesh_files_alone_are_suggested(tmp_path, capsys):
    write_scene(tmp_path)
    (tmp_path / "blok.txt").write_text("")
    _, _, err = checked(capsys, tmp_path / "blok.msh", "--groups")
    assert "block.msh" in err and "blok.txt" not in err


def test_sizes_of_a_bare_file_have_its_own_unit(tmp_path, capsys):
    scene = write_scene(tmp_path)
    assert "centre (file)" in checked(capsys, tmp_path / "block.msh", "--groups")[1]
    assert "centre (m)" in checked(capsys, scene, "--groups")[1]
