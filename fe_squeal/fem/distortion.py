"""A measure of how far cells are from their regular shape."""

from __future__ import annotations

import numpy as np
import skfem
from skfem.refdom import RefTet

from .cells import shape_functions

# Edges of the regular tetrahedron from its first corner, as columns; the regular hexahedron is the cube.
_REGULAR = np.array([[1.0, 0.5, 0.5], [0.0, np.sqrt(3) / 2, np.sqrt(3) / 6], [0.0, 0.0, np.sqrt(2 / 3)]])
_CHUNK = 20_000  # cells at a time


def shape_condition(mesh: skfem.Mesh, elements: np.ndarray) -> np.ndarray:
    """Return the condition number κ of the map from the regular cell to each cell, at its worst node.

    κ = σ_max/σ_min of JW⁻¹, where J is the Jacobian of the cell and W that of the regular tetrahedron or cube. κ is 1
    for a regular cell, the ratio of the longest to the shortest side for a brick, and infinite where a corner is flat
    or a curved cell is folded, so that det J has not the same sign at all of its nodes. An element stiffness has
    entries for strains across the shortest and along the longest extent, and the first are κ² times the second.
    Source: P. M. Knupp, "Algebraic mesh quality metrics", SIAM J. Sci. Comput. 23, 2001.

    Parameters
    ----------
    mesh : skfem.Mesh
    elements : (e,) int
        The cells that are asked for.

    Returns
    -------
    (e,) float, dimensionless

    Examples
    --------
    >>> shape_condition(skfem.MeshHex().scaled((1.0, 1.0, 0.25)), np.array([0])).round(12)
    array([4.])
    """
    inverse = np.linalg.inv(_REGULAR) if mesh.refdom is RefTet else np.eye(3)
    slopes = np.moveaxis(shape_functions(mesh.elem(), np.asarray(mesh.elem.doflocs).T)[1], 2, 0)  # (points, n, 3)
    worst = np.ones(len(elements))
    for start in range(0, len(elements), _CHUNK):
        part = elements[start : start + _CHUNK]
        nodes = mesh.doflocs[:, mesh.dofs.element_dofs[:, part]].T  # (e, n, 3)
        local = np.swapaxes(nodes - nodes[:, :1], 1, 2)  # far from the origin coordinates lack digits
        J = local[:, None] @ slopes @ inverse  # (e, points, 3, 3)
        sizes, det = np.linalg.svd(J, compute_uv=False), np.linalg.det(J)
        folded = (det.min(axis=1) < 0) & (det.max(axis=1) > 0)
        with np.errstate(divide="ignore"):
            kappa = (sizes[..., 0] / sizes[..., 2]).max(axis=1)
        worst[start : start + _CHUNK] = np.where(folded, np.inf, kappa)
    return worst
