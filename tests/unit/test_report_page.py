"""The page of a run as a file: what it says, what it holds, and what it does without."""

from __future__ import annotations

import base64
import json
import re
import shutil
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scene_texts import replaced, write_scene

from fe_squeal.cli import main
from fe_squeal.report.page import verdict
from fe_squeal.report.page.sections import certificate, mode_sections
from fe_squeal.report.page.surface import make_surface, shape_data
from fe_squeal.report.results import Shape, read_results, read_shape, read_shapes
from fe_squeal.report.shapes import HEXAHEDRON, ShapeGrid, normalise_shape
from fe_squeal.report.vtk_files import write_shape
from fe_squeal.run.page import _TABLES

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fe_squeal.report.export.drawing_shapes", lambda *_: nullcontext())
        path = write_scene(folder, replaced('shapes = "none"\nreport = false', 'shapes = "unstable"'))
        assert main(["run", str(path), "-o", str(folder / "out")]) == 0
    return folder / "out"


def data_of(page: Path) -> dict:
    text = page.read_text(encoding="utf-8")
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)[1])


def results_of(folder: Path):
    return read_results(folder, "run.json", _TABLES, "shapes")


@pytest.mark.slow
def test_the_page_is_one_file_below_its_limit(out: Path) -> None:
    """Outside of Plotly's own code nothing refers to a network, and the policy forbids the browser to fetch."""
    text = (out / "report.html").read_text(encoding="utf-8")
    own = re.sub(r"<script>/\*\*\n\* plotly\.js.*?</script>", "", text, flags=re.S)
    assert len(own) < len(text) - 3_000_000  # Plotly is inside
    assert not re.search(r"""(src|href)\s*=\s*["']?(https?:)?//""", own) and "@import" not in own
    assert "default-src 'none'" in own and "connect-src" not in own
    assert (out / "report.html").stat().st_size < 12e6


@pytest.mark.slow
def test_the_answer_has_the_numbers_of_the_tables(out: Path) -> None:
    onset = pd.read_csv(out / "onsets.csv").iloc[0]
    modes = pd.read_csv(out / "modes.csv")
    worst = modes.loc[modes["re"].idxmax()]
    first, at, largest, fed, moved = verdict.answer(results_of(out))
    assert first.startswith("It is unstable: 1 mode is unstable") and "for μ from 0 to 0.8" in first  # 700 Hz: a moan
    assert f"μ = {onset['value']:.6g} (± {onset['uncertainty']:.1e} by the solver; the error of the mesh was not" in at
    assert f"a damping ratio of {100 * worst['damping_ratio']:.3g} %" in largest and "at μ = 0.8" in largest
    assert fed == f"It is fed by friction.belt ({worst['re']:+.3g} 1/s)."
    table = pd.read_csv(out / "sensitivities.csv")
    own = table[(table["value"] == worst["value"]) & (table["mode"] == worst["mode"])]
    change = 0.01 * own["at"] * own["dre"]
    top = own.loc[change.abs().idxmax()]
    assert f"{top['number']} by {0.01 * top['at'] * top['dre']:+.2g} 1/s" in moved.split(":")[1].split(",")[0]


def test_a_sweep_that_begins_behind_an_onset_names_no_later_one_as_the_first(out: Path) -> None:
    whole = results_of(out)
    onset = whole.onsets.iloc[0]
    later = whole.modes[whole.modes["value"] > onset["value"]]
    begin, others = later["value"].min(), whole.onsets.assign(branch_a=98, branch_b=99, value=0.9)
    at = verdict.answer(replace(whole, modes=later, onsets=others))[1]
    assert at == (
        f"The first instability sets in before μ = {begin:.6g}, the first value of the sweep. 1 onset of other modes"
        " follows."
    )


def test_shares_and_sensitivities_that_are_not_known_are_marked(out: Path) -> None:
    """Those of the other terms and numbers are shown as they were."""
    whole = results_of(out)
    shares, moves = whole.contributions, whole.sensitivities
    lost, number = "contact.belt", "springs.across.stiffness"
    holes = replace(whole, contributions=shares.assign(re_share=shares["re_share"].where(shares["term"] != lost)),
                    sensitivities=moves.assign(dre=moves["dre"].where(moves["number"] != number)))  # fmt: skip
    assert verdict.answer(holes)[-2:] == verdict.answer(whole)[-2:]
    shown = mode_sections(holes)
    assert f'<th scope="row">{lost}</th><td class="number">–' in shown and "nan" not in shown
    assert re.search(rf'{number}</th><td class="number">[^<]+</td><td class="number">–', shown)


@pytest.mark.parametrize("record", ["own", "earlier"])
def test_the_certificate_names_units_of_si_alone(out: Path, record: str) -> None:
    """Folders of earlier versions have the units in their scene."""
    results = results_of(out)
    assert results.record["units"] == "SI" and '"col" class="number">area, m²<' in certificate(results)
    inputs = results.record["inputs"]
    if record == "own":
        other = {**results.record, "units": "any"}
    else:
        other = {**results.record, "units": None, "inputs": {**inputs, "scene": {**inputs["scene"], "units": "any"}}}
    told = certificate(replace(results, record=other))
    assert ">area<" in told and ">largest gap<" in told


def test_a_mesh_without_an_axis_has_no_diameters_and_the_page_says_so(out: Path) -> None:
    sentence = "No body with a mesh turns about an axis, so modes have no nodal diameters."
    assert results_of(out).lacks == (sentence,) and sentence in (out / "report.html").read_text(encoding="utf-8")


def test_charts_hold_every_mode_once(out: Path) -> None:
    charts, modes = data_of(out / "report.html")["charts"], pd.read_csv(out / "modes.csv")
    points = [(v, hz, re) for b in charts["branches"] for v, hz, re in zip(b["value"], b["hz"], b["re"], strict=True)]
    assert sorted(points) == sorted(modes[["value", "frequency_hz", "re"]].itertuples(index=False, name=None))
    assert sum(b["grows"] for b in charts["branches"]) == 1
    [onset] = charts["onsets"]
    assert onset["value"] == pytest.approx(0.4, rel=5e-3) and "√(μ − 0.4" in onset["law"]


def test_shapes_come_back_from_the_page(out: Path) -> None:
    """Points, triangles and displacements decode to those of the file, to half a step of 1/32767."""
    shapes, results = data_of(out / "report.html")["shapes"], results_of(out)
    surface = make_surface(results.grid)
    decoded = np.frombuffer(base64.b64decode(shapes["points"]), "<f4").reshape(-1, 3)
    np.testing.assert_allclose(decoded, results.grid.points[surface.nodes], atol=1e-8)
    [shape] = shapes["shapes"]
    u = np.frombuffer(base64.b64decode(shape["u"]), "<i2").reshape(-1, 6) / 32767
    expected = results.shapes[0].u[surface.nodes]
    np.testing.assert_allclose(u[:, :3] + 1j * u[:, 3:], expected, atol=1.1 / 32767)
    assert shape["branch"] == results.shapes[0].info["branch"]


def lattice(n: int, bodies: int = 2) -> ShapeGrid:
    """A row of cubes of n³ hexahedra, each a body of its own."""
    i, j, k = np.meshgrid(*[np.arange(n + 1)] * 3, indexing="ij")
    corner = np.arange((n + 1) ** 3).reshape(n + 1, n + 1, n + 1)
    around = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    cells = np.stack([corner[a : n + a, b : n + b, c : n + c].ravel() for a, b, c in around], axis=1)
    points = np.stack([i.ravel(), j.ravel(), k.ravel()], axis=1) / n
    shift = [points + np.array([2.0 * b, 0, 0]) for b in range(bodies)]
    return ShapeGrid(
        np.vstack(shift), np.vstack([cells + b * len(points) for b in range(bodies)]), HEXAHEDRON,
        np.repeat(np.arange(bodies), n**3), tuple(f"cube {b}" for b in range(bodies)),
    )  # fmt: skip


def test_large_surfaces_are_thinned_and_the_page_says_so() -> None:
    grid = lattice(16)
    whole = make_surface(grid)
    assert not whole.is_thinned and len(whole.nodes) == 2 * (6 * 16**2 + 2)
    thin = make_surface(grid, 800)
    assert thin.is_thinned and 400 < len(thin.nodes) <= 800 and thin.whole == len(whole.nodes)
    corners = thin.triangles
    assert (corners[:, 0] != corners[:, 1]).all() and (corners[:, 1] != corners[:, 2]).all()
    assert len(np.unique(np.sort(corners, axis=1), axis=0)) == len(corners)
    for b in range(2):  # each body is closed round its own box
        part = grid.points[thin.nodes[np.unique(corners[thin.bounds[b] : thin.bounds[b + 1]])]]
        assert np.ptp(part, axis=0).min() > 0.85 and part[:, 0].min() >= 2 * b
    u = np.ones((len(grid.points), 3), complex)
    data, said = shape_data(grid, [Shape({"branch": 1.0}, u)], (0, 0, 1), most=800)
    assert data["left_out"] == []
    assert said == [
        f"The surface has {thin.whole} nodes; the page shows {len(thin.nodes)} of them, and the files in shapes/ all."
    ]
    assert len(data["shapes"]) == 1


def test_what_shapes_are_inside_of_bodies_is_not_kept(tmp_path: Path) -> None:
    """On a fine mesh all shapes of a run would fill the memory; the page shows the same without."""
    grid = lattice(6)
    rng = np.random.default_rng(4)
    outside = make_surface(grid).nodes
    shapes = [rng.standard_normal((len(grid.points), 3, 2)) @ [1, 1j] for _ in range(3)]
    inside = ~np.isin(np.arange(len(grid.points)), outside)
    for b, u in enumerate(shapes):
        u[inside] *= 0.1
        write_shape(grid, u, tmp_path / f"branch_{b}.vtu", {"branch": b})
    whole = [read_shape(path) for path in sorted(tmp_path.glob("*.vtu"))]
    kept, found, lacks = read_shapes(tmp_path)
    assert lacks == [] and all(shape.u.shape == kept.points.shape == (len(outside), 3) for shape in found)
    assert kept.size == grid.size and len(outside) < 0.7 * len(grid.points)
    normal = [Shape(shape.info, normalise_shape(shape.u)) for _, shape in whole]  # with the motion inside
    assert shape_data(kept, found, (0, 3, 4)) == shape_data(grid, normal, (0, 3, 4))
    write_shape(lattice(5), np.ones((len(lattice(5).points), 3)), tmp_path / "other.vtu")
    assert "on another mesh" in read_shapes(tmp_path)[2][0]


def test_a_file_whose_cells_have_no_surface_is_left_out(tmp_path: Path) -> None:
    grid = lattice(2)
    twice = replace(grid, cells=np.vstack([grid.cells] * 2), body=np.tile(grid.body, 2))
    write_shape(twice, np.ones((len(grid.points), 3)), tmp_path / "a.vtu")
    assert read_shapes(tmp_path) == (
        None, [], ["shapes/a.vtu cannot be read (its cells have no surface); this shape is left out."]
    )  # fmt: skip


def test_shapes_without_room_are_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fe_squeal.report.page.surface.BUDGET", 5_000)
    grid = lattice(2)
    shapes = [Shape({"branch": float(b)}, np.ones((len(grid.points), 3), complex)) for b in range(9)]
    data, said = shape_data(grid, shapes, (0, 0, 1))
    kept = len(data["shapes"])
    assert 0 < kept < 9 and data["left_out"] == list(range(kept, 9))
    assert said == [f"The page has the first {kept} of 9 shapes; the others are in shapes/."]


def changed(out: Path, tmp_path: Path, change) -> tuple[str, list[str]]:
    folder = tmp_path / "changed"
    shutil.copytree(out, folder)
    change(folder)
    assert main(["report", str(folder), "-o", str(tmp_path / "page.html")]) == 0
    return (tmp_path / "page.html").read_text(encoding="utf-8"), list(results_of(folder).lacks)


def edit_record(folder: Path, **entries) -> None:
    record = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps(record | entries))


def older(folder: Path) -> None:
    modes = pd.read_csv(folder / "modes.csv")
    modes.iloc[:, :14].to_csv(folder / "modes.csv", index=False)
    (folder / "sensitivities.csv").unlink()
    record = json.loads((folder / "run.json").read_text())
    kept = ("version", "title", "scene", "unknowns", "problem_class", "effects", "method", "seconds", "completeness")
    (folder / "run.json").write_text(json.dumps({k: record[k] for k in kept}))


CHANGES = {
    "older": (older, ["no nodal diameters", "sensitivities.csv is missing"]),
    "interrupted": (lambda f: edit_record(f, status="interrupted"), ["The run was interrupted"]),
    "killed": (lambda f: edit_record(f, status="running"), ["still going on, or was killed"]),
    "no record": (lambda f: (f / "run.json").unlink(), ["run.json: it is missing"]),
    "damaged record": (lambda f: (f / "run.json").write_text("{"), ["run.json: it cannot be read"]),
    "damaged table": (lambda f: (f / "onsets.csv").write_bytes(b"\x00\xff"), ["onsets.csv"]),
    "damaged shape": (lambda f: next(f.glob("shapes/*.vtu")).write_bytes(b"no"), ["cannot be read (it is no VTK"]),
    "no shapes": (lambda f: shutil.rmtree(f / "shapes"), ["No shapes were written"]),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CHANGES)
def test_what_could_not_be_shown_is_said(out: Path, tmp_path: Path, case: str) -> None:
    """The rest of the page is there all the same, and the sentence is on it."""
    change, expected = CHANGES[case]
    page, lacks = changed(out, tmp_path, change)
    for words in expected:
        assert any(words in sentence for sentence in lacks), lacks
        assert words in page
    assert 'id="chosen"' in page and "What it rests on" in page


@pytest.mark.parametrize("state", ["empty", "missing", "foreign"])
def test_a_folder_without_results_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], state: str) -> None:
    folder = tmp_path / "f"
    if state != "missing":
        folder.mkdir()
    if state == "foreign":
        (folder / "note.txt").write_text("mine")
    assert main(["report", str(folder)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and str(folder) in said and "expected" in said
    assert not folder.exists() or not (folder / "report.html").exists()


def test_somebody_elses_file_is_not_replaced(out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "mine.html"
    page.write_text("<html>")
    assert main(["report", str(out), "-o", str(page)]) == 2
    assert page.read_text() == "<html>" and "is no page that fe-squeal wrote" in capsys.readouterr().err
    fresh = tmp_path / "fresh.html"
    assert main(["report", str(out), "-o", str(fresh)]) == main(["report", str(out), "-o", str(fresh)]) == 0


def test_a_table_of_accuracy_makes_a_page(tmp_path: Path) -> None:
    frame = pd.DataFrame({
        "order": [1, 1, 2, 2], "size": [0.02, 0.01, 0.02, 0.01], "modes": 20, "method": "reduced", "tolerance": 1e-8,
        "unknowns": [100, 700, 800, 5000], "seconds": [0.5, 2.0, 2.5, 20.0], "peak_memory_mib": 100.0,
        "error_frequency": [0.2, 0.05, 0.01, 0.001], "error_growth": np.nan, "error_onset": [0.3, 0.1, 0.04, 0.01],
        "knob": ["size"] * 4,
    })  # fmt: skip
    frame.to_csv(tmp_path / "accuracy.csv", index=False)
    assert main(["report", str(tmp_path), "-o", str(tmp_path / "a.html")]) == 0
    plots = data_of(tmp_path / "a.html")["plots"]
    assert [p["id"] for p in plots] == ["error_frequency", "error_onset"]
    assert plots[0]["data"][1]["y"] == [0.01, 0.001]
    assert [line["name"] for line in plots[0]["data"]] == ["size, order 1", "size, order 2"]
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "The error of the growth rates is not known" in text and "2 % on frequencies: order 2, 20 mm" in text
