"""Designs side by side: modes paired by shape across meshes, what changed beyond its bars, what is gone and new."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import skfem

from fe_squeal.cli import main
from fe_squeal.report.difference_figure import plot_differences
from fe_squeal.report.differences import GONE, LATER, NEW, PAIRED, UNKNOWN, compare_designs, sentences
from fe_squeal.report.export import exporting_shapes
from fe_squeal.report.files import write_csv, write_json
from fe_squeal.report.page.difference import read_and_write_page
from fe_squeal.report.pairing import common_points, mac_matrix, pair_shapes
from fe_squeal.report.results import Results, Shape
from fe_squeal.report.shapes import ShapeGrid, shape_grid
from fe_squeal.report.tables import begins_unstable
from fe_squeal.run.difference import _names
from meshes import annulus


def ring(kind: str, counts: tuple[int, int, int], body: str = "disc") -> ShapeGrid:
    """A disc of 0.1 to 0.2 m."""
    mesh = annulus(kind, counts, 0.1, 0.2, 0.01)
    element = {"hex1": skfem.ElementHex1, "hex2": skfem.ElementHex2, "tet2": skfem.ElementTetP2}[kind]()
    return shape_grid(skfem.CellBasis(mesh, element, intorder=2), np.zeros(mesh.nelements, int), (body,))


def waves(grid: ShapeGrid, n: int, sign: int = 1, turn: float = 0.0) -> np.ndarray:
    """A wave of n diameters, e^{i sign nθ}, that grows with the radius; as it is on any mesh of the disc."""
    x, y, _ = grid.points.T
    u = np.zeros((len(x), 3), complex)
    u[:, 2] = (np.hypot(x, y) - 0.1) * np.exp(1j * sign * n * (np.arctan2(y, x) - turn))
    return u


def test_shapes_on_other_meshes_are_as_alike_as_their_functions() -> None:
    """Waves of other numbers of diameters, and the same one the other way around, are orthogonal on the whole disc."""
    a, b = ring("hex2", (2, 36, 1)), ring("tet2", (3, 40, 2))
    points, alone = common_points(a, b)
    assert alone == [] and points.distance.max() < 2e-3  # two chords of the rim
    shapes = [(3, 1), (3, -1), (5, 1), (5, -1)]
    values = mac_matrix([waves(a, *s) for s in shapes], [waves(b, *s) * (2 - 1j) for s in shapes], points)
    np.testing.assert_allclose(values, np.eye(4), atol=0.02)
    half = waves(b, 3, 1) + waves(b, 5, 1)
    assert mac_matrix([waves(a, 3, 1)], [half], points)[0, 0] == pytest.approx(0.5, abs=0.02)


def test_pairs_are_those_of_largest_sum_and_none_below_the_limit() -> None:
    values = np.array([[0.95, 0.90, 0.1], [0.92, 0.1, 0.2], [0.3, 0.2, 0.59]])
    assert pair_shapes(values) == [(0, 1, 0.90), (1, 0, 0.92)]
    assert pair_shapes(np.zeros((2, 0))) == [] and pair_shapes(np.full((1, 1), np.nan)) == []


def design(
    grid: ShapeGrid | None, modes: dict[int, tuple[int, float, float, float]], bar: float = 0.0, mesh: float = np.nan
) -> Results:
    """Results with unstable branches {branch: (diameters, Hz, Re λ, onset)}, and a bar of each growth rate."""
    rows = [
        {"parameter": "mu", "value": 0.7, "mode": i, "branch": branch, "re": re, "im": 2 * np.pi * hz,
         "frequency_hz": hz, "damping_ratio": -re / (2 * np.pi * hz), "stability": "unstable", "re_uncertainty": bar,
         "re_discretisation": mesh, "im_discretisation": 2 * np.pi * 10 if np.isfinite(mesh) else np.nan}
        for i, (branch, (_, hz, re, _)) in enumerate(modes.items(), 1)
    ]  # fmt: skip
    onsets = [
        {"parameter": "mu", "value": at, "frequency_hz": hz, "kind": "flutter", "direction": "into", "branch_a": branch,
         "branch_b": branch + 100, "uncertainty": 1e-8, "discretisation": 0.01 if np.isfinite(mesh) else np.nan}
        for branch, (_, hz, _, at) in modes.items()
    ]  # fmt: skip
    columns = ["parameter", "value", "mode", "branch", "re", "im", "frequency_hz", "damping_ratio", "stability",
               "re_uncertainty", "re_discretisation", "im_discretisation"]  # fmt: skip
    onset_columns = ["parameter", "value", "frequency_hz", "direction", "branch_a", "branch_b", "uncertainty"]
    shapes = tuple(
        Shape({"branch": float(b), "re": re, "value": 0.7}, waves(grid, n, 1, 0.3 * b))
        for b, (n, _, re, _) in modes.items()
    ) if grid is not None else ()  # fmt: skip
    empty = pd.DataFrame()
    return Results({}, pd.DataFrame(rows, columns=columns),
                   pd.DataFrame(onsets) if onsets else pd.DataFrame(columns=onset_columns), empty, empty,
                   grid=grid, shapes=shapes)  # fmt: skip


BASE = {4: (3, 2700.0, 80.0, 0.11), 7: (5, 4630.0, 550.0, 0.24)}
SLOT = {2: (3, 2760.0, 81.0, 0.31), 9: (6, 5100.0, 200.0, 0.4)}


def test_a_slotted_disc_beside_the_plain_one() -> None:
    """The mode of three diameters stays under another number, that of five is gone, and one of six is new."""
    a, b = design(ring("hex2", (2, 36, 1)), BASE, 0.6, 1.0), design(ring("hex1", (3, 48, 1)), SLOT, 0.6, 1.0)
    table, said = compare_designs(a, b, ("plain", "slot"))
    assert said == []
    assert [(r.state, r.branch_a, r.branch_b) for r in table.itertuples()] == [
        (PAIRED, 4, 2), (GONE, 7, pd.NA), (NEW, pd.NA, 9)]  # fmt: skip
    pair = table.iloc[0]
    assert pair["mac"] > 0.98
    assert (pair["onset_change"], pair["onset_bar"]) == (pytest.approx(0.2), pytest.approx(0.02, abs=1e-6))
    assert pair["onset_exceeds"] and not pair["re_exceeds"]  # 1 1/s with bars of 1.6 each
    assert pair["re_bar"] == pytest.approx(3.2) and pair["frequency_exceeds"]
    assert pair["frequency_bar_hz"] == pytest.approx(20.0)
    assert sentences(table, ["slot"], "μ") == ["slot: onset μ 0.11 → 0.31 ± 0.02, 4.63 kHz gone, new at 5.10 kHz."]


def test_a_design_that_is_unstable_from_its_first_value_on_has_no_first_onset() -> None:
    """A sweep that begins behind the first onset is the same brake: no later onset is taken for the first one."""
    grid = ring("hex1", (2, 36, 1))
    whole, late = design(grid, BASE), design(grid, BASE)
    late = replace(late, onsets=late.onsets[late.onsets["branch_a"] != 4])
    assert begins_unstable(whole.modes, whole.onsets) == {}
    assert begins_unstable(late.modes, late.onsets) == {4: 0.7}
    table, said = compare_designs(whole, late, ("whole", "late"))
    assert table["onset_b"].isna().tolist() == [True, False] and not any("other ends" in s for s in said)
    told = "late is unstable from its first value on, μ = 0.7, so that the first onset is not known"
    assert sentences(table, ["late"], "μ", {"late": 0.7}) == [f"late: {told}."]


def test_growth_is_compared_at_values_that_both_sweeps_have() -> None:
    grid = ring("hex1", (2, 36, 1))
    short, long = design(grid, BASE), design(grid, BASE)
    further = long.modes.assign(value=1.0, re=2 * long.modes["re"])
    long = replace(long, modes=pd.concat([long.modes, further], ignore_index=True))
    table, said = compare_designs(short, long, ("short", "long"))
    assert (table["re_a"] == table["re_b"]).all() and (table["value_b"] == 0.7).all()
    assert any("other ends or values: growth is compared from 0.7 to 0.7" in s for s in said)
    beyond = replace(short, modes=short.modes.assign(value=0.9))
    table, said = compare_designs(short, beyond, ("short", "beyond"))
    assert any("they have no value in common, and growth is not compared" in s for s in said)
    assert table["re_exceeds"].to_list() == [None, None]


def test_what_only_one_sweep_could_see_is_neither_gone_nor_new() -> None:
    """The same brake swept further, or with more modes: nothing is new, and no onset is another one."""
    grid = ring("hex1", (2, 36, 1))
    few, many = design(grid, {4: BASE[4]}), design(grid, BASE)
    few = replace(few, record={"frequency_range_hz": [0.0, 4000.0]})
    table, said = compare_designs(few, many, ("few", "many"))
    assert table["state"].to_list() == [PAIRED]
    assert any("4.63 kHz of many may have its partner above the range" in s for s in said)
    later = many.modes["value"].where(many.modes["branch"] != 7, 0.9)
    onsets = many.onsets.assign(value=np.where(many.onsets["branch_a"] == 7, 0.8, many.onsets["value"]))
    further = replace(many, modes=many.modes.assign(value=later), onsets=onsets)
    for pair in ((few, further), (further, few)):
        table, said = compare_designs(*pair, ("a", "b"))
        assert table["state"].to_list() == [PAIRED]
        assert any("only where the other sweep has no values" in s for s in said)
        assert sentences(table, ["b"], "μ") == ["b: onset μ 0.11 → 0.11 ± 2e-08, within the bar."]


def test_what_lies_below_the_range_of_one_design_is_neither_gone_nor_new() -> None:
    """Strong dampers of b hide a mode of 5 Hz, which a has."""
    grid = ring("hex1", (2, 36, 1))
    slow = {**BASE, 7: (5, 5.0, 550.0, 0.24)}
    a, b = design(grid, slow), replace(design(grid, {4: BASE[4]}), record={"frequency_range_hz": [12.0, None]})
    for pair, owner in (((a, b), "a"), ((b, a), "b")):
        table, said = compare_designs(*pair, ("a", "b"))
        assert table["state"].to_list() == [PAIRED]
        assert f"The mode of 5 Hz of {owner} may have its partner below the range of both, 12 Hz." in said


def test_where_growing_modes_part_is_no_onset() -> None:
    """Growth is there on both sides of it."""
    grid = ring("hex1", (2, 36, 1))
    plain = design(grid, BASE)
    parts = plain.onsets.iloc[:1].assign(value=0.05, law="parting")
    other = replace(plain, onsets=pd.concat([plain.onsets.assign(law="root"), parts], ignore_index=True))
    table, _ = compare_designs(plain, other, ("a", "b"))
    assert table["onset_b"].to_list() == table["onset_a"].to_list() == [0.11, 0.24]
    early = replace(plain, onsets=plain.onsets.assign(law="parting", value=0.7))
    assert begins_unstable(early.modes, early.onsets) == {4: 0.7, 7: 0.7}


def test_without_bars_of_the_mesh_it_is_said() -> None:
    grid = ring("hex1", (2, 36, 1))
    table, said = compare_designs(design(grid, BASE), design(grid, BASE), ("a", "b"))
    assert len(said) == 2 and all("error of the mesh is not known" in s for s in said)
    assert table["state"].to_list() == [PAIRED, PAIRED] and table["frequency_exceeds"].to_list() == [None, None]
    assert not table["onset_exceeds"].any()
    assert sentences(table, ["b"], "μ") == ["b: onset μ 0.11 → 0.11 ± 2e-08, within the bar."]


def page_of(table: pd.DataFrame, folder: Path) -> str:
    """The page that is made from the table as it stands in its file."""
    write_csv(table, folder / "diff.csv")
    write_json({"title": "t", "symbol": "μ", "answers": [], "lacks": []}, folder / "diff.json")
    read_and_write_page(folder / "diff.csv", folder / "diff.json", folder / "page.html")
    return (folder / "page.html").read_text(encoding="utf-8").split('<section id="modes"')[1].split("</section>")[0]


@pytest.mark.parametrize("estimated", ["neither", "both", "first"])
def test_the_page_says_of_no_change_that_is_not_decided_what_its_bar_is(tmp_path: Path, estimated: str) -> None:
    """Frequencies have no bar without --estimate, of either design; undecided cells are holes in the table's file."""
    grid = ring("hex1", (2, 36, 1))
    meshes = {"neither": (np.nan, np.nan), "both": (1.0, 1.0), "first": (1.0, np.nan)}[estimated]
    a, b = design(grid, BASE, 0.6, meshes[0]), design(grid, BASE, 0.6, meshes[1])
    table, _ = compare_designs(a, b, ("a", "b"))
    assert [e is None for e in table["frequency_exceeds"]] == 2 * [estimated != "both"]
    page = page_of(table, tmp_path)
    assert "nan" not in page and page.count("is within its bar of") == (6 if estimated == "both" else 4)


def test_growth_at_other_values_has_no_verdict_on_the_page(tmp_path: Path) -> None:
    """The table holds a bar and no decision: the page has the numbers alone, and at which values they are."""
    grid = ring("hex1", (2, 36, 1))
    a = design(grid, BASE, 0.6, 1.0)
    b = replace(a, modes=a.modes.assign(value=0.4, re=300.0, frequency_hz=1.1 * a.modes["frequency_hz"]))
    table, _ = compare_designs(a, b, ("a", "b"))
    assert table["frequency_exceeds"].to_list() == table["re_exceeds"].to_list() == [None, None]
    page = page_of(table, tmp_path)
    assert page.count(" (at μ = 0.7 → 0.4)") == 6  # frequency, growth and damping of two modes
    assert page.count("its bar of") == 2  # of the onsets


def test_frequencies_are_compared_where_both_designs_have_the_same_value() -> None:
    """Both sweeps have 0.5 and 0.7; the same mode grows fastest at one of them in each design."""
    grid = ring("hex1", (2, 36, 1))
    few = design(grid, {4: BASE[4]}, 0.6, 1.0)
    early = few.modes.assign(value=0.5, frequency_hz=3000.0)
    a, b = (replace(few, modes=pd.concat([few.modes, early.assign(re=re)], ignore_index=True)) for re in (79.0, 81.0))
    table, _ = compare_designs(a, b, ("a", "b"))
    [row] = table.to_dict("records")
    assert (row["value_a"], row["value_b"], row["frequency_exceeds"], row["re_exceeds"]) == (0.7, 0.5, None, False)
    table, _ = compare_designs(a, a, ("a", "b"))
    assert table["frequency_exceeds"].to_list() == [False]


@pytest.mark.parametrize("of", ["first", "second", "both"])
@pytest.mark.parametrize("error", [np.inf, np.nan])
def test_an_onset_whose_error_is_not_known_has_no_bar(tmp_path: Path, of: str, error: float) -> None:
    """It vanishes on the refined mesh, or interpolated matrices lack it: the other design's error alone is no bar."""
    grid = ring("hex1", (2, 36, 1))
    a, b = design(grid, BASE, 0.6, 1.0), design(grid, BASE | {4: (3, 2700.0, 80.0, 0.19)}, 0.6, 1.0)
    lost = lambda r: replace(  # noqa: E731
        r, onsets=r.onsets.assign(discretisation=r.onsets["discretisation"].where(r.onsets["branch_a"] != 4, error))
    )
    a, b = lost(a) if of != "second" else a, lost(b) if of != "first" else b
    table, said = compare_designs(a, b, ("a", "b"))
    assert table["onset_exceeds"].to_list() == [None, False] and np.isinf(table["onset_bar"]).tolist() == [True, False]
    assert any("of one mode is not known: whether it changed is not decided" in s for s in said)
    assert sentences(table, ["b"], "μ") == ["b: onset μ 0.11 → 0.19, bar not known."]
    page = page_of(table, tmp_path)
    assert page_of(table.drop(columns=list(LATER)), tmp_path) == page  # of earlier versions
    assert page.count("its bar is not known") == 1 and "inf" not in page and "nan" not in page
    assert plot_differences(table, tmp_path / "diff.png", "μ").exists()


def test_growth_whose_error_of_the_mesh_is_not_known_is_not_said_to_change() -> None:
    """Of an estimated run one mode has none, refined it is another one: its error by the solver is not its bar."""
    grid = ring("hex1", (2, 36, 1))
    a, b = design(grid, BASE, 1e-6, 1.0), design(grid, BASE | {7: (5, 4630.0, 560.0, 0.24)}, 1e-6, 1.0)
    modes = b.modes.copy()
    modes.loc[modes["branch"] == 7, ["re_discretisation", "im_discretisation"]] = np.nan
    table, said = compare_designs(a, replace(b, modes=modes), ("a", "b"))
    assert table["re_exceeds"].to_list() == table["frequency_exceeds"].to_list() == [False, None]
    assert np.isinf(table["re_bar"]).tolist() == [False, True] and any("one mode is not known" in s for s in said)
    only_growth = table.assign(onset_a=np.nan, onset_b=np.nan)
    assert sentences(only_growth, ["b"], "μ") == ["b: no change beyond the bars that are known."]


def test_the_first_onsets_of_two_modes_have_their_own_bars() -> None:
    """Mode 4 begins first before, mode 7 after, and mode 4's bar after is not that of either."""
    grid = ring("hex1", (2, 36, 1))
    a, b = design(grid, BASE, 0.6, 1.0), design(grid, BASE | {4: (3, 2700.0, 80.0, 0.5)}, 0.6, 1.0)
    a = replace(a, onsets=a.onsets.assign(discretisation=[0.03, 0.5]))
    b = replace(b, onsets=b.onsets.assign(discretisation=[0.7, 0.02]))
    table, _ = compare_designs(a, b, ("a", "b"))
    assert sentences(table, ["b"], "μ") == ["b: onset μ 0.11 → 0.24 ± 0.05."]


def test_what_cannot_be_paired_is_said() -> None:
    grid, other = ring("hex1", (2, 36, 1)), ring("hex1", (2, 36, 1), "rotor")
    _, said = compare_designs(design(grid, BASE), design(None, BASE), ("a", "b"))
    assert any("b has no shapes on a mesh" in s for s in said)
    table, said = compare_designs(design(grid, BASE), design(other, BASE), ("a", "b"))
    assert any("no body of the same name" in s for s in said)
    assert table["state"].to_list() == 4 * [UNKNOWN]
    [words] = sentences(table, ["b"], "μ")
    assert "not known" in words and "gone" not in words and "new" not in words
    quiet, _ = compare_designs(design(grid, {}), design(grid, {}), ("a", "b"))
    assert sentences(quiet, ["b"], "μ") == ["b: nothing is unstable in either."]
    gone, _ = compare_designs(design(grid, BASE), design(grid, {}), ("a", "b"))
    assert sentences(gone, ["b"], "μ") == ["b: no onset any more (was μ = 0.11), 2.70 kHz gone, 4.63 kHz gone."]


def written(folder: Path, results: Results) -> Path:
    folder.mkdir()
    results.modes.to_csv(folder / "modes.csv", index=False)
    results.onsets.to_csv(folder / "onsets.csv", index=False)
    shapes = [(f"branch_{s.info['branch']:.0f}", s.u, s.info) for s in results.shapes]
    with exporting_shapes(results.grid, shapes, folder / "shapes", animate=False, pictures=False):
        pass
    return folder


@pytest.mark.slow
def test_the_command_writes_table_picture_and_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plain = written(tmp_path / "plain", design(ring("hex2", (2, 36, 1)), BASE, 0.6, 1.0))
    slot = written(tmp_path / "slot", design(ring("hex1", (3, 48, 1)), SLOT, 0.6, 1.0))
    out = tmp_path / "side_by_side"
    assert main(["diff", str(plain), str(slot), str(slot), "-o", str(out)]) == 0
    assert "slot (2): onset μ 0.11 → 0.31 ± 0.02, 4.63 kHz gone, new at 5.10 kHz." in capsys.readouterr().out
    table = pd.read_csv(out / "diff.csv")
    assert table["state"].to_list() == 2 * [PAIRED, GONE, NEW] and table["mac"].iloc[0] > 0.98
    assert (out / "diff.png").stat().st_size > 10_000
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "new at 5.10 kHz" in page and 'id="onset"' in page and "3.2" in page
    (out / "report.html").unlink()
    assert main(["report", str(out)]) == 0  # the page again, from the table and the record
    assert (out / "report.html").read_text(encoding="utf-8") == page
    assert main(["diff", str(plain), str(slot), "-o", str(out)]) == 0  # its own files are replaced
    (out / "diff.json").write_text("{")
    assert main(["report", str(out)]) == 0
    assert "diff.json: it cannot be read" in capsys.readouterr().out
    (out / "diff.csv").write_text("b\nslot\n")
    assert main(["report", str(out)]) == 2
    assert "expected the table that fe-squeal diff writes" in capsys.readouterr().err


@pytest.mark.parametrize("case", ["one", "empty", "itself", "parameter"])
def test_what_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], case: str) -> None:
    plain = written(tmp_path / "plain", design(ring("hex1", (2, 24, 1)), BASE))
    (tmp_path / "empty").mkdir()
    other = design(ring("hex1", (2, 24, 1)), BASE)
    other.modes["parameter"] = "contacts.outer.normal_stiffness"
    another = written(tmp_path / "another", other)
    folders, out, said = {
        "one": ([plain], tmp_path / "d", "expected two or more"),
        "empty": ([plain, tmp_path / "empty"], tmp_path / "d", "has no modes.csv"),
        "itself": ([plain, another], plain, "is one of the folders to compare"),
        "parameter": ([plain, another], tmp_path / "d", "expected the same parameter"),
    }[case]
    assert main(["diff", *map(str, folders), "-o", str(out)]) == 2
    found = capsys.readouterr().err
    assert said in found and found.count("\n") == 1 and not (tmp_path / "d").exists()


def test_names_of_folders_are_of_characters_that_can_be_drawn_and_written() -> None:
    """Bytes that are not UTF-8 come into Python as halves of pairs, which no file or figure takes."""
    folders = [Path("/runs/caf\udce9"), Path("/runs/a\nb"), Path("/runs/é")]
    assert _names(folders) == [r"caf\udce9", r"a\nb", "é"]
    assert _names([Path("/\udcff/a"), Path("/b/a")]) == [r"\udcff/a", "b/a"]


@pytest.mark.parametrize("first", ["quiet", "loud"])
def test_a_design_without_modes_sweeps_what_the_others_do(tmp_path, capsys, monkeypatch, first: str) -> None:
    """Its modes.csv is a head alone, which does not name the parameter."""
    monkeypatch.setattr("fe_squeal.report.difference_figure.plot_differences", lambda *_: None)
    monkeypatch.setattr("fe_squeal.run.difference.write_difference_report", lambda *_: None)
    grid, name = ring("hex1", (2, 24, 1)), "springs.piston.stiffness"
    loud, quiet = design(grid, BASE), design(grid, {})
    loud = replace(loud, modes=loud.modes.assign(parameter=name))
    written(tmp_path / "loud", loud)
    written(tmp_path / "quiet", quiet)
    folders = sorted((tmp_path / "loud", tmp_path / "quiet"), reverse=first == "quiet")
    assert main(["diff", *map(str, folders), "-o", str(tmp_path / "out")]) == 0
    said = {"quiet": "loud: an onset at stiffness = 0.11 where", "loud": "no onset any more (was stiffness = 0.11)"}
    assert said[first] in capsys.readouterr().out
