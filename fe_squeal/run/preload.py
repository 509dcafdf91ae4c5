"""The static state under preload in the results: preload.csv, files for ParaView, pictures, and entries of run.json."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import skfem

from ..assembly.discretisation import Discretisation, discretisation_of
from ..effects.static_state import contact_summary, state_warnings
from ..fem.stress import von_mises
from ..problem.problem import Problem
from ..report.contact_face import ContactFace
from ..report.preload import export_preload
from ..report.shapes import ShapeGrid, shape_grid
from ..scene import MatrixScene, Scene
from ..sweep.result import Sweep


def write_preload(scene: Scene, problem: Problem, out: Path) -> list[Path]:
    """Write preload.vtu, preload_contacts.vtu and preload.png of the static state at the scene's own numbers."""
    discretisation = discretisation_of(problem)
    if discretisation is None or discretisation.static_state is None:
        return []
    base, space = discretisation.static_state, discretisation.space
    stress = np.zeros(space.mesh.nelements)
    for name, elements in discretisation.bodies.items():
        stress[elements] = von_mises(space, elements, scene.elasticity(name), base.u)
    kinds = dict(zip(scene.contact_names, (c.kind for c in scene.contacts), strict=True))
    faces = {}
    for name, state in base.contacts.items():
        c = discretisation.contacts[name]
        directions = c.directions if kinds[name] == "sliding" else np.zeros_like(c.directions)
        faces[name] = ContactFace(
            c.points, c.normals, directions, c.weights, state.pressure, state.closed, state.normal_force, state.torque
        )
    return export_preload(
        grid_of(discretisation), space.expand(base.u), faces, out, mu=base.mu, von_mises=stress, title=scene.title,
        units=scene.units,
    )  # fmt: skip


def preload_record(scene: Scene | MatrixScene, problem: Problem) -> dict[str, Any] | None:
    """Return forces (N), areas (m²) and pressures (Pa) of the static state at the scene's own numbers, for run.json.

    None without preload.
    """
    discretisation = discretisation_of(problem)
    if discretisation is None or discretisation.static_state is None or not isinstance(scene, Scene):
        return None
    base = discretisation.static_state
    return {
        "mu": base.mu,
        "load_n": base.load,
        "iterations": base.equilibrium.iterations,
        "residual": base.equilibrium.residual,
        "contacts": {
            name: {
                **contact_summary(discretisation.contacts[name], state),
                "force_on_pad_n": state.force,
            }
            for name, state in base.contacts.items()
        },
    }


def preload_dataframe(result: Sweep) -> pd.DataFrame | None:
    """Return the table preload.csv: the state of every pressed contact at every value; None without preload."""
    rows = [
        {"parameter": result.parameter, "value": point.value, "contact": name} | dict(numbers)
        for point in result.points
        for name, numbers in point.pressed.items()
    ]
    return pd.DataFrame(rows) if rows else None


def preload_warnings(result: Sweep, problem: Problem) -> list[str]:
    """Return a sentence for what the static state of a contact exceeds in a sweep, at the value where it is worst.

    What it exceeds at the scene's own numbers by as much was told before the sweep.
    """
    found = []
    for name in dict.fromkeys(name for point in result.points for name in point.pressed):
        for key in ("follower_ratio", "pulling"):
            own = problem.state.get(name, {}).get(key, 0.0)
            at, worst = max(((p.value, p.pressed[name][key]) for p in result.points if name in p.pressed),
                            key=lambda found: found[1])  # fmt: skip
            if worst > own * (1 + 1e-9):
                exceeded = {"follower_ratio": 0.0, "pulling": 0.0, key: worst}
                found += [f"at {result.parameter} = {at:g}, {text}" for text in state_warnings(name, **exceeded)]
    return found


def grid_of(discretisation: Discretisation) -> ShapeGrid:
    """Return the mesh on which shapes and fields are written, with the body of each element."""
    space, bodies = discretisation.space, discretisation.bodies
    basis = skfem.CellBasis(space.mesh, space.element, intorder=1, dofs=space.dofs)
    owner = np.zeros(space.mesh.nelements, int)
    for number, elements in enumerate(bodies.values()):
        owner[elements] = number
    return shape_grid(basis, owner, tuple(bodies))
