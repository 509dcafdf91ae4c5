"""What the page of a run says in words, on tables made from a model of two coupling modes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from test_critical_values import parting
from test_report_figures import ONSET_COLUMNS, SWEEP, coupled_tables

import fe_squeal
from fe_squeal.report import figures
from fe_squeal.report.files import write_json
from fe_squeal.report.page import verdict
from fe_squeal.report.page.charts import chart_data
from fe_squeal.report.page.sections import interval_table, mode_sections, onset_table, verdict_section
from fe_squeal.report.results import Results, read_results

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


def test_an_estimate_that_knows_no_error_is_one() -> None:
    """Interpolated matrices lack the only onset: it is not said that the mesh was not looked at."""
    found = with_bars(results(PAIRS[0]), np.nan)
    found = replace(found, onsets=found.onsets.assign(extrapolated_discretisation=np.nan, value_extrapolated=np.nan))
    assert "its error by the mesh is not known" in verdict.answer(found)[1]
    assert '<td class="number">?</td>' in onset_table(found)


def test_without_an_estimate_no_onset_is_in_doubt() -> None:
    plain = results(*PAIRS)
    assert "the error of the mesh was not estimated" in verdict.answer(plain)[1]
    assert "?" not in onset_table(plain) and {o["mesh"] for o in chart_data(plain)["onsets"]} == {""}


TOLD = {"status": "complete", "completeness": {"found": 4, "expected": 4, "proven": True},
        "onsets_complete": {"sure": True, "width": 1e-9}, "warnings": []}  # fmt: skip
SURE = "Nothing is in doubt that the program could check."


@pytest.mark.parametrize(("changed", "doubt"), [
    ({}, None),
    (None, "there is no record of the run"),
    ({"status": "running"}, "status of the run is: running"),
    ({"status": "interrupted"}, "status of the run is: interrupted"),
    ({"status": None}, "status of the run is: not recorded"),
    ({"warnings": None}, "run.json does not tell warnings"),
    ({"completeness": None, "onsets_complete": None}, "run.json does not tell completeness, onsets_complete"),
    ({"completeness": {"found": 4, "proven": False}}, "not proven at the first value"),
])  # fmt: skip
def test_nothing_is_in_doubt_only_where_the_record_says_so(changed: dict | None, doubt: str | None) -> None:
    section = verdict_section(results(*PAIRS, record={} if changed is None else TOLD | changed))
    assert (SURE in section) == (doubt is None) == ("<h3>In doubt</h3>" not in section)
    assert doubt is None or doubt in section


def test_warnings_that_cannot_be_read_leave_doubt(tmp_path: Path) -> None:
    """Keys that are not as the program writes them are left out of the page, and with them what they would say."""
    write_json(TOLD | {"warnings": "the mesh is bad"}, tmp_path / "run.json")
    section = verdict_section(read_results(tmp_path, "run.json", {"modes": "m", "onsets": "o", "contributions": "c",
                                                                  "sensitivities": "s"}, "shapes"))  # fmt: skip
    assert SURE not in section and "run.json does not tell warnings" in section


def stable(*rows: tuple[float, float, float, str], **record: object) -> Results:
    """Modes (Hz, Re λ, its uncertainty, stability) at one value, with no onsets."""
    modes = pd.DataFrame(rows, columns=["frequency_hz", "re", "re_uncertainty", "stability"])
    modes = modes.assign(parameter="mu", value=0.3, mode=range(1, len(rows) + 1), branch=range(1, len(rows) + 1),
                         im=2 * np.pi * modes["frequency_hz"], damping_ratio=0.0, noise="")  # fmt: skip
    return Results(record, modes, pd.DataFrame(columns=["value", "frequency_hz"]), EMPTY, EMPTY)


RIGID, DOUBLET = (0.0, 0.0, 1e-6, "marginal"), (900.0, 5.0, 8.0, "marginal")
CALM, LOUD = (700.0, -30.0, 1e-6, "stable"), (800.0, -200.0, 1e-6, "stable")
ZERO = "Without damping their Re λ is zero within its uncertainty."


@pytest.mark.parametrize(("modes", "kind", "said"), [
    ((RIGID, DOUBLET), "nonsymmetric", [ZERO]),
    ((RIGID, RIGID), "symmetric", [ZERO]),
    ((LOUD, CALM), "quadratic", ["The mode nearest to it has Re λ = -30 1/s, at 700 Hz and μ = 0.3."]),
    ((RIGID, LOUD, CALM), "quadratic", [
        "It is not decided for one mode: Re λ = 0 1/s, at 0 Hz and μ = 0.3.",
        "The surely stable mode nearest to it has Re λ = -30 1/s, at 700 Hz and μ = 0.3."]),
    ((RIGID, DOUBLET, LOUD), "complex", [
        "It is not decided for 2 modes: Re λ = 5 ± 8 1/s of the one that may grow most, at 900 Hz and μ = 0.3.",
        "The surely stable mode nearest to it has Re λ = -200 1/s, at 800 Hz and μ = 0.3."]),
    ((DOUBLET, DOUBLET), "quadratic", ["It is not decided for 2 modes: Re λ = 5 ± 8 1/s of the one that may grow most,"
                                       " at 900 Hz and μ = 0.3."]),
    ((DOUBLET, CALM), "nonsymmetric", [
        "It is not decided for one mode: Re λ = 5 ± 8 1/s, at 900 Hz and μ = 0.3.",
        "The surely stable mode nearest to it has Re λ = -30 1/s, at 700 Hz and μ = 0.3."]),
    ((DOUBLET,), None, ["It is not decided for one mode: Re λ = 5 ± 8 1/s, at 900 Hz and μ = 0.3."]),
])  # fmt: skip
def test_how_near_to_instability_the_modes_come(modes: tuple, kind: str | None, said: list[str]) -> None:
    """A marginal mode is called undamped only where nothing damps; else it may grow, and others have a distance."""
    [words] = verdict.answer(stable(*modes, problem_class=kind, frequency_range_hz=[0.0, None]))
    start = "Nothing squeals at any frequency of the model: no mode is "
    surely = "surely " if "not decided" in said[0] else ""
    assert words == " ".join([f"{start}{surely}unstable for μ = 0.3.", *said])


@pytest.mark.parametrize(("covered", "where"), [
    ([0.0, None], "at any frequency of the model"),
    ([0.0, 6000.0], "below 6.00 kHz"),
    ([0.0, 0.0], "below 0 Hz"),
    (None, "among the computed modes"),
])  # fmt: skip
def test_all_frequencies_are_meant_only_where_the_record_says_so(covered: list | None, where: str) -> None:
    """A record that is missing or damaged, or has no range, says nothing of modes that were not solved for."""
    record = {} if covered is None else {"frequency_range_hz": covered}
    assert verdict.answer(stable(LOUD, **record))[0].startswith(f"Nothing squeals {where}: no mode is unstable for ")
    said = verdict.answer(results(*PAIRS, record=record))[0]
    told = f"All modes are known {where}." if covered == [0.0, 0.0] else f"2 modes are unstable {where} for"
    assert told in said


def test_what_grows_below_the_range_is_not_said_to_lie_in_it() -> None:
    """Strong dampers let direct solves see no farther down than 3 kHz; a mode of 2.4 kHz was found all the same."""
    found = results(*PAIRS, record={"frequency_range_hz": [3000.0, 6000.0]})
    assert verdict.answer(found)[0] == (
        "It squeals: 2 modes are unstable for μ from 0 to 0.7: 2.41 kHz; 5.00 kHz. All modes are known from 3.00 kHz to"
        " 6.00 kHz."
    )
    charts = chart_data(found)
    assert (charts["rangeEnds"], charts["rangeText"]) == ([3000.0, 6000.0], "all modes from 3.00 kHz to 6.00 kHz")
    inside = verdict.answer(results(*PAIRS, record={"frequency_range_hz": [12.0, None]}))[0]
    assert "2 modes are unstable above 12 Hz for" in inside


def test_growth_whose_error_of_the_mesh_is_not_known_is_marked_everywhere() -> None:
    """Beside modes with an error of 30 1/s one of the solver's alone looks sure: sentence, table and section say so."""
    found = results(*PAIRS)
    found.modes["re_discretisation"] = np.where(found.modes["frequency_hz"] < 3000, 30.0, np.nan)
    largest = next(s for s in verdict.answer(found) if s.startswith("The fastest"))
    assert "± 1e-06 1/s, mesh: ? at μ = 0.7" in largest
    tables, sections = interval_table(found), mode_sections(found)
    assert tables.count("mesh: ?") == sections.count("mesh: ?") == 1
    assert "595.968 ± 1e-06, mesh: ?" in tables and "Re λ is 595.968 ± 1e-06 1/s, mesh: ?" in sections
    assert "420 ± 30" in tables and "Re λ is 420 ± 30 1/s." in sections
    plain = results(*PAIRS)
    assert not any("mesh: ?" in s for s in (*verdict.answer(plain), interval_table(plain), mode_sections(plain)))


@pytest.mark.parametrize("turned", [False, True])
def test_where_growing_modes_part_growth_neither_begins_nor_ends(turned: bool, tmp_path: Path, monkeypatch) -> None:
    """A growing pair becomes two growing real λ at p = 0.5, or, as 0.6 − p is swept, these become a growing pair."""
    problem = parting("undamped")
    if turned:
        mass, stiffness, forces = problem.terms
        K, f = problem.pencil(p=0.6).K, replace(forces, matrix=-forces.matrix)
        problem = replace(problem, terms=(mass, replace(stiffness, matrix=K.tocsr()), f))
    result = fe_squeal.sweep(problem, np.linspace(0, 0.6, 4), "p", modes=2)
    modes, onsets = result.to_dataframe(), result.onsets_dataframe()
    assert onsets["law"].tolist() == ["parting"]
    found = Results({}, modes, onsets, EMPTY, EMPTY)
    assert verdict.answer(found)[1] == "The first instability sets in before p = 0, the first value of the sweep."
    law = "two growing modes become one that swings" if turned else "a growing mode becomes two that do not swing"
    at = "0.1" if turned else "0.5"
    sections = mode_sections(found)
    assert f"At p = {at} {law}; growth neither begins nor ends there." in sections
    assert "<td>parting</td><td>grows on both sides</td>" in onset_table(found)
    assert "instability at" not in sections and [o["parting"] for o in chart_data(found)["onsets"]] == [True]
    drawn = []
    monkeypatch.setattr(figures, "save_figure", lambda figure, path: drawn.append(figure))
    figures.plot_stability(modes, onsets, tmp_path / "stability.png")
    figures.plot_root_locus(modes, onsets, tmp_path / "root_locus.png")
    marks = [[line.get_label() for line in figure.axes[0].lines if line.get_marker() in "osv"] for figure in drawn]
    assert marks == [["growing modes meet or part"], []]


def test_growth_in_a_window_between_values_is_about() -> None:
    """It has no row in the table of modes: two digits, in the sentence, the table and the section."""
    calm = results((2413.0, 60.0, 0.9))
    rows = [("mu", v, 2400.0, "flutter", d, 50.0, 1, 2, 1e-9, np.nan, np.nan)
            for v, d in ((0.103, "into"), (0.105, "out of"))]  # fmt: skip
    found = replace(calm, onsets=pd.DataFrame(rows, columns=ONSET_COLUMNS))
    assert "Re λ = about 1.1 1/s at μ = 0.104" in next(s for s in verdict.answer(found) if s.startswith("The fastest"))
    assert "about 1.1</td>" in interval_table(found) and "Re λ is about 1.1 1/s." in mode_sections(found)
