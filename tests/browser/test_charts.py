"""What the charts of a page draw, of tables made by hand: in a real browser, without a run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from opened import Opened
from playwright.sync_api import Browser

from fe_squeal.report.page.build import write_run_page
from fe_squeal.report.results import Results, Shape
from fe_squeal.report.shapes import HEXAHEDRON, ShapeGrid

pytestmark = pytest.mark.slow
VALUES = np.linspace(0.0, 0.5, 6)


def modes_of(re: dict[int, np.ndarray], hz: float = 1000.0, **columns: float) -> pd.DataFrame:
    """A row for each branch and value, with Re λ (6,) by branch; frequencies are 1, 2, ... times `hz`."""
    rows = [
        {"parameter": "mu", "value": v, "mode": i, "branch": b, "re": r,
         "im": 2 * np.pi * i * hz, "frequency_hz": i * hz,
         "damping_ratio": -r / (2 * np.pi * i * hz), "stability": "unstable" if r > 0 else "stable", "noise": "",
         "re_uncertainty": 1e-6, "re_discretisation": np.nan} | columns
        for i, (b, rates) in enumerate(re.items(), 1) for v, r in zip(VALUES, rates, strict=True)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def onsets_of(*rows: tuple[float, float, str, int, float]) -> pd.DataFrame:
    """Onsets (value, Hz, kind, branch, error of the mesh)."""
    columns = ["value", "frequency_hz", "kind", "branch_a", "discretisation"]
    return pd.DataFrame(rows, columns=columns).assign(
        parameter="mu", direction="into", crossing_speed=50.0, branch_b=np.nan, uncertainty=1e-9, two_mode_value=np.nan
    )


@pytest.fixture
def shown(browser: Browser, tmp_path: Path):
    """Open the page of some tables, and check at the end that nothing was complained about."""
    pages = []

    def show(
        modes: pd.DataFrame, onsets: pd.DataFrame, grid: ShapeGrid | None = None, shapes: tuple[Shape, ...] = (),
        **record: object,
    ):
        empty = pd.DataFrame()
        results = Results(record, modes, onsets, empty, empty, grid=grid, shapes=shapes)
        write_run_page(results, tmp_path / "page.html")
        pages.append(Opened(browser.new_page(viewport={"width": 1280, "height": 900}), tmp_path / "page.html"))
        return pages[-1].page

    yield show
    for opened in pages:
        assert opened.complaints == []
        opened.page.close()


def test_onsets_of_one_mesh_alone_have_markers_of_their_own(shown):
    """One of the refined mesh alone begins nothing here; one that vanishes there is crossed; labels say so."""
    grows = {1: 100 * (VALUES - 0.25), 2: 80 * (VALUES - 0.15)}
    onsets = onsets_of((0.05, 3000.0, "flutter", 0, np.inf), (0.15, 2000.0, "flutter", 2, np.inf),
                       (0.25, 1000.0, "flutter", 1, 0.01))  # fmt: skip
    page = shown(modes_of(grows), onsets)
    marks = page.evaluate("""Object.fromEntries(document.getElementById('stability').data
      .filter((d) => d.name && d.mode === 'markers').map((d) => [d.name, d.x]))""")
    assert marks == {"flutter begins": [0.15, 0.25], "on the refined mesh alone": [0.05],
                     "vanishes on the refined mesh": [0.15]}  # fmt: skip
    labels = page.evaluate("document.getElementById('stability').layout.annotations.map((a) => a.text)")
    assert sorted(labels) == [
        "μ = 0.05, 3.00 kHz, refined only", "μ = 0.15, 2.00 kHz, vanishes refined", "μ = 0.25, 1.00 kHz"]


def test_where_growing_modes_part_has_words_of_its_own(shown):
    """Growth is there on both sides: the mode is neither unstable from there on nor stable again."""
    onsets = onsets_of((0.25, 0.0, "divergence", 1, np.nan)).assign(law="parting", direction="out of")
    page = shown(modes_of({1: 100 * VALUES + 1}), onsets)
    names = page.evaluate("document.getElementById('stability').data.map((d) => d.name).filter(Boolean)")
    assert names == ["growing modes meet or part"]
    words = page.inner_text("#chosen")
    assert "At μ = 0.25, 0 Hz, two growing modes become one that swings; growth neither begins nor ends there." in words
    assert "stable again" not in words and "unstable from" not in words


LOCUS = """() => { const chart = document.getElementById('locus'), axis = chart._fullLayout.xaxis;
  const inside = chart.data.slice(0, -1).flatMap((d) => d.x).filter((x) => x >= axis.range[0] && x <= axis.range[1]);
  return { range: axis.range, inside: inside.length, notes: (chart.layout.annotations || []).map((a) => a.text) }; }"""


def test_the_root_locus_shows_a_brake_that_is_stable(shown):
    """Re λ from −50 to −500 1/s: all of them, and a part of the unstable half."""
    modes = modes_of({b: np.full(6, -50.0 * b) for b in (1, 3, 6, 10)})
    found = shown(modes, onsets_of()).evaluate(LOCUS)
    assert found["inside"] == len(modes) and found["notes"] == []
    assert found["range"][0] < -500 and 50 < found["range"][1] < 200


def test_the_root_locus_shows_what_decays_beside_slow_growth(shown):
    """Growth of 5 beside decay of 200 1/s: all are in the picture. One that decays 1e6 is not, and is counted."""
    rates = {b: np.full(6, -20.0 * b) for b in range(1, 11)} | {11: np.full(6, 5.0)}
    found = shown(modes_of(rates), onsets_of()).evaluate(LOCUS)
    assert found["inside"] == 66 and found["range"][0] < -200
    far = modes_of(rates)
    far.loc[0, "re"] = -1e6
    found = shown(far, onsets_of()).evaluate(LOCUS)
    assert found["inside"] == 65 and found["notes"] == ["1 eigenvalue lies further left, down to Re λ = −1e+06 1/s"]


def test_measured_lines_do_not_scale_the_axes(shown):
    """Scaled to what it holds, the root locus is that of the modes."""
    page = shown(modes_of({1: 10 * (VALUES - 0.2)}), onsets_of(), measured=[{"frequency_hz": 900.0, "label": "test"}])
    low, high = page.evaluate("""() => Plotly.relayout('locus', { 'xaxis.autorange': true })
      .then(() => document.getElementById('locus')._fullLayout.xaxis.range)""")
    assert -5 < low < -2 and 3 < high < 6
    assert page.locator("#locus .shapelayer path, #locus .shape-label text, #locus .shapelayer text").count() >= 2
    words = page.evaluate("document.getElementById('locus').layout.shapes[1].label.text")
    assert "measured: test, 900 Hz" in words


def test_growth_is_shown_with_its_errors(shown):
    """As bars of the dots, on hovering, in words and in both tables; one that is not known of the mesh is marked."""
    modes = modes_of({1: 100 * VALUES + 1, 2: 50 * VALUES + 1})
    modes["re_discretisation"] = np.where(modes["branch"] == 1, 14.0, np.nan)
    page = shown(modes, onsets_of())
    dots = page.evaluate("""document.getElementById('stability').data.filter((d) => d.error_y)
      .map((d) => [d.customdata[0], d.error_y.array, d.text[5]])""")
    assert [(branch, bars) for branch, bars, _ in dots] == [(1, 6 * [14.000001]), (2, 6 * [None])]
    assert "Re λ = 51 ± 14 1/s," in dots[0][2] and "Re λ = 26 ± 1e-06 1/s, mesh: ?," in dots[1][2]
    assert page.locator("#stability .errorbars path.yerror").count() >= 6
    assert page.evaluate("document.getElementById('stability')._fullLayout.yaxis2.range[1]") > 51 + 14
    assert "Re λ = 51 ± 14 1/s, damping" in page.inner_text("#chosen")
    page.select_option("#mode", "2")
    assert "Re λ = 26 ± 1e-06 1/s, mesh: ?, damping" in page.inner_text("#chosen")
    page.evaluate("for (const d of document.querySelectorAll('#charts details')) d.open = true")
    page.wait_for_selector("#all-values td")
    for table in ("#at-value", "#all-values"):
        text = page.inner_text(f"{table} table")
        assert "51 ± 14" in text and "26 ± 1e-06, mesh: ?" in text


def test_what_loss_factors_say_nothing_of_has_no_bar(shown):
    """Re λ decays faster than it swings, uncertain by |λ|: the growing values of the same branch have theirs."""
    modes = modes_of({1: np.array([-9e3, 5.0, 5.0, 5.0, 5.0, 5.0])}, re_uncertainty=0.5)
    modes.loc[0, "re_uncertainty"] = np.hypot(9e3, 2000 * np.pi)
    page = shown(modes, onsets_of())
    bars = page.evaluate("document.getElementById('stability').data.find((d) => d.error_y).error_y.array")
    assert bars == [None, 0.5, 0.5, 0.5, 0.5, 0.5]


def test_each_of_two_shapes_of_one_branch_is_shown(shown):
    """The second one stays when it is picked, and a click on the branch elsewhere shows it again."""
    points = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], float)
    grid = ShapeGrid(points, np.arange(8)[None], HEXAHEDRON, np.zeros(1, int), ("disc",))
    shapes = tuple(Shape({"branch": b, "mode": 1, "value": v, "re": 1.0, "frequency_hz": hz}, points + 0j)
                   for b, v, hz in ((1, 0.3, 1000.0), (1, 0.5, 1001.0), (2, 0.5, 2000.0)))  # fmt: skip
    page = shown(modes_of({1: 100 * VALUES, 2: 50 * VALUES}), onsets_of(), grid, shapes)
    for k, words in ((2, "Branch 2 at μ = 0.5: 2000 Hz"), (1, "Branch 1 at μ = 0.5: 1001 Hz"),
                     (0, "Branch 1 at μ = 0.3: 1000 Hz")):  # fmt: skip
        page.select_option("#shape-mode", str(k))
        assert page.input_value("#shape-mode") == str(k) and page.inner_text("#shape-text").startswith(words)
    page.evaluate("choose(2)")
    assert page.input_value("#shape-mode") == "2"


def test_large_and_small_values_have_as_many_digits_as_others(shown):
    """Values of 1.000e13, 1.002e13 and 1.004e13 are told apart."""
    page = shown(modes_of({1: 100 * VALUES}), onsets_of())
    found = page.evaluate(
        "[1e13, 1.002e13, 1.004e13, 1.23456e-7, -9.87654321e9, 0.125, 1234.5678, 0].map((x) => digits(x))")
    assert found == ["1e+13", "1.002e+13", "1.004e+13", "1.2346e-7", "-9.8765e+9", "0.125", "1234.6", "0"]


def test_a_range_that_begins_above_zero_is_drawn_with_both_ends(shown):
    page = shown(modes_of({1: 100 * VALUES}), onsets_of(), frequency_range_hz=[120.0, 1500.0])
    layout = page.evaluate("(({ shapes, annotations }) => [shapes.map((s) => s.y0), annotations.map((a) => a.text)])"
                           "(document.getElementById('stability').layout)")  # fmt: skip
    assert layout == [[120.0, 1500.0], ["all modes from 120 Hz to 1.50 kHz"]]
