"""Write where the error of the mesh comes from into the folder of a run."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..accuracy.groups import split_dataframe
from ..accuracy.quantities import Split
from ..assembly.assembly import Assembly
from ..assembly.discretisation import discretisation_of
from ..report.files import write_csv
from ..sweep.result import Sweep
from .folder import MESH_ERROR_FIGURE, MESH_ERROR_GRID, MESH_ERROR_PICTURE, MESH_ERROR_TABLE
from .preload import grid_of


def write_mesh_error(split: Split | None, result: Sweep, out: Path, title: str) -> None:
    """Write mesh_error.csv, its pictures and mesh_error.vtu; nothing if `split` is None."""
    assembly, discretisation = result.problem.source, discretisation_of(result.problem)
    if split is None or not split.names or not isinstance(assembly, Assembly) or discretisation is None:
        return
    from ..report.mesh_error import plot_mesh_error, plot_mesh_shares, worst_quantities
    from ..report.vtk_files import add_names, unstructured_grid, write_grid

    parts = split_dataframe(split, assembly)
    write_csv(parts, out / MESH_ERROR_TABLE)
    plot_mesh_error(parts, out / MESH_ERROR_FIGURE, title)
    grid = grid_of(discretisation)
    data = unstructured_grid(grid, grid.points)
    shown = worst_quantities(parts)
    add_names(data, "quantity", shown)
    shares = [np.abs(split.relative[split.names.index(name)]).sum(axis=1) for name in shown]
    for number, share in enumerate(shares):
        data.cell_data[f"part_{number}"] = share
    write_grid(data, out / MESH_ERROR_GRID)
    plot_mesh_shares(grid, shares[0], out / MESH_ERROR_PICTURE, shown[0], title)
