"""Write the tables, figures and shapes of a run into its folder."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..assembly.discretisation import discretisation_of
from ..errors import OutputError
from ..report.files import replace_atomically, write_csv
from ..report.shape_names import shape_name
from ..sweep.point import SweepPoint
from ..sweep.result import Sweep
from .compared import mac_table
from .folder import (
    CONTRIBUTIONS_FIGURE,
    CONTRIBUTIONS_TABLE,
    MAC_FIGURE,
    MAC_TABLE,
    MODES_TABLE,
    ONSETS_TABLE,
    PRELOAD_TABLE,
    ROOT_LOCUS_FIGURE,
    SENSITIVITIES_TABLE,
    STABILITY_FIGURE,
)
from .measured import Frequency, Measurements
from .preload import grid_of, preload_dataframe
from .record import fastest_growing, mode_info
from .view import view_axis


def export_shapes(result: Sweep, folder: str | Path, which: str = "unstable") -> list[Path]:
    """Write complex mode shapes for ParaView (.vtu), each with a picture.

    If the problem comes from matrices in files, without a mesh, each shape is the array `u` (n,) of a .npz file.

    Parameters
    ----------
    result : Sweep
    folder : str or Path
        Where to write; it is made if it is missing.
    which : "unstable" or "all"
        "unstable" writes the shape of every branch that becomes unstable, at the value where it grows fastest. "all"
        also writes every mode at the last value, for which the sweep needs keep_shapes=True.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    OutputError
        `which` is neither of the two, or a file cannot be written.
    """
    with exporting_shapes(result, folder, which) as files:
        pass
    return files


@contextmanager
def exporting_shapes(result: Sweep, folder: str | Path, which: str = "unstable") -> Iterator[list[Path]]:
    """Do what `export_shapes` does; another process draws the pictures while the block does something else.

    Parameters are those of `export_shapes`.

    Yields
    ------
    list of Path
        The files, all there after the block.

    Raises
    ------
    OutputError
        `which` is neither of the two, or a file cannot be written.
    """
    if which not in ("unstable", "all"):
        raise OutputError(f'export_shapes: given which = {which!r:.60}; expected "unstable" or "all"')
    from ..report.export import exporting_shapes as exporting  # loads Matplotlib

    discretisation = discretisation_of(result.problem)
    chosen = fastest_growing(result)
    if which == "all":
        last = result.points[-1]
        chosen += [(last, i) for i in last.shapes if not any(p is last and i == j for p, j in chosen)]
    shapes = _shapes(result, chosen)
    if discretisation is None or not shapes:
        yield [_write_array(name, u, info, Path(folder)) for name, u, info in shapes]
        return
    shapes = [(name, discretisation.space.expand(u), info) for name, u, info in shapes]
    with ExitStack() as stack:
        grid, axis = grid_of(discretisation), view_axis(discretisation)
        yield stack.enter_context(exporting(grid, shapes, folder, axis=axis))
        with warnings.catch_warnings(record=True) as caught:  # not those of the block
            warnings.simplefilter("always", RuntimeWarning)
            stack.close()
    for warning in caught:
        print(f"pictures: {warning.message}", file=sys.stderr)


def write_tables(result: Sweep, out: Path) -> None:
    """Write modes.csv, onsets.csv, contributions.csv and sensitivities.csv."""
    write_modes(result, out)
    write_csv(result.contributions_dataframe(), out / CONTRIBUTIONS_TABLE)
    write_csv(result.sensitivities_dataframe(), out / SENSITIVITIES_TABLE)
    pressed = preload_dataframe(result)
    if pressed is not None:
        write_csv(pressed, out / PRELOAD_TABLE)


def write_modes(result: Sweep, out: Path) -> None:
    """Write modes.csv and onsets.csv, which need no shapes."""
    write_csv(result.to_dataframe(), out / MODES_TABLE)
    write_csv(result.onsets_dataframe(), out / ONSETS_TABLE)


def write_figures(
    result: Sweep, out: Path, title: str, covered: tuple[float, float | None] | None = None,
    measured: Sequence[Frequency] = (),
) -> list[Path]:  # fmt: skip
    """Draw stability.png, root_locus.png and contributions.png, and return their paths.

    Parameters
    ----------
    result : Sweep
    out : Path
        The folder.
    title : str
    covered : (float, float or None), Hz, optional
        The range in which all modes are known, see `frequency_range`.
    measured : sequence of Frequency
        Measured frequencies to be shown.
    """
    from ..report.contributions import plot_contributions
    from ..report.figures import plot_root_locus, plot_stability

    modes, onsets = result.to_dataframe(), result.onsets_dataframe()
    marks = [(m.hz, m.label) for m in measured]
    return [
        plot_stability(modes, onsets, out / STABILITY_FIGURE, title, covered, marks),
        plot_root_locus(modes, onsets, out / ROOT_LOCUS_FIGURE, title, covered, marks),
        plot_contributions(result.contributions_dataframe(), modes, out / CONTRIBUTIONS_FIGURE, title),
    ]


def write_mac(result: Sweep, measured: Measurements, out: Path, title: str) -> list[str]:
    """Write mac.csv and, if it has numbers, mac.png of measured shapes; return sentences on what was left out."""
    table, said = mac_table(measured, result)
    if table is not None:
        write_csv(table, out / MAC_TABLE)
        if table["mac"].notna().any():
            from ..report.mac import plot_mac

            plot_mac(table, out / MAC_FIGURE, title)
    return said


def _shapes(result: Sweep, chosen: Sequence[tuple[SweepPoint, int]]) -> list[tuple[str, np.ndarray, dict[str, Any]]]:
    """Return name, shape (n,) and description of each mode; the description has the backward error of the shape."""
    found = {}
    for point in {id(p): p for p, _ in chosen}.values():
        positions = [i for p, i in chosen if p is point]
        shapes, errors = result.exact_shapes(point, positions)
        tolerance = result.reduced_model.request.tolerance if result.reduced_model is not None else np.inf
        if (errors > tolerance).any():
            at = f"{result.parameter} = {point.value:g}"
            print(f"shapes at {at}: backward error {errors.max():.1e}, above the tolerance", file=sys.stderr)
        for i, u, error in zip(positions, shapes.T, errors, strict=True):
            found[id(point), i] = u, {**mode_info(result, point, i), "backward_error": float(error)}
    described = [found[id(p), i] for p, i in chosen]
    names = [shape_name(info) for _, info in described]
    return [
        (name if names.count(name) == 1 else shape_name(info, exact=True), u, info)
        for name, (u, info) in zip(names, described, strict=True)
    ]


def _write_array(name: str, u: np.ndarray, info: dict[str, Any], folder: Path) -> Path:
    """Write a shape (n,) complex as the array `u` of an .npz file, with what it belongs to beside it."""
    path = folder / f"{name}.npz"
    with replace_atomically(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, u=u, **info)
    return path
