"""Every other format, through meshio: .vtu, .vtk, .xdmf, .med, ...; integer arrays and sets become groups."""

from __future__ import annotations

import contextlib
import io
import re
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fe_squeal.errors import MeshError

from ..elements import SHAPE
from ..raw import CellBlock, Ints, RawMesh

_CORNERS = {"triangle": 3, "triangle6": 3, "triangle7": 3, "quad": 4, "quad8": 4, "quad9": 4}
_REFUSED = ("VTK_LAGRANGE", "VTK_BEZIER", "polyhedron", "tetra", "hexahedron", "wedge", "pyramid")
_INT = re.compile(rb"(?:(SCALARS \S+ )|(\S+ \d+ \d+ ))int((?: \d+)?) *\n")
# Nodes of each cell in XDMF's mixed topology, by its code; meshio's list ends with the wedge and the hexahedron.
_XDMF_NODES = {0x1: 1, 0x2: 2, 0x4: 3, 0x5: 4, 0x6: 4, 0x7: 5, 0x8: 6, 0x9: 8, 0x22: 3, 0x23: 9, 0x24: 6, 0x25: 8,
               0x26: 10, 0x27: 13, 0x28: 15, 0x29: 18, 0x30: 20, 0x31: 24, 0x32: 27}  # fmt: skip
# An array with more values than this numbers cells and does not group them.
MOST_VALUES = 500


def read_with_meshio(path: Path) -> RawMesh:
    """Read any format that meshio knows.

    An integer cell array "name" makes a group "name:v" of each value v, and plain "v" if it is the only such array;
    an array of zeros and ones makes the group "name" of the ones as well. meshio's cell sets, point sets and cell
    tags (MED) become groups under their names.

    Raises
    ------
    MeshError
        meshio cannot read the file.
    """
    import meshio
    from meshio._mesh import topological_dimension

    # meshio 5.3.5 forgets these two in its table of dimensions and stops at them with a KeyError.
    topological_dimension.setdefault("wedge15", 3)
    topological_dimension.setdefault("pyramid13", 3)
    printed = io.StringIO()
    try:
        # meshio prints and calls sys.exit on files it cannot read.
        with (
            contextlib.redirect_stdout(printed),
            contextlib.redirect_stderr(printed),
            warnings.catch_warnings(),
            np.errstate(all="ignore"),
            _all_mixed_cells(path),
        ):
            warnings.simplefilter("ignore")
            return _raw(_with_sized_integers(path) or meshio.read(path), path.name)
    except MeshError:
        raise
    except (Exception, SystemExit) as error:
        known = sorted({suffix for suffix in meshio.extension_to_filetypes if suffix})
        if path.suffix.lower() not in known:
            raise MeshError(
                f'{path.name}: no mesh format is known by the suffix "{path.suffix}"; expected one of '
                ".msh, .inp, .bdf, .nas, .dat, .vtu, .vtk, .xdmf, .med"
            ) from error
        reason = str(error).strip() if not isinstance(error, SystemExit) else printed.getvalue().strip()
        reason = " ".join(reason.split())[:160] or type(error).__name__
        raise MeshError(
            f"{path.name}: not a readable {path.suffix} mesh ({reason}); save it again, or in another format"
        ) from error


@contextlib.contextmanager
def _all_mixed_cells(path: Path) -> Iterator[None]:
    """Let meshio read quadratic cells in XDMF's mixed topology, at which 5.3.5 stops with a KeyError."""
    if path.suffix.lower() not in (".xdmf", ".xmf"):
        yield
        return
    from meshio.xdmf import main

    original = main.translate_mixed_cells
    main.translate_mixed_cells = lambda data: _mixed_cells(data, path.name)
    try:
        yield
    finally:
        main.translate_mixed_cells = original


def _mixed_cells(data: np.ndarray, source: str) -> list[object]:
    """Return meshio's blocks of the cells in XDMF's mixed topology: code, nodes, code, nodes, ..."""
    import meshio
    from meshio.xdmf.common import xdmf_idx_to_meshio_type

    data = np.asarray(data, dtype=np.int64).ravel()
    codes, starts, at = [], [], 0
    while at < len(data):
        code = int(data[at])
        if code not in _XDMF_NODES:
            raise MeshError(
                f"{source}: the mixed topology has cells of XDMF type {code}; expected linear or quadratic tetrahedra"
                " (6, 38), hexahedra (9, 48, 50), wedges (8, 40) or pyramids (7, 39), with triangles or quadrilaterals"
            )
        at += 1
        if code in (0x1, 0x2):  # points and lines state their number of nodes
            if at >= len(data) or data[at] != _XDMF_NODES[code]:
                raise MeshError(f"{source}: the mixed topology has lines of more than 2 points; leave them out")
            at += 1
        codes.append(code)
        starts.append(at)
        at += _XDMF_NODES[code]
    if at != len(data):
        raise MeshError(f"{source}: the mixed topology ends within a cell; save the mesh again")
    blocks, first = [], 0
    for i in range(1, len(codes) + 1):
        if i == len(codes) or codes[i] != codes[first]:
            nodes = data[np.array(starts[first:i])[:, None] + np.arange(_XDMF_NODES[codes[first]])]
            blocks.append(meshio.CellBlock(xdmf_idx_to_meshio_type[codes[first]], nodes))
            first = i
    return blocks


def _with_sized_integers(path: Path) -> object | None:
    """Read a binary legacy .vtk file whose arrays are of type int, four bytes; meshio takes eight."""
    import meshio

    if path.suffix.lower() != ".vtk":
        return None
    data = path.read_bytes()
    if b"Version 5" not in data[:40] or b"\nBINARY" not in data[:400] or not _INT.search(data):
        return None
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder, path.name)
        copy.write_bytes(_INT.sub(rb"\1\2vtktypeint32\3\n", data))
        return meshio.read(copy)


def _raw(mesh: object, source: str) -> RawMesh:
    points = np.atleast_2d(np.asarray(mesh.points, dtype=np.float64))  # type: ignore[attr-defined]
    if points.ndim != 2 or points.shape[1] != 3:
        raise MeshError(
            f"{source}: the points have {points.shape[-1]} coordinates; expected a mesh in three dimensions"
        )
    blocks: list[CellBlock] = []
    surface: dict[int, Ints] = {}
    start: dict[int, int] = {}
    at = number = 0
    for i, cells in enumerate(mesh.cells):  # type: ignore[attr-defined]
        data = np.asarray(cells.data)
        if cells.type in SHAPE:
            nodes = data.astype(np.int64)
            # An index past the end is caught by the gate, a negative one must not count from the end.
            nodes[(nodes < 0) | (nodes >= len(points))] = len(points)
            blocks.append(CellBlock(cells.type, nodes, number + np.arange(len(nodes))))
            start[i] = at
            at += len(nodes)
        elif cells.type in _CORNERS:
            corners = data[:, : _CORNERS[cells.type]].astype(np.int64)
            if len(corners) and (corners.min() < 0 or corners.max() >= len(points)):
                raise MeshError(
                    f"{source}: surface cells refer to points that the file does not define; export them too"
                )
            surface[i] = corners
        elif cells.type.startswith(_REFUSED):
            raise MeshError(
                f"{source}: cells of type {cells.type} are not supported; expected linear or quadratic "
                "tetrahedra, hexahedra, wedges or pyramids"
            )
        number += len(data)
    volumes: dict[str, list[Ints]] = {}
    surfaces: dict[str, list[Ints]] = {}
    notes = []

    def add(name: str, block: int, members: Ints) -> None:
        if block in start and len(members):
            volumes.setdefault(name, []).append(start[block] + members)
        elif block in surface and len(members):
            surfaces.setdefault(name, []).append(surface[block][members])

    arrays, skipped = _integer_arrays(mesh)
    notes += [f'the array "{name}" has too many values to be groups' for name in skipped]
    tags = getattr(mesh, "cell_tags", None) or {}
    for name, parts in arrays.items():
        values = np.unique(np.concatenate(parts))
        for block, part in enumerate(parts):
            for value in values:
                members = np.flatnonzero(part == value)
                for tag in tags.get(value, []) if name == "cell_tags" else []:
                    add(str(tag), block, members)
                add(f"{name}:{value}", block, members)
                if len(arrays) == 1:
                    add(str(value), block, members)
                if value == 1 and set(values.tolist()) <= {0, 1}:
                    add(name, block, members)
    for name, sets in mesh.cell_sets.items():  # type: ignore[attr-defined]
        for block, members in enumerate(sets):
            if members is not None and not name.startswith("gmsh:"):
                add(name, block, np.asarray(members, dtype=np.int64))
    point_sets = getattr(mesh, "point_sets", None) or {}
    node_groups = {name: np.asarray(rows, dtype=np.int64) for name, rows in point_sets.items()}
    groups = {name: np.unique(np.concatenate(parts)) for name, parts in volumes.items()}
    return RawMesh(points, np.arange(len(points)), tuple(blocks), groups, surfaces, node_groups, notes=tuple(notes))


def _integer_arrays(mesh: object) -> tuple[dict[str, list[np.ndarray]], list[str]]:
    """Return the cell arrays of whole numbers, one value per cell, and the names of those with too many values."""
    found, skipped = {}, []
    for name, parts in mesh.cell_data.items():  # type: ignore[attr-defined]
        arrays = [np.asarray(part) for part in parts]
        arrays = [a[:, 0] if a.ndim == 2 and a.shape[1] == 1 else a for a in arrays]
        if all(a.dtype.kind in "iub" and a.ndim == 1 for a in arrays) and arrays:
            arrays = [a.astype(np.int64) for a in arrays]
            if len(np.unique(np.concatenate(arrays))) > MOST_VALUES:
                skipped.append(name)
            else:
                found[name] = arrays
    return found, skipped
