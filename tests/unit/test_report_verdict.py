"""What the page of a run says in words, on tables made from a model of two coupling modes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from test_report_figures import SWEEP, coupled_tables

from fe_squeal.report.page import verdict
from fe_squeal.report.page.charts import chart_data
from fe_squeal.report.page.sections import mode_sections, onset_table
from fe_squeal.report.results import Results

EMPTY = pd.DataFrame()


def results(*pairs: tuple[float, float, float], record: dict | None = None, **options: object) -> Results:
    """Results of pairs of modes (Hz, half split in Hz, critical friction)."""
    return Results(record or {}, *coupled_tables(list(pairs), SWEEP, **options), EMPTY, EMPTY)


def with_bars(given: Results, *bars: float, alone: float | None = None) -> Results:
    """The same with errors of the onsets by the mesh, and with an onset that only the refined mesh has."""
    onsets = given.onsets.assign(discretisation=bars)
    if alone is not None:
        new = onsets.iloc[0].to_dict() | {
            "value": alone, "branch_a": 0, "branch_b": np.nan, "discretisation": np.inf, "frequency_hz": 1500.0}
        onsets = pd.concat([onsets, pd.DataFrame([new])], ignore_index=True)
    return replace(given, onsets=onsets)


PAIRS = (2413.0, 60.0, 0.312), (5000.0, 60.0, 0.2)


def test_onsets_of_the_refined_mesh_alone_are_no_onsets_of_the_sweep() -> None:
    """The earliest of all is not the first instability, and does not count among those that follow."""
    found = with_bars(results(*PAIRS), 0.02, 0.03, alone=0.1)
    _, first, alone, *_ = verdict.answer(found)
    assert "sets in at μ = 0.2 (± 1.0e-09 by the solver; ± 0.03 by the mesh)" in first and "1 more follow" in first
    assert alone == "An onset at μ = 0.1 and 1.50 kHz appears on the refined mesh alone: finer meshes may have it."
    nothing = replace(found, onsets=found.onsets.iloc[2:])
    assert sum("appears on the refined mesh alone" in s for s in verdict.answer(nothing)) == 1
    assert not any("sets in at" in s for s in verdict.answer(nothing))


@pytest.mark.parametrize(("bar", "sentence", "cell", "state"), [
    (0.03, "± 0.03 by the mesh", "0.03", ""),
    (np.inf, "the refined mesh has no such onset", "vanishes refined", "vanishes refined"),
    (np.nan, "its error by the mesh is not known", "?", ""),  # interpolated matrices lack it
])  # fmt: skip
def test_what_the_refined_mesh_says_of_the_first_onset(bar: float, sentence: str, cell: str, state: str) -> None:
    found = with_bars(results(*PAIRS), 0.02, bar)
    assert sentence in verdict.answer(found)[1]
    assert f'<td class="number">{cell}</td>' in onset_table(found)
    assert [o["mesh"] for o in chart_data(found)["onsets"]] == ["", state]
    assert ("The refined mesh has no such onset." in mode_sections(found)) == np.isinf(bar)


def test_without_an_estimate_no_onset_is_in_doubt() -> None:
    plain = results(*PAIRS)
    assert "the error of the mesh was not estimated" in verdict.answer(plain)[1]
    assert "?" not in onset_table(plain) and {o["mesh"] for o in chart_data(plain)["onsets"]} == {""}
