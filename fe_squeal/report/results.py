"""Read a folder of results as far as possible; what is missing is listed, so that the page can say so."""

from __future__ import annotations

import io
import json
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fe_squeal.errors import one_line
from fe_squeal.report.record import RunRecord, left_out, readable
from fe_squeal.report.shapes import Complexes, ShapeGrid, normalise_shape, surface_of
from fe_squeal.report.table_files import check_table, read_table

# Of each table the columns that have no holes, and those that may have some: of what a mode has no such number.
_Columns = tuple[tuple[str, ...], tuple[str, ...]]
_COLUMNS: dict[str, _Columns] = {
    "modes": (("value", "mode", "re", "im", "frequency_hz", "stability"), ()),
    "onsets": (("value", "frequency_hz"), ()),
    "contributions": (("value", "mode", "term"), ("re_share",)),
    "sensitivities": (("value", "mode", "number", "at"), ("dre",)),
}
_MAC: _Columns = (("measured", "value", "branch", "frequency_hz"), ("mac",))
_MESH_ERROR: _Columns = (("quantity", "kind", "change", "scale", "body", "direction", "part"), ())
# VTK's numbers of meshio's types, and how many nodes they have: a Lagrange cell alone may have another order.
_CELLS = {"tetra": (10, 4), "tetra10": (24, 10), "hexahedron": (12, 8), "hexahedron27": (29, 27),
          "VTK_LAGRANGE_HEXAHEDRON": (72, 64)}  # fmt: skip
_HEAD = 200  # bytes: the first tag of a file lies within
_SECOND_VERSION = re.compile(rb'version="2\.[0-9]"')
_STATUS = {
    "running": "The run is still going on, or was killed: what is shown is what was finished until then.",
    "interrupted": "The run was interrupted: what is shown is what was finished until then. fe-squeal run --resume goes"
    " on from there.",
    "not converged": "The solver did not converge at one value: what is shown are the values before it.",
}  # fmt: skip


@dataclass(frozen=True)
class Shape:
    """A complex shape on the grid that all shapes of a run share, and the description of its mode.

    Attributes
    ----------
    info : dict
        "branch", "frequency_hz", "re" and so on, as far as they are known.
    u : (n, 3) complex
        Displacements of the points of the grid. Those of `read_shapes` are a part of what `normalise_shape` makes of
        the whole shape.
    """

    info: dict[str, Any]
    u: Complexes


@dataclass(frozen=True)
class Results:
    """The results of a run.

    Attributes
    ----------
    record : dict
        run.json.
    modes, onsets, contributions, sensitivities : DataFrame
        The tables; empty if the file is missing.
    mac : DataFrame
        mac.csv; empty if no shape was measured.
    mesh_error : DataFrame
        mesh_error.csv; empty if the error of the mesh was not estimated.
    mesh_picture : bytes
        mesh_error_elements.png; empty if the error of the mesh was not estimated.
    grid : ShapeGrid or None
        The grid of all shapes; from a folder its surface alone.
    shapes : tuple of Shape
        The shapes that were written.
    lacks : tuple of str
        A sentence on each thing that is missing or cannot be read.
    """

    record: dict[str, Any]
    modes: pd.DataFrame
    onsets: pd.DataFrame
    contributions: pd.DataFrame
    sensitivities: pd.DataFrame
    mac: pd.DataFrame = field(default_factory=pd.DataFrame)
    mesh_error: pd.DataFrame = field(default_factory=pd.DataFrame)
    mesh_picture: bytes = b""
    grid: ShapeGrid | None = None
    shapes: tuple[Shape, ...] = ()
    lacks: tuple[str, ...] = field(default=())

    @property
    def parameter(self) -> str:
        """Name of the swept parameter."""
        return str(self.modes["parameter"].iloc[0]) if len(self.modes) and "parameter" in self.modes else "mu"


def read_results(
    folder: Path, record_name: str, tables: dict[str, str], shapes: str, mac: str = "mac.csv",
    mesh_error: str = "mesh_error.csv", picture: str = "mesh_error_elements.png",
) -> Results:  # fmt: skip
    """Read a folder of results; what is missing or cannot be read becomes a sentence in `lacks`.

    Parameters
    ----------
    folder : Path
    record_name : str
        Name of run.json.
    tables : mapping of str to str
        Names of the files of "modes", "onsets", "contributions" and "sensitivities".
    shapes : str
        Name of the folder of shapes.
    mac, mesh_error, picture : str
        Names of files that may be absent: the MAC with measured shapes, the error of the mesh, and its picture.
    """
    record, lacks = read_record(folder / record_name)
    frames = {}
    for key, name in tables.items():
        frames[key], why = _read_table(folder / name, _COLUMNS[key])
        if why:
            lacks.append(why)
    more = {mac: pd.DataFrame(), mesh_error: pd.DataFrame()}
    for name, columns in ((mac, _MAC), (mesh_error, _MESH_ERROR)):
        if (folder / name).exists():
            more[name], why = _read_table(folder / name, columns)
            lacks += [why] if why else []
    drawn = b""
    if (folder / picture).is_file():
        with suppress(OSError):
            drawn = (folder / picture).read_bytes()
    status = _STATUS.get(str(record.get("status")))
    if status:
        lacks.insert(0, status)
    if len(frames["modes"]) and "nodal_diameters" not in frames["modes"]:
        lacks.append(
            "modes.csv has no nodal diameters and bodies: a version of the program that did not know them wrote it; run"
            " the scene again to have them."
        )
    elif len(modes := frames["modes"]) and modes["body"].notna().any() and modes["nodal_diameters"].isna().all():
        lacks.append("No body with a mesh turns about an axis, so modes have no nodal diameters.")
    grid, found, why_not = read_shapes(folder / shapes)
    return Results(
        record, **frames, mac=more[mac], mesh_error=more[mesh_error], mesh_picture=drawn, grid=grid,
        shapes=tuple(found), lacks=(*lacks, *why_not),
    )  # fmt: skip


def read_record(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Return what run.json holds that can be shown, and sentences on what cannot."""
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        if isinstance(record, dict):
            record, wrong = readable(record, RunRecord)
            return record, left_out(path.name, wrong)
        why = "it is no table"
    except FileNotFoundError:
        why = "it is missing"
    except (OSError, ValueError, RecursionError) as error:
        why = f"it cannot be read: {error}"
    return {}, [f"{path.name}: {why}; how the result was found, with which errors and from what, cannot be shown."]


def _read_table(path: Path, columns: _Columns) -> tuple[pd.DataFrame, str]:
    needed, there = columns
    try:
        frame = read_table(path)
        check_table(frame, needed, there)
    except FileNotFoundError:
        why = f"{path.name} is missing; what it holds cannot be shown."
    except (OSError, OverflowError, ValueError) as error:
        why = f"{path.name} cannot be read ({error}); it is left out."
    else:
        return frame, ""
    return pd.DataFrame(columns=[*needed, *there]), why


def read_shapes(folder: Path) -> tuple[ShapeGrid | None, list[Shape], list[str]]:
    """Return the surface of the grid, the shapes on it, and sentences on what could not be read.

    What shapes are inside the bodies is not kept: of many shapes on a fine mesh it would fill the memory.
    """
    files = sorted(folder.glob("*.vtu")) if folder.is_dir() else []
    if not files:
        arrays = folder.is_dir() and any(folder.glob("*.npz"))
        return None, [], [
            "The scene has matrices instead of a mesh: its shapes are arrays without places in space, not drawn here."
            if arrays else "No shapes were written, so none can be shown."
        ]  # fmt: skip
    grid: ShapeGrid | None = None
    whole, nodes = (0, 0), np.zeros(0, dtype=np.int64)
    shapes, lacks = [], []
    for file in files:
        try:
            own, shape = read_shape(file)
            if grid is None:
                (grid, nodes), whole = surface_of(own), own.points.shape
        except (OSError, KeyError, ValueError, IndexError) as error:
            lacks.append(f"shapes/{file.name} cannot be read ({error}); this shape is left out.")
            continue
        if own.points.shape != whole:
            lacks.append(f"shapes/{file.name} is on another mesh than the others; this shape is left out.")
            continue
        shapes.append(Shape(shape.info, normalise_shape(shape.u)[nodes]))
    return grid, shapes, lacks


def read_shape(path: Path) -> tuple[ShapeGrid, Shape]:
    """Read a file that `write_shape` wrote.

    Raises
    ------
    OSError, KeyError, ValueError, IndexError
        It is not such a file.
    """
    found = _mesh_of(path)
    if len(found.cells) != 1 or found.cells[0].type not in _CELLS:
        raise ValueError("its cells are not all of one type")
    points, cells = np.asarray(found.points, float), np.asarray(found.cells[0].data, np.int64)
    kind, width = _CELLS[found.cells[0].type]
    if cells.shape[1:] != (width,):
        raise ValueError(f"its cells do not have {width} nodes each")
    u = found.point_data["u_re"] + 1j * found.point_data["u_im"]
    body = np.asarray(found.cell_data["body"][0], np.int64)
    if points.shape != u.shape or points.shape[1:] != (3,) or body.shape != cells.shape[:1] or not len(cells):
        raise ValueError("its arrays do not fit together")
    if cells.min() < 0 or cells.max() >= len(points) or not (np.isfinite(points).all() and np.isfinite(u).all()):
        raise ValueError("its arrays do not hold what they should")
    names = _names_in(found, "body") or {i: f"body {i}" for i in range(int(body.max()) + 1)}
    if body.min() < 0 or sorted(names) != list(range(max(len(names), int(body.max()) + 1))):
        raise ValueError("its bodies are not numbered")
    info: dict[str, Any] = {
        name: float(found.field_data[name][0])
        for name in ("value", "mode", "branch", "re", "im", "frequency_hz")
        if name in found.field_data
    }
    if not np.isfinite(list(info.values())).all():
        raise ValueError("its numbers do not hold what they should")
    for parameter in _names_in(found, "parameter").values():
        info["parameter"] = parameter
    grid = ShapeGrid(points, cells, kind, body, tuple(names[i] for i in sorted(names)))
    return grid, Shape(info, u)


def _mesh_of(path: Path) -> Any:
    """Read a .vtu file by meshio: VTK's own reader ends the process at some damaged files.

    Raises
    ------
    OSError, ValueError
    """
    import meshio

    with path.open("rb") as file:
        head = file.read(_HEAD)
    if not head.lstrip().startswith(b"<"):
        raise ValueError("it is no VTK file")
    printed = io.StringIO()
    try:
        quiet = redirect_stdout(printed), redirect_stderr(printed)
        with _in_known_version(path, head) as known, quiet[0], quiet[1], np.errstate(all="ignore"):
            return meshio.read(known, "vtu")
    except OSError:
        raise
    except (Exception, SystemExit) as error:  # meshio stops at damaged files with almost any exception
        raise ValueError(one_line(str(error))[:160] or "it is damaged") from error


@contextmanager
def _in_known_version(path: Path, head: bytes) -> Iterator[Path]:
    """Yield a .vtu file, or a copy of one that says version 1.0 where `head`, its first bytes, say 2.something.

    VTK writes such a version where there are Lagrange cells, whose nodes it numbered otherwise before; all else is as
    it was. meshio 5.3.5 knows versions up to 1.0 alone.
    """
    if not _SECOND_VERSION.search(head):
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "shape.vtu"
        rest = path.read_bytes()[len(head) :]  # as long as before, so that what lies in it stays in its place
        copy.write_bytes(_SECOND_VERSION.sub(b'version="1.0"', head) + rest)
        yield copy


def _names_in(found: Any, kind: str) -> dict[int, str]:
    """Return numbered names, which `vtk_files.add_names` has written as arrays `KIND: NAME`."""
    head = f"{kind}: "
    return {int(array[0]): name.removeprefix(head) for name, array in found.field_data.items() if name.startswith(head)}
