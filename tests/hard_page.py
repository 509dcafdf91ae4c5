"""Read and write the rows of docs/hard_cases.md."""

from __future__ import annotations

import ast
import inspect
import re
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "hard_cases.md"
FOLDER = ROOT / "tests" / "hard"
SLACK = 1.5  # digits that other versions and threads may cost: an order of magnitude, and rounding of the page
DRIFT = 1e-12  # of |λ|: the page mentions a growth rate that is nothing but rounding if it is larger
FAILS = 3.0  # digits: with fewer the page says that `eigs` fails
HEADER = "| case | what breaks | SciPy's `eigs`, plainly called | digits there | here | digits here | runs |"


@dataclass(frozen=True)
class Result:
    """The result of a run.

    `there` are the digits of `eigs`, None if it cannot be used. `drift` is the |Re λ|/|λ| of `eigs` if all exact
    Re λ are zero.
    """

    digits: float
    here: str
    there: float | None
    drift: float
    elsewhere: str


@dataclass(frozen=True)
class Row:
    """A row of the page, with the fewest digits of all runs."""

    digits: int
    there: int | None
    runs: int


RECORDED: pytest.StashKey[dict[str, list[Result]]] = pytest.StashKey()


def case_name(item: pytest.Item) -> str:
    return f"{item.path.name}::{item.originalname}"


def known_cases() -> dict[str, str]:
    """Return every test in tests/hard that records results, with its docstring in one line."""
    found = {}
    for path in sorted(FOLDER.glob("test_*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef) and "record" in [a.arg for a in node.args.args]:
                found[f"{path.name}::{node.name}"] = " ".join(inspect.cleandoc(ast.get_docstring(node) or "").split())
    return found


def summary(results: list[Result]) -> tuple[Result, float | None, str]:
    """Return the run with the fewest digits here, the fewest digits of `eigs`, and the remark on these."""
    worst = min(results, key=lambda r: r.digits)
    there = min((r.there for r in results if r.there is not None), default=None)
    said = [r.elsewhere for r in sorted(results, key=lambda r: (r.there is None, r.there)) if r.elsewhere][:1]
    if there is not None:
        said.insert(0, "fails" if there < FAILS else "holds")
    drift = max(r.drift for r in results)
    if drift > DRIFT:
        said.append(f"Re λ up to {drift:.0e} \\|λ\\| where it is 0")
    return worst, there, "; ".join(said) or "–"


def write_row(name: str, breaks: str, results: list[Result]) -> str:
    worst, there, said = summary(results)
    file, _, function = name.partition("::")
    title = function.removeprefix("test_").replace("_", " ")
    cells = (
        f"[{title}](../tests/hard/{file})<!--{name}-->", breaks.replace("|", "\\|"), said,
        "–" if there is None else f"{there:.0f}", worst.here.replace("|", "\\|"), f"{worst.digits:.0f}",
        str(len(results)),
    )  # fmt: skip
    return "| " + " | ".join(cells) + " |"


def read_page() -> dict[str, Row]:
    """Return the rows of the page, by the name of the case."""
    rows = {}
    text = PAGE.read_text(encoding="utf-8") if PAGE.exists() else ""
    for line in text.splitlines():
        if name := re.search(r"<!--(.+?)-->", line):
            cells = [c.strip() for c in re.split(r"(?<!\\)\|", line)[1:-1]]
            there = None if cells[3] == "–" else int(cells[3])
            rows[name[1]] = Row(int(cells[5]), there, int(cells[6]))
    return rows
