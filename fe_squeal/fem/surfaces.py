"""Points of surfaces, or nodes of a set, with their weights and the interpolation at them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp


@dataclass(frozen=True)
class Patch:
    """Points with weights, and interpolation at them: of a surface, or the nodes of a set.

    Attributes
    ----------
    points : (q, 3) float, m
    weights : (q,) float
        Weights of the points: areas in m^2 for a surface, 1 for each node of a set of nodes.
    values : (q, nodes) sparse
        Shape-function values: `values @ u_nodes` interpolates at the points.
    """

    points: np.ndarray
    weights: np.ndarray
    values: sp.csr_array

    @property
    def area(self) -> float:
        """Sum of the weights: the area of a surface, m^2, or the number of nodes."""
        return float(self.weights.sum())

    def mean(self) -> np.ndarray:
        """Return the (nodes,) weights of the mean of a nodal field over the surface."""
        return np.asarray(self.values.T @ self.weights) / self.area


@dataclass(frozen=True)
class Surface(Patch):
    """Quadrature and interpolation on facets.

    Attributes
    ----------
    normals : (q, 3) float
        Outward unit normals.
    facets : (f,) int
    """

    normals: np.ndarray
    facets: np.ndarray

    def joined(self, other: Surface) -> Surface:
        """Return both surfaces as one, with the points of the other one behind those of this one."""
        return Surface(
            np.concatenate([self.points, other.points]), np.concatenate([self.weights, other.weights]),
            sp.csr_array(sp.vstack([self.values, other.values])), np.concatenate([self.normals, other.normals]),
            np.concatenate([self.facets, other.facets]),
        )  # fmt: skip
