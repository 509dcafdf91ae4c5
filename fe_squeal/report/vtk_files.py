"""Write mode shapes as VTK files, for ParaView and other programs."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree
from xml.sax.saxutils import escape

import numpy as np

from fe_squeal.errors import OutputError, one_line
from fe_squeal.report.files import replace_atomically
from fe_squeal.report.shapes import Complexes, Floats, ShapeGrid, normalise_shape, semi_major_amplitude

if TYPE_CHECKING:
    import pyvista

_QUOTE = {'"': "&quot;"}
VISIBLE = 0.05  # of the size of the model: the largest displacement that is drawn


def write_shape(
    grid: ShapeGrid,
    u: Complexes,
    path: str | os.PathLike[str],
    metadata: Mapping[str, float | int | str] | None = None,
) -> Path:
    """Write a complex shape, normalised by `normalise_shape`, as a compressed binary .vtu file.

    Point arrays are `u_re`, `u_im` (n, 3) and `amplitude` (n,), the largest displacement over a period, at most 1. The
    cell array is `body`. Field data are `body: NAME` with the number of each body, and all entries of `metadata`; a
    text becomes a part of the name, as in `parameter: mu`, since not all readers of .vtu accept texts as values.

    Parameters
    ----------
    grid : ShapeGrid
        With n points.
    u : (n, 3) complex
    path : str or Path
        The file to write, with the suffix .vtu.
    metadata : mapping, optional
        Such as `frequency_hz`, `re`, `im`, `parameter`, `value`, `mode`, `branch`.
    """
    shape = normalise_shape(u)
    data = unstructured_grid(grid, grid.points)
    data.point_data["u_re"] = np.ascontiguousarray(shape.real)
    data.point_data["u_im"] = np.ascontiguousarray(shape.imag)
    data.point_data["amplitude"] = semi_major_amplitude(shape)
    add_names(data, "body", grid.body_names)
    for name, value in (metadata or {}).items():
        add_field(data, name, value)
    return write_grid(data, Path(path))


def write_animation(
    grid: ShapeGrid, u: Complexes, path: str | os.PathLike[str], frames: int = 16, scale: float = VISIBLE
) -> list[Path]:
    """Write one period of the motion u (n, 3) as a .pvd collection with a .vtu file per frame in `<stem>_frames/`.

    Each frame has the points at rest, `displacement` = Re(u e^{2πik/frames}), and `amplitude` as in `write_shape`. The
    displacement is scaled so that its largest value over the period is `scale` times the diagonal of the bounding box;
    "Warp By Vector" with scale factor 1 shows it. The motion is periodic, without the growth of the mode, and time goes
    from 0 to 1 over a period. Numbers have single precision, which is enough for pictures.

    Returns
    -------
    list of Path
        The .pvd first, then the frames.
    """
    path = Path(path)
    shape = normalise_shape(u)
    folder = path.with_name(f"{path.stem}_frames")
    data = unstructured_grid(grid, grid.points.astype(np.float32))
    data.point_data["amplitude"] = semi_major_amplitude(shape).astype(np.float32)
    collection = ElementTree.Element("VTKFile", type="Collection", version="1.0", byte_order="LittleEndian")
    sets = ElementTree.SubElement(collection, "Collection")
    files = []
    width = len(str(max(frames - 1, 10)))
    for k in range(frames):
        data.point_data["displacement"] = displacement_at(grid, shape, k / frames, scale).astype(np.float32)
        file = folder / f"{path.stem}_{k:0{width}d}.vtu"
        files.append(write_grid(data, file))
        ElementTree.SubElement(sets, "DataSet", timestep=repr(k / frames), group="", part="0",
                               file=f"{folder.name}/{file.name}")  # fmt: skip
    ElementTree.indent(collection)
    with replace_atomically(path) as temporary:
        ElementTree.ElementTree(collection).write(temporary, encoding="utf-8", xml_declaration=True)
    return [path, *files]


def displacement_at(grid: ShapeGrid, shape: Complexes, time: float, scale: float = VISIBLE) -> Floats:
    """Return Re(u e^{2πi time}) · scale · size of the model, (n, 3) m, of a normalised shape; `time` in periods."""
    return np.ascontiguousarray(np.real(shape * np.exp(2j * np.pi * time)) * scale * grid.size)


def unstructured_grid(grid: ShapeGrid, points: Any) -> pyvista.UnstructuredGrid:
    """Return the cells of the grid on the given points, with the cell array `body`."""
    import pyvista

    # Each cell is preceded by its number of nodes. Older versions of pyvista refuse Lagrange cells in a dictionary.
    count, nodes = grid.cells.shape
    cells = np.column_stack([np.full(count, nodes), grid.cells]).ravel()
    data = pyvista.UnstructuredGrid(cells, np.full(count, grid.vtk_cell_type, dtype=np.uint8), points)
    data.cell_data["body"] = grid.body.astype(np.int32)
    return data


def add_field(data: pyvista.DataSet, name: str, value: float | int | str) -> None:
    """Add a number, or a text as a part of the name, as field data of the whole grid."""
    if isinstance(value, str):
        add_names(data, name, [value])
    else:
        data.field_data[name] = [value]


def add_names(data: pyvista.DataSet, kind: str, names: Sequence[str]) -> None:
    """Add names as arrays `KIND: NAME` that have the number of the name, from 0; meshio refuses arrays of texts."""
    from vtkmodules.vtkCommonCore import vtkIntArray

    for number, name in enumerate(names):
        array = vtkIntArray()  # pyvista accepts only ASCII in names
        array.SetName(escape(f"{kind}: {one_line(name)}", _QUOTE))  # VTK does not escape < and & in XML
        array.InsertNextValue(number)
        data.GetFieldData().AddArray(array)


def names_in(data: pyvista.DataSet, kind: str) -> list[str]:
    """Return the names that `add_names` wrote, in their order."""
    found = {}
    for i in range(data.GetFieldData().GetNumberOfArrays()):
        array = data.GetFieldData().GetArray(i)
        key = array.GetName() if array is not None else ""
        if key.startswith(f"{kind}: "):
            found[int(array.GetValue(0))] = key.removeprefix(f"{kind}: ")
    return [found[number] for number in sorted(found)]


def write_grid(data: pyvista.UnstructuredGrid, path: Path) -> Path:
    """Write a grid as a compressed binary .vtu file, by `replace_atomically`; OutputError if that is not possible."""
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(data)
    # As ParaView writes files: raw binary data behind the XML, compressed by zlib, which gives the smallest files.
    writer.SetDataModeToAppended()
    writer.EncodeAppendedDataOff()
    writer.SetCompressorTypeToZLib()
    with replace_atomically(path) as temporary:
        writer.SetFileName(os.fspath(temporary))
        if not writer.Write():
            raise OutputError(f"{path}: VTK cannot write it (no permission, or the disk is full)")
    return path
