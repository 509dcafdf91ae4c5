"""Where supports and springs of a scene act: the facets of surface groups, and the nodes of sets."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..mesh import LoadedMesh
from ..mesh.groups import find_facets
from ..mesh.node_sets import find_nodes
from ..scene import Scene
from ..schema.place import Kind

Held = list[tuple[np.ndarray, str]]  # facets or nodes, and the components that are held there


def held_places(scene: Scene, loaded: LoadedMesh) -> tuple[Held, Held]:
    """Return what supports hold, by facets and by nodes of the mesh.

    Raises
    ------
    MeshError
    """
    facets: Held = []
    nodes: Held = []
    for i, support in enumerate(scene.supports):
        key = f"supports[{i}].{support.kind}"
        if support.kind == "surface":
            facets.append((find_facets(loaded, support.group, key), support.fixed))
        else:
            nodes.append((find_nodes(loaded, support.group, key).held, support.fixed))
    return facets, nodes


def holding(scene: Scene) -> Iterator[tuple[str, Kind, str]]:
    """Yield path, kind and name of each surface and node set on which supports and springs act."""
    for i, support in enumerate(scene.supports):
        yield f"supports[{i}]", support.kind, support.group
    for key, table in scene.ties:
        yield key, table.kind, table.group
    for i, spring in enumerate(scene.springs):
        for group in (spring.group, spring.to):
            if group is not None:
                yield f"springs[{i}]", spring.kind, group
