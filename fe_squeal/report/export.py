"""Write all files of the mode shapes of a run."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fe_squeal.report.pictures import Z_AXIS, PictureJob, drawing_shapes
from fe_squeal.report.shape_names import shape_title
from fe_squeal.report.shapes import Complexes, ShapeGrid
from fe_squeal.report.vtk_files import write_animation, write_shape

FIELDS = ("parameter", "value", "mode", "branch", "re", "im", "frequency_hz")


@contextmanager
def exporting_shapes(
    grid: ShapeGrid,
    shapes: Sequence[tuple[str, Complexes, Mapping[str, Any]]],
    folder: str | os.PathLike[str],
    *,
    animate: bool = True,
    pictures: bool = True,
    frames: int = 16,
    axis: tuple[float, float, float] = Z_AXIS,
) -> Iterator[list[Path]]:
    """Write for each shape `<name>.vtu`, `<name>.pvd` with its frames, and `<name>.png`.

    Another process draws the pictures while the block does something else.

    Parameters
    ----------
    grid : ShapeGrid
        With n points.
    shapes : sequence of (name, u, info)
        `name` as from `shape_name`, all different; `u` (n, 3) complex; `info` with the entries `parameter`, `value`,
        `mode`, `branch`, `re`, `im` (rad/s), `frequency_hz` of the mode's row in `modes.csv`, as far as they are known.
    folder : str or Path
        It is made if it is missing.
    animate, pictures : bool
        Whether to write the .pvd with its frames, and the .png.
    frames : int
        Number of frames in a period.
    axis : (3,) float
        Axis of the disc, or normal of the belt: the direction of the second view of a picture.

    Yields
    ------
    list of Path
        All files, shape by shape, pictures last; these are there after the block.

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
    jobs = jobs if pictures else []
    with drawing_shapes(grid, [u for _, u, _ in shapes], jobs):
        yield [*files, *(job.picture for job in jobs)]


