"""From reference cells to the mesh."""

from __future__ import annotations

import numpy as np
import skfem


def geometry_map(mesh: skfem.Mesh, elements: np.ndarray, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and Jacobians of reference points, one point per element.

    Parameters
    ----------
    elements : (k,) int
    X : (3, k) float
        Reference coordinates.

    Returns
    -------
    x : (3, k) float, m
    J : (3, 3, k) float, m
        J[i, j] = ∂x_i/∂X_j.
    """
    element, nodes = mesh.elem(), mesh.dofs.element_dofs[:, elements]
    x, J = np.zeros((3, X.shape[1])), np.zeros((3, 3, X.shape[1]))
    for i, node in enumerate(nodes):
        phi, dphi = element.lbasis(X, i)
        x += mesh.doflocs[:, node] * phi
        J += mesh.doflocs[:, node][:, None] * np.asarray(dphi)[None]
    return x, J
