"""Effects through the command: what is written of them, and what is refused with which exit code."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import pyvista
from pictures import longest_bar
from scene_texts import CONTACT, COUPLING, K0, SCENE, read_rows, replaced, write_scene

import fe_squeal.fem.static_contact as static_contact
from fe_squeal.cli import main
from fe_squeal.report.contributions import _colours

AREA, PRESSURE = 0.08 * 0.04, 1.0e5
PRELOAD = "[effects.preload]\npressures = { top = 1.0e5 }\n"
DAMPING = "[effects.rayleigh]\nbeta = 1.0e-6\n[effects.friction_damping]\n"
EFFECTS = "[effects.friction]"


def with_effects(text: str) -> str:
    return replaced(EFFECTS, text + EFFECTS)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of the pressed block with damping in its material and in the contact."""
    folder = tmp_path_factory.mktemp("effects")
    text = with_effects(PRELOAD + DAMPING).replace("to = 0.8", "to = 1.6")
    assert main(["run", str(write_scene(folder, text)), "-o", str(folder / "out")]) == 0
    return folder / "out"


def record_of(folder: Path) -> dict:
    return dict(json.loads((folder / "run.json").read_text("utf-8")))


@pytest.mark.slow
def test_record_names_what_was_on(out: Path) -> None:
    record = record_of(out)
    assert record["effects"] == ["friction", "preload", "friction_damping", "rayleigh"]
    assert record["problem_class"] == "quadratic"
    assert {t["name"] for t in record["terms"] if t["slot"] == "C"} == {"rayleigh.block", "friction_damping.belt"}


@pytest.mark.slow
def test_preload_is_written(out: Path) -> None:
    """The whole load goes through the contact at every μ; friction pulls with μ N."""
    rows = read_rows(out / "preload.csv")
    assert [float(r["value"]) for r in rows] == pytest.approx([0.0, 0.4, 0.8, 1.2, 1.6])
    assert [float(r["mu"]) for r in rows] == [float(r["value"]) for r in rows]
    assert {r["contact"] for r in rows} == {"belt"}
    # The rigid block: K0 x + (μk − C) z = 0 and K0 z − C x = −F give N = −k z; the block itself is softer by 0.4 %.
    for r in rows:
        assert float(r["closed"]) == 1.0
        rigid = K0 - COUPLING * (COUPLING - float(r["mu"]) * CONTACT) / K0
        assert float(r["normal_force_n"]) == pytest.approx(CONTACT * PRESSURE * AREA / rigid, rel=5e-3)
    told = record_of(out)["preload"]
    assert told["mu"] == 0.3 and told["load_n"] == pytest.approx([0, 0, -PRESSURE * AREA])
    belt = told["contacts"]["belt"]
    assert belt["force_on_pad_n"][0] == pytest.approx(0.3 * belt["normal_force_n"])
    assert belt["force_on_pad_n"][2] == pytest.approx(belt["normal_force_n"])
    # Of 320 N on the top most goes into the springs, which is said, and all is balanced.
    balance = record_of(out)["forces"]["block"]
    total = np.sum([balance["applied_n"], *balance["contacts_n"].values(), *balance["springs_n"].values()], axis=0)
    assert np.abs(total).max() < 1e-6 * PRESSURE * AREA and balance["supports_n"] == [0, 0, 0]
    assert balance["contacts_n"]["belt"] == pytest.approx(belt["force_on_pad_n"])
    assert any(w.startswith("preload: of 320 N on body block,") for w in record_of(out)["warnings"])
    faces = pyvista.read(out / "preload_contacts.vtu")
    assert faces.point_data["contact_pressure"].max() == pytest.approx(belt["largest_pressure_pa"])
    pressed = faces.point_data["contact_pressure"] * faces.point_data["weight"]
    assert pressed.sum() == pytest.approx(belt["normal_force_n"])
    grid = pyvista.read(out / "preload.vtu")
    assert grid.point_data["displacement"][:, 2].max() < 0  # pressed down everywhere, by some F/k
    assert grid.point_data["displacement"][:, 2].mean() == pytest.approx(-PRESSURE * AREA / 1e7, rel=0.1)
    assert (out / "preload.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_shares_are_the_same_in_all_files(out: Path) -> None:
    """contributions.csv, run.json and modes.csv tell the same of friction and dampers, and shares add up to re."""
    rows, modes = read_rows(out / "contributions.csv"), read_rows(out / "modes.csv")
    unstable = record_of(out)["unstable"]
    assert {u["branch"] for u in unstable} == {int(r["branch"]) for r in modes if r["stability"] == "unstable"}
    for told in unstable:
        [mode] = [m for m in modes if (int(m["branch"]), float(m["value"])) == (told["branch"], told["value"])]
        mine = {r["term"]: r for r in rows if (r["branch"], r["value"]) == (mode["branch"], mode["value"])}
        total = mine.pop("sum")
        assert float(total["re_share"]) == pytest.approx(float(mode["re"]), rel=1e-8)
        assert told["re"] == float(mode["re"])
        shares = {n: float(r["re_share"]) for n, r in mine.items() if float(r["re_share"])}
        assert shares == pytest.approx(told["re_shares"], rel=1e-12)
        assert set(shares) == {"friction.belt", "rayleigh.block", "friction_damping.belt"}
        assert shares["friction.belt"] > 0 > max(shares["rayleigh.block"], shares["friction_damping.belt"])
        assert {n for n, r in mine.items() if r["energy_share"]} == set(told["energy_shares"])
        assert {"mass.block", "elastic.block", "contact.belt"} <= set(told["energy_shares"])
        assert sum(told["energy_shares"].values()) == pytest.approx(2.0)  # one of each kind
        assert told["sensitivities"]["effects.rayleigh.beta"]["dre"] < 0  # damping of the material calms it
    # The bars in the picture have the lengths of the shares.
    largest = {t: max(abs(u["re_shares"].get(t, 0.0)) for u in unstable) for t in shares}
    colours = _colours(dict.fromkeys(r["term"] for r in rows if r["term"] != "sum"))
    bars = {t: longest_bar(out / "contributions.png", colours[t]) for t in shares}
    assert bars["friction.belt"] > 100
    for t in shares:
        assert bars[t] / bars["friction.belt"] == pytest.approx(largest[t] / largest["friction.belt"], abs=0.05), t


@pytest.mark.slow
def test_nothing_of_an_effect_that_is_not_called_for(tmp_path: Path) -> None:
    assert main(["run", str(write_scene(tmp_path)), "-o", str(tmp_path / "out")]) == 0
    assert not [p.name for p in (tmp_path / "out").iterdir() if p.name.startswith("preload")]
    assert record_of(tmp_path / "out")["preload"] is None


@pytest.mark.slow
def test_any_number_may_be_swept(tmp_path: Path) -> None:
    """Over the contact's stiffness at μ = 0.6, with a block a hundred times stiffer than steel."""
    text = SCENE.replace('parameter = "mu"', 'parameter = "contacts.belt.normal_stiffness"')
    text = text.replace("mu = 0.3", "mu = 0.6").replace("youngs_modulus = 2.0e11", "youngs_modulus = 2.0e13")
    text = text.replace("from = 0.0\nto = 0.8", f"from = {1e5 / AREA}\nto = {1e6 / AREA}")
    text = 'units = "any"\n' + text  # no material is as stiff
    assert main(["run", str(write_scene(tmp_path, text)), "-o", str(tmp_path / "out")]) == 0
    [onset] = read_rows(tmp_path / "out" / "onsets.csv")
    assert (onset["parameter"], onset["direction"]) == ("contacts.belt.normal_stiffness", "into")
    # Of the rigid block: (k − CONTACT)² + 4C² = 4Cμk, since springs give K_zz = K0 − CONTACT + k.
    p, q = CONTACT + 2 * 0.6 * COUPLING, CONTACT**2 + 4 * COUPLING**2
    assert float(onset["value"]) * AREA == pytest.approx(p - (p**2 - q) ** 0.5, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (with_effects("[effects.stress_stiffening]\n"), ["effects", "stress_stiffening without preload"]),
        (with_effects("[effects.friction_damping]\n"), ["friction_damping without a pressure"]),
        (with_effects(PRELOAD.replace("1.0e5", "-1.0e5")), ["effects.preload", "every contact", "(0, 0, 320) N"]),
        (with_effects(PRELOAD.replace("top", "tpo")), ["effects.preload.pressures.tpo", 'did you mean "top"']),
        (with_effects("[effects.rayleigh]\nalpah = 1.0\n"), ["effects.rayleigh.alpah", 'did you mean "alpha"']),
        (with_effects("[effects.rayleigh]\nalpha = inf\n"), ["effects.rayleigh.alpha", "inf"]),
        (with_effects('[effects.rotation]\nbodies = ["block"]\n'), ["effects.rotation"]),
        (
            with_effects('[effects.rotation]\nbodies = ["block"]\naxis = [0, 0, 1]\nspeed = 1.0\n'),
            ["effects.rotation", "block", "not a body of revolution"],
        ),
        (SCENE.replace('"mu"', '"springs.normal_3.stiffness"'), ["sweep.parameter", "normal_1"]),
        (SCENE.replace('"mu"', '"effects.rayleigh.beta"'), ["sweep.parameter", "rayleigh"]),
    ],
)
def test_what_makes_no_sense_is_refused(tmp_path: Path, capsys, text: str, words: list[str]) -> None:
    path = write_scene(tmp_path, text)
    assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "Traceback" not in said and said.startswith("error: ") and "block.toml" in said
    for word in words:
        assert word in said.replace("\n", " "), said
    assert not (tmp_path / "out" / "modes.csv").exists()


def test_static_state_that_is_not_found_ends_with_3(tmp_path: Path, capsys, monkeypatch) -> None:
    """As of a contact that opens and closes for ever: no state is passed off as an equilibrium."""
    monkeypatch.setattr(static_contact, "_EQUILIBRIUM", -1.0)
    path = write_scene(tmp_path, with_effects(PRELOAD))
    assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 3
    said = capsys.readouterr().err
    assert "the static contact did not settle" in said and "Traceback" not in said
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_sweep_ends_where_the_contact_opens(tmp_path: Path, capsys) -> None:
    """A pressure from below lifts the block off the belt once it exceeds that from above: what came before is kept."""
    text = with_effects("[effects.preload]\npressures = { top = 1.0e5, bottom = 0.0 }\n")
    text = text.replace('parameter = "mu"', 'parameter = "effects.preload.pressures.bottom"')
    text = text.replace("from = 0.0\nto = 0.8\npoints = 5", "values = [0.0, 0.5e5, 1.5e5]")
    path = write_scene(tmp_path, text)
    assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 3
    said = capsys.readouterr().err
    assert "effects.preload.pressures.bottom = 150000" in said and "open every contact" in said
    assert {float(r["value"]) for r in read_rows(tmp_path / "out" / "modes.csv")} == {0.0, 0.5e5}
    assert [float(r["closed"]) for r in read_rows(tmp_path / "out" / "preload.csv")] == [1.0, 1.0]
    assert record_of(tmp_path / "out")["status"] == "not converged"
    path = write_scene(tmp_path, text.replace("values = [0.0, 0.5e5, 1.5e5]", "values = [1.5e5, 2e5]"))
    assert main(["run", str(path), "-o", str(tmp_path / "other")]) == 2
    assert "block.toml: effects.preload.pressures" in capsys.readouterr().err
