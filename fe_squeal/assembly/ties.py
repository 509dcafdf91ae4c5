"""The ties of a scene on its mesh: which nodes follow which reference point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from ..effects.ties import Averaged, Rigid
from ..errors import SceneError
from ..fem.places import find_patch, nodes_there
from ..fem.spaces import DisplacementSpace
from ..fem.surfaces import Patch
from ..fem.ties import Tie, averaged_tie, mean_tie, rigid_columns, rigid_tie
from ..mesh import LoadedMesh
from ..mesh.groups import find_facets
from ..mesh.node_sets import find_nodes
from ..scene import Scene
from ..schema.place import Kind

_MANY = 300  # nodes: their full coupling has 3 · 10⁵ entries for each pair of components, as many as some 4000 unknowns


def with_ties(space: DisplacementSpace, scene: Scene, loaded: LoadedMesh) -> DisplacementSpace:
    """Return the space with the rigid and averaged reference points of a scene.

    Raises
    ------
    SceneError, MeshError
        Nodes of a tie are held, belong to another one, or lie on a line.
    """
    ties: list[Tie] = []
    owner = np.full(space.nodes, -1)
    keys = [key for key, _ in scene.ties]
    for i, (key, table) in enumerate(scene.ties):
        nodes = _nodes(space, loaded, table, key)
        if (owner[nodes] >= 0).any():
            shared, other = int((owner[nodes] >= 0).sum()), keys[int(owner[nodes].max())]
            what = f'"{table.group}" shares {shared} nodes with {other}'
            raise SceneError(f"{key}.{table.kind}: {what}; expected nodes of its own")
        held = space.fixed.reshape(-1, 3)[nodes].any(axis=1)
        if held.any():
            what = f'[[supports]] hold {int(held.sum())} nodes of "{table.group}"'
            raise SceneError(f"{key}.{table.kind}: {what}; expected them free, and fixed = ... at the reference")
        owner[nodes] = i
        try:
            ties.append(_tie(space, loaded, table, key, nodes))
        except ValueError as error:
            raise SceneError(f'{key}.{table.kind}: "{table.group}": {error}') from error
        single = ties[-1].rigid and ties[-1].fixed[3:].all() and not table.held[3:].all()
        if single and ((table.inertia is not None and any(table.inertia)) or any(s.axis for s in table.springs)):
            raise SceneError(f'{key}: "{table.group}" is one point and does not turn; expected no inertia and no axis')
    if ties and not len(replace(space, ties=tuple(ties)).free) and not sum(t.block.shape[1] for t in ties):
        raise SceneError("rigid: every displacement is held; expected at least one free unknown")
    ties += _means(space, scene, loaded, owner >= 0)
    return replace(space, ties=tuple(ties)) if ties else space


def _means(space: DisplacementSpace, scene: Scene, loaded: LoadedMesh, taken: np.ndarray) -> list[Tie]:
    """Return ties to the means of the large surfaces and node sets that springs with `to` act between.

    Where nodes belong to another tie, the spring's matrix is full instead.
    """
    found: dict[str, Tie] = {}
    taken = taken.copy()
    for i, spring in enumerate(scene.springs):
        for key, group in ((spring.kind, spring.group), ("to", spring.to)) if spring.to is not None else ():
            name = _mean_name(spring.kind, str(group))
            if name in found:
                continue
            weights = find_patch(space, loaded, spring.kind, str(group), f"springs[{i}].{key}").mean()
            nodes = np.flatnonzero(weights)
            if len(nodes) <= _MANY or taken[nodes].any():
                continue
            held = space.fixed.reshape(-1, 3)[nodes].ravel()
            tie = mean_tie(name, nodes, space.coordinates[nodes], weights[nodes], held)
            if tie is not None:
                found[name] = tie
                taken[nodes] = True
    return list(found.values())


def mean_motion(space: DisplacementSpace, patch: Patch, kind: Kind, group: str) -> sp.csr_array:
    """Return the operator (3, n) that gives the mean displacement of a surface or node set."""
    for tie in space.ties:
        if tie.name == _mean_name(kind, group) and tie.freedoms.shape[0] == 3:
            return space.reference(tie)
    means = sp.csr_array(patch.mean()[None, :])
    return sp.csr_array(sp.vstack([space.along(means, e) for e in np.eye(3)]))


def _mean_name(kind: Kind, group: str) -> str:
    return f"mean of {kind} {group}"


def _nodes(space: DisplacementSpace, loaded: LoadedMesh, table: Rigid, key: str) -> np.ndarray:
    if table.kind == "surface":
        return np.unique(space.nodes_of(find_facets(loaded, table.group, f"{key}.surface")))
    if isinstance(table, Averaged):
        return nodes_there(space, loaded, table.kind, table.group, f"{key}.nodes")
    return space.nodes_at(find_nodes(loaded, table.group, f"{key}.nodes").held, between=True)


def _tie(space: DisplacementSpace, loaded: LoadedMesh, table: Rigid, key: str, nodes: np.ndarray) -> Tie:
    x = space.coordinates[nodes]
    patch = find_patch(space, loaded, table.kind, table.group, f"{key}.{table.kind}")
    middle = patch.weights @ patch.points / patch.area  # the same on a refined mesh
    point = middle if table.reference is None else np.array(table.reference)
    if not isinstance(table, Averaged):
        return rigid_tie(table.name, nodes, x, point, table.held)
    R = rigid_columns(patch.points, point).reshape(-1, 3, 6) * patch.weights[:, None, None]
    values = patch.values[:, nodes]
    moments = np.stack([values.T @ R[:, c] for c in range(3)], axis=1)  # (m, 3, 6)
    return averaged_tie(table.name, nodes, x, point, table.held, moments.reshape(-1, 6))
