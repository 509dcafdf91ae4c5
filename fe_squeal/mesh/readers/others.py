"""Read every other format by meshio: .vtu, .vtk, .xdmf, .med, ...; integer arrays and sets become groups."""

from __future__ import annotations

import contextlib
import io
import warnings

import numpy as np

from fe_squeal.errors import MeshError

from ..elements import SHAPE
from ..raw import CellBlock, Ints, RawMesh
from .hdf5 import check_references
from .meshio_patches import patched_meshio, with_sized_integers
from .sources import Sources

_CORNERS = {"triangle": 3, "triangle6": 3, "triangle7": 3, "quad": 4, "quad8": 4, "quad9": 4}
# Of Exodus files meshio 5.3.5 reads neither names of blocks nor side sets, and nodes of hexahedra in a wrong order.
_EXODUS = (".e", ".exo", ".ex2")
_REFUSED = ("VTK_LAGRANGE", "VTK_BEZIER", "polyhedron", "tetra", "hexahedron", "wedge", "pyramid")
# An integer array with more different values than this numbers the cells, and makes no groups.
MOST_VALUES = 500


def read_with_meshio(sources: Sources) -> RawMesh:
    """Read any format that meshio knows, but Exodus.

    An integer cell array "name" makes a group "name:v" for each value v, and a group "v" too if it is the only such
    array. An array of zeros and ones also makes the group "name" of the cells with a one. meshio's cell sets, point
    sets, and tags of cells and points (MED) become groups under their names.

    Raises
    ------
    MeshError
        meshio cannot read the file, or it is an Exodus file.
    """
    path = sources.path
    if path.suffix.lower() in _EXODUS:
        raise MeshError(
            f"{path.name}: Exodus files are not read, as their groups would be lost; save the mesh as an Abaqus file"
            " (.inp)"
        )
    import meshio

    printed = io.StringIO()
    try:
        # meshio prints and calls sys.exit on files it cannot read.
        with (
            contextlib.redirect_stdout(printed),
            contextlib.redirect_stderr(printed),
            warnings.catch_warnings(),
            np.errstate(all="ignore"),
            patched_meshio(path),
        ):
            warnings.simplefilter("ignore")
            check_references(sources)
            return _raw(with_sized_integers(path) or meshio.read(path), path.name)
    except MeshError:
        raise
    except (Exception, SystemExit) as error:
        known = sorted({suffix for suffix in meshio.extension_to_filetypes if suffix})
        if path.suffix.lower() not in known:
            raise MeshError(
                f'{path.name}: no mesh format is known by the suffix "{path.suffix}"; expected one of '
                ".msh, .inp, .bdf, .nas, .dat, .fem, .cdb, .unv, .vtu, .vtk, .xdmf, .med"
            ) from error
        reason = str(error).strip() if not isinstance(error, SystemExit) else printed.getvalue().strip()
        reason = " ".join(reason.split())[:160] or type(error).__name__
        raise MeshError(
            f"{path.name}: not a readable {path.suffix} mesh ({reason}); save it again, or in another format"
        ) from error


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
            # `check_cells` refuses an index past the end. Negative indices, which NumPy would count from the end, and
            # -1, which means "no node" in a CellBlock, are made such indices too.
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
    node_groups |= _tagged_points(mesh)
    groups = {name: np.unique(np.concatenate(parts)) for name, parts in volumes.items()}
    return RawMesh(
        points, np.arange(len(points)), tuple(blocks), groups, surfaces, node_groups, _fractions(mesh), tuple(notes)
    )


def _tagged_points(mesh: object) -> dict[str, Ints]:
    """Return the points by name; a tag of points may have several names, and a name several tags."""
    of_point = np.ravel(mesh.point_data.get("point_tags", []))  # type: ignore[attr-defined]
    found: dict[str, list[Ints]] = {}
    for tag, names in (getattr(mesh, "point_tags", None) or {}).items():
        for name in names:
            found.setdefault(str(name), []).append(np.flatnonzero(of_point == tag))
    return {name: np.concatenate(rows) for name, rows in found.items()}


def _fractions(mesh: object) -> dict[str, str]:
    """Return names that whole numbers of cells would give groups, if they were not written with fractions: why not."""
    found: dict[str, str] = {}
    for name, parts in mesh.cell_data.items():  # type: ignore[attr-defined]
        arrays = [np.asarray(part) for part in parts]
        if not arrays or any(a.dtype.kind != "f" or a.ndim != 1 for a in arrays):
            continue
        values = np.unique(np.concatenate(arrays))
        if len(values) <= MOST_VALUES and (np.isfinite(values) & (values == np.rint(values))).all():
            why = f'the array "{name}" is of floating-point numbers; write it with whole ones'
            found |= {key: why for key in (name, *(f"{name}:{value:.0f}" for value in values))}
    return found


def _integer_arrays(mesh: object) -> tuple[dict[str, list[np.ndarray]], list[str]]:
    """Return the cell arrays of whole numbers by name, and the names of those with more than `MOST_VALUES` values."""
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
