"""The benchmark of the mesh's bars: its parts, and one of its scenes."""

from __future__ import annotations

import mesh_bars as page
import numpy as np
import pytest


def test_constants_are_fitted_on_other_scenes_than_those_measured():
    assert not {(c.size, c.counts, c.kind) for c in page.FITTED} & {(c.size, c.counts, c.kind) for c in page.MEASURED}
    assert len(page.MEASURED) >= 6
    assert {(c.kind, c.order) for c in page.MEASURED} == {(k, o) for k in ("hex", "tet") for o in (1, 2)}
    assert sum("rayleigh" in c.effects for c in page.MEASURED) >= 2
    assert any("preload" in c.effects for c in page.MEASURED)
    assert len({c.parameter for c in page.MEASURED}) >= 3


def test_a_bar_holds_where_both_parts_do():
    rows = page.Pairs(
        np.array([1 + 1j, 3 + 1j, 1 + 5j, 0.5 - 2j]), np.array([2 + 2j] * 4), np.zeros(4), np.array([True] * 4),
        np.array([0, 0, 3j, 0.1]), np.array([0.2 + 1j] * 4), 0,
    )  # fmt: skip
    assert np.logical_and(*page.held(rows, likely=True)).tolist() == [True, True, False, True]
    re, im = page.held(rows)
    assert re.tolist() == [True, False, True, True] and im.tolist() == [True, True, False, True]
    assert "| 4 | 50.0 % |" in page._row("name", rows)


def test_the_section_is_replaced_and_nothing_else():
    text = "# Page\n\nwords\n\n## Do the bars hold?\n\nold\n\n## After\n\nrest\n"
    once = page.with_section(text, page.page(["| row |"]))
    assert "\nold\n" not in once and "| row |" in once and once.endswith("## After\n\nrest\n")
    assert page.with_section(once, page.page(["| row |"])).count("## Do the bars hold?") == 1
    assert page.with_section("# Page\n", page.page(["| row |"])).startswith("# Page\n\n## Do the bars")


@pytest.mark.slow
def test_bars_of_a_scene_hold():
    """A block that flutters, of linear hexahedra, against meshes two levels finer: nine of ten bars hold both parts."""
    pairs = page.measured(page.MEASURED[0])
    re, im = page.held(pairs)
    assert len(re) >= 30 and pairs.growing.sum() >= 4
    assert (re & im).mean() >= 0.9 and (re & im)[pairs.growing].mean() >= 0.9
