"""What a sweep shows of itself in Python and in notebooks."""

from __future__ import annotations

import itertools
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scene_texts import write_scene

import fe_squeal
from fe_squeal.commands.shared import make_console
from fe_squeal.report.damping import damping_figure
from fe_squeal.run import forecast


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> fe_squeal.Sweep:
    problem = fe_squeal.assemble(fe_squeal.load_scene(write_scene(tmp_path_factory.mktemp("shown"))))
    return fe_squeal.sweep(problem, [0.0, 0.4, 0.8], modes=8)


@pytest.mark.slow
def test_figures_draw_and_save_themselves(sweep: fe_squeal.Sweep, tmp_path: Path) -> None:
    figure = sweep.plot_stability(tmp_path / "stability.pdf")
    assert (tmp_path / "stability.pdf").read_bytes().startswith(b"%PDF")
    assert figure._repr_png_().startswith(b"\x89PNG")
    assert "growth rate" in figure.axes[1].get_ylabel()


def test_damping_ratios_are_those_of_the_table(sweep: fe_squeal.Sweep) -> None:
    """At the last value, and at the one nearest to a given one; unstable modes are those below zero."""
    modes = sweep.to_dataframe()
    for asked, at in ((None, 0.8), (0.3, 0.4)):
        axes = sweep.plot_damping(asked).axes[0]
        here = modes[modes["value"] == at]
        drawn = {line.get_label(): line.get_xydata() for line in axes.lines if len(line.get_xydata()) != 2}
        points = np.concatenate([d for label, d in drawn.items() if label in ("stable or marginal", "unstable")])
        scale = 1000.0 if here["frequency_hz"].max() >= 2000 else 1.0
        expected = np.column_stack([here["frequency_hz"] / scale, 100 * here["damping_ratio"]])
        points, expected = (x[np.lexsort(x.round(6).T)] for x in (points, expected))
        np.testing.assert_allclose(points, expected, atol=1e-12)
        assert (drawn["unstable"][:, 1] < 0).all() and len(drawn["unstable"]) == (here["stability"] == "unstable").sum()
    with pytest.raises(ValueError, match="no modes"):
        damping_figure(modes.iloc[:0])


def test_a_notebook_shows_the_answer(sweep: fe_squeal.Sweep) -> None:
    html = sweep._repr_html_()
    assert "1 mode is unstable" in html and "Onsets of instability" in html and "Re λ ≈" in html
    assert "<script" not in html


def test_a_branch_without_a_shape_is_refused(sweep: fe_squeal.Sweep) -> None:
    [known] = {int(p.branches[i]) for p in sweep.points for i in p.shapes}
    with pytest.raises(fe_squeal.SceneError, match=f"given branch 99, whose shape is not known; known: {known}$"):
        sweep.show(99)


@pytest.mark.slow
def test_a_shape_is_shown_in_three_dimensions(sweep: fe_squeal.Sweep) -> None:
    """Off screen: the picture has the model's colours on white."""
    [branch] = {int(p.branches[i]) for p in sweep.points for i in p.shapes}
    plotter = sweep.show(branch, off_screen=True)
    picture = np.asarray(plotter.screenshot(None, return_img=True)).astype(int)
    plotter.close()
    assert (np.ptp(picture, axis=2) > 40).mean() > 0.03


@pytest.mark.slow
def test_a_sweep_loads_what_draws_only_when_asked() -> None:
    code = """if True:
        import importlib, sys
        importlib.import_module("fe_squeal.sweep.result")
        print([m for m in ("matplotlib", "plotly", "pyvista", "pandas") if m in sys.modules])"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=True)
    assert done.stdout.strip() == "[]"


def test_the_forecast_of_a_sweep_is_of_the_values_that_are_left(capsys, monkeypatch):
    """40 s each: one is left at the sixth of seven, and eleven at the 25th of 36, where the run goes on from 20."""
    clock = itertools.count(0.0, 40.0)
    monkeypatch.setattr(forecast, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    for values, kept, told in ((7, 0, "the other 1 of 7 values take about 40 s (40 s each)"),
                               (36, 20, "the other 11 of 36 values take about 7.3 minutes (40 s each)")):  # fmt: skip
        line = forecast.ForecastLine(values, make_console(), kept=False)
        for done in range(max(kept, 1), values):
            line.tell(done)
        assert capsys.readouterr().out == f"forecast: {told}\n"
