"""The smallest rung of benchmarks/sweep_cost.py: it runs, and the reduced sweep is as accurate as its table says."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pictures import longest_bar

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import performance
import sweep_cost

SMALL = replace(next(m for m in sweep_cost.MODELS if m.name == "weak"), modes=8, stop=0.6)


@pytest.fixture(scope="module")
def own():
    return sweep_cost.measure("reduced", SMALL, 0.03, 5)


@pytest.mark.slow
def test_reduced_sweep_is_accurate(own):
    assert own["error"] <= 1e-8 and own["growth_error"] <= 1e-5
    assert own["basis"].startswith("reduced model of") and own["unknowns"] > 1000


@pytest.mark.slow
def test_other_ways_run_on_the_same_problem(own):
    for way in ("direct", "scipy"):
        other = sweep_cost.measure(way, SMALL, 0.03, 1)
        assert other["unknowns"] == own["unknowns"] and other["seconds"] > 0


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.4, 3.0])
def test_table_and_chart(monkeypatch, tmp_path, own, seconds):
    def run(way, *_):
        return own if way == "reduced" else {"model": "weak", "unknowns": own["unknowns"], "seconds": 1.0, "MiB": 100.0}

    own = own | {"seconds": seconds}
    monkeypatch.setattr(sweep_cost, "run", run)
    rows = sweep_cost.compare([SMALL], [0], [5, 9], ["direct", "reduced"])
    lines = sweep_cost.table(rows).splitlines()
    assert len(lines) == 2 + 2 * 2
    assert {len(line.strip("|").split("|")) for line in lines} == {9}
    assert f"| weak | {own['unknowns']} | 9 | direct, PARDISO | 9.0 |" in lines[4]
    sweep_cost.draw(rows, tmp_path / "chart.png")
    ways = {"#1b6ca8": own["seconds"], "#b5b5b5": 9.0}  # the longest bar of each, on a logarithmic axis
    lengths = {colour: longest_bar(tmp_path / "chart.png", colour) for colour in ways}
    start = 0.5 * min(1.0, own["seconds"])
    found, expected = lengths["#1b6ca8"] / lengths["#b5b5b5"], np.log(own["seconds"] / start) / np.log(9.0 / start)
    assert lengths["#b5b5b5"] > 50 and found == pytest.approx(expected, abs=0.05)


def test_rows_of_other_meshes_stay_on_the_page():
    head = "| unknowns | elements | s |\n|---|---|---|\n"
    page = f"# Page\n\n{head}| 30 | hex | 1.0 |\n| 200 | hex | 2.0 |\n| 7 | tet | 3.0 |\n\nMore text.\n"
    found = performance.merged(f"{head}| 200 | hex | 9.0 |\n| 100 | tet | 8.0 |\n| 4 | hex | 7.0 |", page)
    rows = [line.replace(" ", "").strip("|") for line in found.splitlines()[2:]]
    assert rows == ["4|hex|7.0", "30|hex|1.0", "200|hex|9.0", "7|tet|3.0", "100|tet|8.0"]
    assert performance.merged(found, "# Another page\n") == found


@pytest.mark.slow
def test_how_a_sweep_grows():
    assert performance.size_of("0.014") == (0.014, "hex")
    row = performance.measure("tet 0.03", 8, 5)
    assert row["unknowns"] > 1000 and row["proven"] and not row["warnings"]
    assert row["predicted"] > row["factors"] > 0
    lines = performance.table([row]).splitlines()
    assert len({line.count("|") for line in lines}) == 1 and str(row["unknowns"]) in lines[-1]
    assert 0 < sum(row["within"].values()) < row["stages"]["reduction"]
    lines = performance.inside([row]).splitlines()
    unknowns, element, *cells = (cell.strip() for cell in lines[-1].strip("|").split("|"))
    assert (int(unknowns), element) == (row["unknowns"], "tet")
    assert len({line.count("|") for line in lines}) == 1
    assert sum(map(float, cells[len(performance.PARTS) :])) == pytest.approx(row["predicted"], abs=3)
