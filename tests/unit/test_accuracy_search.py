"""What a search for a mesh, and a study of accuracy, take over from the scene and from each other's results."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from accuracy_scene import TINY
from selection import some

from fe_squeal.accuracy import choose as choosing
from fe_squeal.accuracy import measure as measuring
from fe_squeal.accuracy.choose import Choice, Trial, choose
from fe_squeal.accuracy.discretisation import with_changes
from fe_squeal.accuracy.largest_error import estimated_error
from fe_squeal.accuracy.measure import measure
from fe_squeal.accuracy.reference import errors_of, reference_of
from fe_squeal.accuracy.settings import own_setting
from fe_squeal.assembly.assembly import Assembly
from fe_squeal.cli import main
from fe_squeal.eigen.linear import choice
from fe_squeal.eigen.linear.mumps import MumpsOptions
from fe_squeal.eigen.linear.superlu import SUPERLU
from fe_squeal.errors import MeshError, NotConvergedError, SceneError, TooLargeError
from fe_squeal.run.checkpoint import Checkpoint
from fe_squeal.run.folder import hold_folder
from fe_squeal.run.found_mesh import used_again
from fe_squeal.run.inputs import run_inputs
from fe_squeal.run.resume import is_finished
from fe_squeal.scene.file import load_scene
from fe_squeal.sweep.onset import Onset

TWO = TINY.replace("size = 0.02", "size = 0.04").replace("points = 3", "points = 2")  # of two hexahedra
QUIET = '[output]\nreport = false\nshapes = "none"\n'


def written(folder, text, name="block.toml"):
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


@pytest.mark.slow
def test_a_window_between_two_values_is_none_of_the_values(tmp_path):
    """The sweep looks there too, where modes meet and part again; rows of eigenvalues and changes are of the values."""
    text = TWO.replace("height = 0.02", "height = 0.015").replace("mu = 0.4", "mu = 0.19")
    text = text.replace("modes = 8", "modes = 6").replace('parameter = "mu"\nfrom = 0.0\nto = 0.6\npoints = 2', (
        'parameter = "contacts.belt.normal_stiffness"\nvalues = [3e10, 5e10]'
    )).replace("[[contacts]]", '[[contacts]]\nname = "belt"')
    scene = load_scene(written(tmp_path, text))
    found, _ = measure(scene, replace(own_setting(scene), method="direct"), None, True)
    assert ((found.onsets[:, 0] > 3e10) & (found.onsets[:, 0] < 5e10)).sum() == 2  # in and out again
    assert found.lam.shape == found.likely.shape == found.bars.shape and len(found.lam) == 2
    errors = errors_of(found, reference_of(found))
    assert 0 < errors.frequency < 0.1


def test_a_reference_is_where_the_bars_of_its_mesh_say(tmp_path, monkeypatch):
    """Likely values and their bars are those of a run with an estimate, and onsets of the refined mesh are kept."""
    scene, changes = load_scene(written(tmp_path, TWO.replace("to = 0.6", "to = 1.2"))), []
    new = Onset("mu", 0.1, 500.0, "flutter", "into", np.nan, 0, None, 0.0)
    whole = measuring.changes_by
    monkeypatch.setattr(
        measuring, "changes_by", lambda *how: changes.append(replace(whole(*how), appeared=(new,))) or changes[0]
    )
    found, _ = measure(scene, own_setting(scene), None, True)
    candidate = choosing.first_candidate(scene)
    wide = with_changes(choosing._swept(scene, Assembly(candidate.scene, candidate.loaded).problem({})), changes[0])
    reference = reference_of(found)
    point, counted = wide.points[0], reference.counted
    np.testing.assert_allclose(reference.lam, point.extrapolated, rtol=1e-6)
    bars = point.extrapolated_discretisation.imag / point.extrapolated.imag
    assert reference.uncertainty.frequency == pytest.approx(bars[counted].max(), rel=1e-4)
    onsets = [o for o in wide.onsets if o.branch_a]
    assert len(onsets) and len(reference.onsets) == len(onsets) + 1
    np.testing.assert_allclose(reference.onsets[:, 0], [*(o.extrapolated for o in onsets), new.value], rtol=1e-6)
    assert reference.onsets_known.tolist() == [True] * len(onsets) + [False]
    last, growing = wide.points[-1], reference.growing
    bars = last.extrapolated_discretisation.real[growing] / last.extrapolated.real[growing].max()
    assert reference.uncertainty.growth == pytest.approx(bars.max(), rel=1e-4)


@pytest.mark.slow
def test_options_of_mumps_reach_every_solve(tmp_path, monkeypatch):
    """In a search and in a measurement; SuperLU stands in for MUMPS, whose word alone would lose the options."""
    asked = []
    monkeypatch.setattr(choice, "has_mumps", lambda: True)
    monkeypatch.setattr(choice, "MUMPS", None)
    monkeypatch.setattr(choice, "Mumps", lambda options: asked.append(options) or SUPERLU)
    text = f'{TWO}max_frequency = 5000.0\nlinear_solver = "mumps"\n[solve.mumps]\nlow_rank = 1e-9\n'
    scene = load_scene(written(tmp_path, text.replace("modes = 8\n", "")))
    measure(scene, own_setting(scene), None, True)
    choose(scene, 0.9, kinds=("frequencies",))
    assert set(asked) == {MumpsOptions(low_rank=1e-9)}


@pytest.mark.slow
def test_measured_shapes_are_compared_with_every_mode(tmp_path):
    """As a plain run on the same mesh does."""
    (tmp_path / "shape.csv").write_text(
        "x,y,z,uz_re\n" + "".join(f"{x},{y},0.02,{1 + x}\n" for x in (-0.04, 0.0, 0.04) for y in (-0.02, 0.02)), "utf-8"
    )
    path = written(tmp_path, f'{TWO}{QUIET}[[measured]]\nfile = "shape.csv"\n')
    for name, more in (("plain", ()), ("search", ("--accuracy", "0.9", "--accuracy-of", "frequencies"))):
        assert main(["run", str(path), "-o", str(tmp_path / name), *more]) == 0
    plain, search = (pd.read_csv(tmp_path / name / "mac.csv") for name in ("plain", "search"))
    assert len(search) == 8
    pd.testing.assert_frame_equal(search, plain, rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("errors", "nearest"), [([0.5, np.nan], 0), ([np.nan, 0.5], 1), ([np.nan, np.nan], 1)])
def test_a_trial_whose_error_is_not_known_is_nearer_than_none(tmp_path, monkeypatch, errors, nearest):
    scene, given = load_scene(written(tmp_path, TWO)), iter(errors)
    monkeypatch.setattr(choosing, "_RUNS", 2)
    monkeypatch.setattr(choosing, "first_order_bars", lambda *_: np.array([next(given)]))
    monkeypatch.setattr(choosing, "next_candidate", lambda candidate, *_: candidate)
    with pytest.raises(NotConvergedError, match="not met; nearest: ") as caught:
        choose(scene, 1e-3)
    trials = caught.value.partial.trials
    assert len(trials) == 2 and trials[-1].unknowns == sorted(t.unknowns for t in trials)[nearest]
    assert trials[-1].error == estimated_error(caught.value.partial.result)  # by the bars that are written


def fails_at(number, error, whole):
    """The same function, but for an error at one of its calls."""
    calls = []

    def call(*given, **named):
        calls.append(given)
        if len(calls) == number:
            raise error
        return whole(*given, **named)

    return call


@pytest.mark.parametrize(("step", "error", "words"), some([
    ("_swept", NotConvergedError("the modes are not found"), "the modes are not found"),
    ("right_corrections", TooLargeError("too large a mesh"), "too large a mesh"),
    ("_swept", MemoryError(), "the next mesh does not fit into memory"),
    ("next_candidate", MeshError("no such mesh"), "no such mesh"),
    ("finer_candidate", MemoryError(), "the next mesh does not fit into memory"),
], lambda step, error, words: words == "too large a mesh"))  # fmt: skip
def test_what_fails_on_a_later_mesh_leaves_the_nearest(tmp_path, monkeypatch, step, error, words):
    """The results of the meshes before are as good as ever."""
    scene = load_scene(written(tmp_path, TWO))
    monkeypatch.setattr(choosing, "next_candidate", lambda candidate, *_: candidate)
    monkeypatch.setattr(choosing, step, fails_at(1 if "candidate" in step else 2, error, getattr(choosing, step)))
    with pytest.raises(NotConvergedError, match=rf"not met; nearest: the scene's own mesh.* \({words}\)") as caught:
        choose(scene, 1e-3)
    [trial], result = caught.value.partial.trials, caught.value.partial.result
    assert trial.by_bars and trial.error == estimated_error(result) > 1e-3


def test_bars_that_fail_too_leave_the_sweep(tmp_path, monkeypatch):
    scene = load_scene(written(tmp_path, TWO))
    monkeypatch.setattr(choosing, "_RUNS", 1)
    monkeypatch.setattr(choosing, "next_candidate", lambda candidate, *_: candidate)
    monkeypatch.setattr(choosing, "with_discretisation", fails_at(1, TooLargeError("too large"), None))
    with pytest.raises(NotConvergedError, match="not met; nearest: the scene's own mesh") as caught:
        choose(scene, 1e-3)
    result = caught.value.partial.result
    assert result.points[0].discretisation is None and not caught.value.partial.trials[-1].by_bars
    assert result.warnings[-1] == "the error of the mesh is not known: too large"


def test_a_first_mesh_that_fails_says_why(tmp_path, monkeypatch):
    monkeypatch.setattr(choosing, "right_corrections", fails_at(1, TooLargeError("too large a mesh"), None))
    with pytest.raises(TooLargeError, match="too large a mesh"):
        choose(load_scene(written(tmp_path, TWO)), 1e-3)


@pytest.mark.parametrize("kind", [TooLargeError, MeshError, NotConvergedError])
def test_a_resumed_search_that_can_solve_on_no_mesh_names_the_nearest(tmp_path, monkeypatch, kind):
    """It has none of the results before; the folder is as it was, and the exit code says that the target is missed."""
    scene = load_scene(written(tmp_path, TWO))
    trials = [Trial(name, 9, error, 1.0) for name, error in (("a", 0.4), ("b", 0.2), ("c", 0.3))]
    monkeypatch.setattr(choosing, "_tried", fails_at(1, kind("too large"), None))
    said = r"target of 5 % is not met; nearest before the search was resumed: b: 9 unknowns, .* \(too large\)"
    with pytest.raises(NotConvergedError, match=said) as caught:
        choose(scene, 0.05, earlier=(trials, choosing.first_candidate(scene)))
    assert caught.value.partial is None and caught.value.exit_code == 3


@pytest.mark.parametrize(("firsts", "bars", "nearest"), some([
    ([0.012, 0.0105], [0.013], 1),  # by bars the first one is farther off than 0.012
    ([0.5, 0.02], [], 1), ([0.02, 0.5], [], 0), ([0.0105, 0.02], [0.013], 0),
], lambda firsts, bars, nearest: firsts[0] == 0.012))  # fmt: skip
def test_bars_to_first_order_do_not_hide_that_a_mesh_is_coarser(tmp_path, monkeypatch, firsts, bars, nearest):
    scene, to_first_order, by_bars = load_scene(written(tmp_path, TWO)), iter(firsts), iter([*bars, 0.1])
    monkeypatch.setattr(choosing, "_RUNS", 2)
    monkeypatch.setattr(choosing, "first_order_bars", lambda *_: np.array([next(to_first_order)]))
    monkeypatch.setattr(choosing, "estimated_error", lambda *_: next(by_bars))
    monkeypatch.setattr(choosing, "next_candidate", lambda candidate, *_: candidate)
    with pytest.raises(NotConvergedError, match="not met; nearest: ") as caught:
        choose(scene, 0.01)
    trials = caught.value.partial.trials
    assert trials[-1].unknowns == sorted(t.unknowns for t in trials)[nearest]
    assert trials[-1].by_bars and trials[-1].error == (bars[0] if bars and firsts[nearest] == 0.0105 else 0.1)


@pytest.mark.slow
def test_nearest_of_a_resumed_search_is_told_as_such(tmp_path, monkeypatch):
    """Of the trials before the interruption there is no result any more, so that another one is written."""
    scene = load_scene(written(tmp_path, TWO))
    monkeypatch.setattr(choosing, "_RUNS", 1)
    monkeypatch.setattr(choosing, "first_order_bars", lambda *_: np.array([0.5]))
    monkeypatch.setattr(choosing, "estimated_error", lambda *_: 0.5)
    for before, words in ((0.4, "nearest since the search was resumed: "), (0.6, "nearest: ")):
        earlier = [Trial("before", 100, before, 1.0)], choosing.first_candidate(scene)
        with pytest.raises(NotConvergedError, match=f"not met; {words}the scene's own mesh"):
            choose(scene, 1e-3, earlier=earlier)


@pytest.mark.slow
def test_what_is_finished_is_shown_again_and_never_replaced_by_another(tmp_path, capsys, monkeypatch):
    """--resume of another scene, another target or other quantities, and of a search where a plain run was."""
    path, out = written(tmp_path, TWO + QUIET), tmp_path / "out"
    other = written(tmp_path, TWO.replace("2.0e9", "3.0e9") + QUIET, "other.toml")
    run, frequencies = ["-o", str(out), "--accuracy"], ["--accuracy-of", "frequencies"]
    assert main(["run", str(path), *run, "0.9", *frequencies]) == 0
    record = json.loads((out / "run.json").read_text("utf-8"))
    assert record["search"]["target"] == 0.9 and record["search"]["of"] == "frequencies"
    assert [t["unknowns"] for t in record["search"]["trials"]] == [record["unknowns"]]
    files = {p.name: p.read_bytes() for p in out.iterdir()}
    with monkeypatch.context() as patched:
        patched.setattr("fe_squeal.run.accuracy.choose", lambda *_: pytest.fail("nothing is left to solve"))
        capsys.readouterr()
        assert main(["run", str(path), *run, "0.9", *frequencies, "--resume"]) == 0
        said = capsys.readouterr().out
        assert "are complete: nothing is left to resume" in said and "0.32350341" in said
        for scene, more, words in (
            (other, ["0.9", *frequencies], "materials.lining.youngs_modulus is 2000000000.0 there and"),
            (path, ["0.8", *frequencies], "--accuracy is 0.9 there and 0.8 here"),
            (path, ["0.9"], "--accuracy-of is 'frequencies' there and 'all' here"),
        ):
            assert main(["run", str(scene), *run, *more, "--resume"]) == 2
            assert f"{out}: the finished results are of another one: {words}" in capsys.readouterr().err
        assert files == {p.name: p.read_bytes() for p in out.iterdir()}
        assert main(["run", str(path), "-o", str(out)]) == 0
        assert main(["run", str(path), *run, "0.9", "--resume"]) == 2
        assert "are of another one: --accuracy is not given there and 0.9 here" in capsys.readouterr().err


def test_a_search_for_another_target_is_not_resumed(tmp_path, capsys, monkeypatch):
    """The trials that are kept are those of its target and quantities."""
    path, out = written(tmp_path, TWO), tmp_path / "out"

    def stops(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(choosing, "_swept", stops)
    run = ["run", str(path), "-o", str(out), "--accuracy"]
    assert main([*run, "0.1", "--resume"]) == 130
    assert f"nothing to resume in {out}: the search starts anew" in " ".join(capsys.readouterr().out.split())
    for more, words in ((["0.2"], "--accuracy is 0.1 there"), (["0.1", "--accuracy-of", "onsets"], "--accuracy-of is")):
        assert main([*run, *more, "--resume"]) == 2
        assert f"the interrupted run was another one: {words}" in " ".join(capsys.readouterr().err.split())
    assert main([*run, "0.1", "--resume"]) == 130


@pytest.mark.parametrize(("refinement", "words"), [(1, "layers = 1"), (2, "layers = 2, refinement = 1")])
def test_numbers_of_elements_that_are_told_give_the_same_mesh(tmp_path, refinement, words):
    """Also where the scene's own table multiplies them."""
    scene = load_scene(written(tmp_path, TWO.replace("size = 0.04", f"size = 0.04\nrefinement = {refinement}")))
    candidate = choosing.first_candidate(scene)
    problem = Assembly(candidate.scene, candidate.loaded).problem({})
    result = SimpleNamespace(problem=problem)
    said = used_again(Choice(candidate.scene, candidate.loaded, result, ()), scene, tmp_path)
    assert said.endswith(words)
    told = tomllib.loads(said.partition("geometry with ")[2].replace(", ", "\n"))
    again = type(scene.mesh.block).model_validate({**scene.mesh.block.model_dump(), **told})
    assert again.block_counts == candidate.scene.mesh.block.block_counts == (2 * refinement, refinement, refinement)


@pytest.mark.parametrize("status", ["interrupted", "not converged"])
def test_a_plain_run_does_not_go_on_with_results_of_a_search(tmp_path, status):
    """Those are of another mesh than the scene's own, and a search keeps no checkpoint of a run."""
    scene, out = load_scene(written(tmp_path, TWO)), tmp_path / "out"
    chosen = choosing.finer_candidate(choosing.first_candidate(scene)).scene
    with hold_folder(out) as held:
        record = {"status": status, "inputs": run_inputs(chosen, None)}
        (out / "run.json").write_text(json.dumps(record), encoding="utf-8")
        with pytest.raises(SceneError, match=r"the results are of another one: mesh.block.elements_x is 3"):
            is_finished(out, Checkpoint(held), run_inputs(scene, None))
        (out / "run.json").unlink()
