"""What several commands share: arguments, and where they print."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console

SceneFile = Annotated[Path, typer.Argument(metavar="SCENE.toml", help="The scene.", show_default=False)]
Out = Annotated[Path | None, typer.Option("-o", "--out", help="Where the results go.", show_default=False)]


def make_console() -> Console:
    """Return a console that leaves lines and numbers as they are."""
    from rich.console import Console

    return Console(highlight=False, soft_wrap=True)
