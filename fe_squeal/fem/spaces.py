"""Displacement spaces: what a space of unknowns is on surfaces and at nodes, and how one is made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
import skfem
from skfem.refdom import RefTet

from ..errors import SceneError
from ..mesh.node_sets import between_corners, with_nodes_between
from .bubbles import make_bubbles
from .cells import geometry_map, shape_functions
from .facets import facet_points, subdivided_quadrature
from .surfaces import Patch, Surface
from .unknowns import ELEMENTS, Unknowns

ROUNDED = 1e-13  # size below which shape functions and direction components, of order 1, are rounding


@dataclass(frozen=True)
class DisplacementSpace(Unknowns):
    """Continuous piecewise polynomial displacements on a mesh, and their interpolation at nodes and on surfaces."""

    @cached_property
    def coordinates(self) -> np.ndarray:
        """(nodes, 3) float, m: where the nodes are (on curved edges too)."""
        x = np.zeros((self.nodes, 3))
        elements = np.arange(self.mesh.nelements)
        for i, reference in enumerate(self.element.doflocs):
            X = np.repeat(np.asarray(reference)[:, None], len(elements), axis=1)
            x[self.dofs.element_dofs[i]] = geometry_map(self.mesh, elements, X)[0].T
        return x

    @property
    def integration_order(self) -> int:
        """Degree integrated exactly: the mass on straight elements, two more on curved tetrahedra."""
        curved = self.mesh.refdom is RefTet and isinstance(self.mesh, skfem.MeshTet2)
        return 2 * self.order + (2 if curved else 0)

    def nodes_of(self, facets: np.ndarray) -> np.ndarray:
        """Return the nodes (m,) int on facets (f,) int."""
        return np.asarray(self.dofs.get_facet_dofs(facets).flatten())

    def nodes_at(self, places: np.ndarray, between: bool = False) -> np.ndarray:
        """Return the nodes at nodes of the mesh, int.

        Parameters
        ----------
        places : (m,) int
            Columns of `mesh.doflocs`.
        between : bool
            Whether nodes count that elements have between these and the mesh lacks.

        Raises
        ------
        SceneError
            Displacements of order 1 have no unknown at any of them, or those of order 3 none at middles of edges whose
            ends are not among them.
        """
        if self.order == 3 and (places >= self.mesh.nvertices).any():
            members = between_corners(self.mesh, self.dofs, places)
            if members is None:
                raise SceneError(
                    "mesh.order: given 3; expected 1 or 2, since a node set has the middle of an edge without its ends"
                )
            return np.flatnonzero(members)
        members = np.zeros(self.nodes, bool)
        members[places[places < self.nodes]] = True
        if between and self.mesh.doflocs.shape[1] == self.mesh.nvertices < self.nodes:
            members = with_nodes_between(self.mesh, self.dofs, members)
        if not members.any():
            raise SceneError("mesh.order: given 1; expected 2, since a node set lies at middles of edges alone")
        return np.flatnonzero(members)

    def patch(self, places: np.ndarray) -> Patch:
        """Return the patch of nodes of the mesh, columns (m,) int of `mesh.doflocs`, with a weight of one each.

        Displacements of order 1 have those of corners alone. Displacements of order 3 are interpolated at middles of
        edges, faces and cells.

        Raises
        ------
        SceneError
            Displacements of order 1 have none of them.
        """
        if self.order == 3 and (places >= self.mesh.nvertices).any():
            own = np.asarray(self.mesh.dofs.element_dofs)  # (27, elements)
            columns, first = np.unique(own, return_index=True)
            local, element = np.divmod(first[np.searchsorted(columns, places)], own.shape[1])
            shapes = shape_functions(self.element, np.asarray(self.mesh.elem().doflocs).T)[0][:, local]
            points, node = self.mesh.doflocs.T[places], np.asarray(self.dofs.element_dofs)[:, element]
        else:
            nodes = self.nodes_at(places)
            points, node, shapes = self.coordinates[nodes], nodes[None], np.ones((1, len(nodes)))
        some = np.abs(shapes) >= ROUNDED
        rows = np.broadcast_to(np.arange(len(points)), shapes.shape)
        values = sp.csr_array((shapes[some], (rows[some], node[some])), shape=(len(points), self.nodes))
        return Patch(points, np.ones(len(points)), values)

    def surface(
        self, facets: np.ndarray, parts: int = 1, quadrature: tuple[np.ndarray, np.ndarray] | None = None
    ) -> Surface:
        """Return quadrature points and interpolation on boundary facets.

        Parameters
        ----------
        facets : (f,) int
        parts : int
            Every edge is cut into so many parts, and the parts of a facet are integrated separately, for integrands
            that are only piecewise smooth.
        quadrature : ((2, q), (q,)) float, optional
            Points and weights on the reference facet, instead of those of a rule on the parts.
        """
        if quadrature is None:
            quadrature = subdivided_quadrature(self.mesh.brefdom, self.integration_order, parts)
        at = facet_points(self.mesh, self.element, facets, quadrature)
        shapes = np.swapaxes(at.values, 1, 2)  # (facets, points, local nodes)
        rows = np.broadcast_to(np.arange(at.areas.size).reshape(*at.areas.shape, 1), shapes.shape)
        columns = np.broadcast_to(self.dofs.element_dofs[:, at.elements].T[:, None], shapes.shape)
        some = np.abs(shapes) >= ROUNDED  # nodes off the facet have no part in it but rounding
        values = sp.csr_array((shapes[some], (rows[some], columns[some])), shape=(at.areas.size, self.nodes))
        points, normals = at.points.reshape(-1, 3), at.normals.reshape(-1, 3)
        return Surface(points, at.areas.ravel(), values, normals, np.asarray(facets))

    def along(self, values: sp.csr_array, directions: np.ndarray) -> sp.csr_array:
        """Return the operator that gives the displacement along directions at points, on the unknowns.

        Parameters
        ----------
        values : (q, nodes) sparse
            Interpolation of a nodal field.
        directions : (q, 3) or (3,) float

        Returns
        -------
        (q, n) sparse
        """
        d = np.broadcast_to(np.asarray(directions, float), (values.shape[0], 3))
        d = np.where(np.abs(d) < ROUNDED, 0.0, d)
        components = [sp.diags_array(d[:, c]) @ values for c in range(3)]
        nodal = self._interleave(components)
        nodal = sp.csr_array(nodal @ self.nodal_map if self.ties else nodal[:, self.free])
        # Bubbles vanish on the boundary. On faces inside, what is asked for is the displacement of the nodes.
        return sp.csr_array((nodal.data, nodal.indices, nodal.indptr), shape=(nodal.shape[0], self.unknowns))

    def _interleave(self, components: list[sp.csr_array]) -> sp.csr_array:
        parts = [sp.coo_array(p) for p in components]
        rows = np.concatenate([p.coords[0] for p in parts])
        columns = np.concatenate([3 * p.coords[1] + c for c, p in enumerate(parts)])
        data = np.concatenate([p.data for p in parts])
        some = data != 0.0
        return sp.csr_array((data[some], (rows[some], columns[some])), shape=(parts[0].shape[0], 3 * self.nodes))


def make_space(
    mesh: skfem.Mesh, order: int, supports: list[tuple[np.ndarray, str]], mixed: Sequence[np.ndarray] = (),
    points: Sequence[tuple[np.ndarray, str]] = (),
) -> DisplacementSpace:
    """Return the displacement space with supports.

    Parameters
    ----------
    mesh : skfem.Mesh
    order : int
        1, 2, or, of hexahedra, 3.
    supports : list of (facets, components)
        Components are any of "x", "y", "z".
    mixed : sequence of (e,) int
        Elements of each body of the mixed formulation.
    points : sequence of (places, components)
        Node sets that are held, as columns of `mesh.doflocs`.

    Raises
    ------
    SceneError
        Nothing is free, a node set has no unknowns, or the order is 3 for tetrahedra.
    """
    if (mesh.refdom is RefTet, order) not in ELEMENTS:
        raise SceneError(f"mesh.order: given {order}; expected 1 or 2 for tetrahedra")
    space = DisplacementSpace(mesh, order, np.zeros(0, bool))
    fixed, held = np.zeros((space.nodes, 3), bool), np.zeros(mesh.nfacets, bool)
    elements = np.zeros(mesh.nelements, bool)
    for facets, components in supports:
        nodes = space.nodes_of(facets)
        held[facets] = True
        for c in components:
            fixed[nodes, "xyz".index(c)] = True
    for places, components in points:
        nodes = space.nodes_at(places, between=True)
        held |= np.isin(mesh.facets, nodes).all(axis=0)
        for c in components:
            fixed[nodes, "xyz".index(c)] = True
    if fixed.all():
        raise SceneError("supports: every displacement is held; expected at least one free unknown")
    for body in mixed:
        elements[body] = True
    return DisplacementSpace(mesh, order, fixed.ravel(), make_bubbles(mesh, order, elements, held))


def straightened(mesh: skfem.Mesh) -> skfem.Mesh:
    """Return the mesh with straight edges between its corners, groups kept; a straight mesh itself.

    Displacements of order 1 cannot represent the rotation of a curved element, which would resist rigid motions.
    """
    kinds = {skfem.MeshTet2: skfem.MeshTet1, skfem.MeshHex2: skfem.MeshHex1}
    kind = next((k for quadratic, k in kinds.items() if isinstance(mesh, quadratic)), None)
    if kind is None:
        return mesh
    corners = mesh.t.max() + 1
    points = np.ascontiguousarray(mesh.doflocs[:, :corners])
    return kind(points, mesh.t, _subdomains=mesh.subdomains, _boundaries=mesh.boundaries)
