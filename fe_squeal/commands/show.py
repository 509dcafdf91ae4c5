"""Commands that show results: report, animate, diff."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .shared import make_console

Results = Annotated[Path, typer.Argument(metavar="OUT", help="A folder of results.", show_default=False)]


def report(
    out: Results,
    file: Annotated[Path | None, typer.Option("-o", "--out", metavar="FILE.html", show_default=False)] = None,
) -> int:
    """Write the page of a finished run or study: the answer, charts, shapes that move, in one file."""
    from ..run.page import report_folder

    return report_folder(out, file, make_console())


def animate(
    out: Results,
    branch: Annotated[int | None, typer.Option(metavar="B", help="Of one branch alone.", show_default=False)] = None,
    file: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE.gif|FILE.mp4", show_default=False)
    ] = None,
) -> int:
    """Write one period of each shape as a film, into the folder of shapes or to a file."""
    from ..run.animate import animate_folder

    return animate_folder(out, branch, file, make_console())


def diff(
    folders: Annotated[list[Path], typer.Argument(metavar="OUT_A OUT_B ...", help="Results.", show_default=False)],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="DIFF", help="Where it goes.", show_default=False)
    ] = None,
) -> int:
    """Hold design variants side by side: modes paired by shape, what became better or worse."""
    from ..run.difference import compare_folders

    return compare_folders(folders, out or Path("diff"), make_console())
