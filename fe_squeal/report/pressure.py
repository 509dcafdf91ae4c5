"""Picture of the contact pressure: the face of each contact, seen along its normal."""

from __future__ import annotations

import math
import os
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch
from matplotlib.patheffects import Normal, Stroke
from matplotlib.tri import Triangulation
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError, cKDTree

from fe_squeal.report.branches import figure_text
from fe_squeal.report.contact_face import ContactFace
from fe_squeal.report.files import save_figure
from fe_squeal.report.shapes import Floats, axis_frame
from fe_squeal.report.units import drawn_length, force_text, in_brackets, pressure_unit, with_unit
from fe_squeal.report.views import direction_text, seen_text

MAX_COLUMNS = 3
FACE_INCHES = 3.6  # length of the longer side of a face, in
DRAWINGS = 5  # at most, until everything is inside the picture
PIXELS = 500  # pixels along the longer side of a face
COLOURS, OPEN_COLOUR, PULLING_COLOUR = "viridis", "0.78", "tab:red"
LARGEST_TRIANGLE = 1.25  # times the mean area that its corners stand for: a larger triangle is not on the face
_RING = 0.5  # length of the mean of the unit sliding directions: if it is shorter, one arrow cannot show them


def plot_pressure(
    contacts: Mapping[str, ContactFace], path: str | os.PathLike[str], title: str = "", units: str = "SI"
) -> Path:
    """Draw the pressure on the face of each contact in a panel, seen from the pad along the mean normal.

    Every pixel has the value at the nearest quadrature point. The closed part is coloured, on one scale for all
    contacts that starts at 0, and the open part is grey. A face is drawn as far as its outermost quadrature points. The
    arrow points along the sliding of the counterface.

    Parameters
    ----------
    contacts : mapping of name to ContactFace
        At least one.
    path : path
        Where to write; the suffix chooses the format (png, pdf, svg).
    units : "SI" or "any"
        Of the scene. Pictures in SI units are in mm; with "any" numbers stay as they are, and no unit is named.

    Returns
    -------
    Path
        The file written.
    """
    return save_figure(pressure_figure(contacts, title, units), path)


def pressure_figure(contacts: Mapping[str, ContactFace], title: str = "", units: str = "SI") -> Figure:
    """Return the figure that `plot_pressure` writes."""
    peak = max(_peak(face) for face in contacts.values())
    pulls = any((face.pressure[face.closed] < 0).any() for face in contacts.values())
    unit, size = pressure_unit(peak, units)
    scale = Normalize(0.0, peak / size if peak > 0 else 1.0)
    colours = colormaps[COLOURS].with_extremes(under=PULLING_COLOUR, bad=OPEN_COLOUR)

    columns = min(len(contacts), MAX_COLUMNS)
    rows = math.ceil(len(contacts) / columns)
    texts = [_describe(name, face, units) for name, face in contacts.items()]
    sizes = np.array([_panel_size(*pair) for pair in zip(contacts.values(), texts, strict=True)])
    width, heights = sizes[:, 0].max() * columns + 1.2, [sizes[i * columns :][:columns, 1].max() for i in range(rows)]
    head = textwrap.fill(figure_text(title), int(11 * width))
    figure = Figure(figsize=(width, sum(heights) + 0.7 + 0.2 * len(head.split("\n"))), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(head, fontsize=11)
    panels = figure.subplots(rows, columns, squeeze=False, gridspec_kw={"height_ratios": heights}).ravel()
    for axes in panels[len(contacts) :]:
        axes.set_axis_off()
    slides = []
    for axes, face, text in zip(panels, contacts.values(), texts, strict=False):
        axes.set_title(text, fontsize=9)
        slides.append(_draw_face(axes, face, colours, scale, size, units))
    label = in_brackets("contact pressure", unit, units)
    figure.colorbar(ScalarMappable(scale, colours), ax=panels.tolist(), label=label,
                    extend="min" if pulls else "neither", shrink=0.8, aspect=30, pad=0.02)
    keys: list[Any] = []
    if any(not face.closed.all() for face in contacts.values()):
        keys.append(Patch(color=OPEN_COLOUR, label="open"))
    if pulls:
        keys.append(Patch(color=PULLING_COLOUR, label="pulls (held closed)"))
    if any(slides):
        keys.append(Line2D([], [], ls="", marker=r"$\rightarrow$", ms=14, mfc="black", mec="black",
                           label="sliding of the counterface"))  # fmt: skip
    if keys:
        figure.legend(handles=keys, loc="outside lower center", ncols=len(keys), fontsize=9, frameon=False)
    # Faces keep their shape, and so become smaller than their panels: each drawing moves the colour bar a little, and
    # the first one does not know of titles and keys yet. Of the others the first one inside the picture is kept.
    figure.draw_without_rendering()
    for _ in range(DRAWINGS - 1):
        figure.draw_without_rendering()
        drawn = figure.get_tightbbox()
        if drawn.x0 >= 0 and drawn.y0 >= 0 and drawn.x1 <= figure.bbox_inches.x1 and drawn.y1 <= figure.bbox_inches.y1:
            figure.set_layout_engine("none")
            break
    return figure


def face_frame(face: ContactFace) -> Floats:
    """Return the frame (3, 3) of a drawn face: rows to the right, up, and towards the viewer along the mean normal."""
    mean = face.weights @ face.normals / face.weights.sum()
    # A face that closes on itself, such as a cylinder, has no mean normal: it is seen from where the pressure is
    # highest.
    return axis_frame(mean if np.linalg.norm(mean) > 0.05 else face.normals[np.argmax(face.pressure)])


def _peak(face: ContactFace) -> float:
    return float(face.pressure[face.closed].max(initial=0.0))


def _draw_face(axes: Axes, face: ContactFace, colours: Colormap, scale: Normalize, size: float, units: str) -> bool:
    """Draw one panel; return whether it has arrows."""
    frame = face_frame(face)
    length = drawn_length(units)
    points, directions = length * face.points @ frame[:2].T, face.directions @ frame[:2].T
    tilt = face.normals @ frame[2]
    near = tilt > 0  # points whose normals point away from the viewer are hidden
    values = np.where(face.closed, face.pressure / size, np.nan)
    image, extent = _nearest_values(points[near], length**2 * (face.weights * tilt)[near], values[near])
    # The open part is NaN, which `colours` shows in grey; beside the face nothing is drawn.
    pixels = colours(scale(np.ma.masked_invalid(image.data)))
    pixels[image.mask] = 0.0
    axes.imshow(pixels, extent=extent, origin="lower", interpolation="none", aspect="equal", zorder=2)
    axes.set_xlabel(in_brackets(direction_text(frame[0]), "mm", units))
    axes.set_ylabel(in_brackets(direction_text(frame[1]), "mm", units))
    axes.tick_params(labelsize=8)
    axes.locator_params(nbins=6)
    axes.grid(True, color="0.92", lw=0.6)
    return _draw_arrows(axes, points[near], face.weights[near], directions[near])


def _describe(name: str, face: ContactFace, units: str) -> str:
    unit, size = pressure_unit(_peak(face), units)
    lines = [textwrap.fill(figure_text(name), 60), seen_text(face_frame(face)[2]),
             f"normal force {force_text(face.normal_force, units)}, closed {100 * face.closed_part:.3g} % of the area",
             f"peak {with_unit(f'{_peak(face) / size:.3g}', unit, units)}"]  # fmt: skip
    if math.isfinite(face.torque):
        lines[-1] += f", braking torque {with_unit(f'{face.torque:.4g}', 'N m', units)}"
    return "\n".join(lines)


def _panel_size(face: ContactFace, text: str) -> tuple[float, float]:
    """Return width and height of a panel in inches: its face, the labels around it and the title above it."""
    sides = np.ptp(face.points @ face_frame(face)[:2].T, axis=0)
    width, height = np.maximum(FACE_INCHES * sides / max(float(sides.max()), 1e-300), 0.8)
    lines = text.split("\n")
    # A letter of 9 pt is about 0.07 in wide; Matplotlib's layout does not consider the width of titles.
    return max(width + 1.0, 0.07 * max(map(len, lines)) + 0.2), height + 0.7 + 0.17 * len(lines)


def _nearest_values(points: Floats, weights: Floats, values: Floats) -> tuple[np.ma.MaskedArray, Any]:
    """Return an image with the values at the nearest points, masked beside the face, and its extent."""
    side = np.sqrt(np.abs(weights).mean())  # of a square of the mean area that a point stands for
    low, high = points.min(axis=0) - side, points.max(axis=0) + side
    step = (high - low).max() / PIXELS
    x, y = np.meshgrid(*(np.arange(a, b, step) + step / 2 for a, b in zip(low, high, strict=True)))
    tree = cKDTree(points)
    distance, nearest = tree.query(np.stack([x, y], axis=-1))
    triangles = _triangles_on_face(points, weights, tree)
    if len(triangles):
        finder = Triangulation(points[:, 0], points[:, 1], triangles).get_trifinder()
        inside = np.asarray(finder(x, y)) >= 0
    else:
        inside = np.asarray(distance <= side)
    extent = (low[0], low[0] + step * x.shape[1], low[1], low[1] + step * x.shape[0])
    return np.ma.masked_array(values[nearest], ~inside), extent


def _triangles_on_face(points: Floats, weights: Floats, tree: cKDTree) -> NDArray[np.int32]:
    """Return triangles (t, 3) between the points that are on the face, and not across a slot, a hole or a notch.

    There are none if there are fewer than three points or all are on a line.
    """
    try:
        triangles = Delaunay(points).simplices
    except QhullError:
        return np.zeros((0, 3), dtype=np.int32)
    corners = points[triangles]
    sides = np.roll(corners, -1, axis=1) - corners
    area = 0.5 * np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    # The area of a triangle, unlike its edges, shows on stretched meshes too whether its corners are neighbours.
    part = area / np.abs(weights)[triangles].mean(axis=1)
    # Thin triangles across a notch have small areas, but large circumscribed circles.
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.linalg.norm(sides, axis=2).prod(axis=1) / (4 * area)
    reach = 1.5 * tree.query(points, k=[min(25, len(points))])[0][:, 0]
    near = radius <= reach[triangles].max(axis=1)
    return np.asarray(triangles[(part > 1e-6) & (part <= LARGEST_TRIANGLE) & near], dtype=np.int32)


def _draw_arrows(axes: Axes, points: Floats, weights: Floats, directions: Floats) -> bool:
    """Draw the sliding direction: one arrow, or six around the centre if the face slides in circles.

    Returns whether anything was drawn.
    """
    if not directions.any():
        return False
    centre = weights @ points / weights.sum()
    mean = weights @ directions / weights.sum()
    if np.linalg.norm(mean) > _RING:
        places = [int(np.argmin(np.linalg.norm(points - centre, axis=1)))]
        arrows = mean[None]
    else:
        angles = np.arange(6) * np.pi / 3
        radius = np.linalg.norm(points - centre, axis=1).mean()
        wanted = centre + radius * np.column_stack([np.cos(angles), np.sin(angles)])
        places = [int(np.argmin(np.linalg.norm(points - place, axis=1))) for place in wanted]
        arrows = directions[places]
    length = 0.16 * np.ptp(points, axis=0).max()
    for place, arrow in zip(points[places], arrows, strict=True):
        half = 0.5 * length * arrow / max(float(np.linalg.norm(arrow)), 1e-300)
        axes.add_patch(FancyArrowPatch(
            place - half, place + half, arrowstyle="-|>", mutation_scale=13, lw=1.6, color="black", zorder=4,
            shrinkA=0, shrinkB=0, path_effects=[Stroke(linewidth=4.0, foreground="white"), Normal()],
        ))  # fmt: skip
    return True
