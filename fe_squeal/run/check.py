"""What `fe-squeal check` shows of a scene without solving it."""

from __future__ import annotations

import numpy as np
from rich.table import Table

from ..assembly.discretisation import discretisation_of
from ..eigen.linear.processes import local_count
from ..fem.materials import Material
from ..mesh.measures import volume_of
from ..problem.parameters import MU
from ..problem.problem import Problem
from ..process.ranks import process_count
from ..report.units import ANY, with_unit
from ..scene import MatrixScene, Scene
from ..scene.faults import naming_file
from ..scene.solver import note_on_options, solver_of
from ..schema.place import Placed
from ..sweep.forecast import count_memory
from ..sweep.sweep import MODES, checked_values
from .fits import Machines, fits_here, fits_there


def describe(scene: Scene | MatrixScene, problem: Problem, machines: Machines | None = None) -> Table:
    """Return a table of bodies, groups, effects, problem class, size, and what fits here and on other machines.

    Raises
    ------
    SceneError
        The scene does not allow one of the values of its sweep.
    """
    solver = solver_of(scene)
    problem = problem.solved_with(solver)
    if scene.sweep is not None:
        with naming_file(scene):
            grid = checked_values(problem, scene.sweep.parameter, scene.sweep.grid)
            problem = problem.prepared(scene.sweep.parameter, grid)
    table = Table(show_header=False, box=None, pad_edge=False)
    if isinstance(scene, Scene):
        _mesh_rows(table, scene, problem)
    else:
        for term in problem.terms:
            kind = "symmetric" if term.symmetric else "skew" if term.skew else "nonsymmetric"
            table.add_row(term.name, f"{term.matrix.nnz} entries, {kind}")
        table.add_row("parameters", ", ".join(f"{k} = {v:g}" for k, v in scene.parameters.items()) or "none")
    table.add_row("effects on", ", ".join(scene.effect_names) or "none")
    table.add_row("problem class", problem.problem_class)
    discretisation = discretisation_of(problem)
    order = f" (order {discretisation.space.order})" if discretisation is not None else ""
    table.add_row("unknowns", f"{problem.unknowns}{order}")
    pencil = problem.pencil()
    table.add_row("matrix entries", f"{pencil.K.nnz}")
    free = 0 if pencil.free is None else pencil.free.motions.shape[1]
    table.add_row("free motions", f"{free} that nothing holds" if free else "none: everything is held")
    note = note_on_options(scene, solver)
    table.add_row("linear solver", solver.name if note is None else f"{solver.name}; {note}")
    sweep, solve = scene.sweep, scene.solve
    parameter, values = (MU, 1) if sweep is None else (sweep.parameter, len(sweep.grid))
    modes = solve.modes or MODES  # the number of modes below max_frequency is not known before the solve
    count = count_memory(problem, parameter, values, solve.method, solver)
    forecast = count.at(modes)
    guessed = f"; for {modes} modes, max_frequency may need more" if solve.modes is None and solve.max_frequency else ""
    here = f"; of {local_count()} processes on this machine" if process_count() > 1 else ""
    table.add_row("predicted memory", f"{forecast}{here}{guessed}")
    table.add_row("what fits here", fits_here(count, modes, forecast))
    if machines is not None:
        for name, text in fits_there(problem, count, modes, machines):
            table.add_row(name, text)
    return table


def _mesh_rows(table: Table, scene: Scene, problem: Problem) -> None:
    discretisation = discretisation_of(problem)
    assert discretisation is not None
    units = scene.units
    mesh = discretisation.space.mesh
    for name, elements in discretisation.bodies.items():
        material = scene.materials[scene.bodies[name].material]
        volume, _ = volume_of(mesh, elements)
        corners = mesh.p[:, np.unique(mesh.t[:, elements])]
        extent = ", ".join(f"{a:.4g} to {b:.4g}" for a, b in zip(corners.min(axis=1), corners.max(axis=1), strict=True))
        kind = "mixed elements" if scene.bodies[name].is_mixed else "elements"
        size, mass = f"{volume:.4g}", f"{volume * material.density:.4g}"
        size = f"volume {size}, mass {mass}; x, y, z" if units == ANY else f"{size} m3, {mass} kg; x, y, z in m"
        table.add_row(f"body {name}", f"{len(elements)} {kind} of {scene.bodies[name].material}, {size}: {extent}")
        table.add_row("", _values(material) + ("" if units == ANY else " (Pa, kg/m3)"))
    for i, support in enumerate(scene.supports):
        table.add_row(f"support {i + 1}", f"{_place(support)} fixed in {', '.join(support.fixed)}")
    for (key, tied), tie in zip(scene.ties, discretisation.space.ties, strict=False):
        at = with_unit(f"({', '.join(f'{x:.4g}' for x in tie.point)})", "m", units)
        kind = key.partition("[")[0]
        table.add_row(f"{kind} {tied.name}", f"{len(tie.nodes)} nodes of {_place(tied)}, reference at {at}")
    for spring in scene.springs:
        table.add_row(f"spring {spring.name}", f"{_place(spring)}{f' to {spring.to}' if spring.to else ''}")
    for name, c in discretisation.contacts.items():
        area = with_unit(f"{c.area:.4g}", "m2", units)
        table.add_row(f"contact {name}", f"{area} closed, {100 * c.coverage:.4g} % of the surface")
    if discretisation.static_state is not None:
        for name, state in discretisation.static_state.contacts.items():
            closed = discretisation.contacts[name].weights[state.closed].sum() / discretisation.contacts[name].area
            force = with_unit(f"{state.normal_force:.4g}", "N", units)
            pressure = with_unit(f"{state.pressure.max(initial=0.0):.4g}", "Pa", units)
            table.add_row(
                f"preload {name}",
                f"{100 * closed:.4g} % of it presses with {force}, at most {pressure}"
                f" (mu = {discretisation.static_state.mu:g})",
            )
    # Names alone; sizes and places are shown by --groups.
    table.add_row("volume groups", ", ".join(mesh.subdomains or {}))
    table.add_row("surface groups", ", ".join(mesh.boundaries or {}))


def _place(table: Placed) -> str:
    return table.group if table.kind == "surface" else f"nodes {table.group}"


def _values(material: Material) -> str:
    """Return a material's values with their symbols."""
    parts = []
    for value, labels in (
        (material.youngs_modulus, ("E1", "E2", "E3")),
        (material.shear_modulus, ("G23", "G13", "G12")),
        (material.poisson_ratio, ("nu23", "nu13", "nu12")),
    ):
        if isinstance(value, list):
            parts += [f"{label} = {v:g}" for label, v in zip(labels, value, strict=True)]
        elif value is not None:
            parts.append(f"{labels[0].rstrip('0123456789')} = {value:g}")
    return ", ".join([*parts, f"rho = {material.density:g}"])
