"""Numbers that cannot be in SI units are asked about before anything is solved."""

import pytest

from fe_squeal.assembly.assembly import assemble
from fe_squeal.assembly.discretisation import discretisation_of
from fe_squeal.cli import main
from fe_squeal.scene.file import load_scene
from tests.meshes import box, make_problem
from tests.scene_texts import SCENE, replaced, write_scene

SPOILT = [
    # (E, ρ, what they were meant as); the right ones are 2e11 and 7800
    ("2.0e5", "7.8e-9", "MPa and t/mm^3, write youngs_modulus = 2e+11, density = 7800"),
    ("2.0e5", "7800.0", "MPa and kg/m^3, write youngs_modulus = 2e+11, density = 7800"),
    ("2.0e11", "7.8", "Pa and g/cm^3, write youngs_modulus = 2e+11, density = 7800"),
    ("200.0", "7800.0", "write youngs_modulus ="),
    ("2.0e11", "7.8e-9", "Pa and t/mm^3, write youngs_modulus = 2e+11, density = 7800"),
]


@pytest.mark.parametrize(("modulus", "density", "hint"), SPOILT)
@pytest.mark.parametrize("command", ["run", "check", "onset", "accuracy"])
def test_materials_in_other_units_are_refused_with_what_to_write(modulus, density, hint, command, tmp_path, capsys):
    text = replaced("youngs_modulus = 2.0e11", f"youngs_modulus = {modulus}")
    scene = write_scene(tmp_path, replaced("density = 7800.0", f"density = {density}", text))
    options = ["-o", str(tmp_path / "out")] if command in ("run", "accuracy") else []
    assert main([command, str(scene), *options]) == 2
    message = capsys.readouterr().err
    assert "block.toml: materials.steel: given youngs_modulus" in message and hint in message
    assert 'units = "any"' in message and message.count("\n") == 1
    assert not (tmp_path / "out" / "modes.csv").exists()


def test_a_body_of_eighty_metres_is_one_in_millimetres(tmp_path, capsys):
    text = SCENE.replace("length = 0.08", "length = 80").replace("width = 0.04", "width = 40")
    text = text.replace("height = 0.02", "height = 20").replace("size = 0.02", "size = 20")
    scene = write_scene(tmp_path, text.replace('file = "block.msh"\n', ""))
    assert main(["check", str(scene)]) == 2
    message = capsys.readouterr().err
    assert "bodies.block: 80 m long" in message and 'write length_unit = "mm"' in message


def test_any_units_pass_and_nothing_is_said_about_magnitudes(tmp_path):
    text = SCENE.replace("density = 7800.0", "density = 7.8")
    scene = load_scene(write_scene(tmp_path, 'units = "any"\n' + text))
    assert not any("SI" in w or "√(E/ρ)" in w for w in discretisation_of(assemble(scene)).warnings)


@pytest.mark.parametrize(("units", "shown"), [
    ("SI", ("steel, 6.4e-05 m3, 0.4992 kg; x, y, z in m: ", "rho = 7800 (Pa, kg/m3)", " 0.0032 m2 closed")),
    ("any", ("steel, volume 6.4e-05, mass 0.4992; x, y, z: ", "rho = 7800 spring", " 0.0032 closed")),
])  # fmt: skip
def test_check_names_units_of_si_alone(units, shown, tmp_path, capsys):
    assert main(["check", str(write_scene(tmp_path, f'units = "{units}"\n{SCENE}'))]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert [text for text in shown if text not in told] == []


@pytest.mark.parametrize(("modulus", "density"), [(2e11, 7800.0), (3e7, 1100.0), (1.1e12, 3500.0), (7e10, 2700.0)])
def test_materials_of_brakes_pass(modulus, density, tmp_path):
    text = SCENE.replace("youngs_modulus = 2.0e11", f"youngs_modulus = {modulus}")
    scene = load_scene(write_scene(tmp_path, text.replace("density = 7800.0", f"density = {density}")))
    assert assemble(scene).unknowns > 0


def test_a_scene_that_a_script_builds_is_warned_not_refused():
    soft = {"m": {"youngs_modulus": 50.0, "poisson_ratio": 0.3, "density": 1.0}}
    problem = make_problem(box("hex1", (1, 1, 1)), materials=soft, bodies={"block": {"material": "m"}})
    assert any("√(E/ρ) = 7.07 m/s" in w for w in discretisation_of(problem).warnings)
