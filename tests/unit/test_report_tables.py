"""Terminal tables and the small files of a run."""

import io
import json
import os
import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from rich.console import Console
from test_report_figures import SWEEP, coupled_tables, no_onsets

from fe_squeal.errors import OutputError
from fe_squeal.report.files import replace_atomically, write_csv, write_json
from fe_squeal.report.page.sections import mac_table, mesh_error_section
from fe_squeal.report.table_files import read_table
from fe_squeal.report.tables import print_onsets, print_unstable, unstable_intervals
from fe_squeal.run.covered import Seen, above_text
from fe_squeal.run.page import read_run
from fe_squeal.sweep.noise import classify_noise


def printed(function, frame, width=80):
    console = Console(file=io.StringIO(), width=width)
    function(frame, console)
    return console.file.getvalue()


def test_noise_names_change_at_the_source_document_limits():
    assert [classify_noise(f) for f in (0.0, 1e-9, 99.9, 100.0, 999.9, 1000.0, 15000.0)] == [
        "divergence", "groan", "groan", "moan", "moan", "squeal", "squeal"]


def test_a_mode_whose_error_of_the_mesh_is_not_known_is_marked():
    """Beside one whose bar is wide its own, of the solver alone, would look sure."""
    modes, _ = coupled_tables([(2413.0, 60.0, 0.312), (700.0, 5.0, 0.2)], SWEEP, uncertainty=1e-6)
    assert "mesh: ?" not in printed(print_unstable, modes, 100)
    modes["re_discretisation"] = np.where(modes["frequency_hz"] > 1500, 30.0, np.nan)
    lines = printed(print_unstable, modes, 100).splitlines()
    found = [(" 2413 " in line, "mesh: ?" in line) for line in lines if "±" in line]
    assert found == [(True, False), (False, True)]


def test_a_row_for_each_unstable_interval():
    modes, _ = coupled_tables([(2413.0, 60.0, 0.312), (700.0, 5.0, 0.2)], SWEEP, uncertainty=0.25)
    modes.loc[(modes.branch == 1) & np.isclose(modes.value, 0.5), "stability"] = "marginal"
    rows = unstable_intervals(modes)
    assert [row.growth for row in rows] == sorted((row.growth for row in rows), reverse=True)
    spans = sorted((row.branch, row.first, row.last) for row in rows)
    np.testing.assert_allclose(spans, [(1, 0.32, 0.48), (1, 0.52, 0.7), (3, 0.22, 0.7)])
    top = rows[0]
    best = modes.loc[modes.re.idxmax()]
    assert (top.growth, top.peak_value, top.damping_ratio, top.mode) == (best.re, 0.7, best.damping_ratio, best["mode"])
    assert (top.uncertainty, top.noise) == (0.25, "squeal")


def test_unstable_table_of_a_sweep_fits_eighty_columns():
    modes, _ = coupled_tables([(2413.0, 60.0, 0.312), (13000.0, 60.0, 0.2)], SWEEP, uncertainty=0.3)
    text = printed(print_unstable, modes)
    lines = text.splitlines()
    assert max(map(len, lines)) <= 80 and lines[0].strip() == "2 unstable branches"
    [row] = [line.split() for line in lines if line.split()[:1] == ["1"]]
    assert row == ["1", "0.32", "…", "0.7", "2413", "…", "2414", "420.2", "±", "0.3", "0.7", "-2.77", "squeal"]


def test_unstable_table_at_one_value_has_a_row_per_mode():
    modes, _ = coupled_tables([(2413.0, 60.0, 0.312)], SWEEP[30:31], uncoupled=[100.0], uncertainty=0.3)
    text = printed(print_unstable, modes)
    assert "Unstable modes at μ = 0.6" in text
    # mode 1 is the uncoupled one; the growing and the decaying mode share the next frequency
    assert ["2", "2414", "362.1", "±", "0.3"] in [line.split()[:5] for line in text.splitlines()]


def test_long_tables_say_how_much_more_there_is():
    tables = coupled_tables([(800.0 + 500 * i, 30.0, 0.05 + 0.02 * i) for i in range(25)], SWEEP)
    assert printed(print_unstable, tables[0]).rstrip().endswith("... 5 more in modes.csv")
    assert printed(print_onsets, tables[1]).rstrip().endswith("... 5 more in onsets.csv")


def test_nothing_unstable_is_said():
    modes, _ = coupled_tables([(2413.0, 60.0, 0.9)], SWEEP)
    assert printed(print_unstable, modes) == "No unstable mode at μ = 0 … 0.7.\n"
    assert printed(print_unstable, modes.iloc[:0]) == "No unstable mode.\n"
    assert printed(print_onsets, no_onsets()) == "No onset of instability in this sweep.\n"


def test_onsets_come_in_the_order_of_the_parameter():
    _, onsets = coupled_tables([(2413.0, 60.0, 0.312), (5000.0, 60.0, 0.2)], SWEEP)
    onsets.loc[0, ["branch_b", "two_mode_value"]] = np.nan
    onsets.loc[1, "two_mode_value"] = 0.21347
    rows = [line.split() for line in printed(print_onsets, onsets).splitlines() if "flutter" in line]
    assert rows == [["0.2", "1.0e-09", "0.2135", "5000", "flutter", "into", "3", "+", "4"],
                    ["0.312", "1.0e-09", "2413", "flutter", "into", "1"]]


def test_where_growing_modes_part_is_no_onset_into_instability():
    _, onsets = coupled_tables([(2413.0, 60.0, 0.312), (5000.0, 60.0, 0.2)], SWEEP)
    text = printed(print_onsets, onsets.assign(law=["parting", "root"], kind="divergence"), 100)
    first, second = (line for line in text.splitlines() if "1.0e-09" in line)
    assert "parting grows on both sides" in " ".join(second.split())
    assert "divergence" not in second and "into" not in second and "divergence into" in " ".join(first.split())


def test_csv_keeps_every_bit(tmp_path):
    numbers = np.random.default_rng(0).standard_normal(100) * 10.0 ** np.arange(-50, 50)
    file = write_csv(pd.DataFrame({"re": numbers, "empty": np.nan}), tmp_path / "new" / "modes.csv")
    rows = [line.split(",") for line in file.read_text().splitlines()]
    assert rows[0] == ["re", "empty"]
    assert [float(row[0]) for row in rows[1:]] == numbers.tolist() and {row[1] for row in rows[1:]} == {""}
    assert os.listdir(tmp_path / "new") == ["modes.csv"]


def test_json_takes_numpy_and_dataclasses(tmp_path):
    @dataclass
    class Stage:
        name: str
        seconds: np.float64

    data = {"stage": Stage("μ", np.float64(0.5)), "list": np.array([1, 2]), "nan": [np.nan, np.inf], "lam": 1 - 2j,
            "path": Path("a\udcff"), "set": {"b", "a"}, 3: np.True_, "\udce9": "caf\udce9/é.toml"}
    file = write_json(data, tmp_path / "run.json")
    assert json.loads(file.read_text(encoding="utf-8")) == {
        "stage": {"name": "μ", "seconds": 0.5}, "list": [1, 2], "nan": [None, None], "lam": [1.0, -2.0],
        "path": r"a\udcff", "set": ["a", "b"], "3": True, r"\udce9": r"caf\udce9/é.toml"}
    with pytest.raises(TypeError, match="object"):
        write_json({"a": object()}, tmp_path / "other.json")
    assert not (tmp_path / "other.json").exists()


def test_an_interrupted_write_leaves_the_old_file(tmp_path):
    file = tmp_path / "a.txt"
    file.write_text("old")
    with pytest.raises(KeyboardInterrupt), replace_atomically(file) as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert file.read_text() == "old" and os.listdir(tmp_path) == ["a.txt"]


def test_unwritable_place_is_an_output_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"file.*a\.csv: cannot be written"):
        write_csv(pd.DataFrame({"a": [1]}), tmp_path / "file" / "a.csv")


@pytest.mark.parametrize("width", [20, 60, 80])
def test_no_name_and_no_number_of_a_table_is_cut(width):
    """Whatever the width of the terminal: every noise, kind, direction and digit stands in the output whole."""
    modes, onsets = coupled_tables([(2413.0, 60.0, 0.312), (700.0, 5.0, 0.2)], SWEEP, uncertainty=0.25)
    modes["noise"] = "divergence"
    onsets["kind"] = "divergence"
    text = printed(print_unstable, modes, width) + printed(print_onsets, onsets, width)
    assert "…" not in text.replace(" … ", "")
    rows = [line for line in text.splitlines() if "divergence" in line]
    assert len(rows) == 4 and sum("into" in row for row in rows) == 2
    for value in onsets["value"]:
        assert any(f"{value:.8g}" in row for row in rows)


@pytest.mark.parametrize(("width", "terminal", "dropped"), [
    (120, True, []), (80, True, ["noise", "moves most"]), (80, False, []),
])  # fmt: skip
def test_a_narrow_terminal_leaves_out_columns_that_it_names(width, terminal, dropped):
    """Descriptors make the table wider than 80 characters; a log or a pipe has them all."""
    modes, _ = coupled_tables([(2413.0, 60.0, 0.312)], SWEEP, uncertainty=0.25)
    modes = modes.assign(nodal_diameters=5, nodal_diameters_share=0.95, body="back_plates", body_share=0.83)
    console = Console(file=io.StringIO(), width=width, force_terminal=terminal, color_system=None)
    print_unstable(modes, console)
    text = console.file.getvalue()
    assert ("back_plates 83 %" in text, "squeal" in text) == ("moves most" not in dropped, "noise" not in dropped)
    assert ("for want of width: " + ", ".join(dropped) in text) == bool(dropped)
    if terminal:
        assert max(map(len, text.splitlines())) <= width


def test_onsets_are_shown_as_sure_as_they_are():
    """One digit more than the uncertainty allows; what lies above the range where all modes are known is called so."""
    frame = no_onsets()
    for value, uncertainty, hz in ((0.123456789, 2e-4, 900.0), (0.34567891234, 1e-12, 2100.0)):
        row = {"parameter": "mu", "value": value, "uncertainty": uncertainty, "frequency_hz": hz, "kind": "flutter"}
        frame.loc[len(frame)] = row | {"direction": "into instability", "branch_a": 1, "branch_b": 2}
    text = printed(partial(print_onsets, covered=(0.0, 2000.0)), frame)
    assert "Onsets below 2.00 kHz, and those found above" in text
    assert " 0.12346 " in text and "0.34567891" in text and "0.123456" not in text
    assert "found above" not in printed(partial(print_onsets, covered=(0.0, None)), frame)
    assert "Onsets above 1.00 kHz, and those found below" in printed(partial(print_onsets, covered=(1e3, None)), frame)
    both = "from 1.00 kHz to 2.00 kHz, and those found below and above"
    assert both in printed(partial(print_onsets, covered=(1e3, 2e3)), frame)
    assert "found above" not in printed(partial(print_onsets, covered=(0.0, 2200.0)), frame)


def test_no_onset_is_no_promise_where_intervals_are_open():
    text = printed(partial(print_onsets, is_open=True), no_onsets(), 200)
    but = "but where there may be one is not settled everywhere: see the warnings"
    assert text == f"No onset of instability in this sweep, {but}.\n"


@pytest.mark.parametrize(("hz", "limit"), [(7051.0, "7200"), (843.2, "860"), (7.43, "7.6"), (0.0712, "0.073")])
def test_the_limit_that_is_offered_is_a_little_above_the_mode(hz, limit):
    text = above_text(Seen(hz, 3.5, 0.4), "mu")
    assert text.endswith(f"solve.max_frequency = {limit}") and hz < float(limit) < 1.05 * hz


NAMES = ["3", "1e5", "007", "NA", "null", "True", "disc"]


@pytest.mark.parametrize("kind", ["numbers", "holes", "mixed"])
def test_names_come_back_as_they_were_written(tmp_path, kind):
    """Also where every name of a column looks like a number, or a hole; numbers, and yes or no, stay what they are."""
    names = {"numbers": NAMES[:3], "holes": [*NAMES[3:5], None], "mixed": NAMES}[kind]
    part = np.where(np.arange(len(names)) == 1, np.nan, np.inf)
    rows = pd.DataFrame({"body": names, "part": part, "re_exceeds": True})
    read = read_table(write_csv(rows, tmp_path / "a.csv"))
    assert [None if name != name else name for name in read["body"]] == names
    np.testing.assert_array_equal(read["part"], rows["part"])
    assert read["re_exceeds"].dtype == bool


def test_the_error_of_the_mesh_of_bodies_whose_names_are_numbers(tmp_path):
    parts = pd.DataFrame({"quantity": "onset 1", "kind": "onsets", "change": 0.1, "scale": 1.0, "body": ["3", "4"],
                          "direction": "radial", "place": "edge", "part": 0.05})  # fmt: skip
    write_csv(parts, tmp_path / "mesh_error.csv")
    assert "comes from 3, radial: 50 %" in mesh_error_section(read_run(tmp_path))


def test_a_shape_without_a_mac_takes_no_other_with_it(tmp_path):
    """As where all displacements of a measured shape are zero."""
    rows = pd.DataFrame({"measured": ["rim", "rim", "zero", "zero"], "value": 0.7, "branch": [1, 2, 1, 2],
                         "frequency_hz": 900.0, "mac": [0.2, 0.9, np.nan, np.nan]})  # fmt: skip
    write_csv(rows, tmp_path / "mac.csv")
    shown = re.findall(r'<th scope="row">(.*?)</th>.*?>([^<]*)</td></tr>', mac_table(read_run(tmp_path)))
    assert shown == [("rim", "0.90"), ("rim", "0.20"), ("zero", "–")]


@pytest.mark.parametrize(("table", "column"), [("contributions", "re_share"), ("sensitivities", "dre")])
def test_a_number_that_no_mode_has_leaves_the_table_there(tmp_path, table, column):
    rows = {"value": 0.7, "mode": [1, 1], "term": ["a", "b"], "number": ["a", "b"], "at": 1.0}
    write_csv(pd.DataFrame({**rows, column: [1.0, np.nan]}), tmp_path / f"{table}.csv")
    assert len(getattr(read_run(tmp_path), table)) == 2


def test_one_value_says_nothing_of_onsets():
    assert printed(partial(print_onsets, values=1), no_onsets()) == ""
