"""Figures of a study: what labels stand beside, and what the legend names."""

from __future__ import annotations

import io
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from fe_squeal.report import map as map_figure
from fe_squeal.report import study
from fe_squeal.report.files import write_csv, write_json
from fe_squeal.report.map import plot_map
from fe_squeal.report.page.study import write_study_page
from fe_squeal.report.study import driving, plot_indices
from fe_squeal.run import mapped as mapping
from fe_squeal.run.page import write_study_report


@pytest.fixture
def drawn(monkeypatch):
    """Keep the figures that are saved."""
    kept = []
    for module in (map_figure, study):
        save = module.save_figure
        monkeypatch.setattr(
            module, "save_figure", lambda figure, path, save=save: (kept.append(figure), save(figure, path))[1]
        )
    return kept


def test_the_label_of_a_boundary_stands_where_no_other_one_is(tmp_path, drawn):
    """Two boundaries y = ½ ± (x − ½)³ that cross in their middles, where either label could be that of both."""
    side = np.linspace(0.0, 1.0, 5)
    x, y = (a.ravel() for a in np.meshgrid(side, side))
    t = np.linspace(0.0, 1.0, 41)
    curves = [pd.DataFrame({"curve": n, "x": t, "y": 0.5 + s * (t - 0.5) ** 3, "frequency_hz": 1e3 * n})
              for n, s in ((1, 1.0), (2, -1.0))]  # fmt: skip
    grid = pd.DataFrame({"x": x, "y": y, "worst_re": x, "unstable": 1})
    plot_map(grid, pd.concat(curves, ignore_index=True), ("a", "b"), (False, False), tmp_path / "map.png")
    labels = drawn[0].axes[0].texts
    assert {text.get_text() for text in labels} == {"1.00 kHz", "2.00 kHz"}
    for text in labels:
        (own_x, own_y), (_, other_y) = text.xy, (text.xy[0], 1.0 - text.xy[1])
        assert abs(own_y - other_y) > 0.05
        assert 0.05 < own_x < 0.95


@pytest.mark.parametrize(
    ("first", "total", "most"),
    [
        ([0.7, 0.2], [0.3, 0.8], "b"), ([0.7, 0.2], [np.nan, np.nan], "a"), ([np.nan, np.nan], [0.1, 0.9], "b"),
        ([0.7, 0.2], [np.nan, 0.0], "a"), ([np.nan] * 2, [np.nan, 0.0], None), ([np.nan] * 2, [np.nan] * 2, None),
    ],
)  # fmt: skip
def test_what_drives_most_is_known_where_the_indices_of_all_are(first, total, most):
    """One that changes no sample has the index 0, and where those of the others are not known it is no largest one."""
    indices = pd.DataFrame({"parameter": ["a", "b"], "output": "unstable", "first": first, "total": total})
    assert driving(indices, "unstable") == most and driving(indices, "worst_re") is None


@pytest.mark.parametrize("grows", [False, True])
def test_a_map_colours_what_is_unstable_and_marks_what_is_not_known(tmp_path, drawn, grows):
    """Re λ of stable places has rounding; where there are no modes, nothing is known to be stable."""
    grid = pd.DataFrame({"x": [0.0, 1.0, 0.0, 1.0], "y": [0.0, 0.0, 1.0, 1.0], "unstable": [0, 0, 0, int(grows)],
                         "worst_re": [1e-9, -3.0, np.nan, 2e-9]})  # fmt: skip
    none = pd.DataFrame(columns=["curve", "x", "y", "frequency_hz"])
    plot_map(grid, none, ("a", "b"), (False, False), tmp_path / "map.png")
    figure = drawn[0]
    mesh = figure.axes[0].collections[0]
    colours = mesh.to_rgba(mesh.get_array()).reshape(4, 4)
    white = mesh.cmap(0.0)
    assert [tuple(c) == white for c in colours] == [True, True, False, not grows]
    assert np.ptp(colours[2, :3]) == 0 and 0.7 < colours[2, 0] < 0.9
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["no modes"]


@pytest.mark.parametrize("total", [np.nan, 0.4])
def test_the_legend_names_what_is_there(tmp_path, drawn, total):
    """Correlated numbers have no total indices, which the legend then does not name."""
    rows = {"output": "unstable", "parameter": ["mu", "k"], "first": [0.3, 0.2], "first_error": 0.05}
    indices = pd.DataFrame({**rows, "total": total, "total_error": 0.05})
    plot_indices(indices, tmp_path / "indices.png")
    named = [text.get_text() for text in drawn[0].legends[0].get_texts()]
    assert named == (["alone"] if np.isnan(total) else ["alone", "with all others"])


BANDS = pd.DataFrame({
    "low_hz": [1000.0, 2000.0, 1000.0], "high_hz": [2000.0, 4000.0, 3200.0], "samples": 64,
    "probability": [0.25, 0.0, 0.25], "lower": [0.15, 0.0, 0.15], "upper": [0.37, 1.0, 0.37],
})  # fmt: skip


@pytest.mark.parametrize(("record", "label", "sentence"), [
    ({"known_hz": 3200.0}, "all, up to 3200 Hz", " up to 3200 Hz; above it not all modes were solved for."),
    ({"known_hz": None}, "all", "(95 % interval 15 to 37 %)."),
    ({}, "all, 1000 to 3200 Hz", " 1000 to 3200 Hz; above it not all modes may have been solved for."),
    ({"known_hz": "3"}, "all, 1000 to 3200 Hz", " 1000 to 3200 Hz; above it not all modes may have been solved for."),
])  # fmt: skip
def test_the_page_says_up_to_which_frequency_a_probability_holds(tmp_path, record, label, sentence):
    """Unless the modes are all there are; earlier versions did not tell."""
    write_json({"status": "complete", **record}, tmp_path / "study.json")
    write_csv(BANDS, tmp_path / "bands.csv")
    figures = dict.fromkeys(("probability", "scatter", "indices"), tmp_path / "none.png")
    write_study_page(tmp_path / "study.json", {"bands": tmp_path / "bands.csv"}, figures, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    answer = page.split('<section id="answer"')[1].split("</section>")[0]
    assert f'<th scope="row">{label}</th>' in answer
    assert "Unstable with a probability of 25 % (95 % interval 15 to 37 %)" in answer and f"{sentence}</p>" in answer


def test_the_page_leads_with_all_samples_that_are_found_unstable(tmp_path):
    """Also where they are unstable above the frequency up to which all modes of all samples are known."""
    record = {"known_hz": 3200.0, "probability": 0.75, "probability_interval": [0.626, 1.0], "samples": 64}
    write_json({"status": "complete", **record}, tmp_path / "study.json")
    write_csv(BANDS, tmp_path / "bands.csv")
    figures = dict.fromkeys(("probability", "scatter", "indices"), tmp_path / "none.png")
    write_study_page(tmp_path / "study.json", {"bands": tmp_path / "bands.csv"}, figures, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    answer = page.split('<section id="answer"')[1].split("</section>")[0]
    assert (
        '<p class="answer">Unstable with a probability of at least 75 % (95 % interval 62.6 to 100 %): 48 of 64 samples'
        " have an unstable mode among those solved for. The probability is 25 % (95 % interval 15 to 37 %), up to"
        " 3200 Hz, where all modes are known; above it not all modes were solved for.</p>"
    ) in answer
    assert '<th scope="row">all that is found</th>' in answer and "at least 75" in answer


def test_the_picture_has_a_bar_of_all_samples_that_are_found_unstable(tmp_path, drawn):
    study.plot_probability(BANDS, tmp_path / "probability.png", "", 3200.0, (0.75, 0.626, 1.0))
    axes = drawn[0].axes[0]
    assert [text.get_text() for text in axes.get_xticklabels()][2:] == ["all up\nto 3.2", "all that\nis found"]
    assert [bar.get_height() for bar in axes.patches] == [25.0, 0.0, 25.0, 75.0]
    assert [text.get_text() for text in axes.texts][2:] == ["25 %", "≥ 75 %"]


@pytest.mark.parametrize("status", ["complete", "running", "interrupted", "not converged"])
@pytest.mark.parametrize(("kind", "own", "other", "nothing"), [
    ("map", "map.csv", "bands.csv", "There are none."), ("scatter", "bands.csv", "map.csv", "No sample is unstable."),
])  # fmt: skip
def test_the_page_of_an_unfinished_study_says_nothing_of_what_it_did_not_solve(
    tmp_path, kind, own, other, nothing, status
):
    """study.json says of which kind it is, before there is any table."""
    write_json({"kind": kind, "status": status, "unknowns": 2, "problem_class": "real"}, tmp_path / "study.json")
    lacks = write_study_report(tmp_path, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    body = page.split("<main")[-1].split("</main>")[0]
    complete = status == "complete"
    assert (nothing in body) == complete and ("Method: " in body) == complete
    assert (f"The study is {status}." in lacks) != complete
    assert f"{own} is missing, so it is not shown." in lacks and not any(other in sentence for sentence in lacks)


@pytest.mark.parametrize(("known", "label"), [(3200.0, "all up\nto 3.2"), (np.inf, "all")])
def test_the_picture_says_up_to_which_frequency_a_probability_holds(tmp_path, drawn, known, label):
    study.plot_probability(BANDS, tmp_path / "probability.png", "", known)
    assert [text.get_text() for text in drawn[0].axes[0].get_xticklabels()] == ["1 – 2", "2 – 4", label]


@pytest.mark.parametrize("total", [np.nan, 0.4])
def test_the_page_says_why_an_index_is_missing(tmp_path, total):
    rows = {"output": "unstable", "parameter": ["mu", "k"], "first": [0.3, 0.2], "first_error": 0.05}
    write_csv(pd.DataFrame({**rows, "total": total, "total_error": 0.05}), tmp_path / "indices.csv")
    write_csv(BANDS, tmp_path / "bands.csv")
    write_json({"status": "complete", "samples": 64, "samples_without_modes": 1}, tmp_path / "study.json")
    tables = {name: tmp_path / f"{name}.csv" for name in ("bands", "indices")}
    figures = dict.fromkeys(("probability", "scatter", "indices"), tmp_path / "none.png")
    write_study_page(tmp_path / "study.json", tables, figures, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert ("fewer than some twenty samples make all of the variance" in page) == bool(np.isnan(total))
    assert "1 of 64 samples has no mode in the range" in page


def test_the_picture_has_outputs_of_which_total_indices_alone_are_known(tmp_path, drawn):
    rows = {"output": "unstable", "parameter": ["mu", "k"], "first": np.nan, "first_error": np.nan}
    plot_indices(pd.DataFrame({**rows, "total": 0.4, "total_error": 0.05}), tmp_path / "indices.png")
    assert [text.get_text() for text in drawn[0].legends[0].get_texts()] == ["with all others"]


def test_slow_boundaries_have_their_frequencies(tmp_path, drawn, monkeypatch):
    """From 0.16 to 0.48 Hz, on the terminal, the page and the map."""
    t = np.linspace(0.0, 1.0, 5)
    x, y = (a.ravel() for a in np.meshgrid(t, t))
    grid = pd.DataFrame({"x": x, "y": y, "worst_re": x, "unstable": 1, "error": 0.0})
    curve = pd.DataFrame({"curve": 1, "x": t, "y": t, "frequency_hz": 0.16 + 0.32 * t, "kind": "flutter",
                          "uncertainty": 1e-6})  # fmt: skip
    result = SimpleNamespace(grid=grid, boundaries=curve, solver=SimpleNamespace(why=""), told=[], curves=[])
    monkeypatch.setattr(mapping, "stability_map", lambda *_, **__: result)
    axis, console = SimpleNamespace(scale="linear"), Console(file=io.StringIO(), width=120)
    section = SimpleNamespace(x=axis, y=axis, names=("a", "b"), tolerance=1e-6)
    said = mapping.mapped(SimpleNamespace(title=""), section, None, {}, tmp_path, console)
    assert "boundary 1: flutter, 0.16 Hz to 0.48 Hz, 5 points" in console.file.getvalue()
    assert [text.get_text() for text in drawn[0].axes[0].texts] == ["0.32 Hz"]
    [lines] = [c for c in drawn[0].axes[0].collections if c.get_cmap().name == "viridis"]
    assert drawn[0].axes[2].get_ylabel() == "frequency on the boundary (Hz)"
    assert lines.get_clim() == pytest.approx((0.16, 0.48))
    np.testing.assert_allclose(lines.get_array(), [0.2, 0.28, 0.36, 0.44])
    write_json({"status": "complete", **said}, tmp_path / "study.json")
    tables, figures = {n: tmp_path / f"{n}.csv" for n in ("boundaries", "map")}, {"map": tmp_path / "none.png"}
    write_study_page(tmp_path / "study.json", tables, figures, tmp_path / "page.html")
    assert "0.16 Hz to 0.48 Hz" in (tmp_path / "page.html").read_text(encoding="utf-8")
