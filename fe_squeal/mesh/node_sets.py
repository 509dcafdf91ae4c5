"""Node sets: which nodes of the mesh, or of a space on it, a named set of nodes stands for."""

from __future__ import annotations

import numpy as np
import skfem
from skfem.assembly import Dofs

from fe_squeal.errors import MeshError, suggest

from .groups import LoadedMesh
from .raw import Ints


def find_nodes(loaded: LoadedMesh, name: str, key: str) -> Ints:
    """Return a node set as columns of `mesh.doflocs`.

    Parameters
    ----------
    key : str
        Where it was named, for messages.

    Raises
    ------
    MeshError
        With the nearest name if there is none, or what else has that name.
    """
    if name in loaded.node_groups:
        return loaded.node_groups[name]
    alike = [known for known in loaded.node_groups if known.casefold() == name.casefold()]
    if loaded.ignore_case and len(alike) == 1:
        return loaded.node_groups[alike[0]]
    message = f'{key}: no node set "{name}" in {loaded.source}'
    if name in (loaded.mesh.boundaries or {}):
        raise MeshError(f'{message}: that is a surface group; write surface = "{name}"')
    if name in (loaded.mesh.subdomains or {}):
        raise MeshError(f"{message}: that is a volume group{suggest(name, loaded.node_groups)}")
    raise MeshError(message + suggest(name, loaded.node_groups))


def with_nodes_between(mesh: skfem.Mesh, dofs: Dofs, members: np.ndarray) -> np.ndarray:
    """Return a set of nodes with those on edges, faces and cells all of whose corners are in it.

    Parameters
    ----------
    dofs : Dofs
        Numbering of the nodes, corners first.
    members : (nodes,) bool

    Examples
    --------
    >>> mesh = skfem.MeshTet()
    >>> dofs = Dofs(mesh, skfem.ElementTetP2())
    >>> some = np.isin(np.arange(dofs.N), [0, 1, 2])
    >>> int(with_nodes_between(mesh, dofs, some).sum()) - 3  # edges among three corners of a cube's tetrahedra
    3
    """
    found = members.copy()
    places = ((dofs.edge_dofs, mesh.edges), (dofs.facet_dofs, mesh.facets), (dofs.interior_dofs, mesh.t))
    for own, corners in places:
        if own is not None and own.size:
            found[own[:, members[corners].all(axis=0)]] = True
    return found
