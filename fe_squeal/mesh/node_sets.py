"""Node sets: find the nodes that a name means, on the mesh or in a space of displacements on it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import skfem
from skfem.assembly import Dofs

from fe_squeal.errors import MeshError, suggest

from .groups import LoadedMesh, NodeSet
from .raw import Ints


def node_set(mesh: skfem.Mesh, nodes: Ints, added: np.ndarray) -> NodeSet:
    """Return the node set of some nodes.

    Parameters
    ----------
    mesh : skfem.Mesh
    nodes : (n,) int
        Columns of `mesh.doflocs`, in ascending order.
    added : (columns,) bool
        Which columns are nodes that the file does not have: those between nodes of the set are held with it.
    """
    held = nodes
    if added.any():
        members = np.zeros(len(added), bool)
        members[nodes] = True
        held = np.flatnonzero(with_nodes_between(mesh, mesh.dofs, members, added))
    return NodeSet(nodes, held)


def find_nodes(loaded: LoadedMesh, name: str, key: str) -> NodeSet:
    """Return the node set that a key of the scene names.

    Parameters
    ----------
    loaded : LoadedMesh
    name : str
        The name of a node set, the number of a node in the file ("12", "PAD-1.12"), or several of these separated by
        commas.
    key : str
        The key of the scene, such as "supports[0].nodes", for messages.

    Raises
    ------
    MeshError
        There is no such set or node; the message has the nearest name, or says what other group has this name.
    """
    if name in loaded.node_groups:
        return loaded.node_groups[name]
    alike = [known for known in loaded.node_groups if known.casefold() == name.casefold()]
    if loaded.ignore_case and len(alike) == 1:
        return loaded.node_groups[alike[0]]
    parts = [part.strip() for part in name.split(",")]
    if len(parts) > 1 and all(parts):
        nodes = np.unique(np.concatenate([find_nodes(loaded, part, key).nodes for part in parts]))
        return node_set(loaded.mesh, nodes, loaded.added)
    head, dot, number = name.rpartition(".")
    if number.isascii() and number.isdigit() and len(number) < 19:
        for prefix, (numbers, columns) in loaded.node_numbers.items():
            if prefix.casefold() == (head + dot).casefold():
                found = columns[numbers == int(number)]
                if len(found):
                    return NodeSet(found, found)
                raise MeshError(
                    f"{key}: no node {name} in {loaded.source}; expected one from {numbers.min()} to {numbers.max()}"
                )
    message = f'{key}: no node set "{name}" in {loaded.source}'
    if name in (loaded.mesh.boundaries or {}):
        raise MeshError(f'{message}: that is a surface group; write surface = "{name}"')
    if name in (loaded.mesh.subdomains or {}):
        raise MeshError(f"{message}: that is a volume group{suggest(name, loaded.node_groups)}")
    why = next((why for known, why in loaded.unusable.items() if known.casefold() == name.casefold()), "")
    raise MeshError(message + (why and f": {why}") + suggest(name, loaded.node_groups))


def with_named_sets(loaded: LoadedMesh, names: Iterable[str]) -> LoadedMesh:
    """Return the mesh with a node set of its own for each name that means several sets or numbers of nodes.

    Refining a mesh keeps its node sets, but not the numbers of its nodes, so that such names would be lost.

    Raises
    ------
    MeshError
        A name means no node.
    """
    new = {name: find_nodes(loaded, name, "nodes") for name in names if name not in loaded.node_groups}
    return replace(loaded, node_groups={**loaded.node_groups, **new}) if new else loaded


def with_nodes_between(
    mesh: skfem.Mesh, dofs: Dofs, members: np.ndarray, allowed: np.ndarray | None = None
) -> np.ndarray:
    """Return a set of nodes with all nodes between them: on edges whose ends are in the set, then faces, then cells.

    The centre of a face or cell belongs to it if all other nodes of this face or cell do. With the corners of a
    20-node hexahedron alone it does not: what moves there depends on the nodes on the edges too.

    Parameters
    ----------
    mesh : skfem.Mesh
    dofs : Dofs
        Numbering of the nodes, corners first.
    members : (nodes,) bool
        Which nodes are in the set.
    allowed : (nodes,) bool, optional
        Which nodes may be added (default: all).

    Returns
    -------
    (nodes,) bool

    Examples
    --------
    >>> mesh = skfem.MeshTet()
    >>> dofs = Dofs(mesh, skfem.ElementTetP2())
    >>> some = np.isin(np.arange(dofs.N), [0, 1, 2])
    >>> int(with_nodes_between(mesh, dofs, some).sum()) - 3  # edges among three corners of a cube's tetrahedra
    3
    """
    found = members.copy()
    may = np.ones(len(members), bool) if allowed is None else allowed
    if dofs.edge_dofs is not None and dofs.edge_dofs.size:
        _add(found, may, dofs.edge_dofs[:, members[mesh.edges].all(axis=0)])
    if dofs.facet_dofs is not None and dofs.facet_dofs.size:
        on_edges, whole = dofs.edge_dofs[0][mesh.t2e], np.zeros(mesh.nfacets, bool)
        for corners, facets in zip(mesh.refdom.facets, mesh.t2f, strict=True):
            edges = [j for j, ends in enumerate(mesh.refdom.edges) if set(ends) <= set(corners)]
            whole[facets] = found[mesh.t[corners]].all(axis=0) & found[on_edges[edges]].all(axis=0)
        _add(found, may, dofs.facet_dofs[:, whole])
        if dofs.interior_dofs is not None and dofs.interior_dofs.size:
            inside = [found[nodes].all(axis=0) for nodes in (mesh.t, on_edges, dofs.facet_dofs[0][mesh.t2f])]
            _add(found, may, dofs.interior_dofs[:, np.all(inside, axis=0)])
    return found


def between_corners(mesh: skfem.Mesh, dofs: Dofs, places: Ints) -> np.ndarray | None:
    """Return which nodes of higher elements a set of nodes of a quadratic mesh stands for.

    These are its corners, and all nodes of the edges, faces and cells whose middle is in the set.

    Parameters
    ----------
    mesh : skfem.Mesh
        Hexahedra with nodes at the middles of edges, faces and cells.
    dofs : Dofs
        Numbering of the nodes of the higher elements, corners first.
    places : (p,) int
        Columns of `mesh.doflocs`.

    Returns
    -------
    (nodes,) bool or None
        None where the middle of an edge is in the set and an end is not, or that of a face or cell without its corners.
    """
    own, given, found = mesh.dofs, np.zeros(mesh.doflocs.shape[1], bool), np.zeros(dofs.N, bool)
    given[places] = True
    found[places[places < mesh.nvertices]] = True
    for corners, middles, nodes in (
        (mesh.edges, own.edge_dofs, dofs.edge_dofs), (mesh.facets, own.facet_dofs, dofs.facet_dofs),
        (mesh.t, own.interior_dofs, dofs.interior_dofs),
    ):  # fmt: skip
        whole = given[middles[0]]
        if not given[corners[:, whole]].all():
            return None
        found[nodes[:, whole]] = True
    return found


def _add(found: np.ndarray, may: np.ndarray, nodes: Ints) -> None:
    found[nodes[may[nodes]]] = True
