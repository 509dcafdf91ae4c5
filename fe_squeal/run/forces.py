"""The table that shows the balance of forces under preload, and all that is doubtful of a scene before it is solved."""

from __future__ import annotations

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from ..assembly.discretisation import discretisation_of
from ..assembly.forces import PartForces, balance_warnings, force_balance
from ..problem.parameters import MU
from ..problem.problem import Problem

_ROUNDED = 1e-9  # of the largest force: smaller forces are shown as zero


def scene_warnings(problem: Problem, parts: list[PartForces] | None = None) -> list[str]:
    """Return what is doubtful of the scene of a problem, a sentence each: of its mesh, contacts, effects and forces.

    `parts` are those of `force_balance`, where they are known.
    """
    made = discretisation_of(problem)
    forces = balance_warnings(force_balance(problem) if parts is None else parts)
    return [*(made.warnings if made is not None else ()), *forces]


def balance_table(parts: list[PartForces], problem: Problem) -> Table | None:
    """Return a table of the forces, N, on each part of a problem and of their sum; None without preload."""
    if not parts:
        return None
    at = f" at μ = {problem.value(MU):.4g}" if MU in problem.parameters else ""
    table = Table(title=f"Balance of forces under preload{at}, N", title_justify="left", box=SIMPLE_HEAD)
    for head in ("on", "by", "x", "y", "z"):
        table.add_column(head, justify="left" if head in ("on", "by") else "right", no_wrap=True)
    for p in parts:
        rows = [("applied", p.applied)]
        rows += [(f"contact {name}", f) for name, f in p.contacts.items()]
        rows += [(f"spring {name}", f) for name, f in p.springs.items()]
        if p.held.any():
            rows.append(("supports", p.supports))
        largest = max(float(np.abs(f).max()) for _, f in rows)
        for i, (what, force) in enumerate(rows):
            shown = np.where(np.abs(force) > _ROUNDED * largest, force, 0.0)
            table.add_row(" + ".join(p.bodies) if not i else "", what, *(f"{c + 0.0:.5g}" for c in shown))
    return table
