"""Faces that touch and are not joined, or are joined by accident: what meshes from elsewhere often have."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from itertools import combinations

import numpy as np
import skfem
from scipy.spatial import cKDTree

from ..fem.facets import facet_corners, facet_points
from ..fem.meeting import locate_along
from ..mesh import LoadedMesh
from ..mesh.groups import find_facets
from ..scene import Scene

_TOGETHER = 1e-6  # of the model's size: the middle of a facet that is closer to another facet lies on it
_OPPOSITE = -0.5  # cosine between the outward normals of facets that lie on each other, at most


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
    """Yield a sentence for each pair of bodies of which free facets lie on each other; both may be the same body.

    Their nodes may be the same or others: what counts is that the middle of one facet lies on the other one, as it does
    where a mesh has hanging nodes, or hexahedra beside tetrahedra that cut their faces along the other diagonal.
    """
    mesh = loaded.mesh
    free = mesh.boundary_facets()
    joined = [find_facets(loaded, group, "") for group in _joining(scene)]
    free = np.setdiff1d(free, np.concatenate(joined)) if joined else free
    owner = np.empty(mesh.nelements, int)
    for i, elements in enumerate(bodies.values()):
        owner[elements] = i
    names, found = list(bodies), Counter[tuple[str, str]]()
    pairs = owner[np.stack(lying_on(mesh, free), axis=1)].tolist()
    for (i, j), count in sorted(Counter(map(tuple, pairs)).items()):
        one, two = sorted((names[i], names[j]))
        found[one, two] = max(found[one, two], count)  # each side may lie on the other
    for (one, two), count in found.items():
        yield (
            f"{count} faces of body {one} lie on faces of body {two}, and nothing joins them: expected the same faces"
            " and nodes on both sides (pyramids between hexahedra and tetrahedra), or a contact, tied or sliding"
        )


def lying_on(mesh: skfem.Mesh, facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the elements (k,) int of facets whose middles lie on other ones that face them, and those of the others.

    Parameters
    ----------
    facets : (f,) int
        Boundary facets.
    """
    nothing = np.zeros(0, int), np.zeros(0, int)
    if len(facets) < 2:
        return nothing
    cells, corners = mesh.f2t[0, facets], mesh.p[:, mesh.facets[:, facets]]
    middles = corners.mean(axis=1).T
    radii = np.linalg.norm(corners - middles.T[:, None], axis=0).max(axis=0)
    x = mesh.p.T[facet_corners(mesh, facets, cells)]
    normals = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    inside = middles - mesh.p[:, mesh.t[:, cells]].mean(axis=1).T
    normals *= np.sign(np.einsum("fi,fi->f", normals, inside))[:, None]
    # First what may lie there: opposite facets whose middle is within reach of the corners.
    lists = cKDTree(middles).query_ball_point(middles, radii)
    on = np.repeat(np.arange(len(facets)), [len(some) for some in lists])
    of = np.concatenate([np.asarray(some, int) for some in lists])
    away = np.abs(np.einsum("ki,ki->k", middles[of] - middles[on], normals[on]))
    near = (np.einsum("ki,ki->k", normals[of], normals[on]) < _OPPOSITE) & (away <= radii[on] / 2)
    if not near.any():
        return nothing
    own, others = facets[np.unique(of[near])], facets[np.unique(on[near])]
    centre = mesh.brefdom.p.mean(axis=1, keepdims=True)
    at = facet_points(mesh, mesh.elem(), own, (centre, np.ones(1)))
    hits = locate_along(mesh, others, at.points[:, 0], -at.normals[:, 0])
    touch = np.abs(hits.distance) <= _TOGETHER * float(np.ptp(mesh.p, axis=1).max())
    return mesh.f2t[0, own[touch]], hits.elements[touch]


def _joining(scene: Scene) -> Iterable[str]:
    """Yield the surface groups of contacts, springs and ties, which join what lies on either side in their own way."""
    for contact in scene.contacts:
        yield contact.surface
        if not contact.is_rigid:
            yield contact.counterface
    for spring in scene.springs:
        yield from (g for g in (spring.group, spring.to) if g is not None and spring.kind == "surface")
    yield from (table.group for _, table in scene.ties if table.kind == "surface")
