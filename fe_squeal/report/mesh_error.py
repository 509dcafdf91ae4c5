"""Figures of where the error of the mesh comes from, of the quantities that it is largest in."""

from __future__ import annotations

import os
import textwrap
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from fe_squeal.report.branches import figure_text
from fe_squeal.report.files import save_figure
from fe_squeal.report.shapes import ShapeGrid

MAX_QUANTITIES = 4
MAX_ROWS = 16
MAX_BODIES = 6
_COLOURS = ("#1b4965", "#d1495b", "#edae49", "#66a182")
_WHOLE = "all"  # the direction of tetrahedra in mesh_error.csv: they have no axes to tell apart
_PLACES = {
    "edge": "elements at singular edges", "support": "other elements at supports", "contact": "elements at contacts",
    "elsewhere": "other elements",
}  # fmt: skip
# Number of corners of a cell, and its faces by these, in VTK's order; the key is whether cells are hexahedra.
_FACES = {
    True: (8, ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))),
    False: (4, ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3))),
}


def plot_mesh_error(parts: pd.DataFrame, path: str | os.PathLike[str], title: str = "") -> Path:
    """Draw what each body and direction, and each place, adds to the change by refinement of up to four quantities.

    The quantity with the largest change of each kind (onsets, growth, frequencies) is shown, then the next largest of
    any kind.

    Parameters
    ----------
    parts : DataFrame
        As in `mesh_error.csv`.
    path : path
        Where to write; the suffix chooses the format (png, pdf, svg).

    Returns
    -------
    Path
        The file written.
    """
    return save_figure(mesh_error_figure(parts, title), path)


def worst_quantities(parts: pd.DataFrame, count: int = MAX_QUANTITIES) -> list[str]:
    """Return the names of the quantities that refinement changes most: first one of each kind, then any."""
    known = parts.drop_duplicates("quantity").assign(size=lambda t: (t["change"] / t["scale"]).abs())
    known = known.sort_values("size", ascending=False, kind="stable")
    first = known.drop_duplicates("kind")["quantity"].tolist()
    names = first + [q for q in known["quantity"] if q not in first]
    shown = set(names[:count])
    return [q for q in known["quantity"] if q in shown]


def mesh_error_figure(parts: pd.DataFrame, title: str = "") -> Figure:
    """Return the figure that `plot_mesh_error` writes: by body and direction, and below by place."""
    shown = worst_quantities(parts)
    table = parts[parts["quantity"].isin(shown)].assign(
        relative=lambda t: 100 * t["part"] / t["scale"],
        where=lambda t: np.where(t["direction"] == _WHOLE, t["body"], t["body"] + ", " + t["direction"]),
    )
    tables = [_rows(table, "where", shown)]
    if "place" in table:  # which folders of earlier versions lack
        tables.append(_rows(table.replace({"place": _PLACES}), "place", shown))
    sizes = [len(rows) for rows in tables]
    figure = Figure(figsize=(9.0, 2.3 + 0.42 * sum(sizes) + 0.3 * len(shown)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(tables), 1, sharex=True, height_ratios=sizes, squeeze=False)[:, 0]
    changes = table.drop_duplicates("quantity").set_index("quantity")
    relative = 100 * changes["change"] / changes["scale"]
    labels = [figure_text(f"{quantity}: {relative[quantity]:+.2g} % in all") for quantity in shown]
    for axes, rows in zip(panels, tables, strict=True):
        _bars(axes, rows, labels)
    panels[-1].set_xlabel("part of the change when every element is cut into eight, %")
    heads = [textwrap.fill(figure_text(title), 90)] if title else []
    panels[0].set_title("\n".join([*heads, "Where the error of the mesh comes from"]), loc="left", fontsize=11)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower left", fontsize=9, frameon=False)
    return figure


def _rows(table: pd.DataFrame, by: str, shown: list[str]) -> pd.DataFrame:
    """Return the sums of parts, % of each quantity in a column, of the largest `MAX_ROWS` groups."""
    rows = table.pivot_table(index=by, columns="quantity", values="relative", aggfunc="sum", sort=False)[shown]
    largest = rows.abs().max(axis=1).sort_values(ascending=False, kind="stable").index[:MAX_ROWS]
    return rows.loc[[where for where in rows.index if where in largest]]


def _bars(axes: Axes, rows: pd.DataFrame, labels: list[str]) -> None:
    """Draw one group of bars for each row, with a bar of each quantity."""
    height = 0.8 / max(len(labels), 1)
    at = np.arange(len(rows))
    for i, (quantity, label) in enumerate(zip(rows.columns, labels, strict=True)):
        axes.barh(at + (i - (len(labels) - 1) / 2) * height, rows[quantity], height, label=label, color=_COLOURS[i])
    axes.axvline(0, color="0.3", linewidth=0.8)
    axes.set_yticks(at, [textwrap.fill(figure_text(str(where)), 30) for where in rows.index])
    axes.invert_yaxis()
    axes.grid(axis="x", color="0.9")
    axes.set_axisbelow(True)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)


def plot_mesh_shares(
    grid: ShapeGrid, share: np.ndarray, path: str | os.PathLike[str], quantity: str, title: str = ""
) -> Path:
    """Draw each body's surface, every element coloured by its part of the error of one quantity.

    Parameters
    ----------
    grid : ShapeGrid
    share : (ne,) float
        |Part| of each of the ne elements, relative to the scale of the quantity.
    path : str or Path
        The file to write; its suffix chooses the format (png, pdf, svg).
    quantity : str
        Name of the quantity.
    title : str

    Returns
    -------
    Path
        The file written.
    """
    return save_figure(mesh_shares_figure(grid, share, quantity, title), path)


def mesh_shares_figure(grid: ShapeGrid, share: np.ndarray, quantity: str, title: str = "") -> Figure:
    """Return the figure that `plot_mesh_shares` writes, of at most six bodies: those with the largest parts."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    held = np.bincount(grid.body, weights=share, minlength=len(grid.body_names))
    bodies = sorted(np.argsort(-held, kind="stable")[:MAX_BODIES].tolist())
    columns = min(3, len(bodies))
    rows = -(-len(bodies) // columns)
    figure = Figure(figsize=(3.6 * columns + 1.2, 3.4 * rows + 0.9), layout="constrained")
    FigureCanvasAgg(figure)
    scale = Normalize(0.0, 100 * float(share.max(initial=0.0)) or 1.0)
    colours = colormaps["magma_r"]
    panels = []
    for place, body in enumerate(bodies, 1):
        axes = figure.add_subplot(rows, columns, place, projection="3d")
        faces, owners = _surface(grid, np.flatnonzero(grid.body == body))
        axes.add_collection3d(Poly3DCollection(
            faces, facecolors=colours(scale(100 * share[owners])), edgecolors="0.4", linewidths=0.2))  # fmt: skip
        points = faces.reshape(-1, 3)
        low, high = points.min(axis=0), points.max(axis=0)
        for set_limits, a, b in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), low, high, strict=True):
            set_limits(a, b)
        # An oblong body then fills the panel, and is not cut off.
        axes.set_box_aspect(np.maximum(high - low, 0.02 * (high - low).max()), zoom=0.94)
        axes.view_init(elev=40, azim=-60)
        axes.set_axis_off()
        axes.set_title(f"{figure_text(grid.body_names[body])}: {100 * held[body] / max(held.sum(), 1e-300):.0f} %",
                       fontsize=10)  # fmt: skip
        panels.append(axes)
    bar = figure.colorbar(ScalarMappable(scale, colours), ax=panels, shrink=0.7, pad=0.02)
    bar.set_label("part of an element, % of the quantity")
    heads = [textwrap.fill(figure_text(title), 90)] if title else []
    figure.suptitle("\n".join([*heads, figure_text(f"Error of the mesh in the {quantity}")]), fontsize=11)
    return figure


def _surface(grid: ShapeGrid, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners (f, c, 3), m, of the faces on the surface of some cells, and the cell of each face (f,)."""
    corners, faces = _FACES[grid.vtk_cell_type in (12, 29, 72)]
    nodes = np.concatenate([grid.cells[cells][:, :corners][:, list(face)] for face in faces])
    owners = np.tile(cells, len(faces))
    _, index, count = np.unique(np.sort(nodes, axis=1), axis=0, return_index=True, return_counts=True)
    outside = index[count == 1]
    return np.asarray(grid.points[nodes[outside]]), owners[outside]
