"""Structured meshes with named groups: joined from bodies, and turned into what a reader of a file returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fe_squeal.mesh.gmsh_cells import GmshCells, raw_mesh
from fe_squeal.mesh.raw import Floats, Ints, RawMesh

GMSH_TYPE = {(2, 4): 3, (2, 9): 10, (3, 8): 5, (3, 27): 12}  # gmsh's element type by (dimension, nodes per element)


@dataclass(frozen=True)
class GroupedMesh:
    """Nodes, and the elements and facets of each named group, in gmsh's node order.

    Attributes
    ----------
    points : (n, 3) float, in the geometry's unit of length
        Coordinates of the nodes.
    volumes : mapping of str to (m, 8 or 27) int
        By name, the nodes (rows of `points`) of hexahedra with positive Jacobians.
    surfaces : mapping of str to (m, 4 or 9) int
        By name, the nodes of facets, whose normals point out of the body.
    """

    points: Floats
    volumes: Mapping[str, Ints]
    surfaces: Mapping[str, Ints]


def join_meshes(parts: Sequence[GroupedMesh]) -> GroupedMesh:
    """Return one mesh of several whose group names differ; they share no nodes."""
    starts = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
    placed = list(zip(starts, parts, strict=True))
    return GroupedMesh(
        points=np.vstack([part.points for part in parts]),
        volumes={name: cells + start for start, part in placed for name, cells in part.volumes.items()},
        surfaces={name: cells + start for start, part in placed for name, cells in part.surfaces.items()},
    )


def as_raw(mesh: GroupedMesh) -> RawMesh:
    """Return the mesh as a reader would, with nodes and elements in the order in which its file has them."""
    order = np.concatenate(list(owned_nodes(mesh).values()))
    groups = [(2, name, facets) for name, facets in mesh.surfaces.items()]
    groups += [(3, name, elements) for name, elements in mesh.volumes.items()]
    cells, names, first = [], {}, 1
    for tag, (dimension, name, nodes) in enumerate(groups, start=1):
        names[dimension, tag] = name
        cells.append(GmshCells(GMSH_TYPE[dimension, nodes.shape[1]], first + np.arange(len(nodes)), nodes + 1, (tag,)))
        first += len(nodes)
    return raw_mesh("the geometry", order + 1, mesh.points[order], cells, names)


def owned_nodes(mesh: GroupedMesh) -> dict[str, Ints]:
    """Return the nodes (n,) by volume, each node in the first volume that has it: the format lists a node once."""
    free = np.ones(len(mesh.points), dtype=bool)
    owned = {}
    for name, cells in mesh.volumes.items():
        nodes = np.unique(cells)
        owned[name] = nodes[free[nodes]]
        free[nodes] = False
    return owned
