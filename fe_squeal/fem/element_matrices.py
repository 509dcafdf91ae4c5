"""Element matrices of elastic bodies, summed into those of the unknowns."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTet

from ..eigen.threads import one_openblas_thread
from .bubbles import bubble_functions
from .cells import cell_points, shape_functions
from .node_sums import NodeSums, scatter
from .pressures import pressure_functions
from .spaces import DisplacementSpace

_BYTES_PER_CHUNK = 5e8  # size of the element matrices held at once
_AT_ONCE = 16  # elements whose stiffness is computed at once, so that what it is made of stays in the cache


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
    X, W = get_quadrature(space.mesh.refdom, degree)
    N, dN = shape_functions(space.element, X)
    for start in range(0, len(elements), step):
        chunk = elements[start : start + step]
        nodes = space.dofs.element_dofs[:, chunk].T
        points, inverse, determinant = cell_points(space.mesh, chunk, X)
        values = np.broadcast_to(N, (len(chunk), *N.shape))
        gradients = np.einsum("jir,eicr->ejcr", dN, inverse)
        if bubbles is not None:
            b, db = bubble_functions(space.mesh.refdom, X, bubbles.in_cells)
            nodes = np.hstack([nodes, space.nodes + bubbles.functions_of(space.mesh, chunk).T])
            values = np.concatenate([values, np.broadcast_to(b, (len(chunk), *b.shape))], axis=1)
            gradients = np.concatenate([gradients, np.einsum("bir,eicr->ebcr", db, inverse)], axis=1)
        yield ElementShapes(nodes, values, gradients, points, np.abs(determinant) * W)


def scatter_scalar(space: DisplacementSpace, blocks: np.ndarray, nodes: np.ndarray) -> sp.csr_array:
    """Return the (n, n) matrix of a form that acts on each component alike, from its element blocks (e, j, j)."""
    return _alike(space, NodeSums(nodes, space.functions, space.moving), blocks)


def _alike(space: DisplacementSpace, sums: NodeSums, blocks: np.ndarray) -> sp.csr_array:
    return space.restricted(sp.kron(sums.scalar(blocks), sp.eye_array(3), format="csr"), space.moving)


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
        Lamé's λ of the mixed formulation, see `fe_squeal.fem.pressures`; not in the stiffness then.

    Returns
    -------
    K, M : (n, n) sparse, N/m and kg
    """
    K, M = sum_elements(space, elements, stiffness, density, lame)
    if space.selects:
        return K, M
    # Rounding in products with ties leaves an asymmetry of some ulps that would hide the true class of the problem.
    return symmetrised(K), symmetrised(M)


@one_openblas_thread()  # threads that other work keeps from their cores would make it take five times as long
def sum_elements(
    space: DisplacementSpace, elements: np.ndarray, stiffness: np.ndarray, density: float, lame: float = 0.0
) -> tuple[sp.csr_array, sp.csr_array]:
    """Return what `assemble_elasticity` does of elements (e,), (n, n) each and symmetric but for rounding by ties."""
    K = M = None
    for shapes in element_shapes(space, elements):
        N, dN, t = shapes.values, shapes.gradients, shapes.nodes
        e, nodes = t.shape
        block = np.empty((e, nodes, nodes, 3, 3))
        for first in range(0, e, _AT_ONCE):
            own = slice(first, first + _AT_ONCE)
            block[own] = _stiffness(stiffness, dN[own], shapes.dx[own])
        if lame:
            P = pressure_functions(shapes.points, shapes.dx, space.order)
            div = np.einsum("eiq,ejaq->ejai", P * shapes.dx[:, None], dN, optimize=True).reshape(e, 3 * nodes, -1)
            added = (lame * div @ np.swapaxes(div, 1, 2)).reshape(e, nodes, 3, nodes, 3)
            block += np.swapaxes(added, 2, 3)
            block = (block + np.transpose(block, (0, 2, 1, 4, 3))) / 2
        mass = (N * (density * shapes.dx)[:, None, :]) @ np.transpose(N, (0, 2, 1))
        sums = NodeSums(t, space.functions, space.moving)
        own_K = space.restricted(sums.vector(block), space.moving)
        own_M = _alike(space, sums, (mass + np.transpose(mass, (0, 2, 1))) / 2)
        K, M = (own_K, own_M) if K is None else (K + own_K, M + own_M)
    empty = sp.csr_array((space.unknowns, space.unknowns))
    return (empty, empty) if K is None else (K, M)


def sum_mass(space: DisplacementSpace, elements: np.ndarray, components: np.ndarray) -> sp.csr_array:
    """Return M_(Ia)(Jc) = A_ac ∫ N_I N_J over elements (e,) for A (3, 3): (n, n) on the unknowns, m^3."""
    M = sp.csr_array((space.unknowns, space.unknowns))
    for shapes in element_shapes(space, elements):
        N = shapes.values
        scalar = scatter((N * shapes.dx[:, None, :]) @ np.transpose(N, (0, 2, 1)), shapes.nodes, space.functions)
        M = M + space.restricted(sp.kron(scalar, sp.csr_array(components), format="csr"))
    return M


def nodal_mass(space: DisplacementSpace, elements: np.ndarray) -> sp.csr_array:
    """Return ∫ N_I N_J over elements (e,), m^3, of the nodes' functions without bubbles, (nodes, nodes)."""
    M = sp.csr_array((space.functions, space.functions))
    for shapes in element_shapes(space, elements):
        N = shapes.values
        M = M + scatter((N * shapes.dx[:, None, :]) @ np.transpose(N, (0, 2, 1)), shapes.nodes, space.functions)
    return symmetrised(sp.csr_array(M[: space.nodes][:, : space.nodes]))


def _stiffness(stiffness: np.ndarray, dN: np.ndarray, dx: np.ndarray) -> np.ndarray:
    """Return ∫ ∂_b N_I C_abcd ∂_d N_J (e, I, J, a, c) from gradients dN (e, j, 3, q) and weights dx (e, q).

    It is symmetric to the last bit. Rounding would leave some ulps, and hide the true class of the problem.
    """
    e, nodes = dN.shape[:2]
    flat = dN.reshape(e, 3 * nodes, -1)
    products = ((flat * dx[:, None, :]) @ np.swapaxes(flat, 1, 2)).reshape(e, nodes, 3, nodes, 3)  # e I b J d
    by_pair = np.swapaxes(products, 2, 3).reshape(-1, 9)
    block = (by_pair @ np.transpose(stiffness, (1, 3, 0, 2)).reshape(9, 9)).reshape(e, nodes, nodes, 3, 3)
    both: np.ndarray = block + np.transpose(block, (0, 2, 1, 4, 3))
    both /= 2
    return both


def symmetrised(A: sp.csr_array) -> sp.csr_array:
    """Return (A + Aᵀ)/2, with no third matrix of that size where A and Aᵀ have entries at the same places.

    Examples
    --------
    >>> symmetrised(sp.csr_array(np.array([[1.0, 2.0], [4.0, 0.0]]))).toarray()
    array([[1., 3.],
           [3., 0.]])
    """
    A.sum_duplicates()
    T = sp.csr_array(A.T)
    if not (np.array_equal(A.indptr, T.indptr) and np.array_equal(A.indices, T.indices)):
        T = sp.csr_array(A + T)
        T.data /= 2
        return T
    T.data += A.data
    T.data /= 2
    return T

