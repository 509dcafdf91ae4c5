"""A measure of how far cells are from their regular shape."""

from __future__ import annotations

import numpy as np
import skfem
from skfem.refdom import RefTet

from .raw import Floats, Ints

# Edges of the regular tetrahedron from its first corner, as columns; the regular hexahedron is the cube.
_REGULAR = np.array([[1.0, 0.5, 0.5], [0.0, np.sqrt(3) / 2, np.sqrt(3) / 6], [0.0, 0.0, np.sqrt(2 / 3)]])
_CHUNK = 20_000  # cells at a time


def shape_condition(mesh: skfem.Mesh, elements: Ints) -> Floats:
    """Return the condition number κ of the map from the regular cell to each cell, at its worst node.

    κ = σ_max/σ_min of JW⁻¹, J the Jacobian and W that of the regular tetrahedron or cube: 1 where the cell is regular,
    the ratio of the sides of a brick, infinite where a corner is flat. Strains across the shortest extent are κ² times
    as stiff as those along the longest, and an element stiffness has both. (P. M. Knupp, SIAM J. Sci. Comput. 23, 2001:
    algebraic mesh quality metrics.)

    Parameters
    ----------
    elements : (e,) int

    Returns
    -------
    (e,) float

    Examples
    --------
    >>> shape_condition(skfem.MeshHex().scaled((1.0, 1.0, 0.25)), np.array([0])).round(12)
    array([4.])
    """
    inverse = np.linalg.inv(_REGULAR) if mesh.refdom is RefTet else np.eye(3)
    X = np.asarray(mesh.elem().doflocs).T
    worst = np.ones(len(elements))
    for start in range(0, len(elements), _CHUNK):
        part = elements[start : start + _CHUNK]
        J = np.moveaxis(np.asarray(mesh.mapping().DF(X, tind=part)), (0, 1), (-2, -1))  # (e, points, 3, 3)
        sizes = np.linalg.svd(J @ inverse, compute_uv=False)
        with np.errstate(divide="ignore"):
            worst[start : start + _CHUNK] = (sizes[..., 0] / sizes[..., 2]).max(axis=1)
    return worst
