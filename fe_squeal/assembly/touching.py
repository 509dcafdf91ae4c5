"""Bodies that touch and are not joined, or are joined by accident: what meshes from elsewhere often have."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from ..mesh import LoadedMesh
from ..mesh.groups import find_facets
from ..scene import Scene

_TOGETHER = 1e-6  # of the model's size: the middles of facets that are closer lie on each other


def warnings_of_touching(scene: Scene, loaded: LoadedMesh, bodies: Mapping[str, np.ndarray]) -> Iterator[str]:
    """Yield a sentence for contacts given twice, contact sides that share nodes, and faces that nothing joins.

    Parameters
    ----------
    scene : Scene
        Whose groups all exist in the mesh.
    loaded : LoadedMesh
    bodies : mapping of str to (m,) int
        Elements of each body.
    """
    yield from _twice(scene, loaded)
    yield from _glued(scene, loaded)
    yield from _loose(scene, loaded, bodies)


def _twice(scene: Scene, loaded: LoadedMesh) -> Iterator[str]:
    """Yield a sentence for each two contacts that act on the same facets of both sides, with sides swapped or not."""
    sides = []
    for contact in scene.contacts:
        groups = [contact.surface, *([] if contact.is_rigid else [contact.counterface])]
        sides.append([find_facets(loaded, group, "") for group in groups])
    for i, j in combinations(range(len(sides)), 2):
        if len(sides[i]) != len(sides[j]):
            continue
        for other in (sides[j], sides[j][::-1]):
            common = [len(np.intersect1d(one, two)) for one, two in zip(sides[i], other, strict=True)]
            if all(common):
                yield (
                    f'contacts {scene.contact_names[i]} and {scene.contact_names[j]} act between the same faces:'
                    f' {common[0]} of "{scene.contacts[i].surface}" are in both, and their stiffness adds up there'
                )
                break


def _glued(scene: Scene, loaded: LoadedMesh) -> Iterator[str]:
    mesh = loaded.mesh
    for name, contact in zip(scene.contact_names, scene.contacts, strict=True):
        if contact.is_rigid:
            continue
        pad, counter = (mesh.facets[:, find_facets(loaded, g, "")] for g in (contact.surface, contact.counterface))
        shared = np.intersect1d(pad, counter)
        if len(shared):
            yield (
                f"contact {name}: its two surfaces share {len(shared)} nodes, and are glued there; expected nodes of"
                " their own on either side"
            )


def _loose(scene: Scene, loaded: LoadedMesh, bodies: Mapping[str, np.ndarray]) -> Iterator[str]:
    """Yield a sentence for each pair of bodies of which free facets lie on each other."""
    mesh = loaded.mesh
    free = mesh.boundary_facets()
    joined = [find_facets(loaded, group, "") for group in _joining(scene)]
    free = np.setdiff1d(free, np.concatenate(joined)) if joined else free
    if len(free) < 2:
        return
    owner = np.empty(mesh.nelements, int)
    for i, elements in enumerate(bodies.values()):
        owner[elements] = i
    middles = mesh.p[:, mesh.facets[:, free]].mean(axis=1).T
    pairs = cKDTree(middles).query_pairs(_TOGETHER * float(np.ptp(mesh.p, axis=1).max()), output_type="ndarray")
    names = list(bodies)
    found = Counter(tuple(sorted((names[i], names[j]))) for i, j in owner[mesh.f2t[0, free[pairs]]].tolist())
    for (one, two), count in found.items():
        yield (
            f"{count} faces of body {one} lie on faces of body {two}, and nothing joins them: merge their nodes in the"
            " mesh, or give a contact, tied or sliding"
        )


def _joining(scene: Scene) -> Iterable[str]:
    """Yield the surface groups of contacts, springs and ties, which join what lies on either side in their own way."""
    for contact in scene.contacts:
        yield contact.surface
        if not contact.is_rigid:
            yield contact.counterface
    for spring in scene.springs:
        yield from (g for g in (spring.group, spring.to) if g is not None and spring.kind == "surface")
    yield from (table.group for _, table in scene.ties if table.kind == "surface")
