"""The facets of a surface group, or the nodes of a set: where supports, springs and ties act."""

from __future__ import annotations

import numpy as np

from ..mesh import LoadedMesh
from ..mesh.groups import find_facets
from ..mesh.node_sets import find_nodes
from ..schema.place import Kind
from .spaces import DisplacementSpace
from .surfaces import Patch


def find_patch(space: DisplacementSpace, loaded: LoadedMesh, kind: Kind, group: str, key: str) -> Patch:
    """Return a surface group with its quadrature, or the nodes of a set.

    Raises
    ------
    MeshError, SceneError
    """
    if kind == "surface":
        return space.surface(find_facets(loaded, group, key))
    return space.patch(find_nodes(loaded, group, key).nodes)


def nodes_there(space: DisplacementSpace, loaded: LoadedMesh, kind: Kind, group: str, key: str = "") -> np.ndarray:
    """Return the nodes of a surface group, or those whose displacements give those of a node set, int.

    Raises
    ------
    MeshError, SceneError
    """
    if kind == "surface":
        return np.unique(space.nodes_of(find_facets(loaded, group, key)))
    return np.unique(find_patch(space, loaded, kind, group, key).values.indices)
