"""Sections of the page that need no JavaScript: the verdict, each unstable mode, the certificate, the scene."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from fe_squeal.process.signals import signals_deferred
from fe_squeal.report.branches import distinct_texts, frequency_text, numbers, parameter_symbol
from fe_squeal.report.growth import onset_laws
from fe_squeal.report.looks import body_text, diameters_text, plane_text, way_text
from fe_squeal.report.mesh_error import mesh_error_figure
from fe_squeal.report.onsets import VANISHES, change_words, mesh_errors, mesh_states
from fe_squeal.report.page import verdict
from fe_squeal.report.page.charts import law_text
from fe_squeal.report.page.markup import bullets, image, paragraph, table, text
from fe_squeal.report.results import Results
from fe_squeal.report.tables import UnstableInterval, growth_text, likely_values
from fe_squeal.report.terms import ELASTIC, MASS, TermName, is_kinetic, term_of
from fe_squeal.report.units import behind_comma

_MOST_MODES = 40  # unstable modes with a section of their own, at most
_ROWS = 12  # rows in the tables of a mode, at most
_SMALL = 1e-3  # of the energy: springs and contacts with a smaller share are left out


def verdict_section(results: Results) -> str:
    """Return what squeals, in words, with what is in doubt and what could not be shown."""
    first, *rest = verdict.answer(results)
    doubts = verdict.doubts(results)
    parts = [f'<p class="answer">{text(first)}</p>', *(paragraph(sentence) for sentence in rest)]
    measured = [str(m["sentence"]) for m in results.record.get("measured") or [] if m.get("sentence")]
    if measured:
        parts.append("<h3>Measured squeal</h3>" + bullets(measured))
    if doubts:
        parts.append("<h3>In doubt</h3>" + bullets(doubts))
    else:
        parts.append(paragraph("Nothing is in doubt that the program could check."))
    if results.lacks:
        parts.append("<h3>What is not shown</h3>" + bullets(results.lacks))
    return "".join(parts)


def onset_table(results: Results) -> str:
    """Return the table of onsets with their laws of growth and errors."""
    onsets = _onsets(results)
    symbol = parameter_symbol(results.parameter)
    value, solver, two = (numbers(onsets, name) for name in ("value", "uncertainty", "two_mode_value"))
    mesh = mesh_errors(onsets) or len(onsets) * ["–"]
    beyond = likely_values(onsets)
    rows = []
    words = change_words(onsets)
    for i, (told, row) in enumerate(zip(distinct_texts(value, "g"), onsets.to_dict("records"), strict=True)):
        pair = " + ".join(f"{row[k]:.0f}" for k in ("branch_a", "branch_b") if row.get(k) == row.get(k) and row.get(k))
        rows.append((
            told, *words[i], law_text(row, symbol),
            frequency_text(float(row["frequency_hz"])), pair, _number(solver[i], ".1e"), mesh[i].removeprefix("± "),
            *((beyond[i] or "–",) if beyond is not None else ()), _number(two[i], ".4g"),
        ))  # fmt: skip
    heads = (symbol, "kind", "direction", "growth behind it", "frequency", "branches", "± solver", "± mesh",
             *(("extrapolated",) if beyond is not None else ()), "two modes alone")  # fmt: skip
    return table("Onsets of instability", heads, rows, 4)


def _onsets(results: Results) -> pd.DataFrame:
    """Return the onsets with their laws of growth, ascending."""
    laws = onset_laws(results.modes, results.onsets)
    return results.onsets.assign(law=laws).sort_values("value", kind="stable")


def interval_table(results: Results) -> str:
    """Return the table of unstable intervals; each row has a button that shows its mode."""
    symbol = parameter_symbol(results.parameter)
    rows = [
        (f"{row.branch:.0f}", f"{row.first:.4g} … {row.last:.4g}", frequency_text(verdict.peak_hz(results, row)),
         growth_text(row), f"{100 * row.damping_ratio:.3g}", diameters_text(row.looks) or "–",
         body_text(row.looks) or "–")
        for row in verdict.all_intervals(results)
    ]  # fmt: skip
    heads = ("branch", f"unstable at {symbol}", "frequency", "largest Re λ, 1/s", "damping ratio, %", "shape",
             "moves most")  # fmt: skip
    return table("Unstable modes, the fastest growing first", heads, rows)


def mac_table(results: Results) -> str:
    """Return the table of the best matches of each measured shape; "" if no shape was measured."""
    rows: list[tuple[object, ...]] = []
    for name, own in results.mac.groupby("measured", sort=False) if len(results.mac) else ():
        known = own[own["mac"].notna()].sort_values("mac", ascending=False)
        for r in known.iloc[:_ROWS].to_dict("records"):
            rows.append((name, f"{r['branch']:.0f}", frequency_text(float(r["frequency_hz"])), f"{r['value']:.4g}",
                         f"{r['mac']:.2f}"))  # fmt: skip
        if not len(known):
            rows.append((name, *["–"] * 4))
    heads = ("measured shape", "branch", "frequency", parameter_symbol(results.parameter), "MAC")
    return table("Measured shapes and the modes most like them", heads, rows)


def mode_sections(results: Results) -> str:
    """Return a section for each unstable branch."""
    intervals = list({row.branch: row for row in reversed(verdict.all_intervals(results))}.values())[::-1]
    parts = [_mode_section(results, row, i) for i, row in enumerate(intervals[:_MOST_MODES])]
    if len(intervals) > _MOST_MODES:
        parts.append(paragraph(f"{len(intervals) - _MOST_MODES} more unstable modes stand in modes.csv."))
    return "".join(parts) or paragraph("No mode is unstable, so there is nothing to explain.")


def _mode_section(results: Results, interval: UnstableInterval, position: int) -> str:
    row, symbol, branch = verdict.row_of(results, interval), parameter_symbol(results.parameter), interval.branch
    looks = [t for t in (diameters_text(row), way_text(row), plane_text(row), body_text(row)) if t]
    head = f"Branch {branch:.0f}: {frequency_text(verdict.peak_hz(results, interval))}"
    about = f"At {symbol} = {interval.peak_value:.4g} its Re λ is {growth_text(interval, ' 1/s')}"
    parts = [paragraph(f"{about}; {', '.join(looks)}." if looks else f"{about}."), *_partner(results, interval, symbol)]
    shares = verdict.shares_of(results, row)
    shares = shares.assign(kinetic=is_kinetic(shares))
    growth = [
        (r["term"], _number(r["re_share"], "+.4g"), _percent(r.get("energy_share")))
        for r in shares.to_dict("records")
        if not abs(r["re_share"]) <= 1e-9 * abs(interval.growth) or _counts(r)  # an unknown share is no small one
    ]
    parts.append(table("What gives to Re λ, and where the energy is", ("term", "Re λ, 1/s", "energy"), growth[:_ROWS]))
    parts.append(_body_table(shares))
    moves = verdict.sensitivities_of(results, row).iloc[:_ROWS]
    moved = [(r["number"], f"{r['at']:.4g}", _number(r["dre_percent"], "+.3g"), _number(r["dhz_percent"], "+.3g"))
             for r in moves.to_dict("records")]  # fmt: skip
    heads = ("number of the scene", "is", "moves Re λ by, 1/s", "moves the frequency by, Hz")
    parts.append(table("1 % more of this", heads, moved))
    opened = " open" if position < 3 else ""
    return (
        f'<details class="mode" id="branch-{branch:.0f}" data-branch="{branch:.0f}"{opened}><summary><h3>{text(head)}'
        f"</h3></summary>{''.join(parts)}</details>"
    )


def _counts(row: dict[Any, Any]) -> bool:
    """Whether a contact or spring stores energy that is worth a row; bodies have a table of their own."""
    share = row.get("energy_share", np.nan)
    return bool(share > _SMALL) and not row["kinetic"] and term_of(row["term"]).kind != ELASTIC


def _partner(results: Results, interval: UnstableInterval, symbol: str) -> list[str]:
    said = []
    onsets = _onsets(results)
    for row, state in zip(onsets.to_dict("records"), mesh_states(onsets), strict=True):
        pair = [row[k] for k in ("branch_a", "branch_b") if row.get(k) == row.get(k) and row.get(k)]
        if interval.branch not in pair:
            continue
        other = [f"{b:.0f}" for b in pair if b != interval.branch]
        way = "leaves" if row.get("direction") == "out of" else "enters"
        two = float(row.get("two_mode_value", np.nan))
        with_ = f" together with branch {other[0]}" if other else ""
        guess = f" These two modes alone, as they are where the sweep begins, predict {two:.4g}." if two == two else ""
        place = f"{symbol} = {row['value']:.6g}"
        gone = " The refined mesh has no such onset." if state == VANISHES else ""
        if row.get("law") == "parting":
            said.append(paragraph(f"At {place} {law_text(row, symbol)}; growth neither begins nor ends there.{gone}"))
            continue
        said.append(paragraph(f"It {way} instability at {place}{with_}: {law_text(row, symbol)}.{gone}{guess}"))
    return said


def _body_table(shares: pd.DataFrame) -> str:
    """Return the table of kinetic and elastic energy by body; other masses have rows under the names of their terms."""
    if "energy_share" not in shares:
        return ""
    energy = {term_of(r["term"]): float(r["energy_share"]) for r in shares.to_dict("records")}
    rows = []
    for term in map(term_of, shares.loc[shares["kinetic"], "term"]):
        elastic = energy.get(TermName(ELASTIC, term.part)) if term.kind == MASS else None
        rows.append((term.part if term.kind == MASS else str(term), _percent(energy[term]), _percent(elastic)))
    return table("Energy by body", ("body", "of the kinetic energy", "of the potential energy"), rows)


def mesh_error_section(results: Results) -> str:
    """Return where the error of the mesh comes from, as a picture and advice; "" if it was not estimated."""
    parts = results.mesh_error
    if not len(parts):
        return ""
    sums = parts.groupby(["quantity", "body", "direction"], sort=False).agg({"part": "sum", "scale": "first"})
    sums = sums.reset_index().assign(relative=lambda t: (t["part"] / t["scale"]).abs())
    worst = sums.groupby("quantity")["relative"].sum().idxmax()
    own = sums[sums["quantity"] == worst].sort_values("relative", ascending=False, kind="stable")
    first = own.iloc[0]
    along = "" if first["direction"] == "all" else f", {first['direction']}"
    share = 100 * first["relative"] / own["relative"].sum()
    words = (
        f"Most of the error of the {worst} comes from {first['body']}{along}: {share:.0f} % of its parts. Cut finer"
        " there first; fe-squeal run --accuracy 0.02 does so by itself. mesh_error.vtu has the parts by element."
    )
    data = io.BytesIO()
    with signals_deferred():
        mesh_error_figure(parts).savefig(data, format="png", dpi=110)
    bars = image(data.getvalue(), "Bars: parts of the error of the mesh by body and direction")
    drawn = image(results.mesh_picture, "The bodies, elements coloured by their parts of the error")
    return paragraph(words) + bars + (drawn if results.mesh_picture else "")


def certificate(results: Results) -> str:
    """Return the evidence for the result: completeness, errors, solver, and everything needed to repeat the run."""
    r = results.record
    if not r:
        return paragraph("run.json is missing, so that there is no record of how this was found.")
    # A folder of an earlier version has its units in the scene alone.
    units = str(r.get("units") or ((r.get("inputs") or {}).get("scene") or {}).get("units", "SI"))
    c, onsets = r.get("completeness") or {}, r.get("onsets_complete") or {}
    found = f"{'sure' if onsets.get('sure') else 'not sure'} down to windows of {onsets.get('width', 0):.1e} in width"
    modes = results.modes
    how = (f"{c.get('found')} of {c.get('expected') if c.get('expected') is not None else '?'} at the first value, "
           + ("proven by counting" if c.get("proven") else "not proven"))  # fmt: skip
    worst = [float(np.nanmax(numbers(modes, k))) if np.isfinite(numbers(modes, k)).any() else np.nan
             for k in ("backward_error", "re_uncertainty", "re_discretisation")]  # fmt: skip
    rows: list[tuple[str, object]] = [
        ("status", r.get("status", "–")),
        ("modes", how if c else "–"),
        ("onsets", found if onsets else "–"),
        ("largest backward error", _number(worst[0], ".1e")),
        ("largest uncertainty of Re λ by the solver, 1/s", _number(worst[1], ".1e")),
        ("largest uncertainty of Re λ by the mesh, 1/s", _number(worst[2], ".2g", "not estimated")),
        ("effects", ", ".join(r.get("effects") or []) or "none"),
        ("unknowns", r.get("unknowns", "–")),
        ("class", r.get("problem_class", "–")),
        ("method", r.get("method", "–")),
        ("linear solver", r.get("linear_solver", "–")),
        ("version", r.get("version", "–")),
        ("largest memory, MiB", _number(r.get("peak_memory_mib"), ".0f")),
    ]  # fmt: skip
    inputs = r.get("inputs") or {}
    digests = [(name, digest) for name, digest in (inputs.get("content") or {}).items()]
    seconds = [(stage, f"{s:.2f}") for stage, s in (r.get("seconds") or {}).items() if isinstance(s, int | float)]
    contacts = [
        (name, f"{c['area_m2']:.4g}", _percent(c["coverage"]), f"{c['largest_gap_m']:.1e}")
        for name, c in (r.get("contacts") or {}).items()
    ]
    area, gap = behind_comma("area", "m²", units), behind_comma("largest gap", "m", units)
    return "".join((
        table("How it was found", ("what", "value"), rows, 2),
        table("Contacts", ("contact", area, "covered", gap), contacts),
        table("Seconds by stage", ("stage", "seconds"), seconds),
        table("Inputs, by the SHA-256 of their content", ("file", "digest"), digests, 2),
        bullets(str(note) for note in r.get("notes") or []),
    ))  # fmt: skip


def scene_section(results: Results) -> str:
    """Return the scene as it was read, in lines like those of TOML."""
    scene = (results.record.get("inputs") or {}).get("scene")
    if not isinstance(scene, dict):
        return paragraph("The scene was not recorded.")
    lines = "\n".join(f"{key} = {value}" for key, value in _flat(scene, ""))
    return f'<pre tabindex="0">{"".join(text(line) + chr(10) for line in lines.split(chr(10)))}</pre>'


def _flat(data: Mapping[str, Any], prefix: str) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    for key, value in data.items():
        path = f"{prefix}.{key}".removeprefix(".")
        if isinstance(value, Mapping):
            found += _flat(value, path)
        elif isinstance(value, list) and value and all(isinstance(v, Mapping) for v in value):
            for i, v in enumerate(value):
                found += _flat(v, f"{path}[{i}]")
        else:
            found.append((path, repr(value).replace("'", '"')))
    return found


def _number(value: Any, form: str, unknown: str = "–") -> str:
    return unknown if value is None or not np.isfinite(value) else format(float(value), form)


def _percent(value: Any) -> str:
    return "–" if value is None or value != value else f"{100 * float(value):.3g} %"
