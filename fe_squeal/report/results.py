"""Read a folder of results as far as possible; what is missing is listed, so that the page can say so."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fe_squeal.report.shapes import Complexes, ShapeGrid

_NEEDED = {
    "modes": ("value", "mode", "re", "im", "frequency_hz", "stability"),
    "onsets": ("value", "frequency_hz"),
    "contributions": ("value", "mode", "term", "re_share"),
    "sensitivities": ("value", "mode", "number", "at", "dre"),
}
_MAC = ("measured", "value", "branch", "frequency_hz", "mac")
_MESH_ERROR = ("quantity", "kind", "change", "scale", "body", "direction", "part")
_STATUS = {
    "running": "The run is still going on, or was killed: what is shown is what was finished until then.",
    "interrupted": "The run was interrupted: what is shown is what was finished until then. fe-squeal run --resume goes"
    " on from there.",
    "not converged": "The solver did not converge at one value: what is shown are the values before it.",
}  # fmt: skip


@dataclass(frozen=True)
class Shape:
    """A complex shape on the grid that all shapes of a run share, and the description of its mode."""

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
        The grid of all shapes.
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
    record, lacks = _read_record(folder / record_name)
    frames = {}
    for key, name in tables.items():
        frames[key], why = _read_table(folder / name, _NEEDED[key])
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


def _read_record(path: Path) -> tuple[dict[str, Any], list[str]]:
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        if isinstance(record, dict):
            return record, []
        why = "it is no table"
    except FileNotFoundError:
        why = "it is missing"
    except (OSError, ValueError, RecursionError) as error:
        why = f"it cannot be read: {error}"
    return {}, [f"{path.name}: {why}; how the result was found, with which errors and from what, cannot be shown."]


def _read_table(path: Path, needed: Sequence[str]) -> tuple[pd.DataFrame, str]:
    try:
        frame = pd.read_csv(path)
    except FileNotFoundError:
        return pd.DataFrame(columns=list(needed)), f"{path.name} is missing; what it holds cannot be shown."
    except (OSError, ValueError) as error:
        return pd.DataFrame(columns=list(needed)), f"{path.name} cannot be read ({error}); it is left out."
    missing = [name for name in needed if name not in frame.columns]
    if missing:
        return pd.DataFrame(columns=list(needed)), f"{path.name} has no column {', '.join(missing)}; it is left out."
    return frame, ""


def read_shapes(folder: Path) -> tuple[ShapeGrid | None, list[Shape], list[str]]:
    """Return the grid, the shapes on it, and sentences on what could not be read."""
    files = sorted(folder.glob("*.vtu")) if folder.is_dir() else []
    if not files:
        arrays = folder.is_dir() and any(folder.glob("*.npz"))
        return None, [], [
            "The scene has matrices instead of a mesh: its shapes are arrays without places in space, not drawn here."
            if arrays else "No shapes were written, so none can be shown."
        ]  # fmt: skip
    grid: ShapeGrid | None = None
    shapes, lacks = [], []
    for file in files:
        try:
            own, shape = read_shape(file)
        except (OSError, KeyError, ValueError, IndexError) as error:
            lacks.append(f"shapes/{file.name} cannot be read ({error}); this shape is left out.")
            continue
        if grid is not None and own.points.shape != grid.points.shape:
            lacks.append(f"shapes/{file.name} is on another mesh than the others; this shape is left out.")
            continue
        grid = grid or own
        shapes.append(shape)
    return grid, shapes, lacks


def read_shape(path: Path) -> tuple[ShapeGrid, Shape]:
    """Read a file that `write_shape` wrote.

    Raises
    ------
    OSError, KeyError, ValueError, IndexError
        It is not such a file.
    """
    # It is read by VTK's own reader, since importing pyvista takes half a second.
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

    from fe_squeal.report.vtk_files import names_in

    if not path.read_bytes()[:200].lstrip().startswith(b"<"):
        raise ValueError("it is no VTK file")
    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    if not data.GetNumberOfCells() or not data.IsHomogeneous():
        raise ValueError("its cells are not all of one type")
    cells = vtk_to_numpy(data.GetCells().GetConnectivityArray()).reshape(data.GetNumberOfCells(), -1)

    def array(owner: Any, name: str) -> Any:
        if not owner.HasArray(name):
            raise KeyError(f"no array {name}")
        return vtk_to_numpy(owner.GetArray(name))

    body = np.asarray(array(data.GetCellData(), "body"), dtype=np.int64)
    names = names_in(data, "body") or [f"body {i}" for i in range(int(body.max(initial=0)) + 1)]
    u = array(data.GetPointData(), "u_re") + 1j * array(data.GetPointData(), "u_im")
    info: dict[str, Any] = {
        name: float(array(data.GetFieldData(), name)[0])
        for name in ("value", "mode", "branch", "re", "im", "frequency_hz")
        if data.GetFieldData().HasArray(name)
    }
    parameter = names_in(data, "parameter")
    if parameter:
        info["parameter"] = parameter[0]
    points = np.array(vtk_to_numpy(data.GetPoints().GetData()), dtype=float)
    kind = int(data.GetCellType(0))
    return ShapeGrid(points, np.array(cells, dtype=np.int64), kind, body, tuple(names)), Shape(info, u)
