"""The table of the gallery in docs/performance.md."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from typing import NamedTuple

from gallery_models import MODELS, Model

PEERS = {"scipy": "SciPy, right modes", "slepc": "SLEPc + MUMPS, right modes"}
COLUMNS = (
    "model", "unknowns", "values", "way", "CPU, s", "ratio to the fastest peer", "found", "worst error of λ", "vectors",
    "onsets", "warnings", "share of the onsets", "memory, MiB", "count proven",
)  # fmt: skip
HEAD = "## The gallery: models that the program is not tuned to"
NOTE = """Models of `benchmarks/gallery/gallery_models.py`, which differ in kind; none is an example of the program. Its
own ways sweep over all values with right and left modes, tracking, onsets and the count of modes; peers solve
the last value for right modes alone, whose seconds are scaled to all values; SLEPc is among them where the
machine has it, and for problems without dampers. With dampers or complex stiffness SciPy takes three complex
shifts inside the band, which it is told. The ratio is the fastest peer's seconds over these: above 1 is
faster. Found and error compare the modes at the last value with those of the direct solve. Vectors are those
of the reduced model. The share of the onsets is that of refining them in the seconds of the sweep. A way that took
longer than the limit of seconds says so. Each process has one thread, and its CPU seconds count, since the machine is
shared with other work."""
_LEAST = 0.05  # of a sweep's seconds: smaller parts are not named
AIMED = """What was aimed at, the smallest ratio in each class, and what that sweep's seconds are spent on. What bounds
it is in the last section, by profile."""
STAGES = {
    "reduction": "reduced model", "eigenvalues": "modes at values", "tracking": "tracking", "onsets": "onsets",
    "completeness": "count", "descriptors": "shares and sensitivities",
}  # fmt: skip


class Aim(NamedTuple):
    """A ratio to the fastest peer that is aimed at.

    Attributes
    ----------
    kind : str
        The class of models, in words.
    ways : tuple of str
    ratios : mapping of int to float
        By the number of values.
    belongs : callable of a row
        Whether a measurement is one of the class.
    """

    kind: str
    ways: tuple[str, ...]
    ratios: dict[int, float]
    belongs: Callable[[dict], bool]


AIMS = (
    Aim("undamped, about 20 000 unknowns", ("auto",), {21: 4, 101: 12},
        lambda r: 15_000 < r["unknowns"] < 35_000 and not r["damped"]),
    Aim("undamped, from 35 000 unknowns", ("auto",), {21: 6, 101: 24},
        lambda r: r["unknowns"] > 35_000 and not r["damped"]),
    Aim("damped or rotating", ("auto",), {21: 4, 101: 12}, lambda r: r.get("damped", False)),
    Aim("all", ("auto", "direct"), {2: 0.4}, lambda r: True),
)  # fmt: skip


def table_line(r: dict) -> str:
    """Return one row as Markdown, with what a failure says where a measurement failed; as it was if it is earlier."""
    if "line" in r:
        return str(r["line"])
    start = f"| {r['model']} | {r['unknowns'] or ''} | {r['values']} | {PEERS.get(r['way'], r['way'])} |"
    if "failed" in r:
        return f"{start} {r['failed'].replace('|', '/')} |" + " |" * (len(COLUMNS) - 5)
    found = f"{r['found']} of {r['wanted']}" if "found" in r else ""
    error = f"{r['error']:.0e}" if "error" in r and r["way"] != "direct" else ""
    method = r.get("method", "").split()
    vectors = method[3] if method[:2] == ["reduced", "model"] else ""
    told = [str(r[k]) if k in r else "" for k in ("onsets", "warnings")]
    complete = ("yes" if r["complete"] else "not proven") if "complete" in r else ""
    stages = r.get("stages", {})
    share = f"{100 * stages['onsets'] / sum(stages.values()):.0f} %" if stages.get("onsets") else ""
    ratio = "" if math.isnan(r["ratio"]) else f"{r['ratio']:.2g}"  # no peer was within the limit
    times, memory = [f"{r['seconds']:.1f}", ratio], f"{r['MiB']:.0f}"
    cells = [*times, found, error, vectors, *told, share, memory, complete]
    return f"{start} " + " | ".join(cells) + " |"


def table(rows: list[dict]) -> str:
    """Return the rows as Markdown."""
    return "\n".join(["| " + " | ".join(COLUMNS) + " |", "|---" * len(COLUMNS) + "|", *map(table_line, rows)])


def section(rows: list[dict], models: list[Model], limit: float) -> str:
    """Return the section of the page."""
    there = {r["model"] for r in rows}
    about = "\n".join(f"- {m.name}: {m.about}" for m in MODELS if m.name in there)
    when = f"{models[0].modes} modes, limit {limit:g} s; {os.cpu_count()} cores; {time.strftime('%Y-%m-%d')}."
    made = f"Made by `python benchmarks/gallery/compare.py --write`; {when}"
    earlier = ", ".join(m.name for m in MODELS if m not in models and m.name in there)
    never = ", ".join(m.name for m in MODELS if m.name not in there)
    rest = f"\nMeasured earlier: {earlier}.\n" if earlier else ""
    rest += f"\nNot measured: {never}.\n" if never else ""
    return f"{HEAD}\n\n{NOTE}\n{made}\n\n{about}\n{rest}\n{slower(rows)}\n\n{AIMED}\n\n{aims(rows)}\n\n{table(rows)}\n"


def slower(rows: list[dict]) -> str:
    """Return a list of the models on which `auto` takes longer than the fastest peer, by the number of values."""
    lines = []
    for values in sorted({r["values"] for r in rows}):
        auto = [r for r in rows if r["values"] == values and r["way"] == "auto"]
        own = [r for r in auto if not math.isnan(r.get("ratio", math.nan))]
        behind = [f"{r['model']} ({r['unknowns']}: {r['ratio']:.2g})" for r in own if r["ratio"] < 1]
        ahead = len(own) - len(behind)
        lines.append(
            f"- {values} values: `auto` is faster than the fastest peer on {ahead} of {len(own)}"
            + (f"; slower on {', '.join(behind)} (unknowns: ratio)" if behind else "")
        )
    return "\n".join(lines)


def aims(rows: list[dict]) -> str:
    """Return what was aimed at, beside the smallest ratio in each class, as Markdown.

    Examples
    --------
    >>> row = {"model": "a", "unknowns": 4, "values": 2, "way": "auto", "damped": True, "ratio": 0.5}
    >>> aims([row | {"stages": {"onsets": 1.0, "tracking": 0.0}}]).splitlines()[-1]
    '| all | auto | 2 | 0.4 | 0.5 | a (4) | onsets 100 % |'
    """
    head = "class", "way", "values", "aimed at", "smallest", "of", "spent on"
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for kind, ways, ratios, belongs in AIMS:
        for way in ways:
            for values, aim in ratios.items():
                own = [r for r in rows if r["way"] == way and r["values"] == values and belongs(r)]
                own = [r for r in own if not math.isnan(r.get("ratio", math.nan))]
                if not own:
                    continue
                worst = min(own, key=lambda r: r["ratio"])
                of = f"{worst['model']} ({worst['unknowns']})"
                cells = [kind, way, str(values), f"{aim:g}", f"{worst['ratio']:.2g}", of, _spent(worst)]
                lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _spent(row: dict) -> str:
    """Return what a sweep's seconds are spent on, in words; of an earlier one what was written then, if anything."""
    if "spent" in row:
        return str(row["spent"])
    whole = sum(row["stages"].values())
    shares = sorted(((s / whole, STAGES[name]) for name, s in row["stages"].items()), reverse=True)
    return ", ".join(f"{name} {100 * share:.0f} %" for share, name in shares if share >= _LEAST)
