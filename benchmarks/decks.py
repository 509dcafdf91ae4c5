"""What is taken over from decks, and a comparison with CalculiX's decks: python benchmarks/decks.py [--write]

It makes the tables of docs/decks.md. Those of keywords are made from the program's own lists. The comparison needs
Debian's package calculix-ccx-test (see .ci/run); without it that section of the page is not changed.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from calculix import Outcome, asks_for_frequencies, compare, decks_folder, unpack  # noqa: E402

from fe_squeal.decks.abaqus import keywords  # noqa: E402
from fe_squeal.decks.ansys import read as ansys  # noqa: E402
from fe_squeal.decks.nastran import parameters  # noqa: E402
from fe_squeal.decks.nastran import read as nastran  # noqa: E402

PAGE = ROOT / "docs/decks.md"
BEGIN, END = "<!-- {}: python benchmarks/decks.py --write -->\n", "<!-- end of {} -->\n"
_SAME = 5e-3  # of a frequency: smaller differences come from the elements: reduced integration there, 27 nodes here


def keyword_tables() -> str:
    """Return what the program does with each keyword of Abaqus."""
    silent = ", ".join(f"`*{word.title()}`" for word in sorted(keywords.SILENT))
    left_out = {f"*{word.title()}": why for word, why in keywords.LEFT_OUT.items()}
    return _tables("keyword", keywords.BECOMES, left_out, silent)


def card_tables() -> str:
    """Return what the program does with each card of Nastran."""
    names = [*sorted(nastran.SILENT), *(f"PARAM {name}" for name in sorted(parameters.SILENT))]
    left_out = nastran.LEFT_OUT | {f"PARAM {name}": why for name, why in parameters.LEFT_OUT.items()}
    return _tables("card", nastran.BECOMES, left_out, ", ".join(f"`{name}`" for name in names))


def command_tables() -> str:
    """Return what the program does with an Ansys archive."""
    return _tables("command", ansys.BECOMES, ansys.LEFT_OUT,
                   "all other commands, but for blocks (`...BLOCK`), which are asked for")  # fmt: skip


def _tables(what: str, becomes: dict[str, str], left_out: dict[str, tuple[str, Any]], silent: str) -> str:
    rows = [f"| `{k.replace(', ', '`, `')}` | {v} |" for k, v in becomes.items()]
    lines = [f"| {what} | becomes |", "|---|---|", *rows]
    lines += ["", "| left out | what that means |", "|---|---|"]
    by_text: dict[tuple[str, str], list[str]] = {}
    for word, (text, weight) in left_out.items():
        by_text.setdefault((text, weight), []).append(f"`{word}`")
    for (text, weight), words in by_text.items():
        asked = " **The scene does not run before this is settled.**" if weight == "missing" else ""
        lines.append(f"| {', '.join(words)} | {text}.{asked} |")
    return "\n".join([*lines, "", f"Passed over without a word: {silent}.", ""])


def calculix_table(outcomes: dict[str, Outcome]) -> str:
    """Return the table of CalculiX's decks."""
    states = [o.state for o in outcomes.values()]
    same = sum(o.off is not None and abs(o.off).max() <= _SAME for o in outcomes.values())
    lines = [
        f"Of {len(outcomes)} decks that ask for frequencies {states.count('compared')} are solved from the deck alone,"
        f" {same} of them with all frequencies within {100 * _SAME:g} %; {states.count('asked')} ask for something, and"
        f" {states.count('refused')} are refused in a sentence.",
        "", "| deck | frequencies off by | left out, asked for, or why not |", "|---|---|---|",
    ]  # fmt: skip
    for name, o in outcomes.items():
        off = "" if o.off is None else f"{o.off[abs(o.off).argmax()]:+.2%}"
        text = o.text if len(o.text) < 150 else o.text[:147] + "..."
        lines.append(f"| {name} | {off} | {text.replace('|', '/')} |")
    return "\n".join([*lines, ""])


def main() -> int:
    """Print or write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write docs/decks.md instead of printing it")
    arguments = parser.parse_args()
    sections = {"keywords": keyword_tables(), "cards": card_tables(), "commands": command_tables()}
    folder = decks_folder()
    if folder is None:
        print("calculix-ccx-test is not installed: its section stays as it is", file=sys.stderr)
    else:
        with tempfile.TemporaryDirectory() as place:
            decks = [deck for deck in unpack(folder, Path(place)) if asks_for_frequencies(deck)]
            sections["calculix"] = calculix_table({deck.stem: compare(deck) for deck in decks})
    text = PAGE.read_text(encoding="utf-8")
    for name, section in sections.items():
        before, _, rest = text.partition(BEGIN.format(name))
        after = rest.partition(END.format(name))[2]
        text = before + BEGIN.format(name) + "\n" + section + "\n" + END.format(name) + after
    if arguments.write:
        PAGE.write_text(text, encoding="utf-8")
    else:
        print("\n".join(sections.values()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
