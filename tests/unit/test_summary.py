"""What a run says on the terminal at its end."""

import io
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from rich.console import Console

import fe_squeal
from fe_squeal.cli import main
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.eigen.unsearched import Unsearched
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.report import figures
from fe_squeal.report.warnings import told_once
from fe_squeal.run.covered import frequency_range, unstable_above
from fe_squeal.run.run import report_sweep
from fe_squeal.scene.file import load_scene
from fe_squeal.sweep import solving
from fe_squeal.sweep.state import (
    modes_of_record,
    point_of_record,
    record_of_modes,
    record_of_point,
    record_of_state,
    state_of_record,
)
from tests.scene_texts import write_scene


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    scene = load_scene(write_scene(tmp_path_factory.mktemp("summary")))
    problem = fe_squeal.assemble(scene)
    return scene, fe_squeal.sweep(problem, np.linspace(0.0, 0.8, 5), modes=8)


def summary(scene, result, width=80):
    console = Console(file=io.StringIO(), width=width, soft_wrap=True)
    report_sweep(scene, result, Path("out"), console, 1.0)
    return console.file.getvalue()


def test_equal_warnings_once_with_their_number_and_the_gravest_at_the_end(block):
    scene, result = block
    rough = "3 of the modes have frequencies that rounding of the matrices may move, by up to 2 %"
    lost = [f"branch {b} is not found again between mu = {b / 10} and {b / 5}" for b in range(1, 115)]
    text = summary(scene, replace(result, warnings=(rough, *lost)))
    warnings = [line for line in text.splitlines() if line.startswith("warning: ")]
    assert warnings == [f"warning: {rough}", f"warning: {lost[-1]} (one of 114 such warnings)"]
    assert text.rstrip().splitlines()[-1] == warnings[-1]


def test_warnings_about_other_contacts_stay():
    given = ["contact pad_1: only 3 % touch", "contact pad_2: only 5 % touch"]
    assert told_once(given) == given


def test_the_range_is_part_of_the_answer(block):
    scene, result = block
    assert frequency_range(scene, result)[1] == min(p.modes.frequency_hz.max() for p in result.points)
    assert "Onsets below " in summary(scene, result)
    none = replace(result, onsets=())
    assert re.search(r"No onset of instability below [\d.]+ k?Hz in this sweep", summary(scene, none))
    solve = scene.solve.model_copy(update={"modes": None, "max_frequency": 2009.0})
    limited = scene.model_copy(update={"solve": solve})
    assert frequency_range(limited, result) == (0.0, 2009.0)
    every = scene.model_copy(update={"solve": scene.solve.model_copy(update={"modes": result.problem.unknowns})})
    assert frequency_range(every, result) == (0.0, None)
    assert "at any frequency of the model" in summary(every, none)


def pair_above_others():
    """Two single modes of 100 and 200 rad/s, a pair at 300 that flutters from μ = 0.2 on, and ten far above."""
    theta = np.concatenate([[100.0, 200.0], [300.0, 304.0], 1000.0 * np.arange(2.0, 12.0)]) ** 2
    coupling = np.zeros((len(theta),) * 2)
    half = (theta[3] - theta[2]) / 2
    coupling[2, 3], coupling[3, 2] = half / 0.2, -half / 0.2
    terms = (
        Term("m", "M", sp.eye_array(len(theta), format="csr"), True),
        Term("k", "K", sp.diags_array(theta).tocsr(), True),
        Term("f", "K", sp.csr_array(coupling), False, {"mu": 1}),
    )  # fmt: skip
    return Problem(terms, {"mu": 0.0})


@pytest.mark.parametrize("method", ["reduced", "direct"])
def test_an_unstable_mode_above_the_range_is_mentioned(block, method):
    """Two modes asked for below the pair that flutters: the sweep follows four more and has seen it."""
    scene, _ = block
    few = scene.model_copy(update={"solve": scene.solve.model_copy(update={"modes": 2})})
    problem = pair_above_others()
    result = fe_squeal.sweep(problem, np.linspace(0.0, 0.8, 5), modes=2, method=method)
    assert result.onsets == ()
    end = frequency_range(few, result)[1]
    assert end == pytest.approx(200 / (2 * np.pi))
    seen = unstable_above(result)
    lam = np.sqrt(-np.linalg.eigvals(problem.pencil(mu=0.8).K.toarray()).astype(complex))
    assert seen.value == 0.8 and seen.growth == pytest.approx(np.abs(lam.real).max(), rel=1e-6)
    assert seen.frequency_hz == pytest.approx(302 / (2 * np.pi), rel=0.02)
    text = summary(few, result)
    assert "No onset of instability below 31.83 Hz" in text
    assert "above the range that was asked for a mode is unstable: 48" in text
    shown = result._repr_html_()
    assert "Nothing squeals below 31.83 Hz: no mode is" in shown
    assert "above the range that was asked for a mode is unstable: 48" in shown


def test_a_notebook_tells_where_all_modes_are_known():
    """As many as there are: any frequency. Fewer: the range ends at the highest that every value has."""
    problem = pair_above_others()
    for modes, words in ((14, "at any frequency of the model"), (4, "below 48.07 Hz")):
        shown = fe_squeal.sweep(problem, [0.0, 0.1, 0.4], modes=modes)._repr_html_()
        assert f"1 mode is unstable {words} for" in shown


@pytest.mark.slow
def test_figures_and_record_tell_the_range(tmp_path, monkeypatch):
    kept = []
    save = figures.save_figure
    monkeypatch.setattr(figures, "save_figure", lambda figure, path: (kept.append(figure), save(figure, path))[1])
    assert main(["run", str(write_scene(tmp_path)), "-o", str(tmp_path / "out")]) == 0
    low, high = json.loads((tmp_path / "out" / "run.json").read_text())["frequency_range_hz"]
    assert low == 0 and high > 0
    for figure in kept[:2]:
        legend = figure.axes[0].get_legend()
        assert any(t.get_text().startswith("all modes below ") for t in legend.get_texts())


def test_what_was_not_looked_for_is_told_with_its_values_and_the_range_begins_above(block, monkeypatch):
    """Also of values after the first one, in one sentence, and by a sweep that is interrupted and goes on."""
    scene, _ = block
    calls, states = [], []

    def incomplete(*given):
        calls.append(given)
        left_out = Unsearched(("modes",), low=2 * np.pi * len(calls), rate=900.0 / len(calls), damped=len(calls) > 2)
        return replace(solve_modes(*given), unsearched=left_out if len(calls) > 1 else Unsearched())

    class Kept:
        load_model = save_model = flush = staticmethod(lambda *_: None)
        load = staticmethod(lambda: states[-1] if states else None)

        @staticmethod
        def save(state):
            first = modes_of_record(record_of_modes(state.first))
            points = tuple(point_of_record(record_of_point(point)) for point in state.points)
            states.append(state_of_record(record_of_state(state), first, points))
            if len(points) == 3:
                raise KeyboardInterrupt

    monkeypatch.setattr(solving, "solve_modes", incomplete)
    solve = {"modes": 4, "method": "direct", "store": Kept()}
    with pytest.raises(KeyboardInterrupt):
        fe_squeal.sweep(pair_above_others(), [0.0, 0.01, 0.02, 0.03], **solve)
    result = fe_squeal.sweep(pair_above_others(), [0.0, 0.01, 0.02, 0.03], **solve)
    left_out = "modes, and real eigenvalues that grow faster than 225 1/s, and modes below 4 Hz"
    assert result.unsettled == (
        f"at mu = 0.01 to 0.03 {left_out} were not looked for everywhere, and an unstable one may be missing",
    )
    damped = "modes with light damping were not looked for everywhere: some that decay may be missing"
    assert [w for w in result.warnings if "looked for" in w and w not in result.unsettled] == [
        f"at mu = 0.02 to 0.03 {damped}"
    ]
    assert result.warnings.count(result.unsettled[0]) == 1 and not result.onsets_complete["sure"]
    assert frequency_range(scene, result)[0] == pytest.approx(4.0)
    assert len(calls) == 4
