"""Commands about the lumped models: lumped, compare."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from ..errors import SceneError
from .shared import make_console


def lumped_models(
    model: Annotated[
        str, typer.Argument(metavar="MODEL", help="oscillator, minimal, two-mass, nine-dof or uncoupled-disc.")
    ],
    study: Annotated[str | None, typer.Option(help="A study by name, or all.", show_default=False)] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE ...", help="Parameters.", show_default=False)
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print eigenvalues and critical friction as JSON.")] = False,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Where a study goes.", show_default=False)] = None,
    more: Annotated[list[str] | None, typer.Argument(metavar="NAME=VALUE", help="Further parameters.")] = None,
) -> int:
    """Evaluate a lumped model, or run its studies."""
    import lumped as models

    given = [*(settings or []), *(more or [])]
    try:
        if study is not None:
            if given or as_json:
                raise SceneError("lumped: --study has its own parameters; expected neither --set nor --json beside it")
            from ..run.lumped import study_model

            paths = study_model(model, study, out or Path(f"lumped_{model}"))
            make_console().print("\n".join(f"wrote {p}" for p in paths), markup=False)
            return 0
        if out is not None:
            raise SceneError("lumped: -o says where a study goes; expected --study beside it")
        result = models.evaluate(model, models.parse_settings(given))
    except ValueError as error:
        raise SceneError(f"lumped: {error}") from error
    if as_json:
        print(json.dumps(result))
        return 0
    console = make_console()
    for re, im in result["eigenvalues"]:
        console.print(f"λ = {re:+.12g} {im:+.12g}i rad/s", markup=False)
    shown = ", ".join(f"{mu:.15g}" for mu in result["critical_mu"]) or "none"
    complete = result["critical_mu_complete"]
    console.print(f"critical μ: {shown}", markup=False)
    console.print(f"searched: {complete['what']}", markup=False)
    for sentence in complete["open"]:
        console.print(f"warning: {sentence}", markup=False)
    console.print(f"studies: {', '.join(models.STUDIES[model])}", markup=False)
    return 0


def compare(
    case: Annotated[str, typer.Argument(help="One case; all of them by default.")] = "all",
) -> int:
    """Hold finite-element models of the lumped systems against the lumped systems themselves."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from ..compare import compare as compare_cases
    from ..report.terminal import print_table

    frame = compare_cases(case)
    table = Table(box=SIMPLE_HEAD)
    for column in ("case", "quantity", "lumped", "FE", "difference"):
        table.add_column(column, justify="left" if column in ("case", "quantity") else "right", no_wrap=True)
    previous = ""
    for name, quantity, *values in frame.astype(object).itertuples(index=False, name=None):
        numbers = [f"{x:{form}}" for x, form in zip(values, (".9g", ".9g", ".1e"), strict=True)]
        table.add_row(name if name != previous else "", quantity, *("none" if n == "nan" else n for n in numbers))
        previous = name
    console = make_console()
    print_table(table, console)
    console.print("Of each spectrum the eigenvalue that differs most is shown; differences fall with 1/E.")
    console.print("The block sprung at its top is no mass point: its rotation takes part, and it does not flutter.")
    return 0
