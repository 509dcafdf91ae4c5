"""Write a checked mesh as a Gmsh file (MSH 4.1, text); read back, it has the same groups and node sets."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from fe_squeal.errors import OutputError

from .elements import FACES, REFERENCE, SHAPE
from .gmsh_cells import HELD, POINT, SOLIDS
from .groups import LoadedMesh
from .loading import UNITS
from .raw import Floats, Ints
from .subdividing import vtk_nodes

_FACET_NODES = {"tetra": 3, "tetra10": 6, "hexahedron": 4, "hexahedron27": 9}
_FACET_TYPES = {3: 2, 6: 9, 4: 3, 9: 10}  # Gmsh's type number of a facet, by its number of nodes


def write_loaded(loaded: LoadedMesh, path: str | Path, length_unit: str = "m") -> Path:
    """Write a mesh with its volume groups, surfaces and node sets.

    Nodes keep their numbers if these are known, unique in the whole mesh and positive, as the format wants them; else
    they are numbered from 1. Elements get new numbers. Labels, notes and warnings of the file that the mesh came from
    are not written, nor is `LoadedMesh.bisection`. The file gets its name when it is complete, so that nobody sees a
    part of it.

    Parameters
    ----------
    loaded : LoadedMesh
    path : str or Path
        The file to write, with the suffix .msh.
    length_unit : "m" or "mm"
        The unit of the file's coordinates, which `mesh.length_unit` of a scene with this file has to name.

    Returns
    -------
    Path
        Where the mesh was written.

    Raises
    ------
    OutputError
        The name does not end in .msh, a group's name has a quotation mark, or the file cannot be written.

    Examples
    --------
    >>> import tempfile, skfem
    >>> from .from_python import from_skfem
    >>> from .loading import load_mesh
    >>> block = from_skfem(skfem.MeshHex().refined(1).with_subdomains({"pad": [0, 1]}))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     load_mesh(write_loaded(block, Path(folder, "block.msh"))).mesh.subdomains["pad"].shape
    (2,)
    """
    path = Path(path)
    if path.suffix != ".msh":
        raise OutputError(f"{path}: a mesh is written as a gmsh file; expected a name that ends in .msh")
    mesh = loaded.mesh
    for name in (*(mesh.subdomains or {}), *(mesh.boundaries or {}), *loaded.node_groups):
        if '"' in name or not name.isprintable():
            raise OutputError(f"{path}: the group name {name!r} cannot be written; expected no quotation marks in it")
    partial = path.with_name(f".{path.stem}.{secrets.token_hex(8)}.partial")
    try:
        with partial.open("w", encoding="utf-8", newline="\n") as file:
            file.writelines(f"{line}\n" for line in _lines(loaded, UNITS[length_unit]))
        os.replace(partial, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        partial.unlink(missing_ok=True)
    return path


def _lines(loaded: LoadedMesh, scale: float) -> Iterator[str]:
    mesh = loaded.mesh
    kind, nodes = vtk_nodes(mesh)
    points = mesh.doflocs.T / scale
    # By name: a mesh that was read back is written as before.
    groups: dict[int, Mapping[str, Ints]] = {
        d: dict(sorted((found or {}).items()))
        for d, found in ((0, _node_groups(loaded)), (2, mesh.boundaries), (3, mesh.subdomains))
    }
    tags = {(d, name): tag for tag, (d, name) in enumerate(((d, n) for d in groups for n in groups[d]), start=1)}
    yield from ("$MeshFormat", "4.1 0 8", "$EndMeshFormat")
    yield from ("$PhysicalNames", str(len(tags)))
    yield from (f'{d} {tag} "{name}"' for (d, name), tag in tags.items())
    yield "$EndPhysicalNames"

    # The format lists an element once, and physical groups belong to entities. So elements that belong to the same
    # groups make an entity.
    solid, order = next((number, order) for number, (name, order) in SOLIDS.items() if name == kind)
    cells = nodes.copy()
    if order is not None:
        cells[:, order] = nodes
    blocks: list[tuple[int, int, Ints, list[int]]] = []  # dimension, Gmsh's type, nodes (n, k), physical groups
    for name, rows in groups[0].items():
        blocks.append((0, POINT, np.asarray(rows)[:, None], [tags[0, name]]))
    for members, names in _shared(groups[2], mesh.nfacets):
        if names:
            facets = _facet_nodes(loaded, kind, nodes, members)
            blocks.append((2, _FACET_TYPES[facets.shape[1]], facets, [tags[2, n] for n in names]))
    for members, names in _shared(groups[3], mesh.nelements):
        blocks.append((3, solid, cells[members], [tags[3, n] for n in names]))
    yield "$Entities"
    yield " ".join(str(sum(d == dimension for d, *_ in blocks)) for dimension in range(4))
    for tag, (dimension, _, rows, physical) in enumerate(blocks, start=1):
        ends = [] if dimension == 0 else [0]  # no bounding entities are named
        yield f"{tag} {_box(points[rows.ravel()], dimension)} {_row([len(physical), *physical, *ends])}"
    yield "$EndEntities"

    numbers = _node_numbers(loaded)
    first = next(tag for tag, (dimension, *_) in enumerate(blocks, start=1) if dimension == 3)
    yield from ("$Nodes", f"1 {len(points)} {numbers.min()} {numbers.max()}", f"3 {first} 0 {len(points)}")
    yield from map(str, numbers.tolist())
    yield from (" ".join(map(repr, point)) for point in points.tolist())
    yield "$EndNodes"

    total = sum(len(rows) for _, _, rows, _ in blocks)
    yield from ("$Elements", f"{len(blocks)} {total} 1 {total}")
    element = 1
    for tag, (dimension, number, rows, _) in enumerate(blocks, start=1):
        yield f"{dimension} {tag} {number} {len(rows)}"
        yield from (_row([label, *row]) for label, row in enumerate(numbers[rows].tolist(), start=element))
        element += len(rows)
    yield "$EndElements"


def _row(numbers: list[int]) -> str:
    return " ".join(map(str, numbers))


def _box(points: Floats, dimension: int) -> str:
    ends = [points[0]] if dimension == 0 else [points.min(axis=0), points.max(axis=0)]
    return " ".join(repr(float(x)) for x in np.concatenate(ends))


def _node_groups(loaded: LoadedMesh) -> dict[str, Ints]:
    """Return the nodes of the node sets by name, and under NAME + `HELD` those of `NodeSet.held` where they differ."""
    found: dict[str, Ints] = {}
    for name, group in loaded.node_groups.items():
        found[name] = group.nodes
        if not np.array_equal(group.nodes, group.held):
            found[name + HELD] = group.held
    return found


def _node_numbers(loaded: LoadedMesh) -> Ints:
    count = loaded.mesh.doflocs.shape[1]
    known = loaded.node_numbers
    if list(known) != [""] or known[""][0].min() < 1:
        return np.arange(1, count + 1)
    given, columns = known[""]
    numbers = int(given.max()) + 1 + np.arange(count)
    numbers[columns] = given
    return numbers


def _shared(groups: Mapping[str, Ints], count: int) -> Iterator[tuple[Ints, list[str]]]:
    """Yield disjoint sets of the members 0 to `count` − 1, each with the names of the groups that all in it belong to.

    Every member is in exactly one of the sets, also those of no group.
    """
    belongs = np.zeros((count, len(groups)), bool)
    for column, members in enumerate(groups.values()):
        belongs[np.asarray(members), column] = True
    packed = np.packbits(belongs, axis=1) if groups else np.zeros((count, 1), np.uint8)
    kinds, index = np.unique(packed, axis=0, return_inverse=True)
    order = np.argsort(index.ravel(), kind="stable")
    for members in np.split(order, np.cumsum(np.bincount(index.ravel(), minlength=len(kinds)))[:-1]):
        yield members, [name for name, here in zip(groups, belongs[members[0]], strict=True) if here]


def _facet_nodes(loaded: LoadedMesh, kind: str, nodes: Ints, facets: Ints) -> Ints:
    """Return the nodes (f, k) of facets, corners first, counterclockwise seen from outside of the facet's element."""
    mesh, reference = loaded.mesh, REFERENCE[kind]
    owner = nodes[mesh.f2t[0, facets]]
    wanted = np.sort(mesh.facets[:, facets].T, axis=1)
    found = np.empty((len(facets), _FACET_NODES[kind]), np.int64)
    for face in FACES[SHAPE[kind]]:
        ends = reference[list(face)]
        middles = [(a + b) / 2 for a, b in zip(ends, np.roll(ends, -1, axis=0), strict=True)]
        places = [*ends, *middles, ends.mean(axis=0)][: found.shape[1]]
        local = [int(np.abs(reference - x).max(axis=1).argmin()) for x in places]
        here = (np.sort(owner[:, list(face)], axis=1) == wanted).all(axis=1)
        found[here] = owner[here][:, local]
    return found
