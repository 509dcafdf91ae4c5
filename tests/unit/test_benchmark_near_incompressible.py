"""The smallest rung of benchmarks/near_incompressible.py: it runs, and its tables say what its page says."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from pictures import of_colour

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import near_incompressible as benchmark

RATIOS = (0.49, 0.4999)  # the same modes


@pytest.fixture(scope="module")
def rows():
    smooth = {s: "xyz"[axis] for s, (axis, _) in benchmark.SIDES.items()}
    counts = {1: (4, 4, 4), 2: (3, 3, 3)}
    return benchmark.measure(benchmark.WALLS, counts, smooth, benchmark.between_walls, RATIOS)


@pytest.mark.slow
def test_errors(rows):
    """Eight kinds; standard elements get worse, linear hexahedra many times, mixed ones hardly at all."""
    assert len(rows) == 8
    for row in rows:
        low, high = row.errors
        if row.formulation == "mixed":
            assert high < 1.15 * low and high < (0.3 if row.order == 1 else 0.08)
        else:
            assert high > (5 if (row.kind, row.order) == ("hexahedra", 1) else 1.25) * low
        assert row.unknowns > 0 and row.entries > row.unknowns
    same = [r.unknowns for r in rows if (r.kind, r.order) == ("hexahedra", 2)]
    assert same[0] == same[1]


@pytest.mark.slow
def test_table_chart_and_page(rows, tmp_path):
    lines = benchmark.table(rows, RATIOS).splitlines()
    assert len(lines) == 2 + 8 and {line.count("|") for line in lines} == {8}
    assert lines[2].startswith("| hexahedra | 1 | standard | ") and lines[2].rstrip(" |").rpartition(" × ")[1]
    benchmark.chart({"walls": rows}, RATIOS, tmp_path / "chart.png")
    # Errors fall along the vertical axis: the lines of linear elements lie above those of quadratic ones.
    heights = {}
    for colour in ("#e08a1e", "#b3341f", "#5aa4d6", "#1f4e8c"):
        drawn = of_colour(tmp_path / "chart.png", colour)[: int(0.8 * 550)]  # without the legend
        assert np.count_nonzero(drawn) > 100, colour
        heights[colour] = np.flatnonzero(drawn.any(axis=1)).max()
    assert heights["#e08a1e"] < heights["#b3341f"] and heights["#5aa4d6"] < heights["#1f4e8c"]
    text = benchmark.page(rows, rows, RATIOS, {1: (4, 4, 4), 2: (2, 2, 2)}, 1e-3)
    assert 'formulation = "mixed"' in text and text.count("| tetrahedra | 2 | mixed |") == 2


@pytest.mark.slow
def test_reference_is_extrapolated():
    """The frequencies of a clamped lining fall from mesh to mesh, and the reference is near them."""
    found, moved = benchmark.clamped_reference(0.3, finest=16)
    assert found.shape == (benchmark.MODES,) and 0 < moved < 0.02
    assert np.all(np.diff(found) > 0)
