"""Write files and a picture of the static state under preload: displacement, stress and contact pressure."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fe_squeal.report.contact_face import ContactFace
from fe_squeal.report.shapes import Floats, ShapeGrid
from fe_squeal.report.vtk_files import add_names, unstructured_grid, write_grid


def export_preload(
    grid: ShapeGrid,
    displacement: Floats,
    contacts: Mapping[str, ContactFace],
    folder: str | os.PathLike[str],
    *,
    mu: float = np.nan,
    von_mises: Floats | None = None,
    title: str = "",
    units: str = "SI",
    picture: bool = True,
) -> list[Path]:
    """Write `preload.vtu` and, if there are contacts, `preload_contacts.vtu` and `preload.png`.

    `preload.vtu` has the point array `displacement` (m), the cell arrays `body` and `von_mises` (Pa), and the field
    data `body: NAME` and `contact: NAME` with the number of each body and contact, `mu`, and for each contact
    `normal_force` (N) and `torque` (N m).
    `preload_contacts.vtu` has every quadrature point as a vertex, with `contact` (the number in `contact: NAME`),
    `contact_pressure` (Pa), `closed` (0 or 1), `normal`, `sliding_direction` and `weight` (m²).

    Parameters
    ----------
    grid : ShapeGrid
        With n points and ne cells.
    displacement : (n, 3) float, m
    contacts : mapping of str to ContactFace
    folder : str or Path
        It is made if it is missing.
    mu : float
        Friction coefficient of the static state.
    von_mises : (ne,) float, Pa, optional
        Von Mises stress of each cell.
    title : str
        Text above the picture.
    units : "SI" or "any"
        Of the scene; with "any" the picture names none, and the files have the scene's own.
    picture : bool
        Whether to write the .png.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    ValueError
        An array does not fit the grid.
    OutputError
        A file cannot be written.
    """
    folder = Path(folder)
    if np.shape(displacement) != grid.points.shape:
        raise ValueError(f"displacement of shape {np.shape(displacement)}; expected {grid.points.shape}")
    data = unstructured_grid(grid, grid.points)
    data.point_data["displacement"] = np.ascontiguousarray(displacement, dtype=float)
    if von_mises is not None:
        if np.shape(von_mises) != (len(grid.cells),):
            raise ValueError(f"von_mises of shape {np.shape(von_mises)}; expected {(len(grid.cells),)}")
        data.cell_data["von_mises"] = np.asarray(von_mises, dtype=float)
    add_names(data, "body", grid.body_names)
    data.field_data["mu"] = [mu]
    if contacts:
        add_names(data, "contact", list(contacts))
        data.field_data["normal_force"] = [face.normal_force for face in contacts.values()]
        data.field_data["torque"] = [face.torque for face in contacts.values()]
    files = [write_grid(data, folder / "preload.vtu")]
    if contacts:
        files.append(write_contact_points(contacts, folder / "preload_contacts.vtu"))
    if contacts and picture:
        from fe_squeal.report.pressure import plot_pressure

        of = f"static state at μ = {mu:.4g}" if np.isfinite(mu) else ""  # which may be none of the sweep's values
        head = ", ".join(t for t in (title, of) if t)
        files.append(plot_pressure(contacts, folder / "preload.png", head, units))
    return files


def write_contact_points(contacts: Mapping[str, ContactFace], path: str | os.PathLike[str]) -> Path:
    """Write the quadrature points of all contacts as vertices of a .vtu file, as described at `export_preload`."""
    import pyvista

    faces = list(contacts.values())
    points = np.concatenate([face.points for face in faces])
    vertices = np.arange(len(points))[:, None]
    data = pyvista.UnstructuredGrid({pyvista.CellType.VERTEX: vertices}, points)
    sizes = [len(face.points) for face in faces]
    data.point_data["contact"] = np.repeat(np.arange(len(faces), dtype=np.int32), sizes)
    data.point_data["contact_pressure"] = np.concatenate([face.pressure for face in faces])
    data.point_data["closed"] = np.concatenate([face.closed for face in faces]).astype(np.uint8)
    data.point_data["normal"] = np.concatenate([face.normals for face in faces])
    data.point_data["sliding_direction"] = np.concatenate([face.directions for face in faces])
    data.point_data["weight"] = np.concatenate([face.weights for face in faces])
    add_names(data, "contact", list(contacts))
    return write_grid(data, Path(path))
