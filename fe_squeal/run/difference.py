"""What `fe-squeal diff` does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from rich.console import Console

from ..errors import OutputError, one_line
from ..report.files import write_csv, write_json
from .folder import (
    DIFFERENCE_FIGURE,
    DIFFERENCE_FILES,
    DIFFERENCE_RECORD,
    DIFFERENCE_TABLE,
    MODES_TABLE,
    REPORT,
    hold_folder,
)
from .page import read_run, write_difference_report


def compare_folders(folders: Sequence[Path], out: Path, console: Console) -> int:
    """Compare each folder of results with the first one, and write diff.csv, diff.png and the page; return 0.

    Raises
    ------
    OutputError
        There are fewer than two folders, one of them has no results or another swept parameter, or `out` is one of them
        or cannot be used.
    """
    from ..report.difference_figure import plot_differences
    from ..report.differences import compare_designs, sentences, symbol_of
    from ..report.tables import begins_unstable

    if len(folders) < 2:
        raise OutputError(f"diff: given {len(folders)} folder; expected two or more folders of results")
    for folder in folders:
        if not (folder / MODES_TABLE).is_file():
            raise OutputError(f"{folder}: has no {MODES_TABLE}; expected a folder that fe-squeal run has written")
    if out.resolve() in {folder.resolve() for folder in folders}:
        raise OutputError(f"{out}: is one of the folders to compare; expected another one for the comparison, by -o")
    names = _names(folders)
    results = [read_run(folder) for folder in folders]
    base, tables, lacks = results[0], [], [f"{n}: {s}" for n, r in zip(names, results, strict=True) for s in r.lacks]
    # A design without modes does not tell what it sweeps.
    telling = [(name, r) for name, r in zip(names, results, strict=True) if len(r.modes)] or [(names[0], base)]
    first, known = telling[0]
    for name, other in telling[1:]:
        if other.parameter != known.parameter:
            raise OutputError(
                f"{name}: sweeps {other.parameter}, and {first} sweeps {known.parameter}; expected the same parameter"
            )
    for name, other in zip(names[1:], results[1:], strict=True):
        table, said = compare_designs(base, other, (names[0], name))
        tables.append(table)
        lacks += [sentence for sentence in said if sentence not in lacks]
    kept = [t for t in tables if len(t)]
    whole, symbol = pd.concat(kept, ignore_index=True) if kept else tables[0], symbol_of(known)
    early = [begins_unstable(r.modes, r.onsets) for r in results]
    begun = {n: min(found.values()) for n, found in zip(names, early, strict=True) if found}
    answers, title = sentences(whole, names[1:], symbol, begun, lacks), f"{', '.join(names[1:])} beside {names[0]}"
    record = {"title": title, "symbol": symbol, "answers": answers, "lacks": lacks}
    with hold_folder(out, [folder / MODES_TABLE for folder in folders]) as held:
        held.check(lambda name: name in DIFFERENCE_FILES)
        write_csv(whole, out / DIFFERENCE_TABLE)
        write_json(record, out / DIFFERENCE_RECORD)
        plot_differences(whole, out / DIFFERENCE_FIGURE, symbol, title)
        write_difference_report(out, out / REPORT)
    for sentence in answers:
        console.print(sentence, markup=False)
    for sentence in lacks:
        console.print(f"note: {sentence}", markup=False)
    console.print(f"comparison in {out}: {REPORT}, {DIFFERENCE_FIGURE}, {DIFFERENCE_TABLE}", markup=False)
    return 0


def _names(folders: Sequence[Path]) -> list[str]:
    """Return a short name for each folder: its own name, with that of its parent in front if two are equal."""
    names = [one_line(folder.resolve().name) for folder in folders]
    if len(set(names)) < len(names):
        names = [one_line("/".join(folder.resolve().parts[-2:])) for folder in folders]
    return names if len(set(names)) == len(names) else [f"{name} ({i})" for i, name in enumerate(names, 1)]
