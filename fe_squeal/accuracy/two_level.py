"""From a mesh to the refined one: prolongation, and solves on the refined mesh with factors of the coarse problem."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from ..eigen.blocks import times, with_short_indices
from ..eigen.linear.refinement import in_single
from ..errors import NotConvergedError
from ..fem.cells import geometry_map
from ..fem.contact import interpolation
from ..fem.spaces import DisplacementSpace

_NEWTON = 30  # Newton steps, at most, to find a point in its element
# The Newton iteration ends with a step of reference coordinates (an element is 1 long) below the rounding of the
# point's coordinates, of which _ROUNDED times the machine's unit is allowed, but never below _FOUND, nor ever above
# _NEAR.
_FOUND, _NEAR = 1e-12, 1e-6
_ROUNDED = 32.0
_ASTRAY = 1e-3  # of an element: a point that is farther from where it is likely to be is looked for from the middle
_POINTS = 4096  # that are found at once: what their elements' maps take then stays in the processor's cache
_ITERATIONS, _FEWEST = 60, 3  # steps of conjugate gradients, at most and at least
_SETTLED = 0.03  # of the energy ½ xᵀPx so far: the conjugate gradients end with a step that adds less
_ROWS = 4096  # whose products are summed in single precision: sums of many more would lose digits
_COLUMNS = 32  # right-hand sides that are solved at once: more take memory, and no less time


def prolongation(coarse: DisplacementSpace, fine: DisplacementSpace) -> sp.csr_array:
    """Return the (n_fine, n_coarse) sparse operator that writes a displacement on a mesh as one on the refined mesh.

    Parameters
    ----------
    coarse : DisplacementSpace
        On the mesh.
    fine : DisplacementSpace
        On the mesh that `fe_squeal.mesh.refining.refine` makes of that of `coarse`, with the same order, supports and
        ties.

    Raises
    ------
    NotConvergedError
        The formulation is the mixed one, whose bubbles are not functions of the refined mesh; or an element is so
        distorted that a node of the refined mesh is not found in it.
    """
    if coarse.bubbles is not None:
        raise NotConvergedError(
            'formulation = "mixed" adds functions between elements that a refined mesh does not have; hexahedra of'
            " order 2 do without"
        )
    children = nodes_of_children(coarse, fine)
    any_place = np.empty(fine.nodes, int)  # each node has one in every element around it, and any of these will do
    any_place[children.ravel()] = np.arange(children.size)
    parent, place = np.divmod(any_place, children.shape[1])
    near = places_in_first(coarse, fine)[:, place]
    values = interpolation(coarse, parent, reference_coordinates(coarse, parent, fine.coordinates.T, near))
    nodal = sp.csr_array(sp.kron(values, sp.eye_array(3), format="csr"))
    if coarse.ties or fine.ties:
        return with_short_indices(sp.csr_array(fine.nodal_inverse @ nodal @ coarse.nodal_map))
    return with_short_indices(sp.csr_array(nodal[fine.free][:, coarse.free]))


def nodes_of_children(coarse: DisplacementSpace, fine: DisplacementSpace) -> np.ndarray:
    """Return (m, 8 k) int the k nodes of the eight children of each of the m elements, as numbers in the fine mesh."""
    return np.asarray(fine.dofs.element_dofs).T.reshape(coarse.mesh.nelements, -1)


def places_in_first(coarse: DisplacementSpace, fine: DisplacementSpace) -> np.ndarray:
    """Return (3, 8 k) the reference coordinates, in the first element, of the nodes of its children.

    As a rule other elements are cut alike, so that from there Newton's method has nothing to do but to confirm it.
    """
    nodes = nodes_of_children(coarse, fine)[0]
    return reference_coordinates(coarse, np.zeros(len(nodes), int), fine.coordinates[nodes].T)


def reference_coordinates(
    space: DisplacementSpace, elements: np.ndarray, x: np.ndarray, near: np.ndarray | None = None
) -> np.ndarray:
    """Return the reference coordinates (3, k) of points in their elements, by Newton's method.

    Parameters
    ----------
    space : DisplacementSpace
    elements : (k,) int
        The element that each point lies in.
    x : (3, k) float, m
        The points.
    near : (3, k) float, optional
        Where the points are likely to be. From there, where that is right, and else from the middle of the element,
        the iteration starts.

    Raises
    ------
    NotConvergedError
        The iteration does not settle: an element is too distorted.
    """
    found, size = np.empty_like(x), np.abs(x).max(initial=0.0)
    for start in range(0, len(elements), _POINTS):
        own = slice(start, start + _POINTS)
        found[:, own] = _located(space, elements[own], x[:, own], None if near is None else near[:, own], size)
    return found


def _located(
    space: DisplacementSpace, elements: np.ndarray, x: np.ndarray, near: np.ndarray | None, size: float
) -> np.ndarray:
    """Return what `reference_coordinates` does; `size` is the largest coordinate of any point."""
    middle = np.asarray(space.mesh.elem().doflocs).mean(axis=0)[:, None]
    X = np.repeat(middle, len(elements), axis=1) if near is None else near
    for i in range(_NEWTON):
        at, J = geometry_map(space.mesh, elements, X)
        inverse = np.linalg.inv(J.transpose(2, 0, 1))
        step = (inverse @ (x - at).T[:, :, None])[:, :, 0].T
        X = X + step
        if i == 0 and near is not None and (astray := np.abs(step).max(axis=0) > _ASTRAY).any():
            X[:, astray] = middle
            continue
        # x is known to ε|x| only, so the reference coordinates are known to ε|x||J⁻¹| only: less well in thin elements.
        rounding = _ROUNDED * np.finfo(float).eps * size * np.abs(inverse).max(axis=(1, 2))
        if (np.abs(step) <= np.clip(rounding, _FOUND, _NEAR)).all():
            return X
    raise NotConvergedError("a node of the refined mesh was not found in its element: an element is too distorted")


class TwoLevelSolver:
    """Applies P⁻¹ on the refined mesh by conjugate gradients, preconditioned by diag(P)⁻¹ + E P_coarse⁻¹ Eᵀ.

    The second summand is exact on what the coarse mesh can represent. What it cannot represent oscillates from node to
    node, and for such vectors the diagonal of P is equivalent to P up to a factor that does not depend on the mesh
    (Bank, Dupont, Yserentant, Numer. Math. 52, 1988).

    Errors of some per cent do not matter, and all but the coarse solves is limited by the memory that it reads: so it
    is done in single precision (unless numbers are beyond that, see `in_single`).

    Parameters
    ----------
    P : (n_fine, n_fine) sparse, symmetric positive definite
    E : (n_fine, n_coarse) sparse
        The prolongation.
    coarse : callable
        Takes (n_coarse, k) to P_coarse⁻¹ times it.

    Attributes
    ----------
    iterations : int
        Steps of conjugate gradients so far, each on a block of right-hand sides.
    """

    def __init__(self, P: sp.csr_array, E: sp.csr_array, coarse: Callable[[np.ndarray], np.ndarray]) -> None:
        self._P, self._coarse = in_single(P), coarse
        self._E = sp.csr_array((E.data.astype(self._P.dtype), E.indices, E.indptr), shape=E.shape)
        self._restriction = sp.csr_array(self._E.T)
        self._diagonal = self._P.diagonal()[:, None]
        self.iterations = 0

    def solve(self, B: np.ndarray, negligible: np.ndarray | float = 0.0) -> np.ndarray:
        """Return P⁻¹B for B (n_fine, k) real, with an error of a few per cent of each column in the energy norm.

        Parameters
        ----------
        B : (n_fine, k) float
        negligible : (k,) float, optional
            Energies xᵀPx so small that it does not matter whether they are found.

        Raises
        ------
        NotConvergedError
            The iteration has not settled after `_ITERATIONS` steps.
        """
        limits = np.broadcast_to(negligible, B.shape[1])
        X, loaded = np.zeros(B.shape), np.flatnonzero(B.any(axis=0))  # imaginary parts of real vectors are zero
        if not len(loaded):
            return X
        for own in np.array_split(loaded, -(-len(loaded) // _COLUMNS)):
            size = np.abs(B[:, own]).max(axis=0)  # numbers in single precision end at 1e38
            X[:, own] = size * self._solve((B[:, own] / size).astype(self._P.dtype), limits[own] / size**2)
        return X

    def _solve(self, B: np.ndarray, negligible: np.ndarray) -> np.ndarray:
        X, R, Z, part = np.zeros_like(B), B.copy(), np.empty_like(B), np.empty_like(B)
        self._precondition(R, Z)
        D, rz = Z.copy(), _dots(R, Z)
        energy = np.zeros(B.shape[1])
        for step in range(_ITERATIONS):
            AD = times(self._P, D)
            curvature = _dots(D, AD)
            alpha = np.divide(rz, curvature, out=np.zeros_like(rz), where=curvature > 0)
            length = alpha.astype(D.dtype)
            X += np.multiply(D, length, out=part)
            R -= np.multiply(AD, length, out=part)
            gain = alpha * rz  # twice what this step adds to the energy ½ xᵀPx
            energy += gain
            self.iterations += 1
            if step + 1 >= _FEWEST and (gain <= np.maximum(_SETTLED * energy, negligible)).all():
                return X
            self._precondition(R, Z)
            before, rz = rz, _dots(R, Z)
            D *= np.divide(rz, before, out=np.zeros_like(rz), where=before > 0).astype(D.dtype)
            D += Z
        raise NotConvergedError(f"the correction on the refined mesh has not settled after {_ITERATIONS} iterations")

    def _precondition(self, R: np.ndarray, Z: np.ndarray) -> None:
        """Write the preconditioner times R to Z."""
        np.divide(R, self._diagonal, out=Z)
        Z += times(self._E, self._coarse(times(self._restriction, R)).astype(Z.dtype, copy=False))


def _dots(X: np.ndarray, Y: np.ndarray) -> np.ndarray:
    """Return the products xᵀy (k,) of the columns of X and Y (n, k)."""
    blocks = (slice(first, first + _ROWS) for first in range(0, len(X), _ROWS))
    return np.asarray(sum(np.einsum("ij,ij->j", X[rows], Y[rows]).astype(float) for rows in blocks))
