"""Rows of earlier measurements, read from the table of the gallery in docs/performance.md."""

from __future__ import annotations

import math
from typing import Any

from gallery_models import MODELS
from gallery_table import COLUMNS, PEERS


def earlier_rows(page: str, measured: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows that a page has of models of which none was measured now.

    A row has the model, its unknowns, the number of values, the way, its ratio as printed, whether the model is damped,
    its line, and where the page says so, as text, what its seconds were spent on.

    Parameters
    ----------
    page : str
        The section of the gallery.
    measured : list of rows
        As of `compare`.

    Examples
    --------
    >>> line = "| weak | 9 | 2 | auto | 2.9 | 0.17 |" + " |" * 8
    >>> rows = earlier_rows("| all | auto | 2 | 0.4 | 0.17 | weak (9) | onsets 90 % |\\n" + line, [])
    >>> [(r["unknowns"], r["ratio"], r["spent"]) for r in rows]
    [(9, 0.17, 'onsets 90 %')]
    >>> earlier_rows(line, [{"model": "weak"}])
    []
    """
    ways = {name: way for way, name in PEERS.items()}
    damped = {m.name: m.damped for m in MODELS}
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in page.splitlines() if line.startswith("| ")]
    spent = {(c[5], int(c[2]), c[1]): c[6] for c in cells if len(c) == 7 and c[2].isdigit()}
    rows = []
    for line, c in zip((x for x in page.splitlines() if x.startswith("| ")), cells, strict=True):
        if len(c) != len(COLUMNS) or c[0] not in damped or c[0] in {r["model"] for r in measured}:
            continue
        row: dict[str, Any] = {
            "model": c[0], "unknowns": int(c[1] or 0), "values": int(c[2]), "way": ways.get(c[3], c[3]), "line": line,
            "damped": damped[c[0]],
        }  # fmt: skip
        if c[5]:
            row["spent"] = spent.get((f"{c[0]} ({c[1]})", row["values"], row["way"]), "")
            row["ratio"] = float(c[5])
        elif not c[4].startswith("over"):
            row["ratio"] = math.nan
        rows.append(row)
    return rows


def in_order(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows in the order of the gallery; those of one model stay in theirs."""
    names = [m.name for m in MODELS]
    return sorted(rows, key=lambda r: names.index(r["model"]))
