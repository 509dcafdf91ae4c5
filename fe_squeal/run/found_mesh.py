"""What is told of a mesh that was searched for: the meshes tried for it, and how a scene uses it again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from ..accuracy.choose import Choice
from ..assembly.contacts import closed_by_default
from ..report.terminal import print_table
from ..scene import Scene
from .folder import MESH

_MESH = 44  # characters of the words for a mesh in one line of a table, which then fits into 80


def print_trials(choice: Choice, target: float, console: Console) -> None:
    """Print the meshes that were tried, and what each cost."""
    table = Table(title=f"Meshes tried for {100 * target:g} %", title_justify="left", box=SIMPLE_HEAD)
    table.add_column("mesh", max_width=_MESH)
    for head in ("unknowns", "error, %", "seconds"):
        table.add_column(head, justify="right")
    for t in choice.trials:
        error = f"{100 * t.error:.2g}" if np.isfinite(t.error) else "not known"
        table.add_row(t.mesh, str(t.unknowns), error, f"{t.seconds:.1f}")
    print_table(table, console)


def used_again(choice: Choice, scene: Scene, out: Path) -> str:
    """Return a sentence on how to use the mesh that was found in a scene."""
    geometry = choice.scene.mesh.geometry
    closed = ", ".join(closed_by_default(choice.result.problem, scene, choice.scene))
    order = f"order = {choice.scene.mesh.order}{f' and {closed}' if closed else ''}"
    text = f"the mesh is {out / MESH}; with {order}, [mesh] takes it as its file"
    if geometry is None or geometry.element != "hex":
        return text
    counts = (f"{key} = {line.elements}" for key, line in geometry.lines.items())
    # The numbers include the scene's refinement, by which its own table would multiply them once more.
    own = scene.mesh.geometry
    whole = ["refinement = 1"] if own is not None and own.refinement != 1 else []
    alone = " and without its file" if scene.mesh.file is not None else ""
    return (
        f"{text}, or the scene's own table of the geometry{alone} with"
        f" {', '.join([*counts, *whole, *geometry.placing])}"
    )
