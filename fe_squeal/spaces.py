"""Displacement spaces: unknowns, elastic element matrices, surface interpolation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
import skfem
from skfem.assembly import Dofs
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTet, RefTri

from .bubbles import Bubbles, bubble_functions, make_bubbles
from .cell_map import geometry_map
from .errors import SceneError
from .facet_mapping import facet_mapping
from .mixed import pressure_functions

_ELEMENTS = {
    (True, 1): skfem.ElementTetP1,
    (True, 2): skfem.ElementTetP2,
    (False, 1): skfem.ElementHex1,
    (False, 2): skfem.ElementHex2,
}
ROUNDED = 1e-13  # size below which shape functions and direction components, of order 1, are rounding
_BYTES_PER_CHUNK = 2e8  # of element matrices held at once


@dataclass(frozen=True)
class Surface:
    """Quadrature and interpolation on facets.

    Attributes
    ----------
    points : (q, 3) float, m
    normals : (q, 3) float
        Outward unit normals.
    weights : (q,) float, m^2
    values : (q, nodes) sparse
        Shape-function values: `values @ u_nodes` interpolates at the points.
    facets : (f,) int
    """

    points: np.ndarray
    normals: np.ndarray
    weights: np.ndarray
    values: sp.csr_array
    facets: np.ndarray

    @property
    def area(self) -> float:
        """Area of the surface, m^2."""
        return float(self.weights.sum())

    def mean(self) -> np.ndarray:
        """Return the (nodes,) weights of the mean of a nodal field over the surface."""
        return np.asarray(self.values.T @ self.weights) / self.area


@dataclass(frozen=True)
class DisplacementSpace:
    """Continuous piecewise polynomial displacements on a mesh.

    Unknowns are the components of the nodes' displacements, 3 j + c being component c at node j, less those that are
    held, and behind them those of the bubbles between elements of the mixed formulation, which vanish at all nodes.

    Attributes
    ----------
    mesh : skfem.Mesh
        Tetrahedra or hexahedra, straight or curved.
    order : int
        1 or 2.
    fixed : (3 nodes,) bool
        Displacements that supports hold at zero; they are not unknowns.
    bubbles : Bubbles or None
    """

    mesh: skfem.Mesh
    order: int
    fixed: np.ndarray
    bubbles: Bubbles | None = None

    @cached_property
    def element(self) -> skfem.Element:
        """The scalar nodal element."""
        return _ELEMENTS[self.mesh.refdom is RefTet, self.order]()

    @cached_property
    def dofs(self) -> Dofs:
        """Numbering of the nodes."""
        return Dofs(self.mesh, self.element)

    @property
    def nodes(self) -> int:
        """Number of displacement nodes."""
        return int(self.dofs.N)

    @property
    def functions(self) -> int:
        """Number of scalar shape functions: of the nodes, and the bubbles behind them."""
        return self.nodes + (self.bubbles.functions if self.bubbles is not None else 0)

    @cached_property
    def free(self) -> np.ndarray:
        """Positions of the unknown displacements among all 3*nodes, int; the unknowns of bubbles come behind them."""
        return np.flatnonzero(~self.fixed)

    @property
    def unknowns(self) -> int:
        """Number of unknowns n."""
        return len(self.free) + (self.bubbles.unknowns if self.bubbles is not None else 0)

    @cached_property
    def prolongation(self) -> sp.csr_array:
        """(3 functions, n): amplitudes of all shape functions along x, y and z from the unknowns."""
        rows, columns = self.free, np.arange(len(self.free))
        nodal = sp.csr_array((np.ones(len(rows)), (rows, columns)), shape=(3 * self.nodes, len(rows)))
        if self.bubbles is None:
            return nodal
        return sp.csr_array(sp.block_diag([nodal, self.bubbles.directions]))

    def restricted(self, A: sp.csr_array) -> sp.csr_array:
        """Return the (n, n) matrix of a form on the unknowns from that (3 functions, 3 functions) on all functions."""
        if self.bubbles is None:
            return sp.csr_array(A[self.free][:, self.free])
        return sp.csr_array(self.prolongation.T @ A @ self.prolongation)

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
        """Return the nodes on facets."""
        return np.asarray(self.dofs.get_facet_dofs(facets).flatten())

    def surface(self, facets: np.ndarray, parts: int = 1) -> Surface:
        """Return quadrature and interpolation on boundary facets.

        Parameters
        ----------
        parts : int
            Every edge is cut into so many parts and each part of a facet integrated by itself, for integrands that are
            smooth only piece by piece.
        """
        quadrature = subdivided_quadrature(self.mesh.brefdom, self.integration_order, parts)
        basis = skfem.FacetBasis(
            self.mesh, self.element, facet_mapping(self.mesh, facets, len(quadrature[1])), facets=facets,
            quadrature=quadrature, dofs=self.dofs,
        )  # fmt: skip
        q = basis.dx.size
        shapes = np.stack([np.asarray(shape) for (shape,) in basis.basis])  # (local nodes, facets, points)
        rows = np.broadcast_to(np.arange(q).reshape(basis.dx.shape), shapes.shape)
        columns = np.broadcast_to(basis.element_dofs[:, :, None], shapes.shape)
        some = np.abs(shapes) >= ROUNDED  # nodes off the facet have no part in it but rounding
        values = sp.csr_array((shapes[some], (rows[some], columns[some])), shape=(q, self.nodes))
        points = np.asarray(basis.global_coordinates()).reshape(3, -1).T
        normals = np.asarray(basis.normals).reshape(3, -1).T
        return Surface(points, normals, basis.dx.ravel(), values, np.asarray(facets))

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
        nodal = sp.csr_array(self._interleave(components)[:, self.free])
        # Bubbles vanish on the boundary; on faces inside it is the nodal interpolant that counts.
        return sp.csr_array((nodal.data, nodal.indices, nodal.indptr), shape=(nodal.shape[0], self.unknowns))

    def expand(self, u: np.ndarray) -> np.ndarray:
        """Return nodal displacements (nodes, 3) of a vector of unknowns (n,)."""
        full = np.zeros(3 * self.nodes, dtype=u.dtype)
        full[self.free] = u[: len(self.free)]
        return full.reshape(-1, 3)

    def gather(self, nodal: np.ndarray) -> np.ndarray:
        """Return the unknowns (n,) of nodal displacements (nodes, 3), bubbles at rest; held displacements drop out."""
        u = np.zeros(self.unknowns, dtype=nodal.dtype)
        u[: len(self.free)] = nodal.ravel()[self.free]
        return u

    def amplitudes(self, u: np.ndarray) -> np.ndarray:
        """Return those of all shape functions, (functions, 3), of a vector of unknowns (n,)."""
        return np.asarray(self.prolongation @ u).reshape(-1, 3)

    def _interleave(self, components: list[sp.csr_array]) -> sp.csr_array:
        parts = [sp.coo_array(p) for p in components]
        rows = np.concatenate([p.coords[0] for p in parts])
        columns = np.concatenate([3 * p.coords[1] + c for c, p in enumerate(parts)])
        data = np.concatenate([p.data for p in parts])
        some = data != 0.0
        return sp.csr_array((data[some], (rows[some], columns[some])), shape=(parts[0].shape[0], 3 * self.nodes))


def make_space(
    mesh: skfem.Mesh, order: int, supports: list[tuple[np.ndarray, str]], mixed: Sequence[np.ndarray] = ()
) -> DisplacementSpace:
    """Return the displacement space with supports.

    Parameters
    ----------
    mesh : skfem.Mesh
    order : int
        1 or 2.
    supports : list of (facets, components)
        Components are any of "x", "y", "z".
    mixed : sequence of (e,) int
        Elements of each body of the mixed formulation.
    """
    space = DisplacementSpace(mesh, order, np.zeros(0, bool))
    fixed, held = np.zeros((space.nodes, 3), bool), np.zeros(mesh.nfacets, bool)
    elements = np.zeros(mesh.nelements, bool)
    for facets, components in supports:
        nodes = space.nodes_of(facets)
        held[facets] = True
        for c in components:
            fixed[nodes, "xyz".index(c)] = True
    if fixed.all():
        raise SceneError("supports: every displacement is held; expected at least one free unknown")
    for body in mixed:
        elements[body] = True
    return DisplacementSpace(mesh, order, fixed.ravel(), make_bubbles(mesh, order, elements, held))


def straightened(mesh: skfem.Mesh) -> skfem.Mesh:
    """Return the mesh with straight edges between its corners, groups kept; a straight mesh itself.

    Displacements of order 1 hold no rotation of a curved element: they would stiffen it against rigid motions.
    """
    kinds = {skfem.MeshTet2: skfem.MeshTet1, skfem.MeshHex2: skfem.MeshHex1}
    kind = next((k for quadratic, k in kinds.items() if isinstance(mesh, quadratic)), None)
    if kind is None:
        return mesh
    corners = mesh.t.max() + 1
    return kind(mesh.doflocs[:, :corners], mesh.t, _subdomains=mesh.subdomains, _boundaries=mesh.boundaries)


@dataclass(frozen=True)
class ElementShapes:
    """Shape functions on some elements at their quadrature points.

    Attributes
    ----------
    nodes : (e, j) int
        Numbers of the functions: those of nodes, and bubbles behind them.
    values : (e, j, q) float
    gradients : (e, j, 3, q) float, 1/m
    points : (e, 3, q) float, m
    dx : (e, q) float, m^3
    """

    nodes: np.ndarray
    values: np.ndarray
    gradients: np.ndarray
    points: np.ndarray
    dx: np.ndarray


def element_shapes(space: DisplacementSpace, elements: np.ndarray) -> Iterator[ElementShapes]:
    """Yield the shape functions of the elements (e,) of a body, so many at once that their matrices stay small."""
    bubbles = space.bubbles if space.bubbles is not None and space.bubbles.elements[elements].any() else None
    degree, local = space.integration_order, len(space.element.doflocs)
    if bubbles is not None:
        # The stiffness of bubbles, exact on straight elements. On tetrahedra the rule has positive weights, unlike the
        # next ones, and integrates the mass but for the products of two cell bubbles.
        degree = 6 if space.mesh.refdom is RefTet else 4
        local += len(space.mesh.refdom.facets) + bubbles.in_cells
    step = max(1, int(_BYTES_PER_CHUNK / (8 * (3 * local) ** 2)))
    mapping = space.mesh.mapping()
    for start in range(0, len(elements), step):
        chunk = elements[start : start + step]
        basis = skfem.CellBasis(
            space.mesh, space.element, mapping=mapping, elements=chunk, intorder=degree, dofs=space.dofs,
            disable_doflocs=True,
        )  # fmt: skip
        nodes = space.dofs.element_dofs[:, chunk].T
        values = np.stack([np.asarray(f[0]) for f in basis.basis], axis=1)
        gradients = np.moveaxis(np.stack([f[0].grad for f in basis.basis], axis=0), 2, 0)
        if bubbles is not None:
            b, db = bubble_functions(space.mesh.refdom, basis.X, bubbles.in_cells)
            nodes = np.hstack([nodes, space.nodes + bubbles.functions_of(space.mesh, chunk).T])
            values = np.concatenate([values, np.broadcast_to(b, (len(chunk), *b.shape))], axis=1)
            inverse = mapping.invDF(basis.X, tind=chunk)  # inverse[i, c] = ∂X_i/∂x_c
            gradients = np.concatenate([gradients, np.einsum("bir,icer->ebcr", db, inverse)], axis=1)
        points = np.moveaxis(np.asarray(basis.global_coordinates()), 0, 1)
        yield ElementShapes(nodes, values, gradients, points, basis.dx)


def scatter_scalar(space: DisplacementSpace, blocks: np.ndarray, nodes: np.ndarray) -> sp.csr_array:
    """Return the (n, n) matrix of a form that acts on each component alike, from its element blocks (e, j, j)."""
    scalar = scatter(blocks, nodes, space.functions)
    return space.restricted(sp.kron(scalar, sp.eye_array(3), format="csr"))


def assemble_elasticity(
    space: DisplacementSpace, elements: np.ndarray, stiffness: np.ndarray, density: float, lame: float = 0.0
) -> tuple[sp.csr_array, sp.csr_array]:
    """Return stiffness and mass matrix of a set of elements on the unknowns.

    K_(Ia)(Jc) = ∫ ∂_b N_I C_abcd ∂_d N_J + λ ∫ Π(∂_a N_I) Π(∂_c N_J),  M_(Ia)(Jc) = δ_ac ∫ ρ N_I N_J.

    Parameters
    ----------
    elements : (e,) int
    stiffness : (3, 3, 3, 3) float, Pa
    density : float, kg/m^3
    lame : float, Pa
        Lamé's λ of the mixed formulation, see `fe_squeal.mixed`; not in the stiffness then.

    Returns
    -------
    K, M : (n, n) sparse, N/m and kg
    """
    K = M = sp.csr_array((space.unknowns, space.unknowns))
    for shapes in element_shapes(space, elements):
        N, dN, t = shapes.values, shapes.gradients, shapes.nodes
        e, nodes = t.shape
        stress = np.einsum("abcd,ejdq,eq->ejcabq", stiffness, dN, shapes.dx, optimize=True)
        # Contract b and q in one batched matrix product: (e, I, bq) x (e, bq, Jca).
        right = np.transpose(stress, (0, 4, 5, 1, 2, 3)).reshape(e, -1, nodes * 9)
        block = (dN.reshape(e, nodes, -1) @ right).reshape(e, nodes, nodes, 3, 3)  # e I J c a
        block = np.transpose(block, (0, 1, 4, 2, 3)).reshape(e, 3 * nodes, 3 * nodes)
        if lame:
            P = pressure_functions(shapes.points, shapes.dx, space.order)
            div = np.einsum("eiq,ejaq->ejai", P * shapes.dx[:, None], dN, optimize=True).reshape(e, 3 * nodes, -1)
            block = block + lame * div @ np.swapaxes(div, 1, 2)
        mass = (N * (density * shapes.dx)[:, None, :]) @ np.transpose(N, (0, 2, 1))
        t3 = (3 * t[:, :, None] + np.arange(3)).reshape(e, -1)
        K = K + space.restricted(scatter(block, t3, 3 * space.functions))
        M = M + scatter_scalar(space, mass, t)
    # Rounding in the products leaves an asymmetry of some ulps that would hide the true class of the problem.
    return sp.csr_array((K + K.T) / 2), sp.csr_array((M + M.T) / 2)


def subdivided_quadrature(refdom: type, order: int, parts: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a composite rule on the reference triangle or square, cut into parts² equal pieces.

    Returns
    -------
    X : (2, q), W : (q,)
    """
    X, W = get_quadrature(refdom, order)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(parts), np.arange(parts), indexing="ij"))
    if refdom is not RefTri:
        pieces = [(np.array([a, b]), 1.0) for a, b in zip(i, j, strict=True)]
    else:
        # Upright triangles from their lower left corner, and those upside down from their upper right one.
        pieces = [(np.array([a, b]), 1.0) for a, b in zip(i, j, strict=True) if a + b < parts]
        pieces += [(np.array([a + 1, b + 1]), -1.0) for a, b in zip(i, j, strict=True) if a + b < parts - 1]
    points = [(corner[:, None] + sign * X) / parts for corner, sign in pieces]
    return np.concatenate(points, axis=1), np.tile(W / parts**2, len(pieces))


def scatter(blocks: np.ndarray, index: np.ndarray, n: int) -> sp.csr_array:
    """Return the (n, n) sum of element matrices (e, j, j) at the rows and columns of index (e, j)."""
    rows = np.broadcast_to(index[:, :, None], blocks.shape).ravel()
    columns = np.broadcast_to(index[:, None, :], blocks.shape).ravel()
    return sp.csr_array((blocks.ravel(), (rows, columns)), shape=(n, n))
