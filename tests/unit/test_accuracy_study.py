"""The study of accuracy and the choice of a mesh, on the smallest scenes there are."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accuracy_scene import TINY, fake
from rich.console import Console

from fe_squeal import load_scene, parse_scene
from fe_squeal.accuracy import study as study_module
from fe_squeal.accuracy.forecast import by_information, forecast_of
from fe_squeal.accuracy.measure import measure, measure_apart
from fe_squeal.accuracy.settings import key_of, own_setting, plan, scene_at
from fe_squeal.accuracy.study import COLUMNS, run_study
from fe_squeal.assembly.assembly import Assembly
from fe_squeal.cli import main
from fe_squeal.errors import NotConvergedError, SceneError
from fe_squeal.run.accuracy import study_scene
from fe_squeal.run.folder import hold_folder
from fe_squeal.run.measurements import MeasurementFolder


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "belt.toml"
    path.write_text(TINY)
    return path


def test_what_tells_most_for_its_time_comes_first(tiny):
    scene = load_scene(tiny)
    forecast, settings = forecast_of(scene), plan(scene)
    ordered = by_information(settings, forecast)
    assert sorted(map(str, ordered)) == sorted(map(str, settings))
    work = [forecast.work(s) for s in ordered]
    meshes = {k: [i for i, s in enumerate(ordered) if s.knob == "size" and s.order == k] for k in (1, 2)}
    # Both orders are seen before methods are compared, coarse meshes before fine ones of the same order.
    methods = min(i for i, s in enumerate(ordered) if s.knob == "method")
    for own in meshes.values():
        assert min(own) < methods
        assert [work[i] for i in own] == sorted(work[i] for i in own)


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2])
def test_unknowns_are_forecast(tiny, order):
    scene = load_scene(tiny)
    forecast = forecast_of(scene)
    own = replace(own_setting(scene), order=order)
    assert measure(scene, own, None, False)[0].unknowns == pytest.approx(forecast.unknowns(own), rel=0.02)
    finer = replace(own, size=own.size / 2)
    changed, loaded = scene_at(scene, finer)
    exact = Assembly(changed, loaded).problem({}).unknowns
    assert forecast.unknowns(finer) == pytest.approx(exact, rel=0.02)


BRAKE = Path(__file__).parents[2] / "examples" / "disc_pad.toml"


@pytest.mark.slow
@pytest.mark.parametrize(("size", "order", "damped"), [(0.03, 2, False), (0.025, 2, True), (0.014, 1, False)])
def test_a_forecast_is_right_within_half_as_much(size, order, damped):
    """Unknowns and MiB of a brake in a process of its own, before anything is measured; undamped and damped."""
    scene = load_scene(BRAKE)
    effects = {"friction": {"mu": 0.4}} | ({"rayleigh": {"alpha": 20.0, "beta": 1e-8}} if damped else {})
    data = scene.model_dump(mode="json", by_alias=True, exclude_unset=True)
    data["mesh"].pop("file")
    short = data["sweep"] | {"points": 5}
    scene = parse_scene(data | {"effects": effects, "sweep": short, "solve": {"modes": 23}})
    setting = replace(own_setting(scene), size=size, order=order)
    forecast = forecast_of(scene)
    found, _ = measure_apart(scene, setting, None, False, None)
    assert 1 / 1.2 < forecast.unknowns(setting) / found.unknowns < 1.2
    assert 1 / 1.5 < forecast.memory(setting) / found.peak_memory_mib < 1.5
    done = [(setting, found.peak_memory_mib)]  # corrected by what is measured
    assert forecast.memory(setting, done) == pytest.approx(found.peak_memory_mib)


def study_with(tiny, tmp_path, monkeypatch, stop_after=None, budget=None, seconds=1.0):
    """Run a study whose measurements are made up; return what was said, and the study or the interruption."""
    said, calls = [], []

    def made_up(scene, setting, probes, estimate, rest):
        if stop_after is not None and len(calls) == stop_after:
            raise KeyboardInterrupt
        calls.append(setting)
        shapes = np.eye(6)[:, :3] + 0j
        found = fake([100j, 200j, 400j], shapes, changes=[[-1j, -1j, -1j]] * 2 if estimate else ())
        stages = {"assembly": seconds} | ({"estimate": 0.5} if estimate else {})
        return replace(found, seconds=stages), np.zeros((1, 4))

    monkeypatch.setattr(study_module, "measure_apart", made_up)
    store = MeasurementFolder(tmp_path / "kept")
    try:
        found = run_study(load_scene(tiny), store, budget, progress=lambda *told: said.append(told))
    except KeyboardInterrupt as stop:
        found = stop
    return said, calls, found


def test_a_study_says_beforehand_what_it_takes_and_counts_what_was_measured(tiny, tmp_path, monkeypatch):
    said, calls, found = study_with(tiny, tmp_path, monkeypatch, budget=25.0, seconds=30.0)
    first = r"\d+ settings, up to about \d+ unknowns and \d+ MiB: some \d+ s in all, of which 25 s"
    assert re.search(first, said[0][2])
    assert said[-1][2] == f"{len(calls)} of {len(plan(load_scene(tiny)))} measured"
    assert found.left_out and len(found.left_out) + len(calls) == said[0][1]
    assert max(done for done, *_ in said) == len(calls)  # what was left out is not counted as done
    running = [text for _, _, text, _ in said if " unknowns, " in text]
    assert len(running) == len(calls)


def test_an_interrupted_study_keeps_what_was_measured(tiny, tmp_path, monkeypatch):
    _, calls, stop = study_with(tiny, tmp_path, monkeypatch, stop_after=3)
    study = stop.args[0]
    assert len(calls) == 3 == len(study.settings)
    assert {why for _, why in study.left_out} == {"interrupted"}
    assert len(list((tmp_path / "kept").glob("*.npz"))) == 3
    _, _, nothing = study_with(tiny, tmp_path / "other", monkeypatch, stop_after=0)
    assert isinstance(nothing, KeyboardInterrupt) and nothing.args == (None,)


def test_a_measurement_without_estimate_does_not_stand_for_one_with_it(tmp_path, monkeypatch):
    """Where the scene's own tolerance is one of those that are tried, both settings have the same modes."""
    (tmp_path / "belt.toml").write_text(f"{TINY}tolerance = 1e-6\n", encoding="utf-8")
    scene, of_scene = load_scene(tmp_path / "belt.toml"), key_of(load_scene(tmp_path / "belt.toml"))
    same = [s for s in plan(scene) if s.key(of_scene) == own_setting(scene).key(of_scene)]
    assert sorted((s.knob, s.estimated) for s in same) == [("size", True), ("tolerance", False)]
    monkeypatch.setattr(study_module, "plan", lambda _: [s for s in same if not s.estimated])
    study_with(tmp_path / "belt.toml", tmp_path, monkeypatch)
    monkeypatch.setattr(study_module, "plan", lambda _: same)
    for expected in ([True], []):  # made once, and kept then
        _, calls, study = study_with(tmp_path / "belt.toml", tmp_path, monkeypatch)
        assert [s.estimated for s in calls] == expected
        by_knob = study.to_dataframe().set_index("knob")["seconds_estimate"]
        assert by_knob["size"] == 0.5 and len(study.reference.lost)


def test_a_measurement_of_an_older_program_is_made_again(tmp_path):
    """It has changes by refinement, and not the likely values and their bars."""
    kept, made = MeasurementFolder(tmp_path), fake([100j, 200j], np.eye(6)[:, :2] + 0j, changes=[[-1j, -1j]] * 2)
    kept.save("new", made)
    np.testing.assert_array_equal(kept.load("new").bars, made.bars)
    with np.load(tmp_path / "new.npz") as file:
        arrays = {name: file[name] for name in file.files if name not in ("likely", "bars", "likely_onsets")}
    np.savez(tmp_path / "old.npz", changes=np.zeros((2, 2)), onset_changes=np.zeros(0), **arrays)
    assert kept.load("old") is None


def test_the_command_interrupted_writes_its_tables(tiny, tmp_path, monkeypatch, capsys):
    _, _, stop = study_with(tiny, tmp_path, monkeypatch, stop_after=3)

    def stopped(*args, **kwargs):
        raise stop

    monkeypatch.setattr("fe_squeal.run.accuracy.run_study", stopped)
    assert main(["accuracy", str(tiny), "-o", str(tmp_path / "out")]) == 130
    assert "interrupted: 3 settings were measured" in capsys.readouterr().err
    assert len(pd.read_csv(tmp_path / "out" / "accuracy.csv")) == 3


@pytest.mark.parametrize("report", [True, False])
def test_the_command_names_the_files_that_it_wrote(tiny, tmp_path, monkeypatch, capsys, report):
    """A page only where the scene asks for one."""
    _, _, stop = study_with(tiny, tmp_path, monkeypatch, stop_after=3)
    monkeypatch.setattr("fe_squeal.run.accuracy.run_study", lambda *_, **__: stop.args[0])
    scene, out = tmp_path / "belt.toml", tmp_path / "out"
    scene.write_text(f"{TINY}[output]\nreport = {str(report).lower()}\n")
    assert main(["accuracy", str(scene), "-o", str(out)]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    files = {path.name for path in out.iterdir()} - {"accuracy_stages.csv", "manifest.sha256", "measurements"}
    assert ("report.html" in files) == report
    assert set(last.removeprefix(f"results in {out}: ").split(", ")) == files


def test_settings_of_a_file_are_its_refinements(tiny, tmp_path):
    assert main(["mesh", str(tiny), "-o", str(tmp_path / "belt.msh")]) == 0
    text = TINY.replace("[mesh.block]", 'file = "belt.msh"\n[ignored]').split("[ignored]")
    scene_file = tmp_path / "file.toml"
    scene_file.write_text(text[0] + "[materials.lining]" + text[1].split("[materials.lining]")[1])
    scene = load_scene(scene_file)
    own = own_setting(scene)
    assert own.size == pytest.approx(0.02)
    sizes = sorted({(s.size, s.refinement) for s in plan(scene)})
    assert [r for _, r in sizes] == [2, 1, 0] and sizes[0][0] == pytest.approx(own.size / 4)
    once = scene_at(scene, replace(own, refinement=1))[1]
    assert once.mesh.nelements == 8 * scene_at(scene, own)[1].mesh.nelements


def test_modes_up_to_a_frequency_are_counted(tiny):
    scene = load_scene(tiny)
    found, _ = measure(scene, own_setting(scene), None, False)
    limit = float(found.lam[0].imag[:-1].mean()) / (2 * np.pi)
    solve = scene.solve.model_copy(update={"modes": None, "max_frequency": limit})
    limited = scene.model_copy(update={"solve": solve})
    assert own_setting(limited).modes == np.count_nonzero(found.lam[0].imag < 2 * np.pi * limit) + 1


@pytest.fixture(scope="module")
def measured(tiny, tmp_path_factory):
    """Folder of measurements of some settings, the settings, and their study.

    All in this process, since each one of its own would import everything again: test_measure_apart.py has these.
    """
    scene, folder = load_scene(tiny), tmp_path_factory.mktemp("measured")
    settings = [s for s in plan(scene) if s.size > 0.019 and s.knob in ("size", "modes") and s.modes == 8]
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(study_module, "measure_apart", lambda *given: measure(*given[:4]))
        return folder, settings, run_study(scene, MeasurementFolder(folder), None, settings)


@pytest.mark.slow
def test_study_is_resumed_and_bounded(tiny, measured, tmp_path):
    scene = load_scene(tiny)
    folder, settings, study = measured
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    frame = study.to_dataframe()
    assert tuple(frame.columns) == COLUMNS and not study.left_out
    planned = [s for s in study.settings if not s.adapted]
    assert planned == by_information(settings, forecast_of(scene))
    at = next(i for i, s in enumerate(study.settings) if s.adapted)  # at once after the mesh that it is made from
    assert (study.settings[at - 1].order, study.settings[at - 1].size) == (2, forecast_of(scene).size)
    one, two = (frame[(frame["order"] == k) & (frame["knob"] == "size")] for k in (1, 2))
    assert (two["error_frequency"].to_numpy() < one["error_frequency"].to_numpy()).all()
    # What is there is taken from there, whatever the budget; only what is missing is left out.
    files = {p.name: p.stat().st_mtime_ns for p in tmp_path.glob("*.npz")}
    missing = f"{next(s for s in settings if s.knob == 'modes').key(key_of(scene))}.npz"
    (tmp_path / missing).unlink()
    again = run_study(scene, MeasurementFolder(tmp_path), 1e-9, settings)
    assert len(again.measurements) == len(study.settings) - 1 and len(again.left_out) == 1
    assert "budget" in again.left_out[0][1]
    assert {p.name: p.stat().st_mtime_ns for p in tmp_path.glob("*.npz")} == {
        name: time for name, time in files.items() if name != missing
    }


@pytest.mark.slow
def test_meshes_are_adapted_beside_uniform_ones(tiny, measured):
    """Twice, each with more unknowns than the mesh before it and a smaller error; the last one is not estimated."""
    frame = measured[2].to_dataframe()
    adapted = frame[frame["knob"] == "adapted"].sort_values("unknowns")
    own = frame[(frame["knob"] == "size") & (frame["order"] == 2)].sort_values("size").iloc[0]
    assert len(adapted) == 2 and (adapted["unknowns"] > own["unknowns"]).all()
    kinds = ["error_frequency", "error_growth", "error_onset"]
    errors = adapted[kinds].max(axis=1).to_numpy()
    assert errors[1] < errors[0] < own[kinds].max() / 2
    assert (adapted["size"] < own["size"]).all()
    assert adapted["seconds_estimate"].notna().tolist() == [True, False]


def test_nothing_within_the_budget(tiny, tmp_path):
    with pytest.raises(NotConvergedError, match="nothing could be measured"):
        run_study(load_scene(tiny), MeasurementFolder(tmp_path), 1e-9)


@pytest.mark.slow
def test_command_writes_its_files(tiny, measured, tmp_path, capsys):
    out = tmp_path / "out"
    made, of_scene = MeasurementFolder(measured[0]), key_of(load_scene(tiny))
    with hold_folder(out):  # what an interrupted command leaves, and the next one finds
        found = MeasurementFolder(out / "measurements")
        found.save_probes(of_scene, made.load_probes(of_scene))
        for path in measured[0].glob("*.npz"):
            found.save(path.stem, made.load(path.stem))
    assert main(["accuracy", str(tiny), "-o", str(out), "--budget", "1e-9"]) == 0
    printed = capsys.readouterr().out
    assert "left out" in printed and "% on frequencies" in printed
    frame = pd.read_csv(out / "accuracy.csv")
    assert tuple(frame.columns) == COLUMNS
    stages = pd.read_csv(out / "accuracy_stages.csv")
    assert len(stages) == len(frame) and {"mesh", "assembly", "onsets", "estimate"} <= set(stages.columns)
    page = (out / "accuracy.md").read_text()
    assert "## What to choose" in page and "## Left out" in page
    assert (out / "accuracy.png").read_bytes()[:4] == b"\x89PNG"


def test_bad_budget(tiny, tmp_path, capsys):
    assert main(["accuracy", str(tiny), "-o", str(tmp_path / "out"), "--budget", "-1"]) == 2
    assert "--budget" in capsys.readouterr().err
    with pytest.raises(SceneError):
        study_scene(load_scene(tiny), tmp_path / "out", Console(quiet=True), 0.0)
