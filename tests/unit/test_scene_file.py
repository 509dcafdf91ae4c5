"""What load_scene refuses: file, key, what was given and what is expected, in one line; exit code 2, no traceback.

In one file, since it is a list of mistakes and of what is said to each.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from scene_texts import CONTACTS, HEAD, SCENE, SPRINGS, TAIL, replaced, without, write_scene

from fe_squeal.cli import main
from fe_squeal.errors import SceneError
from fe_squeal.scene.file import load_scene, parse_scene

RANGE = "from = 0.0\nto = 0.8\npoints = 5"
SLIDING = "sliding = { direction = [1, 0, 0], speed = 1.0 }"
FIRST_DIRECTION = "direction = [-1.0, 0.0, 1.0]"
TWICE = "a table or key is given twice, or once as [...] and once as [[...]]"
FINITE = "expected a finite number (the largest is 1.8e308)"
SIZE = "expected a number between 1e-50 and 1e+50 in size, or 0"
SUPPORT = '[[supports]]\nsurface = "left"\n'

# (text to replace, with what, the whole message behind the name of the file)
UNKNOWN_KEYS = [
    ("[sweep]", "[swep]", 'swep: unknown key; did you mean "sweep"?'),
    ("file =", "flie =", 'mesh.flie: unknown key; did you mean "file"?'),
    ("length =", "lenght =", 'mesh.block.lenght: unknown key; did you mean "length"?'),
    ("density =", "densty =", 'materials.steel.densty: unknown key; did you mean "density"?'),
    ('material = "', 'materail = "', 'bodies.block.materail: unknown key; did you mean "material"?'),
    ("stiffness =", "stifness =", 'springs[0].stifness: unknown key; did you mean "stiffness"?'),
    ("counterface =", "conterface =", 'contacts[0].conterface: unknown key; did you mean "counterface"?'),
    (SLIDING, SLIDING.replace("speed", "sped"), 'contacts[0].sliding.sped: unknown key; did you mean "speed"?'),
    ("[effects.friction]", "[effects.fricton]", 'effects.fricton: unknown key; did you mean "friction"?'),
    ("from =", "form =", 'sweep.form: unknown key; did you mean "from"?'),
    ("modes =", "mode =", 'solve.mode: unknown key; did you mean "modes"?'),
    ("shapes =", "shape =", 'output.shape: unknown key; did you mean "shapes"?'),
    ("shapes =", "colour_of_the_disc =", "output.colour_of_the_disc: unknown key; valid: report, shapes"),
    ("title =", '"ti\\u001b[31mtle" =', '"ti\\u001b[31mtle": unknown key; did you mean "title"?'),
]
WRONG_TYPES = [
    ('title = "block on a belt"', "title = 3", "title: given 3; expected a text in quotes"),
    ("2.0e11", '"2.0e11"', 'materials.steel.youngs_modulus: given "2.0e11"; expected a number'),
    ("2.0e11", "true", "materials.steel.youngs_modulus: given true; expected a number"),
    ("7800.0", "[1, 2]", "materials.steel.density: given [1, 2]; expected a number"),
    ("7800.0", "{ a = 1 }", "materials.steel.density: given a table; expected a number"),
    ("7800.0", "1979-05-27", "materials.steel.density: given 1979-05-27; expected a number"),
    ("order = 1", "order = 4", "mesh.order: given 4; expected 1, 2, or, for hexahedra, 3"),
    ("order = 1", "order = true", "mesh.order: given true; expected 1, 2, or, for hexahedra, 3"),
    ("order = 1", "order = 1.0", "mesh.order: given 1.0; expected 1, 2, or, for hexahedra, 3"),
    ("order = 1", "length_unit = 'inch'", 'mesh.length_unit: given "inch"; expected one of "m" or "mm"'),
    ('"block.msh"', "3", "mesh.file: given 3; expected a text in quotes"),
    ("[effects.friction]", '[effects.preload]\nmu = "swep"\n[effects.friction]',
     'effects.preload.mu: given "swep"; expected "swept", or a number'),
    ('"block.msh"', '""', 'mesh.file: given ""; expected a text that is not empty'),
    ("modes = 8", "modes = true", "solve.modes: given true; expected a whole number"),
    ("modes = 8", "modes = 1.5", "solve.modes: given 1.5; expected a whole number"),
    ("modes = 8", "modes = 8.0", "solve.modes: given 8.0; expected a whole number"),
    (FIRST_DIRECTION, "direction = 'z'", 'springs[0].direction: given "z"; expected a list of numbers'),
    (FIRST_DIRECTION, "direction = [0, 1]", "springs[0].direction: given [0, 1]; expected 3 entries"),
    (FIRST_DIRECTION, "direction = []", "springs[0].direction: given []; expected 3 entries"),
    (FIRST_DIRECTION, "direction = [1, 2, 3, 4]", "springs[0].direction: given [1, 2, 3, 4]; expected 3 entries"),
    (FIRST_DIRECTION, "direction = [1, 'a', 0]", 'springs[0].direction[1]: given "a"; expected a number'),
    ("[bodies.block]", '[bodies.block]\ngroups = "a"',
     'bodies.block.groups: given "a"; expected a list, written [...]'),
    ("[bodies.block]", "[bodies.block]\ngroups = []", "bodies.block.groups: given []; expected at least 1 entry"),
    ("2.0e11", '"' + 300 * "a" + '"', f'materials.steel.youngs_modulus: given "{56 * "a"}...; expected a number'),
]  # fmt: skip
TABLES = [
    ("[mesh]\n", "[[mesh]]\n", "mesh: given a list of tables; expected a table, written [mesh]"),
    ("[materials.steel]", "[[materials.steel]]",
     "materials.steel: given a list of tables; expected a table, written [materials.steel]"),
    ("[bodies.block]", "[[bodies]]", "bodies: given a list of tables; expected a table, written [bodies]"),
    ('[bodies.block]\nmaterial = "steel"', '[bodies]\nblock = "steel"',
     'bodies.block: given "steel"; expected a table, written [bodies.block]'),
    ("[[contacts]]", "[contacts]", "contacts: given a table; expected a list of tables, written [[contacts]]"),
    ("[[contacts]]", f'{SUPPORT.replace("[[supports]]", "[supports]")}fixed = "x"\n[[contacts]]',
     "supports: given a table; expected a list of tables, written [[supports]]"),
    ("title =", 'supports = "hub"\ntitle =',
     'supports: given "hub"; expected a list of tables, written [[supports]]'),
    ("[sweep]", "[[sweep]]", "sweep: given a list of tables; expected a table, written [sweep]"),
    ("[effects.friction]\nmu = 0.3", "[effects]\nfriction = 0.3",
     "effects.friction: given 0.3; expected a table, written [effects.friction]"),
    (SLIDING, 'sliding = "x"', 'contacts[0].sliding: given "x"; expected a table, written { ... }'),
]  # fmt: skip
RANGES = [
    *[("7800.0", v, f"materials.steel.density: given {g}; expected a number > 0")
      for v, g in (("-7800.0", "-7800.0"), ("0.0", "0.0"), ("0", "0"), ("-0.0", "-0.0"))],
    *[("7800.0", v, f"materials.steel.density: given {g}; {FINITE}")
      for v, g in (("1e400", "inf"), ("inf", "inf"), ("nan", "nan"), ("1" + 400 * "0", "a whole number of 1329 bits"))],
    ("7800.0", "1e300", f"materials.steel.density: given 1e+300; {SIZE}"),
    ("7800.0", "1e-300", f"materials.steel.density: given 1e-300; {SIZE}"),
    ("2.0e11", "-2.0e11", "materials.steel.youngs_modulus: given -2e+11; expected a number > 0"),
    ("2.0e11", "0", "materials.steel.youngs_modulus: given 0; expected a number > 0"),
    ("2.0e11", "nan", f"materials.steel.youngs_modulus: given nan; {FINITE}"),
    ("2.0e11", "[1e9, 2e9, -3e9]", "materials.steel.youngs_modulus[2]: given -3e+09; expected a number > 0"),
    ("2.0e11", "[1e9, 2e9]", "materials.steel.youngs_modulus: given [1e+09, 2e+09]; expected a number, or a list of"
     " three for an orthotropic material; got 2"),
    *[("poisson_ratio = 0.3", f"poisson_ratio = {v}", f"materials.steel.poisson_ratio: given {v}; expected a number"
       " with -1 < nu < 0.5, outside which the stiffness is not positive") for v in ("0.5", "-1", "0.7")],
    ("stiffness = 400000.0", "stiffness = -4e5", "springs[0].stiffness: given -400000.0; expected a number ≥ 0"),
    ("stiffness = 400000.0", "damping = -1", "springs[0].damping: given -1; expected a number ≥ 0"),
    ("stiffness = 400000.0", "",
     "springs[0]: has neither stiffness nor damping; expected at least one of them > 0"),
    ("stiffness = 400000.0", "stiffness = 0.0\ndamping = 0",
     "springs[0]: has neither stiffness nor damping; expected at least one of them > 0"),
    ("normal_stiffness = ", "normal_stiffness = -",
     "contacts[0].normal_stiffness: given -3.125e+08; expected a number > 0"),
    (SLIDING, SLIDING + "\ngap_tolerance = -1", "contacts[0].gap_tolerance: given -1; expected a number ≥ 0"),
    ("modes = 8", "modes = 0", "solve.modes: given 0; expected a whole number ≥ 1"),
    ("modes = 8", "modes = -1", "solve.modes: given -1; expected a whole number ≥ 1"),
    ("modes = 8", "modes = 8\nmax_frequency = 1e3", "solve: given modes and max_frequency; expected one of them"),
    ("modes = 8", "max_frequency = 0.0", "solve.max_frequency: given 0.0; expected a number > 0"),
    ("modes = 8", "tolerance = 0", "solve.tolerance: given 0; expected a number > 0"),
    ("modes = 8", "tolerance = 1.5", "solve.tolerance: given 1.5; expected a number < 1"),
    (
        "modes = 8", 'method = "fast"',
        'solve.method: given "fast"; expected one of "auto", "direct", "reduced" or "modal"',
    ),
    ('shapes = "none"', 'shapes = "some"', 'output.shapes: given "some"; expected one of "unstable", "all" or "none"'),
    (FIRST_DIRECTION, "direction = [0, 0, 0]",
     "springs[0].direction: given [0, 0, 0]; expected a vector that is not zero"),
    (FIRST_DIRECTION, "direction = [1e-200, 0, 0]", f"springs[0].direction: given [1e-200, 0, 0]; {SIZE}"),
    ("[[contacts]]", SUPPORT + 'fixed = "xq"\n[[contacts]]',
     'supports[0].fixed: given "xq"; expected any of the letters x, y and z, such as "xyz" or "z"'),
    ("[[contacts]]", SUPPORT + 'fixed = ""\n[[contacts]]',
     'supports[0].fixed: given ""; expected any of the letters x, y and z, such as "xyz" or "z"'),
    ('material = "steel"', 'material = "steel"\naxes = [[1, 0, 0], [2, 0, 0]]', "bodies.block.axes: given"
     " [[1, 0, 0], [2, 0, 0]]; axes 1 and 2 are parallel or zero; expected two vectors that span a plane"),
]  # fmt: skip
SWEEPS = [
    ("to = 0.8", "to = -0.8", "sweep: given from = 0, to = -0.8; expected from < to"),
    ("to = 0.8", "to = 0.0", "sweep: given from = 0, to = 0; expected from < to"),
    ("points = 5", "points = 0", "sweep.points: given 0; expected a whole number ≥ 1"),
    ("points = 5", "points = 1",
     "sweep: given points = 1; expected at least 2 from one value to another (one: values = [...])"),
    ("points = 5", "points = 1000000000", "sweep.points: given 1000000000; expected a whole number ≤ 100000"),
    ("points = 5\n", "", "sweep: given from, to; expected from, to and points, or values = [...]"),
    (RANGE, "", "sweep: given nothing; expected from, to and points, or values = [...]"),
    (RANGE, RANGE + "\nvalues = [1.0]",
     "sweep: given from, to, points, values; expected from, to and points, or values = [...]"),
    (RANGE, "values = []", "sweep.values: given []; expected at least 1 entry"),
    (RANGE, "values = [0.1, 0.1]",
     "sweep.values: given [0.1, 0.1]; expected values that increase; 0.1 comes after 0.1"),
    (RANGE, "values = [0.3, 0.1]",
     "sweep.values: given [0.3, 0.1]; expected values that increase; 0.1 comes after 0.3"),
    (RANGE, "values = [nan]", f"sweep.values[0]: given nan; {FINITE}"),
    (RANGE, "values = 0.3", "sweep.values: given 0.3; expected a list, written [...]"),
    (RANGE, "values = [true]", "sweep.values[0]: given true; expected a number"),
    ("[effects.friction]\nmu = 0.3\n", "",
     'sweep.parameter: given "mu", but no friction; expected [effects.friction] with mu'),
    (SLIDING, 'kind = "frictionless"',
     'effects.friction: no contact slides; expected a [[contacts]] entry of kind "sliding"'),
]  # fmt: skip
EITHER = "expected either axis (and centre) for a rotation or direction for a straight belt"
NO_COMMA = "expected a name without a comma, which stands between the paths of several numbers"
CONTACT_FAULTS = [
    ("direction = [1, 0, 0], speed", "direction = [1, 0, 0], axis = [0, 0, 1], speed",
     f"contacts[0].sliding: given both axis and direction; {EITHER}"),
    ("direction = [1, 0, 0], speed", "speed", f"contacts[0].sliding: given neither axis nor direction; {EITHER}"),
    ("direction = [1, 0, 0], speed", "direction = [1, 0, 0], centre = [0, 0, 0], speed", "contacts[0].sliding: given"
     " direction and centre; expected centre with a rotation about an axis, not with a straight belt"),
    ("direction = [1, 0, 0], speed", "axis = [0, 0, 0], speed",
     "contacts[0].sliding.axis: given [0, 0, 0]; expected a vector that is not zero"),
    ("speed = 1.0", "speed = 0",
     "contacts[0].sliding.speed: given 0; expected a number that is not zero, whose sign gives the direction"),
    (", speed = 1.0", "", "contacts[0].sliding.speed: is missing; expected a number"),
    (SLIDING, "", "contacts[0]: a sliding contact needs sliding = { axis, centre, speed } or { direction, speed }; or"
     ' set kind = "frictionless" or "tied"'),
    (SLIDING, SLIDING + '\nkind = "slidng"',
     'contacts[0].kind: given "slidng"; expected one of "sliding", "frictionless" or "tied"'),
    ('counterface = "rigid"\n', "", "contacts[0].counterface: is missing; expected a text in quotes"),
    ('name = "inclined_2"', 'name = "inclined_1"',
     'springs[1].name: given "inclined_1", as springs[0] is; expected different names'),
    ('name = "inclined_1"\n', "", "springs[0].name: is missing; expected a text in quotes"),
    ('name = "inclined_1"', 'name = ""', 'springs[0].name: given ""; expected a name'),
    ('name = "inclined_1"', 'name = "a, b"', f'springs[0].name: given "a, b"; {NO_COMMA}'),
    ('name = "belt"', 'name = "a,b"', f'contacts[0].name: given "a,b"; {NO_COMMA}'),
    ("[[contacts]]", '[[averaged]]\nname = "a,"\nsurface = "top"\n[[contacts]]',
     f'averaged[0].name: given "a,"; {NO_COMMA}'),
    ("[[contacts]]", '[[rigid]]\nname = ""\nsurface = "top"\n[[contacts]]', 'rigid[0].name: given ""; expected a name'),
    ("[materials.steel]", '[materials."steel, grey"]', f'materials."steel, grey": given "steel, grey"; {NO_COMMA}'),
    ("[materials.steel]", '[materials.""]', 'materials."": given ""; expected a name'),
    ("[bodies.block]", '[bodies."block, left"]', 'bodies."block, left": given "block, left"; expected a name without a'
     ' comma, and in its table groups = ["block, left"] for the volume group'),
    (FIRST_DIRECTION, FIRST_DIRECTION + '\nto = "front"',
     'springs[0].to: given "front", its own surface; expected another one'),
    ('material = "steel"\n', "", "bodies.block.material: is missing; expected a text in quotes"),
    ("density = 7800.0\n", "", "materials.steel.density: is missing; expected a number > 0"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "message"),
    UNKNOWN_KEYS + WRONG_TYPES + TABLES + RANGES + SWEEPS + CONTACT_FAULTS,
    ids=lambda text: "".join(c if c.isalnum() else "_" for c in text[:40]),
)
def test_bad_value(tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, message: str) -> None:
    """The scene is refused before any mesh is looked for: there is none here."""
    path = tmp_path / "brake.toml"
    path.write_text(replaced(old, new), encoding="utf-8")
    assert main(["check", str(path)]) == 2
    captured = capsys.readouterr()
    assert captured.err == f"error: {path}: {message}\n"
    assert captured.out == ""


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "mesh: is missing; expected a table, written [mesh] | materials: is missing; expected a table for each,"
         " written [materials.NAME] | bodies: is missing; expected a table for each, written [bodies.NAME]"),
        (without(r"\[bodies.block\].*?(?=\[\[)"),
         "bodies: is missing; expected a table for each, written [bodies.NAME]"),
        (without(r"file = .*?\n", without(r"\[mesh.block\].*?(?=\[materials)")),
         'mesh: given no mesh; expected file = "...", or a geometry [mesh.disc_pad] or [mesh.block]'),
        (HEAD + SPRINGS + TAIL, 'effects.friction: no contact slides; expected a [[contacts]] entry of kind "sliding"'),
        (replaced("density =", "densty =").replace("modes = 8", "mode = 8").replace("mu = 0.3", 'mu = "a"'),
         'materials.steel.densty: unknown key; did you mean "density"? |'
         ' solve.mode: unknown key; did you mean "modes"? | effects.friction.mu: given "a"; expected a number'),
        (replaced("density =", "weight ="),
         "materials.steel.weight: unknown key; valid: density, loss_factor, poisson_ratio, shear_modulus,"
         " youngs_modulus | materials.steel.density: is missing; expected a number > 0"),
        (replaced("2.0e11", '"a"').replace("poisson_ratio = 0.3", "poisson_ratio = nan"),
         'materials.steel.youngs_modulus: given "a"; expected a number |'
         ' materials.steel.poisson_ratio: given nan; expected a finite number (the largest is 1.8e308)'),
        (replaced("direction = [-1.0, 0.0, 1.0]", "direction = [true]"),
         "springs[0].direction[0]: given true; expected a number"),
    ],
    ids=["empty", "no bodies", "no mesh", "no contact", "three faults", "far name", "two unions", "short and wrong"],
)  # fmt: skip
def test_faults_are_counted_once_per_key(text: str, message: str) -> None:
    """A value that fails as number and as list is one fault, a misspelled key and its absence are one."""
    with pytest.raises(SceneError) as caught:
        parse_scene(tomllib.loads(text), "brake.toml")
    assert str(caught.value) == f"brake.toml: {message}"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"a = = 3\n", "not TOML: Invalid value (at line 1, column 5): a = = 3"),
        (b"a = 7800,0\n",
         "not TOML: Expected newline or end of document after a statement (at line 1, column 9): a = 7800,0"),
        (b'title = "a"\ntitle = "b"\n',
         f'not TOML: Cannot overwrite a value (at line 2, column 12): title = "b"; {TWICE}'),
        (SCENE.replace("[[springs]]", "[springs]", 1).encode(),
         f"not TOML: Cannot overwrite a value (at line 21, column 10): [[springs]]; {TWICE}"),
        (b"\n" + "Bremsger\xe4t = 1".encode("latin-1"),
         "not TOML: line 2 holds the byte 0xe4, which is not UTF-8; expected a text file saved as UTF-8"),
        (SCENE.encode("utf-16"),
         "not TOML: line 1 holds the byte 0xff, which is not UTF-8; expected a text file saved as UTF-8"),
        (b"a = " + 2000 * b"[" + 2000 * b"]", "not a scene: nested too deeply"),
    ],
    ids=["not TOML", "decimal comma", "twice", "table and list", "latin-1", "utf-16", "deep"],
)  # fmt: skip
def test_not_toml(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "brake.toml"
    path.write_bytes(content)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert str(caught.value) == f"{path}: {message}"


def test_huge_whole_number_is_not_a_traceback(tmp_path: Path) -> None:
    """Python refuses to read decimals of more than 4300 digits, and to write out longer hexadecimal ones."""
    for number in (5000 * "1", "0x" + 5000 * "f"):
        path = tmp_path / "brake.toml"
        path.write_text(replaced("7800.0", number))
        with pytest.raises(SceneError, match=r"not TOML: Exceeds the limit|given a whole number of 20000 bits"):
            load_scene(path)


@pytest.mark.parametrize("content", [b"\xef\xbb\xbf" + SCENE.encode(), SCENE.replace("\n", "\r\n").encode()])
def test_windows_files_are_read(tmp_path: Path, content: bytes) -> None:
    """A byte order mark and CRLF change nothing."""
    path = tmp_path / "brake.toml"
    path.write_bytes(content)
    scene = load_scene(path)
    assert scene.title == "block on a belt"
    assert scene.sweep is not None
    assert scene.sweep.grid.tolist() == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8])


def test_no_such_scene(tmp_path: Path) -> None:
    for path, message in (
        (tmp_path / "none.toml", "no such file; expected a scene in TOML"),
        (tmp_path, "not a file; expected a scene in TOML"),
        (tmp_path / (300 * "a"), "cannot be read: File name too long; expected a scene in TOML"),
    ):
        with pytest.raises(SceneError) as caught:
            load_scene(path)
        assert str(caught.value) == f"{path}: {message}"


def test_key_of_a_table_named_like_a_key_of_its_own() -> None:
    """Names of bodies and materials are free: one that is a key of the section does not lead the message astray."""
    data = {"mesh": {"file": "a.msh"}, "materials": {"density": {"densty": 1.0}}, "bodies": {"groups": {"grups": []}}}
    with pytest.raises(SceneError) as caught:
        parse_scene(data, "a.toml")
    faults = str(caught.value).removeprefix("a.toml: ").split(" | ")
    assert faults[:2] == [
        'materials.density.densty: unknown key; did you mean "density"?',
        'bodies.groups.grups: unknown key; did you mean "groups"?',
    ]
    # Missing beside the two unknown keys: two moduli of the material, the body's material.
    assert [f.split(": is missing")[0] for f in faults[2:]] == [
        "materials.density.youngs_modulus", "materials.density.poisson_ratio", "bodies.groups.material",
    ]  # fmt: skip


def test_defaults_and_units(tmp_path: Path) -> None:
    scene = load_scene(write_scene(tmp_path, HEAD + CONTACTS))
    assert (scene.mesh.scale, scene.solve.modes, scene.solve.tolerance) == (1.0, None, 1e-8)
    assert scene.output.shapes == "unstable"
    assert scene.contact_names == ("belt",)
    assert scene.effects.names == ()
    assert scene.mesh_path == tmp_path / "block.msh"
    assert scene.contacts[0].sliding is not None
    assert scene.contacts[0].sliding.motion().velocity.tolist() == [1.0, 0.0, 0.0]
