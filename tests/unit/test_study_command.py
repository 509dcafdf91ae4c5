"""fe-squeal study: files and their columns, messages, resuming, several processes."""

from __future__ import annotations

import json
from functools import partial

import numpy as np
import pandas as pd
import pytest
import scipy.io
import scipy.sparse as sp
from undrawn import without_figures

import fe_squeal
import fe_squeal.run.run
from fe_squeal.cli import main
from fe_squeal.errors import NotConvergedError, SceneError
from fe_squeal.run.parts import StageParts
from fe_squeal.scene.file import load_scene
from fe_squeal.study import engine
from tests.studies import SCATTER, STIFFNESS, write_study

TWICE = """
[study]
samples = 64
correlation = [["mu", "delta", 0.5], ["delta", "mu", 0.1]]
[study.parameters]
mu = { normal = { mean = 0.1, deviation = 0.01 } }
delta = { normal = { mean = 0.1, deviation = 0.01 } }
"""
MAP = """
[study.x]
parameter = "mu"
from = 0.01
to = 0.1
points = 3
[study.y]
parameter = "delta"
from = 0.01
to = 0.3
points = 3
"""


@pytest.fixture
def drawn_scene(tmp_path):
    """Write a scene of two modes with a study, and return its path."""
    return partial(write_study, tmp_path)


@pytest.fixture
def scene(drawn_scene, no_figures):
    """The same for tests that look at no figure."""
    return drawn_scene


@pytest.mark.slow
def test_a_scatter_writes_what_the_interface_promises(drawn_scene, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["study", str(drawn_scene(SCATTER)), "-o", str(out)]) == 0
    samples, modes, bands, indices = (
        pd.read_csv(out / f"{name}.csv") for name in ("samples", "unstable_modes", "bands", "indices")
    )
    head = ["sample", "mu", "delta", "unstable", "worst_re", "worst_frequency_hz", "worst_damping_ratio", "error"]
    assert list(samples.columns)[:9] == [*head, "method"] and len(samples) == 64
    assert list(modes.columns) == ["sample", "frequency_hz", "re", "re_uncertainty", "damping_ratio", "noise"]
    assert list(bands.columns) == ["low_hz", "high_hz", "probability", "lower", "upper", "samples"]
    assert list(indices.columns) == ["parameter", "output", "first", "first_error", "total", "total_error"]
    assert (samples["unstable"] == (samples["delta"] < 2 * samples["mu"])).all()
    assert len(modes) == samples["unstable"].sum() and set(modes["noise"]) == {"squeal"}
    assert bands["probability"].iloc[-1] == pytest.approx(samples["unstable"].mean())
    assert bands["probability"].iloc[:-1].sum() == pytest.approx(bands["probability"].iloc[-1])
    record = json.loads((out / "study.json").read_text())
    assert record["status"] == "complete" and "LAPACK" in record["method"]
    assert record["known_hz"] is None  # both modes of two unknowns
    assert all((out / f"{name}.png").stat().st_size > 5000 for name in ("probability", "scatter", "indices"))
    # The samples that grow most run as scenes, and give the same growth.
    dangerous = load_scene(out / record["dangerous"][0])
    worst = samples.loc[samples["worst_re"].idxmax()]
    assert dangerous.parameters["mu"] == pytest.approx(worst["mu"], rel=1e-14)  # pandas 2 may lose the last digit
    assert dangerous.study is None
    with without_figures():
        assert main(["run", str(out / record["dangerous"][0]), "-o", str(tmp_path / "run")]) == 0
    assert pd.read_csv(tmp_path / "run" / "modes.csv")["re"].max() == pytest.approx(worst["worst_re"])
    assert main(["study", str(tmp_path / "scene.toml"), "-o", str(out), "--resume"]) == 0
    assert "nothing is left to resume" in capsys.readouterr().out


def test_a_scatter_leads_with_all_samples_that_are_found_unstable(scene, tmp_path, capsys):
    """Of each sample one mode of two: all modes are known up to the lowest alone, and most unstable ones are above."""
    path, out = scene(SCATTER, 16), tmp_path / "out"
    path.write_text(path.read_text().replace("[study]", "[solve]\nmodes = 1\n[study]\nindices = false"))
    assert main(["study", str(path), "-o", str(out)]) == 0
    record, samples = json.loads((out / "study.json").read_text()), pd.read_csv(out / "samples.csv")
    whole, printed = pd.read_csv(out / "bands.csv").iloc[-1], " ".join(capsys.readouterr().out.split())
    count = int((samples["delta"] < 2 * samples["mu"]).sum())
    assert record["unstable_samples"] == count and record["probability"] == count / 16 > record["known_probability"]
    assert record["known_probability"] == whole["probability"] and whole["high_hz"] == record["known_hz"]
    assert record["known_probability_interval"] == whole[["lower", "upper"]].to_list()
    assert record["probability_interval"][1] == 1.0
    assert f"at least {100 * count / 16:.3g} % (95 %: " in printed
    assert f"{count} of 16 samples have an unstable mode among those solved for" in printed
    assert f"up to {whole['high_hz']:.4g} Hz, where all modes are known, the probability is" in printed


def test_what_drives_a_rare_instability_is_not_told(scene, tmp_path, capsys):
    """Of few unstable samples no index is known: the parameter that is given first drives no more than the others."""
    rare = SCATTER.replace("[study]", "[study]\nindices = false").replace("0.1 }", "0.05 }")
    path, out = scene(rare, 16), tmp_path / "out"
    assert main(["study", str(path), "-o", str(out)]) == 0
    assert pd.read_csv(out / "indices.csv")[["first", "total"]].isna().all(axis=None)
    record = json.loads((out / "study.json").read_text())
    assert 0 < record["probability"] < 1 and record["driver"] is None
    assert "driven most" not in capsys.readouterr().out


def test_a_map_writes_what_the_interface_promises(drawn_scene, tmp_path):
    out = tmp_path / "out"
    path = drawn_scene(MAP)
    path.write_text(path.read_text().replace("report = false", "report = true"))
    assert main(["study", str(path), "-o", str(out)]) == 0
    grid, boundaries = pd.read_csv(out / "map.csv"), pd.read_csv(out / "boundaries.csv")
    assert list(grid.columns) == ["x", "y", "unstable", "worst_re", "worst_frequency_hz", "error"] and len(grid) == 9
    assert list(boundaries.columns) == ["curve", "x", "y", "frequency_hz", "kind", "uncertainty"]
    assert boundaries["y"].to_numpy() == pytest.approx(2 * boundaries["x"].to_numpy(), rel=1e-8)
    assert (out / "map.png").stat().st_size > 5000
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "data:image/png" in page and "flutter" in page


@pytest.mark.parametrize(
    ("study", "message"),
    [
        ("", "study: is missing"),
        (SCATTER.replace("mu =", "nu ="), 'given "nu", which is no parameter'),
        (SCATTER.replace("low = 0.0, high = 0.1", "low = 0.2, high = 0.1"), "expected low < high"),
        (SCATTER.replace("uniform = { low = 0.0, high = 0.1 }", "normal = { mean = 0.1 }"), "deviation"),
        (SCATTER + "correlation = 1", "correlation"),
        (TWICE, "correlation[1]: given delta, mu twice"),
        (SCATTER + MAP, "given both"),
        (MAP.replace("to = 0.1\n", "to = 0.01\n"), "expected from < to"),
        (MAP.replace('parameter = "delta"', 'parameter = "mu"'), 'given "mu" twice'),
        *((f"[study]\n{key} = {value}\n" + MAP, f"{key}: belongs to a scatter; expected none beside [study.x]")
          for key, value in {"samples": 64, "seed": 0, "bands": [1, 2], "correlation": [], "indices": "true"}.items()),
        ('[solve]\nmethod = "modal"\n' + SCATTER, 'solve.method: given "modal", which studies do not have'),
    ],
)
def test_bad_input_is_one_sentence(scene, tmp_path, capsys, study, message):
    assert main(["study", str(scene(study)), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert message in said and said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_direct_solves_are_made_where_they_are_asked_for(scene, tmp_path):
    out = tmp_path / "out"
    assert main(["study", str(scene('[solve]\nmethod = "direct"\n' + SCATTER, 16)), "-o", str(out)]) == 0
    assert json.loads((out / "study.json").read_text())["method"] == 'direct solves, which method = "direct" asks for'
    assert set(pd.read_csv(out / "samples.csv")["method"]) == {"direct"}


@pytest.mark.slow
def test_resuming_gives_the_same_samples(scene, tmp_path, monkeypatch):
    """Stopped after its first chunk, and gone on with; nothing that was finished is solved again."""
    path, whole, parts = scene(SCATTER, 96), tmp_path / "whole", tmp_path / "parts"
    assert main(["study", str(path), "-o", str(whole)]) == 0
    solve, solved = engine.solve_chunk, []

    def stop(model, places):
        if solved:
            raise KeyboardInterrupt
        solved.append(len(places))
        return solve(model, places)

    monkeypatch.setattr(engine, "solve_chunk", stop)
    assert main(["study", str(path), "-o", str(parts)]) == 130
    assert json.loads((parts / "study.json").read_text())["status"] == "interrupted"

    def go_on(model, places):
        solved.append(len(places))
        return solve(model, places)

    monkeypatch.setattr(engine, "solve_chunk", go_on)
    assert main(["study", str(path), "-o", str(parts), "--resume"]) == 0
    assert sum(solved) == 96 + 2 * 64  # samples, and those of the indices: none twice
    for name in ("samples.csv", "indices.csv", "bands.csv"):
        assert (parts / name).read_text() == (whole / name).read_text()
    assert not (parts / "parts").exists()


@pytest.mark.slow
def test_the_page_that_an_interruption_has_left_out_is_written(drawn_scene, tmp_path, monkeypatch):
    path, out = drawn_scene(MAP), tmp_path / "out"
    path.write_text(path.read_text().replace("report = false", "report = true"))
    command = ["study", str(path), "-o", str(out), "--resume"]
    with monkeypatch.context() as patched:
        patched.setattr("fe_squeal.run.study.write_study_report", lambda *_: exec("raise KeyboardInterrupt"))
        assert main(command) == 130
    assert not (out / "report.html").exists()
    monkeypatch.setattr("fe_squeal.run.study.assemble", lambda *_: pytest.fail("assembled again"))
    assert main(command) == 0
    assert "data:image/png" in (out / "report.html").read_text(encoding="utf-8")
    assert not (out / "parts").exists()


def test_parts_of_another_study_are_refused(scene, tmp_path, capsys, monkeypatch):
    out = tmp_path / "out"
    monkeypatch.setattr(engine, "solve_chunk", lambda model, places: (_ for _ in ()).throw(KeyboardInterrupt))
    assert main(["study", str(scene(SCATTER)), "-o", str(out)]) == 130
    assert main(["study", str(scene(SCATTER, 65)), "-o", str(out), "--resume"]) == 2
    assert "study.samples is 64 there and 65 here" in capsys.readouterr().err


def failing(error):
    """Return what stands for a chunk that cannot be solved."""
    return lambda model, places: (_ for _ in ()).throw(error)


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (NotConvergedError("no worker is left"), 3, "no worker is left; nothing was finished, and {out} is as it was"),
        (KeyboardInterrupt(), 130, "interrupted: nothing was finished, and {out} is as it was"),
        (SceneError("delta: given -1; expected a number > 0"), 2, "delta: given -1; expected a number > 0"),
    ],
)
def test_results_make_way_when_the_first_chunk_of_new_ones_is_there(
    scene, tmp_path, capsys, monkeypatch, error, code, said
):
    """Until then a study that fails, of the same kind or another one, leaves every file of the folder as it was."""
    out = tmp_path / "out"
    assert main(["study", str(scene(MAP)), "-o", str(out)]) == 0
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    for study in (MAP, SCATTER):
        with monkeypatch.context() as patched:
            patched.setattr(engine, "solve_chunk", failing(error))
            assert main(["study", str(scene(study)), "-o", str(out)]) == code
        assert capsys.readouterr().err.endswith(f"{said.format(out=out)}\n")
        assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before
    assert main(["study", str(scene(SCATTER)), "-o", str(out), "--resume"]) == 2  # of which there is nothing
    assert "expected the same one: start anew without --resume, or give another folder" in capsys.readouterr().err
    save = StageParts.save

    def stop(*arguments):
        save(*arguments)
        raise KeyboardInterrupt

    monkeypatch.setattr(StageParts, "save", stop)
    assert main(["study", str(scene(SCATTER)), "-o", str(out)]) == 130
    assert f"what was finished is in {out}, --resume goes on from there" in capsys.readouterr().err
    assert {path.name for path in out.iterdir()} == {"study.json", "parts", "manifest.sha256"}


@pytest.mark.slow
def test_parts_of_another_study_stay_until_there_are_others(scene, tmp_path, monkeypatch):
    """They belong to another scene and count for nothing, though its places are the same."""
    out, path = tmp_path / "out", scene(MAP)
    save = StageParts.save

    def stop(*arguments):
        save(*arguments)
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(StageParts, "save", stop)
        assert main(["study", str(path), "-o", str(out)]) == 130
    kept = {part: part.read_bytes() for part in (out / "parts").iterdir()}
    scipy.io.mmwrite(tmp_path / "K.mtx", sp.coo_array(4 * STIFFNESS * np.eye(2)))
    with monkeypatch.context() as patched:
        patched.setattr(engine, "solve_chunk", failing(NotConvergedError("no worker is left")))
        assert main(["study", str(path), "-o", str(out)]) == 3
    assert {part: part.read_bytes() for part in (out / "parts").iterdir()} == kept
    assert main(["study", str(path), "-o", str(out)]) == 0
    assert pd.read_csv(out / "map.csv")["worst_frequency_hz"].min() > 0.99 * np.sqrt(STIFFNESS) / np.pi


@pytest.mark.slow
def test_the_page_of_a_run_stays_until_a_study_has_its_own(scene, tmp_path, monkeypatch):
    """A study that is stopped in its first chunk leaves it, and so does one that is stopped behind it."""
    path, out = scene(SCATTER), tmp_path / "out"
    path.write_text(path.read_text().replace("report = false", "report = true"))
    assert main(["run", str(path), "-o", str(out)]) == 0
    page = (out / "report.html").read_bytes()
    solve, solved = engine.solve_chunk, []

    def stop(model, places):
        solved.append(len(places))
        if len(solved) != 2:
            raise KeyboardInterrupt
        return solve(model, places)

    monkeypatch.setattr(engine, "solve_chunk", stop)
    for _ in range(2):
        assert main(["study", str(path), "-o", str(out)]) == 130
        assert (out / "report.html").read_bytes() == page
    assert len(solved) == 3 and (out / "parts").exists()


@pytest.mark.parametrize("last", ["run", "study"])
def test_the_page_is_that_of_the_command_which_wrote_last(drawn_scene, tmp_path, capsys, monkeypatch, last):
    """And `report` makes it anew; it had been that of the run in either order."""
    monkeypatch.setattr(fe_squeal.run.run, "write_figures", lambda *_: None)
    path, out = drawn_scene(MAP), tmp_path / "out"
    path.write_text(path.read_text().replace("report = false", "report = true"))
    for command in sorted(("run", "study"), key=lambda command: command == last):
        assert main([command, str(path), "-o", str(out)]) == 0
    whole = (out / "report.html").read_bytes()
    (out / "report.html").unlink()
    capsys.readouterr()
    assert main(["report", str(out)]) == 0
    assert (out / "report.html").read_bytes() == whole
    names = ("run.json", "study.json") if last == "run" else ("study.json", "run.json")
    assert f"the page is of {names[0]}, the last one, not of {names[1]}" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_many_scenes(scene, tmp_path, workers):
    """Two modes with gaps of 0.1 and 0.2 flutter at μ of half the gap."""
    if workers:
        pytest.importorskip("distributed")
    sweep = '[sweep]\nparameter = "mu"\nfrom = 0.0\nto = 0.3\npoints = 4\n'
    text = scene(sweep).read_text()
    for name, gap in (("narrow", 0.1), ("wide", 0.2)):
        (tmp_path / f"{name}.toml").write_text(text.replace("delta = 0.1", f"delta = {gap}"))
    modes, onsets = fe_squeal.run_many({n: tmp_path / f"{n}.toml" for n in ("narrow", "wide")}, workers=workers)
    assert onsets["scene"].tolist() == ["narrow", "wide"]
    assert onsets["value"].to_numpy() == pytest.approx([0.05, 0.1], rel=1e-10)
    assert modes["scene"].value_counts().to_dict() == {"narrow": 8, "wide": 8}
    with pytest.raises(fe_squeal.SceneError, match="no such file"):
        fe_squeal.run_many([tmp_path / "missing.toml"])
    twice, _ = fe_squeal.run_many([tmp_path / "wide.toml", tmp_path / "wide.toml"])
    assert twice["scene"].nunique() == 2 and len(twice) % 2 == 0


def test_lognormal_numbers_with_a_negative_power_stay_above_0(scene):
    """Also with `low = 0`, which none of them is; uniform ones may be."""
    path = scene('[study]\n[study.parameters]\ndelta = { lognormal = { median = 0.1, factor = 1.5, low = 0.0 } }\n')
    path.write_text(path.read_text().replace("delta = 1", "delta = -1"))
    assert load_scene(path).study.parameters["delta"].ends == (0.0, None)
    path.write_text(path.read_text().replace("lognormal = { median = 0.1, factor = 1.5,", "uniform = { high = 1.0,"))
    with pytest.raises(SceneError, match="given 0 among the values of delta, of which a term has a negative power"):
        load_scene(path)
