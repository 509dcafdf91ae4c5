"""What several commands share: arguments, and where they print."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from ..scene import MatrixScene, Scene

SceneFile = Annotated[Path, typer.Argument(metavar="SCENE.toml", help="The scene.", show_default=False)]
SceneOrDeck = Annotated[
    Path, typer.Argument(metavar="SCENE.toml", help="The scene, or a deck that has all of it.", show_default=False)
]


def out_option(own: str) -> Any:
    """Return the option -o of a command whose results go into a folder of this name without it."""
    return typer.Option("-o", "--out", help=f"The folder for results (default: {own}).", show_default=False)


def make_console() -> Console:
    """Return a console that leaves lines and numbers as they are."""
    from rich.console import Console

    return Console(highlight=False, soft_wrap=True, emoji=False, markup=False)  # names may have colons and brackets


def load_scene_or_deck(path: Path) -> Scene | MatrixScene:
    """Return the scene of a scene file or a deck, and print what of a deck is not taken over.

    Raises
    ------
    SceneError, MeshError
    """
    from ..decks.scene import scene_of

    scene, draft = scene_of(path)
    for text in () if draft is None else draft.told:
        make_console().print(text, markup=False)
    return scene
