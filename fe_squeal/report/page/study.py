"""The page of a study: the answer of a scatter or a map, its pictures and tables."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fe_squeal.errors import OutputError
from fe_squeal.report.branches import frequency_text
from fe_squeal.report.page.build import Section, write_page
from fe_squeal.report.page.markup import bullets, image, paragraph, table, text
from fe_squeal.report.record import StudyRecord, left_out, readable
from fe_squeal.report.study import without_modes_text
from fe_squeal.report.table_files import read_checked

_MOST = 200  # rows of a table, at most
_EMPTY = ("–: not known, as fewer than some twenty samples make all of the variance; with all others also where no"
          " sample was solved again with that number drawn anew.")  # fmt: skip
# Of each table the columns that have no holes, and those that may have some.
_COLUMNS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "bands": (("low_hz", "high_hz", "probability", "lower", "upper"), ()),
    "indices": (("parameter", "output"), ("first", "first_error", "total", "total_error")),
    "samples": ((), ()),
    "boundaries": (("curve", "x", "y", "frequency_hz", "kind", "uncertainty"), ()),
    "map": ((), ()),
}


def write_study_page(record: Path, tables: dict[str, Path], figures: dict[str, Path], page: Path) -> tuple[str, ...]:
    """Write the page of a study from what is in its folder; return sentences on what could not be shown.

    Parameters
    ----------
    record : Path
        study.json.
    tables : mapping of str to Path
        "bands", "indices" and "samples" of a scatter; "boundaries" and "map" of a map.
    figures : mapping of str to Path
        "probability", "scatter" and "indices" of a scatter; "map" of a map.
    page : Path
        The file to write.

    Raises
    ------
    OutputError
        study.json cannot be read, or a table is missing.
    """
    try:
        said: dict[str, Any] = json.loads(record.read_text(encoding="utf-8"))
        if not isinstance(said, dict):
            raise ValueError("it is no table")
    except (OSError, OverflowError, RecursionError, ValueError) as error:
        raise OutputError(f"{record}: cannot be read ({error}); expected what fe-squeal study writes") from error
    frames = {
        name: read_checked(path, "fe-squeal study", *_COLUMNS[name]) for name, path in tables.items() if path.exists()
    }
    said, wrong = readable(said, StudyRecord)
    lacks = left_out(record.name, wrong)
    lacks += [f"{path.name} is missing, so it is not shown." for path in (*tables.values(), *figures.values())
             if not path.exists()]  # fmt: skip
    if not _complete(said):
        lacks.append(f"The study is {said.get('status', 'not complete')}.")
    make = _map_sections if "map" in tables else _scatter_sections
    sections = [*make(said, frames, figures), ("rests", "What it rests on", _rests(said) + bullets(lacks))]
    write_page(str(said.get("title") or "A study"), sections, page)
    return tuple(lacks)


def _scatter_sections(said: dict[str, Any], frames: dict[str, pd.DataFrame], figures: dict[str, Path]) -> list[Section]:
    bands, indices = frames.get("bands", pd.DataFrame()), frames.get("indices", pd.DataFrame())
    answer, rows = _probabilities(said, bands)
    if said.get("driver") and 0 < (said.get("probability") or 0) < 1:
        answer.append(f"What drives it most is {said['driver']}.")
    words = "".join(f'<p class="answer">{text(sentence)}</p>' for sentence in answer)
    shares = [
        (r["parameter"], r["output"], *(_share(r[k], r[f"{k}_error"]) for k in ("first", "total")))
        for r in indices.to_dict("records")
    ]
    dangerous = bullets(said.get("dangerous") or []) or _nothing(said, "No sample is unstable.")
    return [
        ("answer", "The answer", words + table("Probability by band", ("band", "%", "95 % interval, %"), rows)),
        ("bands", "Probability", _image(figures["probability"], "Probability of instability by band")),
        ("scatter", "Every unstable mode", _image(figures["scatter"], "Damping ratio against frequency")),
        ("indices", "What drives it", _image(figures["indices"], "Sobol indices") + table(
            "Sobol indices with 95 % intervals", ("parameter", "of", "alone", "with all others"), shares, 2)
            + (paragraph(_EMPTY) if "–" in {share for row in shares for share in row[2:]} else "")),
        ("dangerous", "Samples that grow most, as scenes", dangerous),
    ]  # fmt: skip


def _probabilities(said: dict[str, Any], bands: pd.DataFrame) -> tuple[list[str], list[tuple[str, str, str]]]:
    """Return the sentence on the probability of instability, if it is known, and the rows of the table by band."""
    if not len(bands):
        return [], []
    numbers = [[100 * r[k] for k in ("probability", "lower", "upper")] for r in bands.to_dict("records")]
    spans = [f"{r['low_hz']:g} to {r['high_hz']:g} Hz" for r in bands.to_dict("records")]
    where, above = _covered(said, spans[-1])
    rows = [(span, f"{p:.3g}", f"{low:.3g} to {high:.3g}") for span, (p, low, high) in zip(spans, numbers, strict=True)]
    _, value, interval = rows[-1]
    rows[-1] = f"all{where}", value, interval
    found, count = 100 * (said.get("probability") or 0.0), said.get("samples")
    if not above or found <= numbers[-1][0] or not count:
        return [f"Unstable with a probability of {value} % (95 % interval {interval} %){where}{above}."], rows
    # Some samples are unstable only by modes above the frequency up to which all are known.
    ends = said.get("probability_interval")
    sure = f"{100 * ends[0]:.3g} to {100 * ends[1]:.3g}" if ends else ""
    least = "at least " if found < 100 else ""
    rows.append(("all that is found", f"{least}{found:.3g}", sure))
    sure = f" (95 % interval {sure} %)" if sure else ""
    return [
        f"Unstable with a probability of {least}{found:.3g} %{sure}: {found * count / 100:.0f} of {count} samples"
        f" have an unstable mode among those solved for. The probability is {value} % (95 % interval {interval}"
        f" %){where}, where all modes are known{above}."
    ], rows


def _covered(said: dict[str, Any], span: str) -> tuple[str, str]:
    """Return where the probability holds, and what is above; "" for both where there are no more modes.

    Studies of earlier versions do not tell up to which frequency all modes are known; the last band ends there at most.
    """
    if "known_hz" not in said:
        return f", {span}", "; above it not all modes may have been solved for"
    known = said["known_hz"]
    return ("", "") if known is None else (f", up to {known:.4g} Hz", "; above it not all modes were solved for")


def _map_sections(said: dict[str, Any], frames: dict[str, pd.DataFrame], figures: dict[str, Path]) -> list[Section]:
    boundaries = frames.get("boundaries", pd.DataFrame({"curve": []}))
    rows = [
        (f"{number}", r["kind"].iloc[0],
         " to ".join(frequency_text(hz) for hz in (r["frequency_hz"].min(), r["frequency_hz"].max())),
         f"{r['x'].min():.5g} to {r['x'].max():.5g}", f"{r['y'].min():.5g} to {r['y'].max():.5g}", len(r),
         f"{r['uncertainty'].max():.0e}")
        for number, r in boundaries.groupby("curve")
    ]  # fmt: skip
    parameters: list[str] = said.get("parameters") or []
    names = parameters if len(parameters) == 2 else ["x", "y"]
    heads = ("boundary", "kind", "frequency", names[0], names[1], "points", "uncertainty, of the width")
    share = said.get("unstable_share")
    words = "" if share is None else f"{100 * share:.3g} % of the places on the grid are unstable."
    words = f'<p class="answer">{text(words)}</p>' if words else ""
    left = said.get("not_followed") or []
    return [
        ("answer", "The map", words + _image(figures["map"], "Largest growth, and the boundaries of stability")),
        ("boundaries", "Boundaries", (table("Boundaries", heads, rows[:_MOST], 2) or _nothing(said, "There are none."))
         + (("<h3>What could not be followed</h3>" + bullets(left[:_MOST])) if left else "")),
    ]  # fmt: skip


def _complete(said: dict[str, Any]) -> bool:
    return said.get("status") == "complete"


def _nothing(said: dict[str, Any], sentence: str) -> str:
    """Return a sentence on what a study did not find; of one that is not complete nobody knows."""
    return f"<p>{text(sentence)}</p>" if _complete(said) else "<p>The study is not complete.</p>"


def _rests(said: dict[str, Any]) -> str:
    facts = [f"{said.get('unknowns')} unknowns, {said.get('problem_class')} problem."]
    if _complete(said):
        facts += [
            f"Method: {said.get('method')}.",
            f"Tolerance of every eigenvalue {said.get('tolerance')};"
            f" largest estimated error {said.get('largest_error')}.",
        ]
    if said.get("samples_without_modes"):
        facts.append(f"{without_modes_text(said['samples_without_modes'], said.get('samples') or 0)}.")
    if said.get("solved_directly") is not None:
        facts.append(f"{said['solved_directly']} of {said.get('samples')} samples were solved directly.")
    return paragraph(*facts)


def _share(value: float, error: float) -> str:
    return "–" if not np.isfinite(value) else f"{value:.2f} ± {error:.2f}"


def _image(path: Path, words: str) -> str:
    if not path.exists():
        return ""
    return image(path.read_bytes(), words)
