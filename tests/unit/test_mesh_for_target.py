"""`run --accuracy`: a mesh for a target, its true error, what is written, what is kept when it is stopped."""

from __future__ import annotations

import json
import threading
from types import SimpleNamespace

import meshio
import numpy as np
import pandas as pd
import pytest
import scipy.sparse as sp
from clamped_block import BLOCK, write
from rich.console import Console
from scipy.sparse.linalg import LinearOperator, eigs
from undrawn import without_figures

from fe_squeal import assemble, load_mesh, sweep
from fe_squeal.accuracy import choose as choosing
from fe_squeal.accuracy import refined
from fe_squeal.accuracy.choose import Trial, choose
from fe_squeal.accuracy.discretisation import with_discretisation
from fe_squeal.accuracy.largest_error import estimated_error
from fe_squeal.assembly.assembly import Assembly
from fe_squeal.cli import main
from fe_squeal.commands.shared import make_console
from fe_squeal.eigen.linear.choice import factorize
from fe_squeal.mesh.refining import refine
from fe_squeal.run import accuracy as run_accuracy
from fe_squeal.run.found_mesh import print_trials
from fe_squeal.scene.file import load_scene


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    """Frequencies at both values from two meshes far finer than any chosen, extrapolated; clamped corners: rate 1.4."""
    scene = load_scene(write(tmp_path_factory.mktemp("fine")))
    found = []
    for along in ((8, 4, 3), (16, 8, 6)):
        table = scene.mesh.block.with_counts(dict(zip(("elements_x", "elements_y", "layers"), along, strict=True)))
        fine = scene.model_copy(update={"mesh": scene.mesh.model_copy(update={"block": table})})
        problem = assemble(fine)
        found.append(np.array([lowest(problem.pencil(mu=mu)) for mu in (0.0, 0.3)]))
    return found[1] + (found[1] - found[0]) / (2**1.4 - 1)


def lowest(pencil):
    """Five frequencies by a plain Krylov method, which needs one factorisation."""
    K, start = pencil.K, np.ones(pencil.n)
    inverse = LinearOperator(K.shape, factorize(K, False).solve, dtype=float)
    w2 = eigs(K, 5, pencil.M, 0.0, OPinv=inverse, v0=start, return_eigenvectors=False)
    return np.sort(np.sqrt(w2 + 0j).real) / (2 * np.pi)


def true_error(result, truth):
    return max(float(np.abs(p.modes.frequency_hz[:5] / t - 1).max()) for p, t in zip(result.points, truth, strict=True))


@pytest.mark.slow
@pytest.mark.long
def test_a_target_is_met(tmp_path, truth, monkeypatch, no_figures):
    """The choice's own estimate meets it, its true error, too, and the written mesh gives the same frequencies."""
    for element, target in (("hex", 0.006), ("tet", 0.01)):  # in one test, since `truth` takes long
        with monkeypatch.context() as patched:
            (tmp_path / element).mkdir()
            assert_target_is_met(tmp_path / element, truth, element, target, patched)


def assert_target_is_met(folder, truth, element, target, patched):
    scene, out = load_scene(write(folder, element)), folder / "out"
    made = []
    patched.setattr(run_accuracy, "choose", lambda *how: made.append(choose(*how)) or made[0])
    assert run_accuracy.run_to_accuracy(scene, out, Console(quiet=True), target) == 0
    [choice] = made
    assert len(choice.trials) > 1 and choice.trials[-1].error <= target < choice.trials[0].error
    assert estimated_error(choice.result) == choice.trials[-1].error
    assert true_error(choice.result, truth) <= target
    bars = [p.discretisation.imag / p.modes.lam.imag for p in choice.result.points]
    for point, bar, exact in zip(choice.result.points, bars, truth, strict=True):
        assert (np.abs(point.modes.frequency_hz[:5] / exact - 1) <= bar[:5]).all()
        beyond = np.abs(point.extrapolated.imag[:5] / (2 * np.pi * exact) - 1)
        assert beyond.max() < np.abs(point.modes.frequency_hz[:5] / exact - 1).max()
    if element == "hex":
        first, last = scene.mesh.block, choice.scene.mesh.block
        assert last.cells < 8 * first.cells and last.layers * last.elements_x * last.elements_y == last.cells
    again = load_mesh(out / "mesh.msh")
    plain = scene.model_copy(update={"mesh": choice.scene.mesh})
    point = sweep(assemble(plain, again), [0.3], modes=5).points[0]
    table = pd.read_csv(out / "modes.csv").query("value == 0.3")
    np.testing.assert_allclose(np.sort(point.modes.lam.imag), np.sort(table["im"]), rtol=1e-9)


@pytest.mark.slow
def test_what_is_written_besides(tmp_path, capsys):
    """Columns that are extrapolated, the parts of the error, the page's section; parts add up to the changes."""
    scene, out = write(tmp_path, report=True), tmp_path / "out"
    assert main(["run", str(scene), "-o", str(out), "--accuracy", "0.03", "--accuracy-of", "frequencies"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "mesh.msh" in printed and "elements_x = " in printed
    modes = pd.read_csv(out / "modes.csv")
    assert list(modes.columns[-2:]) == ["re_extrapolated", "im_extrapolated"]
    assert (modes["im_extrapolated"] < modes["im"]).all()  # supports and functions fewer than all: too stiff
    assert pd.read_csv(out / "onsets.csv").columns[-1] == "value_extrapolated"
    parts = pd.read_csv(out / "mesh_error.csv")
    assert set(parts["kind"]) == {"frequencies"} and set(parts["direction"]) == {"x", "y", "z"}
    for _, own in parts.groupby("quantity"):
        assert own["part"].sum() == pytest.approx(own["change"].iloc[0], rel=1e-9)
    page = (out / "report.html").read_text("utf-8")
    assert "Where the error of the mesh comes from" in page and "Cut finer there first" in page
    assert all((out / f"mesh_error{n}.png").read_bytes()[:4] == b"\x89PNG" for n in ("", "_elements"))
    drawn = meshio.read(out / "mesh_error.vtu").cell_data["part_0"][0]
    worst = parts.assign(size=(parts["change"] / parts["scale"]).abs()).sort_values("size").iloc[-1]
    # Parts of one sign add up to the change itself, but for the order in which they are added.
    assert drawn.sum() >= worst["size"] * (1 - 1e-12) and page.count("data:image/png") >= 2
    # A plain run into the same folder leaves nothing of it behind.
    with without_figures():
        assert main(["run", str(scene), "-o", str(out)]) == 0
    assert not any((out / name).exists() for name in ("mesh.msh", "mesh_error.csv", "mesh_error.vtu"))
    assert "re_extrapolated" not in pd.read_csv(out / "modes.csv")


@pytest.mark.slow
def test_a_target_that_is_missed(tmp_path, capsys, monkeypatch, no_figures):
    """The nearest result is written, with bars, and marked."""
    monkeypatch.setattr(choosing, "_RUNS", 1)
    scene, out = write(tmp_path), tmp_path / "out"
    assert main(["run", str(scene), "-o", str(out), "--accuracy", "1e-6"]) == 3
    printed = capsys.readouterr()
    assert "not met; nearest: the scene's own mesh" in " ".join(printed.err.split())
    assert "Traceback" not in printed.err
    record = json.loads((out / "run.json").read_text("utf-8"))
    assert record["status"] == "not converged" and record["seconds"]["trial 1"] > 0
    assert pd.read_csv(out / "modes.csv")["im_discretisation"].notna().all()
    assert not (out / "checkpoint").exists()


@pytest.mark.slow
def test_a_mesh_too_large_is_not_begun(tmp_path, capsys, monkeypatch, no_figures):
    """What the next mesh needs is compared with the memory before it is assembled; what there is is written."""
    whole = choosing.require_memory
    monkeypatch.setattr(choosing, "require_memory", lambda needed, *rest: whole(10**18, *rest))
    scene, out = write(tmp_path), tmp_path / "out"
    assert main(["run", str(scene), "-o", str(out), "--accuracy", "0.002"]) == 3
    printed = capsys.readouterr()
    assert "next: " in printed.out and "GiB are free" in " ".join(printed.err.split())
    assert len(pd.read_csv(out / "modes.csv"))


@pytest.mark.slow
def test_a_search_goes_on_where_it_was_stopped(tmp_path, capsys, monkeypatch, no_figures):
    """Stopped in its second trial: what the first gave is there; resumed, the first is not repeated."""
    scene, out = write(tmp_path), tmp_path / "out"
    run = ["run", str(scene), "-o", str(out), "--accuracy", "0.012"]
    swept, meshes = choosing._swept, []

    def stops(scene, problem):
        meshes.append(problem.unknowns)
        if len(meshes) == 2:
            raise KeyboardInterrupt
        return swept(scene, problem)

    monkeypatch.setattr(choosing, "_swept", stops)
    assert main(run) == 130
    assert "interrupted: what came nearest" in capsys.readouterr().err
    assert json.loads((out / "run.json").read_text("utf-8"))["status"] == "interrupted"
    assert len(pd.read_csv(out / "modes.csv"))
    assert main([*run, "--resume"]) == 0
    assert meshes[2] == meshes[1] > meshes[0]
    printed = capsys.readouterr().out
    assert printed.index("the scene's own mesh: ") < printed.rindex(" unknowns, error about")
    assert json.loads((out / "run.json").read_text("utf-8"))["status"] == "complete"
    assert not (out / "checkpoint").exists()


@pytest.mark.slow
def test_the_refined_mesh_is_begun_before_the_sweep(tmp_path, monkeypatch):
    """Each trial takes what was assembled beside its sweep, with the errors of an assembly behind it."""
    scene = load_scene(write(tmp_path))
    assembled, swept = threading.Event(), choosing._swept
    prepare = Assembly.prepare
    monkeypatch.setattr(Assembly, "prepare", lambda self: (prepare(self), assembled.set())[0])

    def waits(scene, problem):
        assert assembled.wait(60)
        assembled.clear()
        return swept(scene, problem)

    monkeypatch.setattr(choosing, "_swept", waits)
    beside = choose(scene, 0.012)
    monkeypatch.undo()
    monkeypatch.setattr(choosing, "finer_mesh_ahead", lambda *_: None)
    behind = choose(scene, 0.012)
    assert len(beside.trials) > 1
    assert [t.unknowns for t in beside.trials] == [t.unknowns for t in behind.trials]
    # Single precision, in which what is solved on the refined mesh is rounded by the order of a sum.
    assert [t.error for t in beside.trials] == pytest.approx([t.error for t in behind.trials], rel=1e-3)


@pytest.mark.slow
def test_bars_of_tetrahedra_are_those_of_an_estimate(tmp_path, monkeypatch):
    """Where the error comes from is looked at before the bars are made, and must not change what they are made from."""
    scene, exact = load_scene(write(tmp_path, "tet")), refined.prolongation

    def rounded(*spaces):  # as where edges of elements are not parallel to the axes
        E = exact(*spaces)
        noise = sp.random_array(E.shape, density=0.01, random_state=np.random.default_rng(1))
        return sp.csr_array(E + 1e-18 * noise)

    expected = with_discretisation(choosing._swept(scene, assemble(scene)))
    monkeypatch.setattr(refined, "prolongation", rounded)
    found = choose(scene, 0.9).result
    for point, other in zip(found.points, expected.points, strict=True):
        np.testing.assert_allclose(point.discretisation.imag, other.discretisation.imag, rtol=1e-2)


def test_nothing_is_begun_without_memory_for_both(tmp_path, monkeypatch):
    scene = load_scene(write(tmp_path))
    problem = assemble(scene)
    ahead = refined.finer_mesh_ahead(problem, "mu", [0.0])
    assert ahead is not None and ahead.take().prolongation.shape[1] == problem.unknowns
    monkeypatch.setattr(refined, "available_memory", lambda: 2**20)
    assert refined.finer_mesh_ahead(problem, "mu", [0.0]) is None


def test_terms_of_other_numbers_are_not_used(tmp_path):
    """Terms that were collected beside a sweep are those of its numbers and over its parameter, or made anew."""
    problem = assemble(load_scene(write(tmp_path)))
    finer = refined.FinerMesh.prepared(problem, "mu", [0.0, 0.3], "auto")
    assert finer.assembly is None and finer.collected is not None
    assert finer.serves("mu", {}) and not finer.serves("mu", {"mu": 0.1}) and not finer.serves("value", {})
    assert {t.name for t in finer.collected.terms} >= {"K0", "M0"}
    single = refined.FinerMesh.prepared(problem, "mu", [0.3], "auto")
    assert single.collected is None and single.serves("value", {"mu": 0.1})


def test_brackets_of_tables_of_a_scene_are_printed(capsys):
    """In a table, too, whose cells Rich takes for markup if its console does."""
    trial = Trial("the mesh of [mesh.block]", 300, 0.1, 0.1)
    print_trials(SimpleNamespace(trials=(trial,)), 0.02, make_console())
    assert "the mesh of [mesh.block]" in capsys.readouterr().out


@pytest.mark.parametrize("element", ["hex", "tet"])
def test_what_no_part_explains_makes_the_mesh_finer_everywhere(tmp_path, element):
    first = choosing.first_candidate(load_scene(write(tmp_path, element)))
    finer = choosing.finer_candidate(first)
    assert finer.unknowns > 1.5 * first.unknowns
    if element == "hex":
        before, after = (c.scene.mesh.block.lines for c in (first, finer))
        assert all(after[key].elements > line.elements for key, line in before.items())


def test_order_1_begins_with_as_many_unknowns(tmp_path):
    """Elements of order 2 twice as long, since their nodes are half as far apart."""
    one, two = (choosing.first_candidate(load_scene(write(tmp_path, order=k))) for k in (1, 2))
    assert one.scene.mesh.order == two.scene.mesh.order == 2 and one.unknowns < two.unknowns


@pytest.mark.slow
def test_imported_hexahedra_are_refined_as_a_whole(tmp_path):
    """A file of hexahedra has no lines: every element is cut into eight, and the target is met all the same."""
    scene = load_scene(write(tmp_path))
    loaded = assemble(scene).source.loaded
    from fe_squeal.mesh.writing import write_loaded

    write_loaded(loaded, tmp_path / "block.msh")
    text = BLOCK.format(element="hex", order=2)
    head, _, tail = text.partition("[mesh.block]")
    path = tmp_path / "file.toml"
    path.write_text(head + 'file = "block.msh"\n[materials.steel]' + tail.partition("[materials.steel]")[2], "utf-8")
    choice = choose(load_scene(path), 0.015)
    assert choice.mesh.mesh.nelements == refine(loaded).mesh.nelements and choice.trials[-1].error <= 0.015
    assert choice.trials[-1].mesh == "every element into eight"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--accuracy", "2"], "between 0 and 1"), (["--accuracy", "0.1", "--accuracy-of", "mass"], "one of onsets"),
        (["--accuracy-of", "onsets"], "without --accuracy"),
    ],
)  # fmt: skip
def test_bad_targets(tmp_path, capsys, arguments, words):
    assert main(["run", str(write(tmp_path)), "-o", str(tmp_path / "out"), *arguments]) == 2
    assert words in " ".join(capsys.readouterr().err.split())
