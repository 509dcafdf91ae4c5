"""What `fe-squeal animate` does."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from rich.console import Console

from ..errors import OutputError
from .folder import RECORD, RESULTS, SHAPES, hold_folder
from .page import tell
from .view import Z_AXIS


def animate_folder(folder: Path, branch: int | None, file: Path | None, console: Console) -> int:
    """Write a film of every shape of a run, beside the shape's file, or of the shape of one branch to a given file.

    Of a branch that has shapes at several values the given file takes the one where it grows fastest.

    Raises
    ------
    OutputError
        There is no such shape, a file is given for several shapes or exists already, its format is not known, or VTK
        cannot draw.
    """
    from ..report.animation import FORMATS
    from ..report.results import read_record
    from ..report.shape_names import shape_title

    if file is not None and file.suffix.lower() not in FORMATS:
        known = " or ".join(FORMATS)
        raise OutputError(f"{file}: given the format {file.suffix or '(none)'}; expected a name that ends in {known}")
    record, lacks = read_record(folder / RECORD)
    shapes = _shapes(folder, branch, _looks(record))
    tell(lacks, console)
    several = file is not None and len(shapes) > 1
    if several and branch is None:
        raise OutputError(
            f"{file}: given one file for {len(shapes)} shapes; expected --branch with one of {_branches(shapes)}"
        )
    axis = (record.get("axis") or {}).get("direction") or Z_AXIS
    if file is not None:
        if file.exists():
            raise OutputError(f"{file}: exists already; it is not replaced: remove it, or give another file by -o")
        fastest = max(shapes, key=lambda shape: float(shape[1].get("re", -math.inf)))
        if several:
            taken = shape_title(fastest[1]).splitlines()[0]
            console.print(f"note: of {len(shapes)} shapes that with the largest Re λ is taken: {taken}", markup=False)
        _write(fastest, file, axis, console)
        return 0
    with hold_folder(folder, expected=f"{RESULTS}, or -o FILE elsewhere"):
        for shape in shapes:
            _write(shape, shape[0].with_suffix(FORMATS[0]), axis, console)
    return 0


def _write(shape: tuple[Path, dict[str, Any]], path: Path, axis: Any, console: Console) -> None:
    from ..report.animation import write_film
    from ..report.shape_names import shape_title

    write_film(shape[0], path, shape_title(shape[1]), axis)
    console.print(f"wrote {path} ({path.stat().st_size / 1e6:.1f} MB)", markup=False)


def _shapes(folder: Path, branch: int | None, looks: dict[Any, dict[str, Any]]) -> list[tuple[Path, dict[str, Any]]]:
    """Return the shape files of a folder, all or those of one branch, each with what is known of its mode."""
    from ..report.results import read_shape

    if not folder.is_dir():
        raise OutputError(f"{folder}: is no folder; expected one that fe-squeal run has written")
    files = sorted((folder / SHAPES).glob("*.vtu"))
    if not files:
        arrays = any((folder / SHAPES).glob("*.npz"))
        why = "of a scene of matrices, which has no mesh" if arrays else 'see [output] shapes = "unstable" or "all"'
        raise OutputError(f"{folder / SHAPES}: holds no shapes that can be drawn ({why})")
    found = []
    for file in files:
        try:
            info = read_shape(file)[1].info
        except (OSError, KeyError, ValueError, IndexError) as error:
            raise OutputError(f"{file}: cannot be read ({error}); expected a shape that fe-squeal run wrote") from error
        found.append((file, info | looks.get((info.get("branch"), info.get("value")), {})))
    chosen = [(f, i) for f, i in found if branch is None or i.get("branch") == branch]
    if not chosen:
        known = _branches(found) or "none"
        raise OutputError(f"{folder / SHAPES}: given branch {branch}; expected one with a shape: {known}")
    return chosen


def _branches(shapes: list[tuple[Path, dict[str, Any]]]) -> str:
    return ", ".join(sorted({f"{info['branch']:.0f}" for _, info in shapes if "branch" in info}, key=int))


def _looks(record: dict[str, Any]) -> dict[Any, dict[str, Any]]:
    """Return the descriptors of the unstable modes by branch and value, without what is damaged."""
    from ..report.record import UnstableMode, readable

    names = UnstableMode.model_fields.keys() - {"branch", "value"}
    rows = [readable(row, UnstableMode)[0] for row in record.get("unstable") or []]
    return {
        (float(row["branch"]), row["value"]): {k: row[k] for k in names if k in row}
        for row in rows
        if "branch" in row and "value" in row
    }
