"""All files of the mode shapes of a run."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fe_squeal.report.branches import parameter_symbol, value_text
from fe_squeal.report.pictures import Z_AXIS, PictureJob, draw_shapes
from fe_squeal.report.shapes import Complexes, ShapeGrid
from fe_squeal.report.vtk_files import write_animation, write_shape

FIELDS = ("parameter", "value", "mode", "branch", "re", "im", "frequency_hz")


def export_shapes(
    grid: ShapeGrid,
    shapes: Sequence[tuple[str, Complexes, Mapping[str, Any]]],
    folder: str | os.PathLike[str],
    *,
    animate: bool = True,
    pictures: bool = True,
    frames: int = 16,
    axis: tuple[float, float, float] = Z_AXIS,
) -> list[Path]:
    """Write for each shape `<name>.vtu`, `<name>.pvd` with its frames, and `<name>.png`.

    Parameters
    ----------
    shapes : sequence of (name, u, info)
        `name` as from `shape_name`, each once; `u` (n, 3) complex; `info` has the keys `parameter`, `value`, `mode`,
        `branch`, `re`, `im` (rad/s), `frequency_hz` of the mode's row in `modes.csv`, as far as they are known.
    folder : path
        Made where it is missing.
    animate, pictures : bool
        Whether to write the .pvd with its frames, and the .png.
    axis : (3,)
        Axis of the disc, or normal of the belt: the direction of the second view.

    Returns
    -------
    list of Path
        All files written, shape by shape, pictures last.

    Raises
    ------
    ValueError
        Two shapes have the same name.
    OutputError
        A file cannot be written.
    """
    folder = Path(folder)
    names = [name for name, _, _ in shapes]
    if len(set(names)) < len(names):
        raise ValueError(f"shapes of the same name: {sorted({name for name in names if names.count(name) > 1})}")
    files: list[Path] = []
    jobs = []
    for name, u, info in shapes:
        known = {key: info[key] for key in FIELDS if key in info and info[key] is not None}
        shape = write_shape(grid, u, folder / f"{name}.vtu", known)
        files.append(shape)
        if animate:
            files += write_animation(grid, u, folder / f"{name}.pvd", frames)
        jobs.append(PictureJob(shape, folder / f"{name}.png", shape_title(info), axis))
    if pictures:
        draw_shapes(grid, [u for _, u, _ in shapes], jobs)
        files += [job.picture for job in jobs]
    return files


def shape_name(info: Mapping[str, Any]) -> str:
    """Return a file name without suffix that sorts by branch, then by the sweep's value.

    Examples
    --------
    >>> shape_name({"parameter": "mu", "value": 0.6, "branch": 7, "frequency_hz": 2413.2})
    'branch_07_mu_0.60_2413Hz'
    >>> shape_name({"parameter": "springs.piston.damping", "value": 1.5e7, "mode": 3, "frequency_hz": 0.25})
    'mode_03_damping_1.5e+07_0.25Hz'
    """
    branch = info.get("branch")
    known = branch is not None and np.isfinite(branch)
    parts = [f"branch_{int(info['branch']):02d}" if known else f"mode_{int(info.get('mode', 0)):02d}"]
    if "value" in info:
        short = str(info.get("parameter", "value")).rsplit(".", 1)[-1]
        parts += [re.sub(r"[^A-Za-z0-9_-]+", "-", short), value_text(float(info["value"]))]
    if "frequency_hz" in info:
        frequency = float(info["frequency_hz"])
        parts.append(f"{frequency:.0f}Hz" if frequency >= 100 else f"{frequency:.3g}Hz")
    return "_".join(parts)


def shape_title(info: Mapping[str, Any]) -> str:
    """Return the text over a picture.

    Examples
    --------
    >>> shape_title({"parameter": "mu", "value": 0.6, "branch": 7, "frequency_hz": 2413.2, "re": 12.345})
    'branch 7:  2413 Hz,  Re λ = +12.35 1/s,  μ = 0.60'
    """
    parts = []
    if "frequency_hz" in info:
        parts.append(f"{float(info['frequency_hz']):.4g} Hz")
    if "re" in info:
        parts.append(f"Re λ = {float(info['re']):+.4g} 1/s")
    if "value" in info:
        parts.append(f"{parameter_symbol(str(info.get('parameter', 'value')))} = {value_text(float(info['value']))}")
    head = next((f"{key} {int(info[key])}:  " for key in ("branch", "mode")
                 if info.get(key) is not None and np.isfinite(info[key])), "")
    return head + ",  ".join(parts)
