"""Pictures of mode shapes: two views side by side, drawn in a process of their own.

If VTK cannot get an OpenGL context, it may end the whole process. So all pictures of a run are drawn by one child
process with a time limit (`fe_squeal.report.draw`). Pictures that it did not draw are drawn here by Matplotlib, more
plainly.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from fe_squeal.process.isolation import isolated_environment
from fe_squeal.report.branches import figure_text
from fe_squeal.report.files import replace_atomically, save_figure, temporary_path
from fe_squeal.report.shapes import (
    Complexes,
    ShapeGrid,
    axis_frame,
    boundary_triangles,
    normalise_shape,
    semi_major_amplitude,
    sharp_edges,
)
from fe_squeal.report.views import AxialView, choose_view, moving_triangles, seen_text
from fe_squeal.report.vtk_files import VISIBLE, displacement_at, write_shape

AMPLITUDE_COLOURS, NORMAL_COLOURS = "viridis", "RdBu_r"
Z_AXIS = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class PictureJob:
    """One picture to draw: the shape file to read, the .png to write, the text above it, the axis to look along."""

    shape: Path
    picture: Path
    title: str
    axis: tuple[float, float, float] = Z_AXIS


def draw_shape(
    grid: ShapeGrid,
    u: Complexes,
    path: str | os.PathLike[str],
    title: str = "",
    axis: tuple[float, float, float] = Z_AXIS,
) -> str:
    """Draw one shape as .png and return the renderer: "pyvista", or "matplotlib" if VTK cannot draw here.

    Left: all bodies seen obliquely from above, displaced by Re u (at most 5 % of the model's size) and coloured by
    amplitude, with the edges at rest in grey. Right: of the bodies that move the one that is widest across `axis`, seen
    along the axis and coloured by its displacement along it, or in the plane where that is nearly all, with nodal lines
    in black and the outlines of the other bodies, so that nodal diameters can be counted.

    Parameters
    ----------
    grid : ShapeGrid
        With n points.
    u : (n, 3) complex
        Displacements of any phase and size; they are normalised.
    path : str or Path
        The .png to write.
    title : str
    axis : (3,) float
        Axis of the disc, or normal of the belt.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        job = PictureJob(write_shape(grid, u, Path(folder) / "shape.vtu"), path, title, axis)
        return draw_shapes(grid, [u], [job])[0]


def draw_shapes(
    grid: ShapeGrid, shapes: Sequence[Complexes], jobs: Sequence[PictureJob], seconds: float | None = None
) -> list[str]:
    """Draw several shapes in one child process; return the renderer of each, "pyvista" or "matplotlib".

    Parameters are those of `drawing_shapes`.
    """
    with drawing_shapes(grid, shapes, jobs, seconds) as renderers:
        pass
    return renderers


@contextmanager
def drawing_shapes(
    grid: ShapeGrid, shapes: Sequence[Complexes], jobs: Sequence[PictureJob], seconds: float | None = None
) -> Iterator[list[str]]:
    """Draw several shapes in one child process while the block does something else.

    Pictures that the child did not draw within its time limit are drawn by Matplotlib, after a warning that says why.
    If the block raises an error, the child is ended.

    Parameters
    ----------
    grid : ShapeGrid
    shapes : sequence of (n, 3) complex
        The shape of each job, for Matplotlib.
    jobs : sequence of PictureJob
        Their shape files have to be written already.
    seconds : float, s, optional
        The time limit (default: 60 s, and 20 s for each picture).

    Yields
    ------
    list of str
        Empty; after the block the renderer of each picture, "pyvista" or "matplotlib".
    """
    renderers: list[str] = []
    if not jobs:
        yield renderers
        return
    with _child_that_draws(jobs, 60.0 + 20.0 * len(jobs) if seconds is None else seconds) as finish:
        yield renderers
        drawn, reason = finish()
    missing = [i for i in range(len(jobs)) if i not in drawn]
    if missing:
        message = f"{len(missing)} of {len(jobs)} pictures of shapes are drawn by Matplotlib, more plainly: {reason}"
        warnings.warn(message, RuntimeWarning, stacklevel=3)
    for i in missing:
        _draw_with_matplotlib(grid, shapes[i], jobs[i])
    renderers += ["pyvista" if i in drawn else "matplotlib" for i in range(len(jobs))]


@contextmanager
def _child_that_draws(jobs: Sequence[PictureJob], seconds: float) -> Iterator[Callable[[], tuple[set[int], str]]]:
    """Start the child; what is yielded waits for it, and returns which jobs it drew, and why it did not draw others."""
    # Absolute, since the child has another working folder.
    unfinished = [temporary_path(job.picture.absolute()).absolute() for job in jobs]
    limit = time.monotonic() + seconds
    with ExitStack() as stack:
        # Files instead of pipes: writing to a pipe whose reader has died could end this process too, nobody reads what
        # the child says before it ends, and what it has started may hold a pipe open.
        try:
            files = [stack.enter_context(tempfile.TemporaryFile()) for _ in range(3)]
            child, reason = _started(jobs, unfinished, *files)
        except OSError as error:  # no folder for them, or a full disc
            files, child, reason = [], None, f"no process could be started ({error})"

        def finish() -> tuple[set[int], str]:
            if child is None:
                return set(), reason
            done = _is_done(child, limit)
            output, why = (_text_of(file) for file in files[1:])
            last = f": {why.strip().splitlines()[-1]}" if why.strip() else ""
            ended = f"ended with code {child.returncode}{last}" if done else f"was not done after {seconds:.0f} s"
            # The child prints the number of each complete picture; VTK may print other things.
            drawn = {int(line.split()[1]) for line in output.splitlines() if line.startswith("drawn ")}
            drawn = {i for i in drawn if unfinished[i].exists()}
            for i in drawn:
                with replace_atomically(jobs[i].picture) as temporary:
                    os.replace(unfinished[i], temporary)
            return drawn, f"VTK's process {ended}"

        try:
            yield finish
        finally:
            if child is not None:
                child.kill()
                child.wait()
            for path in unfinished:
                path.unlink(missing_ok=True)


def _started(
    jobs: Sequence[PictureJob], unfinished: Sequence[Path], orders: IO[bytes], said: IO[bytes], errors: IO[bytes]
) -> tuple[subprocess.Popen[bytes] | None, str]:
    """Return the child, or None and why it could not be started."""
    if not sys.executable:
        return None, "no Python interpreter to start"
    given = [{"shape": str(job.shape.absolute()), "picture": str(picture), "title": job.title,
              "axis": list(job.axis)} for job, picture in zip(jobs, unfinished, strict=True)]  # fmt: skip
    os.write(orders.fileno(), json.dumps(given).encode())  # nothing is left to be written when the file is closed
    orders.seek(0)
    command = [sys.executable, "-m", "fe_squeal.report.draw"]
    return subprocess.Popen(
        command, stdin=orders, stdout=said, stderr=errors, env=isolated_environment(), cwd=Path(__file__).parent
    ), ""


def _is_done(child: subprocess.Popen[bytes], limit: float) -> bool:
    """Wait for a child until a time, and return whether it has ended by itself; else it is ended."""
    try:
        child.wait(max(limit - time.monotonic(), 0.0))
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()
        return False
    return True


def _text_of(file: IO[bytes]) -> str:
    """Return all that another process wrote to a file."""
    file.seek(0)
    return file.read().decode(errors="replace")


def compose_figure(title: str, body_name: str, view: AxialView, axis: Sequence[float]) -> tuple[Figure, Axes, Axes]:
    """Return a figure with titles and colour bars, and the axes for the left and the right view."""
    figure = Figure(figsize=(12, 6), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle("\n".join(figure_text(line) for line in title.split("\n")), fontsize=13)
    name, seen = figure_text(body_name), [view.side * x for x in axis]
    left, right = figure.subplots(1, 2)
    for axes, text, colours, low, label in (
        (left, f"real part, warped to {VISIBLE:.0%} of the model's size", AMPLITUDE_COLOURS, 0.0,
         "amplitude over a period / largest"),
        (right, f"{name}, {seen_text(seen)}; nodal lines black", NORMAL_COLOURS, -view.limit,
         f"{view.label}, Re u / largest amplitude"),
    ):
        axes.set_title(text, fontsize=10)
        axes.set_axis_off()
        scale = ScalarMappable(Normalize(low, view.limit if low else 1.0), colours)
        figure.colorbar(scale, ax=axes, orientation="horizontal", shrink=0.7, aspect=35, pad=0.02, label=label,
                        ticks=MaxNLocator(4))
    return figure, left, right


def _draw_with_matplotlib(grid: ShapeGrid, u: Complexes, job: PictureJob) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    frame = axis_frame(job.axis)
    shape = normalise_shape(u)
    points = grid.points @ frame.T
    warped = points + displacement_at(grid, shape, 0.0) @ frame.T
    view = choose_view(points, shape.real @ frame.T, semi_major_amplitude(shape), grid.cells, grid.body, frame)
    main, limit, values = view.body, view.limit, view.values
    figure, left, right = compose_figure(job.title, grid.body_names[main], view, job.axis)

    triangles, _ = boundary_triangles(grid)
    solid = figure.add_subplot(left.get_subplotspec(), projection="3d", computed_zorder=False)
    colours = colormaps[AMPLITUDE_COLOURS](semi_major_amplitude(shape)[triangles].mean(axis=1))
    # Shading is computed here, since Matplotlib's own needs normals that all point outwards.
    a, b, c = warped[triangles].swapaxes(0, 1)
    normal = np.cross(b - a, c - a)
    light = np.abs(normal @ [0.3, -0.4, 0.87]) / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    colours[:, :3] *= (0.6 + 0.4 * light)[:, None]
    solid.add_collection3d(Poly3DCollection(warped[triangles], facecolors=colours, edgecolors=colours, linewidths=0.2))
    low, high = warped.min(axis=0), warped.max(axis=0)
    solid.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    solid.set_box_aspect(np.maximum(high - low, 1e-3 * (high - low).max()), zoom=1.25)
    solid.view_init(elev=35, azim=-60)
    solid.set_axis_off()

    triangles, _ = boundary_triangles(grid, main)
    points = points * [view.side, 1.0, view.side]  # turned about y where it is seen from below
    # Triangles are drawn in the order of their depth, the nearest last.
    triangles = triangles[np.argsort(points[triangles, 2].mean(axis=1))]
    shades = colormaps[NORMAL_COLOURS](Normalize(-limit, limit)(values[triangles].mean(axis=1)))
    flat = list(points[triangles, :2])
    right.add_collection(PolyCollection(flat, facecolors=shades, edgecolors=shades, linewidths=0.2))
    upper = triangles[points[triangles, 2].min(axis=1) > points[triangles, 2].mean()]
    if len(upper) and np.ptp(values[upper]) > 1e-3:
        moving = moving_triangles(points, upper, values, semi_major_amplitude(shape))
        if moving.any():
            face = Triangulation(points[:, 0], points[:, 1], upper, mask=~moving)
            right.tricontour(face, values, levels=[0.0], colors="black", linewidths=1.5)
    for part in np.unique(grid.body):
        edges = sharp_edges(points, boundary_triangles(grid, int(part))[0])
        right.add_collection(LineCollection(list(points[edges, :2]), colors="0.2", linewidths=0.7))
    right.set_aspect("equal")
    right.autoscale_view()
    figure.text(0.995, 0.99, "drawn without OpenGL", ha="right", va="top", fontsize=7, color="0.5")
    save_figure(figure, job.picture)
