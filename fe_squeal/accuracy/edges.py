"""Elements at edges where stresses are singular, so that errors fall slowly as elements become smaller.

Near an edge of a body the displacement is r^α g(θ) plus what is smooth, r being the distance from the edge, and the
errors of eigenvalues in the elements at the edge fall like h^(2α) (Grisvard, Singularities in boundary value problems,
1992; Leguillon, Sanchez-Palencia, 1987). α is below 1, where

- a free surface turns inwards (α falls from 1 at an angle of 180° inside the material to 0.5 at a crack);
- what holds the surface ends (0.7 at a right angle on steel, 0.5 on a flat surface, 0.3 where the surface turns inwards
  there by a right angle, 0.25 at a crack);
- two materials that are joined come to the surface together.

A motion that is held along the normal alone, or along the surface alone, is the half of one that is symmetric or
antisymmetric. Such a surface counts as the inside of a body twice as large.

A contact that is hard beside the elements of a body, and whose other side is rigid or far stiffer, holds the body's
surface: all of its motion if it is tied, else that along the normal. Between two bodies of similar stiffness stresses
are singular where a hard contact ends: without friction α is 0.77 where a right angle stands on the flat surface of a
body of the same material (Dundurs, Lee, J. Elasticity 2, 1972), and 0.54 where it is tied there. Elsewhere, and where
tractions are bounded, as under springs and at the edges of a soft contact, errors fall at the rate of the elements.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from skfem.quadrature import get_quadrature

from ..assembly.assembly import Assembly
from ..assembly.places import held_places, holding
from ..effects.ties import Averaged
from ..fem.facets import facet_edges, facet_points
from ..fem.places import nodes_there
from ..mesh import LoadedMesh
from ..mesh.groups import find_facets
from ..mesh.node_sets import find_nodes

_INWARDS = 20.0  # degrees: an angle between facets that is larger than 180° by more than this turns inwards
_RIGHT = 100.0  # degrees: up to this angle a mirrored body has no edge that turns inwards
_CLOSED = 179.0  # degrees: facets that turn by more lie on each other, as at a crack; a wedge is not so thin
_ALONG = 0.99  # cosine: a normal counts as one of the axes
# Times E/h, h being the size of the elements: the stiffness of a hard contact. On hexahedra that are tied to a rigid
# wall by 2 E/h and less, the parts of elements at its edge fall to a quarter or less as the mesh is refined, as those
# of regular elements may; by 10 E/h they do not.
_HARD = 2.0
# Times a body's modulus: that of a far stiffer one. For its right angle on that one's flat surface, without friction, α
# is then 0.96 and more.
_STIFFER = 10.0
_DEGREE = 2  # of the quadrature of areas, which need be known to some per cent
_AXES = "xyz"
_NORMAL, _ELASTIC = 8, 16  # bits: held along the own normal; in hard contact with a body of similar stiffness


@dataclass(frozen=True)
class Edges:
    """The e edges on the surface of a mesh.

    Attributes
    ----------
    nodes : (e, 2) int
        Corners at the ends, as columns of `mesh.p`.
    elements : (e, 2) int
        The elements of the two facets that meet there; of two of them where more meet.
    facets : (e, 2) int
        These facets.
    angle : (e,) float, degrees
        Between the facets, through the material; NaN where more than two meet.
    normals : (e, 2, 3) float
        Outward normals of the two facets at the middle of the edge.
    """

    nodes: np.ndarray
    elements: np.ndarray
    facets: np.ndarray
    angle: np.ndarray
    normals: np.ndarray


def singular_elements(assembly: Assembly) -> np.ndarray:
    """Return (m,) bool, which elements have a node where stresses are singular.

    That is on an edge, or in a set of nodes that supports, springs or ties act on, but for faces that are held as a
    whole.

    Parameters
    ----------
    assembly : Assembly
    """
    mesh, scene = assembly.loaded.mesh, assembly.scene
    edges = surface_edges(assembly.loaded)
    held = _held_components(assembly)[edges.facets]  # (e, 2)
    material = np.zeros(mesh.nelements, int)
    names = list(scene.materials)
    for name, cells in assembly.bodies.items():
        material[cells] = names.index(scene.bodies[name].material)
    joined = material[edges.elements[:, 0]] != material[edges.elements[:, 1]]
    alike = held[:, 0] == held[:, 1]
    mirrored = [_is_mirror(held[:, i], edges.normals[:, i]) | (held[:, i] == 0) for i in (0, 1)]
    smooth = (alike & (edges.angle <= 180.0 + _INWARDS)) | (mirrored[0] & mirrored[1] & (edges.angle <= _RIGHT))
    corner = np.zeros(mesh.p.shape[1], bool)
    corner[edges.nodes[~smooth | joined]] = True
    found = np.asarray(corner[mesh.t].any(axis=0))
    space = assembly.space
    marked = np.zeros(space.nodes, bool)
    for path, kind, group in holding(scene):
        if kind != "surface":
            nodes = nodes_there(space, assembly.loaded, kind, group, path)
            is_held = path.startswith(("supports", "rigid"))
            marked[np.setdiff1d(nodes, _on_held_faces(assembly, group, path)) if is_held else nodes] = True
    return found | np.asarray(marked[space.dofs.element_dofs].any(axis=0))


def has_end_in_a_notch(assembly: Assembly) -> bool:
    """Return whether what holds a surface ends where the surface turns inwards: the slowest rate of all edges.

    Parameters
    ----------
    assembly : Assembly
    """
    edges = surface_edges(assembly.loaded)
    held = _held_components(assembly)[edges.facets] % _ELASTIC
    return bool(((held[:, 0] != held[:, 1]) & (edges.angle > 180.0 + _INWARDS)).any())


def acting_on_points(assembly: Assembly) -> list[str]:
    """Return the paths of supports, springs and ties on sets of nodes that cover no face.

    What a force on a point or a line displaces there grows without a limit as elements become smaller. A tie of nodes
    whose reference carries nothing has no forces if it is averaged or has one node.

    Parameters
    ----------
    assembly : Assembly
    """
    mesh, ties = assembly.loaded.mesh, dict(assembly.scene.ties)
    faces = mesh.facets[:, mesh.boundary_facets()]
    found: list[str] = []
    for path, kind, group in holding(assembly.scene):
        if kind == "surface" or path in found:
            continue
        nodes, tie = find_nodes(assembly.loaded, group, path).nodes, ties.get(path)
        if tie is not None and not tie.is_loaded and (isinstance(tie, Averaged) or len(nodes) == 1):
            continue
        if not _covered(faces, nodes).any():
            found.append(path)
    return found


def surface_edges(loaded: LoadedMesh) -> Edges:
    """Return the edges of a mesh that lie on its surface, each with the facets that meet there.

    Normals and angles are those of curved facets at the middle of the edge.
    """
    mesh = loaded.mesh
    facets = mesh.boundary_facets()
    cells, found = mesh.f2t[0, facets], facet_edges(mesh, facets)
    own, outward, inside = found.facet, found.normals, found.inwards
    key, inverse, count = np.unique(found.nodes, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(inverse.ravel(), kind="stable")
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    pair = np.stack([order[start], order[start + count - 1]], axis=1)  # rows of the two facets, where there are two
    n = outward[pair]
    turn = np.degrees(np.arccos(np.clip(np.einsum("ei,ei->e", n[:, 0], n[:, 1]), -1.0, 1.0)))
    inwards = (np.einsum("ei,ei->e", n[:, 0], inside[pair[:, 1]]) > 0) | (turn > _CLOSED)
    angle = np.where(count == 2, 180.0 + np.where(inwards, turn, -turn), np.nan)
    return Edges(key, cells[own[pair]], facets[own[pair]], angle, n)


def _held_components(assembly: Assembly) -> np.ndarray:
    """Return for each facet of the mesh the components that are held there, as bits: 1, 2 and 4 for x, y and z.

    A set of nodes holds the facets that it covers. Hard contacts have bits of their own, too.
    """
    scene, loaded = assembly.scene, assembly.loaded
    held, points = held_places(scene, loaded)
    for i, tie in enumerate(scene.rigid):
        if tie.kind == "surface":
            held.append((find_facets(loaded, tie.group, f"rigid[{i}].surface"), _AXES))
        else:
            points.append((find_nodes(loaded, tie.group, f"rigid[{i}].nodes").held, _AXES))
    held += [(_covered(loaded.mesh.facets, nodes), fixed) for nodes, fixed in points]
    found = np.zeros(loaded.mesh.facets.shape[1], int)
    for facets, fixed in held:
        found[facets] |= sum(1 << _AXES.index(c) for c in set(fixed))
    for facets, bits in _hard_contacts(assembly):
        found[facets] |= bits
    return found


def _hard_contacts(assembly: Assembly) -> Iterator[tuple[np.ndarray, int]]:
    """Yield the facets of each side of a contact that is hard beside its elements, and their bits."""
    mesh, scene = assembly.loaded.mesh, assembly.scene
    modulus = np.zeros(mesh.nelements)
    for name, cells in assembly.bodies.items():
        modulus[cells] = np.min(scene.materials[scene.bodies[name].material].youngs_modulus)
    for path, part in assembly.contacts().items():
        touching = np.unique(part.operators.values.indices)
        sides = [find_facets(assembly.loaded, group, path) for group in part.groups]
        moduli = [float(modulus[mesh.f2t[0, facets]].min()) for facets in sides]
        others = moduli[::-1] if len(sides) == 2 else [np.inf]
        for facets, own, other in zip(sides, moduli, others, strict=True):
            points = facet_points(mesh, mesh.elem(), facets, get_quadrature(mesh.brefdom, _DEGREE))
            size = np.sqrt(points.areas.sum() / len(facets))
            if part.normal_stiffness * size > _HARD * own:
                holds = 7 if part.kind == "tied" else _NORMAL
                yield facets[_covered(mesh.facets[:, facets], touching)], holds if other > _STIFFER * own else _ELASTIC


def _on_held_faces(assembly: Assembly, group: str, key: str) -> np.ndarray:
    """Return the nodes (n,) int of the faces that a held set of nodes covers; none if it leaves nodes of them free."""
    mesh, space = assembly.loaded.mesh, assembly.space
    held = space.nodes_at(find_nodes(assembly.loaded, group, key).held, between=True)
    faces = mesh.boundary_facets()
    nodes = np.unique(space.nodes_of(faces[_covered(mesh.facets[:, faces], held)]))
    return nodes if np.isin(nodes, held).all() else nodes[:0]


def _covered(facets: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Return (f,) bool, which facets, columns of corners, a set of nodes covers: all their corners are in it."""
    return np.asarray(np.isin(facets, nodes).all(axis=0))


def _is_mirror(held: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return (e,) bool, where the normal motion alone is held, or the two others alone."""
    axis = np.abs(normals).argmax(axis=1)
    along = np.abs(normals).max(axis=1) >= _ALONG
    normal = 1 << axis
    return np.asarray((held == _NORMAL) | (along & ((held == normal) | (held == 7 - normal))))
