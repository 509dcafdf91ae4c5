"""Structured meshes with named groups: put together from bodies, and handed on as they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fe_squeal.mesh.gmsh_cells import Cells, raw_mesh
from fe_squeal.mesh.raw import Floats, Ints, RawMesh

GMSH_TYPE = {(2, 4): 3, (2, 9): 10, (3, 8): 5, (3, 27): 12}  # (dimension, nodes per element) -> gmsh's element type


@dataclass(frozen=True)
class GroupedMesh:
    """Nodes, and the elements and facets of each named group, in gmsh's node order.

    Attributes
    ----------
    points : (n, 3) float, length
    volumes : name -> (m, 8 or 27) int
        Hexahedra with positive Jacobians, numbered from 0 into `points`.
    surfaces : name -> (m, 4 or 9) int
        Facets, their normals pointing out of the body.
    """

    points: Floats
    volumes: Mapping[str, Ints]
    surfaces: Mapping[str, Ints]


def join_meshes(parts: Sequence[GroupedMesh]) -> GroupedMesh:
    """Put meshes side by side, sharing no nodes; group names must differ."""
    starts = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
    placed = list(zip(starts, parts, strict=True))
    return GroupedMesh(
        points=np.vstack([part.points for part in parts]),
        volumes={name: cells + start for start, part in placed for name, cells in part.volumes.items()},
        surfaces={name: cells + start for start, part in placed for name, cells in part.surfaces.items()},
    )


def as_raw(mesh: GroupedMesh) -> RawMesh:
    """Return the mesh as a reader would hand it over: nodes and elements in the order in which a file has them."""
    order = np.concatenate(list(owned_nodes(mesh).values()))
    groups = [(2, name, facets) for name, facets in mesh.surfaces.items()]
    groups += [(3, name, elements) for name, elements in mesh.volumes.items()]
    cells, names, first = [], {}, 1
    for tag, (dimension, name, nodes) in enumerate(groups, start=1):
        names[dimension, tag] = name
        cells.append(Cells(GMSH_TYPE[dimension, nodes.shape[1]], first + np.arange(len(nodes)), nodes + 1, (tag,)))
        first += len(nodes)
    return raw_mesh("the geometry", order + 1, mesh.points[order], cells, names)


def owned_nodes(mesh: GroupedMesh) -> dict[str, Ints]:
    """Give each node to the first volume that has it, for the format lists a node once."""
    free = np.ones(len(mesh.points), dtype=bool)
    owned = {}
    for name, cells in mesh.volumes.items():
        nodes = np.unique(cells)
        owned[name] = nodes[free[nodes]]
        free[nodes] = False
    return owned
