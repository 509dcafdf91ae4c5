"""Show a sweep from Python: figures, a shape in 3-D, and a summary for notebooks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from ..assembly.discretisation import discretisation_of
from ..errors import SceneError
from ..report.damping import damping_figure
from ..report.figures import stability_figure
from ..report.files import save_figure
from ..sweep.point import SweepPoint
from ..sweep.result import Sweep
from .covered import above_text, found_range, unstable_above
from .preload import grid_of
from .record import mode_info
from .view import view_axis


def plot_stability(result: Sweep, path: str | Path | None = None) -> Figure:
    """See `Sweep.plot_stability`."""
    return _kept(stability_figure(result.to_dataframe(), result.onsets_dataframe()), path)


def plot_damping(result: Sweep, value: float | None = None, path: str | Path | None = None) -> Figure:
    """See `Sweep.plot_damping`."""
    return _kept(damping_figure(result.to_dataframe(), value), path)


def show(result: Sweep, branch: int, off_screen: bool = False) -> Any:
    """See `Sweep.show`."""
    import pyvista

    from ..report.pictures import AMPLITUDE_COLOURS
    from ..report.shape_names import shape_title
    from ..report.shapes import boundary_triangles, normalise_shape, semi_major_amplitude, sharp_edges
    from ..report.vtk_files import displacement_at

    discretisation = discretisation_of(result.problem)
    if discretisation is None:
        raise SceneError("show: the problem has matrices instead of a mesh; expected one of a scene with [mesh]")
    point, i = _fastest(result, branch)
    grid = grid_of(discretisation)
    shape = normalise_shape(discretisation.space.expand(point.shapes[i]))
    triangles = np.asarray(boundary_triangles(grid)[0], dtype=int)
    surface = pyvista.PolyData.from_regular_faces(grid.points + displacement_at(grid, shape, 0.0), triangles)
    surface.point_data["amplitude"] = semi_major_amplitude(shape)
    ends = sharp_edges(grid.points, triangles)
    edges = pyvista.PolyData(grid.points, lines=np.column_stack([np.full(len(ends), 2), ends]).ravel())
    plotter: Any = pyvista.Plotter(off_screen=off_screen or None)
    plotter.set_background("white")
    bar = {"title": "amplitude", "color": "black", "vertical": True}
    plotter.add_mesh(surface, scalars="amplitude", cmap=AMPLITUDE_COLOURS, smooth_shading=True, split_sharp_edges=True,
                     clim=(0.0, 1.0), scalar_bar_args=bar)  # fmt: skip
    plotter.add_mesh(edges, color="dimgray", opacity=0.6)
    letters = str(Path(matplotlib.get_data_path()) / "fonts/ttf/DejaVuSans.ttf")  # VTK's own fonts lack Greek letters
    plotter.add_text(shape_title(mode_info(result, point, i)), font_size=9, color="black", font_file=letters)
    plotter.enable_parallel_projection()
    axis = np.array(view_axis(discretisation))
    across = np.eye(3)[int(np.argmin(np.abs(axis)))]
    plotter.view_vector(axis * 0.7 + across + 0.8 * np.cross(axis, across), viewup=axis)
    plotter.camera.zoom(1.3)
    if not off_screen:
        plotter.show()
    return plotter


def html(result: Sweep) -> str:
    """Return HTML for a notebook: the answer in words, and tables of unstable modes and of onsets."""
    from ..report.page.markup import bullets, paragraph
    from ..report.page.sections import interval_table, onset_table
    from ..report.page.verdict import answer
    from ..report.results import Results
    from ..report.warnings import told_once

    above = unstable_above(result)
    beyond = [] if above is None else [above_text(above, result.parameter)]
    results = Results(
        {"completeness": {"proven": result.completeness.proven}, "problem_class": result.problem.problem_class,
         "frequency_range_hz": found_range(result)},
        result.to_dataframe(), result.onsets_dataframe(),
        result.contributions_dataframe(), result.sensitivities_dataframe(),
    )  # fmt: skip
    tables = interval_table(results) + onset_table(results)
    return "".join(paragraph(s) for s in answer(results)) + tables + bullets([*beyond, *told_once(result.warnings)])


def _fastest(result: Sweep, branch: int) -> tuple[SweepPoint, int]:
    """Return the point and the position of the mode where a branch grows fastest, of those whose shape is known.

    Raises
    ------
    SceneError
        No shape of this branch is known.
    """
    known = [(point, i) for point in result.points for i in point.shapes]
    own = [(point, i) for point, i in known if int(point.branches[i]) == branch]
    if not own:
        names = sorted({int(point.branches[i]) for point, i in known})
        listed = ", ".join(map(str, names)) or "none; those of unstable modes are kept, and all with keep_shapes=True"
        raise SceneError(f"show: given branch {branch!r}, whose shape is not known; known: {listed}")
    return max(own, key=lambda place: float(place[0].modes.lam[place[1]].real))


def _kept(figure: Figure, path: str | Path | None) -> Figure:
    if path is not None:
        save_figure(figure, path)
    return figure
