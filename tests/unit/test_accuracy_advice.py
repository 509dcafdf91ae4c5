"""What is read off the table of a study: rates, Pareto front and advice, on tables with known rates."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from fe_squeal.accuracy.settings import Setting
from fe_squeal.report.accuracy import accuracy_page, plot_accuracy
from fe_squeal.report.advice import QUANTITIES, advice, charted, fitted, lines_of, pareto
from fe_squeal.report.page.accuracy import write_accuracy_page


def table(rates=(2.0, 4.0), work=(1.0, 2.0)):
    """Errors that follow powers of the size exactly, and times of half a second and what grows with the elements."""
    rows = []
    for order, rate, at_once in zip((1, 2), rates, work, strict=True):
        for size in (0.02, 0.014, 0.01, 0.007):
            error = (0.5 if order == 1 else 0.1) * (size / 0.02) ** rate
            seconds = 0.5 + at_once * (size / 0.02) ** -3.5
            rows.append((order, size, "size", seconds, error, error, error))
    columns = ["order", "size", "knob", "seconds", "error_frequency", "error_growth", "error_onset"]
    alone = {f"algebraic_{what}": np.nan for what in ("frequency", "growth", "onset")}
    return pd.DataFrame(rows, columns=columns).assign(**alone)


def test_fits_find_the_powers():
    for order, rate in ((1, 2.0), (2, 4.0)):
        assert fitted(table(), order, "error_onset") == pytest.approx(rate)


@pytest.mark.slow
def test_a_title_is_no_formula(tmp_path):
    """Two dollars in the title of a scene, of which Matplotlib would make one that it cannot draw."""
    rows, own = table().assign(modes=20, tolerance=1e-8), dict.fromkeys(QUANTITIES, 0.01)
    plot_accuracy(rows, own, tmp_path / "accuracy.png", r"pad of 3 $\frac for 4 $")
    assert (tmp_path / "accuracy.png").stat().st_size > 1000


def test_advice_says_what_the_table_shows():
    """Of order 2, with 0.1 (h/20 mm)^4, 14 mm has 2.4 %, 10 mm 0.63 %; of order 1, with 0.5 (h/20 mm)², 7 mm 6.1 %."""
    [five, two, one] = advice(table(), "error_onset")
    assert five.startswith("5 % on critical values: order 2, 14 mm, 7.5 s (2.4 %); order 1 does not have it")
    for text, target in ((two, 2), (one, 1)):
        assert text.startswith(f"{target} % on critical values: order 2, 10 mm, 23 s (0.62 %); order 1 does not")
    both = advice(table((4.0, 4.0)), "error_onset")[0]
    assert "order 2, 14 mm, 7.5 s (2.4 %); order 1, 10 mm, 12 s (3.1 %) has it as well." in both
    none = advice(table((0.1, 0.1)), "error_onset")[2]
    assert none.startswith("1 % on critical values: no mesh that was measured has it; nearest is order 2, 7 mm")
    assert not any("extrapolated" in text for text in (five, two, one, both, none))


def test_what_the_refined_mesh_does_not_have_is_told_and_no_mesh_advised_for_it(tmp_path):
    columns = dict(modes=8, method="direct", tolerance=1e-8, unknowns=100, peak_memory_mib=200.0)
    columns |= {f"algebraic_{what}": np.nan for what in ("frequency", "growth", "onset")}
    columns |= dict(lost_frequency=2, lost_growth=0, lost_onset=1)
    frame = table().assign(**columns, error_onset=np.nan)
    gone = "1 of them vanishes or appears when the finest mesh is refined"
    assert advice(frame, "error_onset") == [f"Critical values: not known: {gone}."]
    assert len(advice(frame, "error_growth")) == 3
    *_, last = advice(frame, "error_frequency")
    assert last.startswith("Frequencies: 2 of them vanish when the finest mesh is refined, so that what does has")
    own = {"error_frequency": np.nan, "error_growth": 0.02, "error_onset": np.nan}
    text = accuracy_page(frame, own, "order 2, 7 mm", False, (), "")
    assert "uncertain by growth rates 2 %; frequencies: not known: 2 of them vanish when" in text
    assert f"; critical values: not known: {gone}." in text
    frame.to_csv(tmp_path / "accuracy.csv", index=False)
    write_accuracy_page(tmp_path / "accuracy.csv", tmp_path / "page.html")
    assert f"Critical values: not known: {gone}." in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_sizes_in_other_units_have_none(tmp_path):
    """A model in mm whose scene says so by units = "any" alone: 14 is no 14 m."""
    sizes = table().assign(size=lambda t: 1e3 * t["size"], units="any")
    assert "order 2, 14, 7.5 s (2.4 %)" in advice(sizes, "error_onset")[0]
    columns = dict(modes=8, method="direct", tolerance=1e-8, unknowns=100, peak_memory_mib=200.0)
    algebraic = {f"algebraic_{what}": np.nan for what in ("frequency", "growth", "onset")}
    for frame, head, size in ((sizes, "size", "14"), (table(), "size, mm", "14")):
        whole = frame.assign(**columns, **algebraic)
        text = accuracy_page(whole, dict.fromkeys(QUANTITIES, 0.1), "", False, (), "")
        assert f"| order | {head} | modes |" in text and f"| 2 | {size} | 8 | direct" in text
        whole.to_csv(tmp_path / "accuracy.csv", index=False)
        write_accuracy_page(tmp_path / "accuracy.csv", tmp_path / "report.html")
        page = (tmp_path / "report.html").read_text("utf-8")
        assert f">{head}<" in page and ("14 mm" in page) == (head == "size, mm")
    assert str(Setting(2, 14.0, 8, "direct", 1e-8, units="any")).startswith("order 2, size 14, 8 modes")
    assert str(Setting(2, 0.014, 8, "direct", 1e-8)).startswith("order 2, size 0.014 m, 8 modes")


def test_advice_names_the_order_that_its_table_has():
    """Order 1 falls faster by a fit, and is not there; order 2 is there with 1.1 %: that is what is advised for 2 %."""
    rows = [(1, 0.02, "size", 1.0, 0.5), (1, 0.01, "size", 4.0, 0.06),
            (2, 0.02, "size", 6.0, 0.011)]
    frame = pd.DataFrame(rows, columns=["order", "size", "knob", "seconds", "error_growth"])
    assert advice(frame, "error_growth")[1].startswith("2 % on growth rates: order 2, 20 mm, 6 s (1.1 %); order 1")


def test_adapted_meshes_stand_beside_uniform_ones():
    """The fastest of order 2 is named, adapted or not; rates are those of uniform meshes alone."""
    frame = table()
    adapted = pd.DataFrame([(2, 0.012, "adapted", 3.0, *[0.004] * 3)], columns=frame.columns[:7])
    both = pd.concat([frame, adapted])
    assert advice(both, "error_onset")[2].startswith("1 % on critical values: order 2, 12 mm adapted, 3 s (0.4 %)")
    assert fitted(both, 2, "error_onset") == pytest.approx(4.0)
    assert [line.knob for line, _ in lines_of(both)] == ["size", "size", "adapted"]


def test_pareto_front():
    frame = pd.DataFrame({"seconds": [1.0, 2.0, 3.0, 2.5], "error_onset": [0.1, 0.05, 0.06, np.nan]})
    assert pareto(frame.assign(algebraic_onset=np.nan), "error_onset").tolist() == [True, True, False, False]


def test_a_row_that_is_good_by_accident_is_not_on_the_pareto_front():
    """The error of its projection, 0.2, cancels that of the mesh but for 0.001: on another mesh it may not."""
    frame = pd.DataFrame({"seconds": [1.0, 2.0, 1.5], "error_growth": [0.1, 0.05, 0.001]})
    frame["algebraic_growth"] = [np.nan, 1e-9, 0.2]
    assert charted(frame, "error_growth").tolist() == [0.1, 0.05, 0.2]
    assert pareto(frame, "error_growth").tolist() == [True, True, False]
