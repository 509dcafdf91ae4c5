"""Facets: the map of their elements, for meshes far from the origin as well, and composite quadrature."""

from __future__ import annotations

import copy
from itertools import combinations
from typing import Any

import numpy as np
import skfem
from skfem.mapping import MappingAffine
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTri

from ..errors import MeshError

_CLOSEST = 1e-12  # residual, summed over points, at which scikit-fem stops Newton's method for reference coordinates
_ROUNDING = 4.0  # roundings of a coordinate, over the size of the element, that remain at each point
_LARGEST = 1e-6  # part of the size of an element: a larger error would show in results


def facet_mapping(mesh: skfem.Mesh, facets: np.ndarray, points: int) -> Any:
    """Return the map of a mesh, whose inverse on the elements of some facets stops at the level of rounding.

    With coordinates of size x the reference coordinates in an element of size h are known to ε x/h only. scikit-fem's
    own limit cannot be reached for elements of 1 cm at a distance of 100 m.

    Parameters
    ----------
    mesh : skfem.Mesh
    facets : (f,) int
    points : int
        Points for each facet.

    Raises
    ------
    MeshError
        From the inverse: rounding leaves no accuracy.
    """
    mapping = copy.copy(mesh.mapping())  # the mesh keeps its own
    if isinstance(mapping, MappingAffine):
        return mapping
    corners = mesh.p[:, mesh.t[:, mesh.f2t[0, facets]]]
    pairs = combinations(range(corners.shape[1]), 2)
    lengths = np.array([np.linalg.norm(corners[:, i] - corners[:, j], axis=0) for i, j in pairs])
    size = float(lengths[lengths > 0].min(initial=np.inf))  # edges of collapsed cells have the length 0
    reach = float(np.abs(corners).max(initial=0.0))
    error = _ROUNDING * np.finfo(float).eps * reach / size
    inverse = mapping.invF

    def invF(x: np.ndarray, tind: np.ndarray | None = None) -> np.ndarray:
        try:
            if error <= _LARGEST:
                return np.asarray(inverse(x, tind, newton_tol=max(_CLOSEST, 3 * points * error)))
        except Exception as failure:  # scikit-fem raises no other
            if "Newton" not in str(failure):
                raise
        raise MeshError(
            f"elements of {size:.3g} m have nodes at {reach:.3g} m from the origin, where rounding hides their shape;"
            " expected elements that are less distorted, or a mesh nearer to the origin"
        )

    mapping.invF = invF
    return mapping


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
