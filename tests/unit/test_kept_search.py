"""What `run --accuracy` keeps of a search, and where an interrupted one goes on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from clamped_block import write
from deck_texts import deck_of

from fe_squeal import load_mesh
from fe_squeal.accuracy import choose as choosing
from fe_squeal.accuracy.choose import Trial
from fe_squeal.accuracy.line_errors import LineErrors
from fe_squeal.cli import main
from fe_squeal.errors import InputError
from fe_squeal.mesh.digest import mesh_digest
from fe_squeal.mesh.marked import refine_marked
from fe_squeal.run.folder import hold_folder
from fe_squeal.run.inputs import run_inputs
from fe_squeal.run.search import KeptSearch
from fe_squeal.scene.file import load_scene
from meshes import box


@pytest.mark.slow
def test_a_search_that_ended_in_writing_does_not_begin_anew(tmp_path, monkeypatch, no_figures):
    scene, out = write(tmp_path), tmp_path / "out"
    run = ["run", str(scene), "-o", str(out), "--accuracy", "0.012"]
    swept, meshes = choosing._swept, []
    monkeypatch.setattr(choosing, "_swept", lambda scene, p: (meshes.append(p.unknowns), swept(scene, p))[1])
    with monkeypatch.context() as patched:
        patched.setattr("fe_squeal.run.accuracy.write_record", lambda *_: exec("raise KeyboardInterrupt"))
        assert main(run) == 130
    found = len(meshes)
    assert found > 1
    assert main([*run, "--resume"]) == 0
    assert meshes[found:] == meshes[found - 1 : found]  # the last mesh alone
    assert not (out / "checkpoint").exists()


def test_a_search_of_another_scene_is_not_resumed(tmp_path, capsys, monkeypatch):
    scene, out = write(tmp_path), tmp_path / "out"
    run = ["run", str(scene), "-o", str(out), "--accuracy", "0.012"]

    def stops(scene, problem):
        raise KeyboardInterrupt

    monkeypatch.setattr(choosing, "_swept", stops)
    assert main(run) == 130
    scene.write_text(scene.read_text("utf-8").replace("7800.0", "7900.0"), encoding="utf-8")
    assert main([*run, "--resume"]) == 2
    assert "the interrupted run was another one" in " ".join(capsys.readouterr().err.split())


def at_next_mesh(scene):
    """The first candidate, and a finer one with what the first has told of its lines."""
    first = choosing.first_candidate(scene)
    finer = choosing.finer_candidate(first)
    lines, parts = first.scene.mesh.geometry.lines, np.array([[0.1, np.nan]])
    along, one = np.array(["layers"]), np.zeros(1, int)
    errors = LineErrors(lines, {key: 1.9 for key in lines}, parts, along, one, one, one > 0, first.scene.mesh.order)
    return first, replace(finer, errors=errors)


def test_a_search_on_tetrahedra_goes_on_with_the_same_mesh(tmp_path):
    """It is refined as it would have been: cuts follow those before, and warnings name elements of the file."""
    folder = tmp_path / "out"
    (tmp_path / "Block.inp").write_text(deck_of(box("tet1", (2, 1, 1), (0.06, 0.03, 0.02), name="pad"), first=100))
    scene = load_scene(write(tmp_path, "tet"))
    first = choosing.first_candidate(scene)
    loaded = refine_marked(load_mesh(tmp_path / "Block.inp"), np.array([0, 3]), 1)[0]
    with hold_folder(folder) as held:
        kept = KeptSearch(held, run_inputs(scene, None))
        kept.save([], replace(first, loaded=loaded))
        (_, again) = kept.load(scene)
    for name in ("element_labels", "bisection", "added"):
        np.testing.assert_array_equal(getattr(again.loaded, name), getattr(loaded, name))
    assert again.loaded.ignore_case and mesh_digest(again.loaded) == mesh_digest(loaded)
    marked = np.arange(0, loaded.mesh.nelements, 2)
    assert mesh_digest(refine_marked(again.loaded, marked)[0]) == mesh_digest(refine_marked(loaded, marked)[0])


@pytest.mark.parametrize("given", ["order = 2", ""])
def test_what_is_kept_of_a_search_belongs_together(tmp_path, monkeypatch, given):
    """Killed between writing the next mesh and its record, the search goes on with the mesh before."""
    path = write(tmp_path)
    path.write_text(path.read_text("utf-8").replace("order = 2", given), encoding="utf-8")
    scene = load_scene(path)
    first, finer = at_next_mesh(scene)
    trial = Trial("the scene's own mesh", 300, float("nan"), 0.1, by_bars=False)
    with hold_folder(tmp_path / "out") as held:
        kept = KeptSearch(held, run_inputs(scene, None))
        kept.save([], first)
        with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
            patched.setattr("fe_squeal.run.search.write_json", lambda *_: exec("raise KeyboardInterrupt"))
            kept.save([trial], finer)
        trials, again = kept.load(scene)
        assert trials == [] and again.unknowns == first.unknowns and again.told == first.told
        kept.save([trial], finer)
        (found,), again = kept.load(scene)
        assert np.isnan(found.error) and not found.by_bars and "error not known" in str(found)
        assert again.scene.mesh.geometry == finer.scene.mesh.geometry and again.unknowns == finer.unknowns
        assert again.errors.order == again.scene.mesh.order == (2 if given else 3)
        assert again.errors.lines == finer.errors.lines and again.errors.rates == finer.errors.rates
        for name in ("parts", "along", "layers", "groups", "singular"):
            np.testing.assert_array_equal(getattr(again.errors, name), getattr(finer.errors, name))
        assert sorted(p.name for p in (tmp_path / "out" / "checkpoint").iterdir()) == ["next_1.npz", "search.json"]


@pytest.mark.parametrize(("old", "new"), [
    ('"next_1.npz"', '"../../block.toml"'), ('"next_1.npz"', '"next_7.npz"'), ('"seconds": 0.1', '"seconds": []'),
    ('"geometry"', '"geometri"'), ('"layers": 2', '"layers": -2'), ('"rates"', '"lines"'), ("{", ""),
    ('"trials"', '"x"'), ('"groups": [', '"groups": [1,'), ('"layers": [', '"layers": [2,'),
])  # fmt: skip
def test_a_search_that_is_damaged_is_told(tmp_path, old, new):
    scene = load_scene(write(tmp_path))
    _, finer = at_next_mesh(scene)
    with hold_folder(tmp_path / "out") as held:
        kept = KeptSearch(held, run_inputs(scene, None))
        kept.save([Trial("", 300, 1.0, 0.1)], finer)
        path = tmp_path / "out" / "checkpoint" / "search.json"
        assert old in path.read_text("utf-8")
        path.write_text(path.read_text("utf-8").replace(old, new), encoding="utf-8")
        with pytest.raises(InputError, match=r"is damaged; run without|interrupted run was another"):
            kept.load(scene)
