"""Draw mode shapes with VTK, off screen: `python -m fe_squeal.report.draw` reads a list of jobs from standard input.

`fe_squeal.report.pictures` runs it as a process of its own, since VTK ends the process where it cannot draw. The jobs
are JSON, `[{"shape": .vtu, "picture": .png, "title": ..., "axis": [x, y, z]}, ...]`. When a picture is complete, the
line `drawn <index>` is printed.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyvista
from numpy.typing import NDArray

from fe_squeal.report.pictures import AMPLITUDE_COLOURS, NORMAL_COLOURS, compose_figure
from fe_squeal.report.shapes import axis_frame
from fe_squeal.report.views import AxialView, choose_view, moving_triangles
from fe_squeal.report.vtk_files import VISIBLE, names_in

PIXELS = (1100, 860)
SUBDIVISION = 2  # each face of a quadratic cell becomes 4² triangles, so that curved shapes look curved


def draw_file(shape: Path, picture: Path, title: str, axis: list[float]) -> None:
    """Draw one shape file, as described at `fe_squeal.report.pictures.draw_shape`."""
    grid = pyvista.read(shape)
    frame = axis_frame(axis)
    size = float(grid.length)
    grid.points = grid.points @ frame.T
    real = grid.point_data["u_re"] @ frame.T
    body = np.asarray(grid.cell_data["body"])
    nodes = grid.cell_connectivity.reshape(grid.n_cells, -1)  # all cells are of one kind
    view = choose_view(np.asarray(grid.points), real, grid.point_data["amplitude"], nodes, body, frame)
    grid.point_data["u_n"] = view.values

    figure, left, right = compose_figure(title, names_in(grid, "body")[view.body], view, axis)
    left.imshow(_oblique_view(grid, real * VISIBLE * size), interpolation="antialiased")
    right.imshow(_axial_view(grid, body, view), interpolation="antialiased")
    figure.savefig(picture)  # the caller gives the name of an unfinished file, and renames it


def _oblique_view(grid: Any, displacement: NDArray[np.float64]) -> NDArray[np.uint8]:
    plotter = _plotter()
    warped = grid.copy()
    warped.points = grid.points + displacement
    plotter.add_mesh(_surface(warped), scalars="amplitude", clim=(0.0, 1.0), cmap=AMPLITUDE_COLOURS,
                     show_scalar_bar=False, smooth_shading=True, split_sharp_edges=True, ambient=0.2)
    plotter.add_mesh(_edges(grid), color="dimgray", line_width=1.5, opacity=0.6)
    return _shoot(plotter, (1.0, -1.3, 1.15), (0.0, 0.0, 1.0))


def _axial_view(grid: Any, body: NDArray[np.int64], view: AxialView) -> NDArray[np.uint8]:
    plotter, main, limit = _plotter(), view.body, view.limit
    surface = _surface(grid.extract_cells(np.flatnonzero(body == main)))
    plotter.add_mesh(surface, scalars="u_n", clim=(-limit, limit), cmap=NORMAL_COLOURS, show_scalar_bar=False,
                     lighting=False)
    plotter.add_mesh(_edges(surface), color="dimgray", line_width=1.0)
    lift = np.array([0.0, 0.0, 0.02 * view.side * grid.length])  # moves lines a little in front of their surface
    u_n = surface.point_data["u_n"]
    if u_n.min() < 0 < u_n.max() and np.ptp(u_n) > 1e-3:  # a body that moves to one side only has no nodal lines
        triangles = surface.triangulate().faces.reshape(-1, 4)[:, 1:]
        moving = moving_triangles(np.asarray(surface.points), triangles, u_n, surface.point_data["amplitude"])
        crossed = pyvista.PolyData.from_regular_faces(surface.points, triangles[moving])
        crossed.point_data["u_n"] = u_n
        lines = crossed.contour([0.0], scalars="u_n")
        if lines.n_points:
            plotter.add_mesh(lines.translate(lift), color="black", line_width=2.5)
    for other in np.setdiff1d(body, [main]):
        part = grid.extract_cells(np.flatnonzero(body == other))
        plotter.add_mesh(_edges(part).translate(2 * lift), color="black", line_width=1.2)
    return _shoot(plotter, (0.0, 0.0, float(view.side)), (0.0, 1.0, 0.0))


def _plotter() -> Any:
    plotter: Any = pyvista.Plotter(off_screen=True, window_size=list(PIXELS), lighting="light kit")
    plotter.set_background("white")
    plotter.enable_parallel_projection()
    plotter.enable_anti_aliasing("ssaa")
    return plotter


def _surface(grid: Any) -> Any:
    return grid.extract_surface(nonlinear_subdivision=SUBDIVISION)


def _edges(grid: Any) -> Any:
    surface = grid if isinstance(grid, pyvista.PolyData) else _surface(grid)
    return surface.extract_feature_edges(feature_angle=35, boundary_edges=True, non_manifold_edges=False,
                                         manifold_edges=False)


def _shoot(plotter: Any, towards: tuple[float, float, float], up: tuple[float, float, float]) -> NDArray[np.uint8]:
    """Return the picture seen from the direction `towards`, cropped to the part that is not white."""
    plotter.view_vector(towards, viewup=up)
    plotter.reset_camera()
    image: NDArray[np.uint8] = np.asarray(plotter.screenshot(None, return_img=True))[..., :3]
    plotter.close()
    inked = np.any(image < 250, axis=2)
    if not inked.any():
        raise RuntimeError("VTK drew an empty picture")
    rows, columns = np.flatnonzero(inked.any(axis=1)), np.flatnonzero(inked.any(axis=0))
    return image[max(rows[0] - 8, 0) : rows[-1] + 9, max(columns[0] - 8, 0) : columns[-1] + 9]


def main() -> None:
    """Draw the jobs on standard input."""
    pyvista.OFF_SCREEN = True
    jobs = json.load(sys.stdin)
    for i, job in enumerate(jobs):
        print("drawing", i, flush=True)  # raises, and so ends this process, if the run that asked for it was killed
        draw_file(Path(job["shape"]), Path(job["picture"]), job["title"], job["axis"])
        print("drawn", i, flush=True)


if __name__ == "__main__":
    main()
