"""Volumes, areas, centres and normals of bodies and groups."""

from __future__ import annotations

import numpy as np
import skfem

from .raw import Floats, Ints

_DEGREE = 6  # degree of the quadrature: curved hexahedra are integrated exactly


def volume_of(mesh: skfem.Mesh, elements: Ints) -> tuple[float, Floats]:
    """Return the volume, m³, and the centre (3,), m, of some elements (e,) int together."""
    basis = skfem.CellBasis(mesh, mesh.elem(), elements=elements, intorder=_DEGREE)
    return _sums(basis)


def area_of(mesh: skfem.Mesh, facets: Ints) -> tuple[float, Floats, Floats]:
    """Return the area, m², the centre (3,), m, and the mean unit normal (3,) of some facets (f,) int together.

    The mean of normals of different directions is shorter than 1.
    """
    basis = skfem.FacetBasis(mesh, mesh.elem(), facets=facets, intorder=_DEGREE)
    area, centre = _sums(basis)
    return area, centre, np.einsum("ifq,fq->i", np.asarray(basis.normals), basis.dx) / area


def mean_distance(mesh: skfem.Mesh, facets: Ints, axis: Floats, centre: Floats) -> float:
    """Return the mean distance of some facets (f,) int from the axis along a unit vector (3,) through a point (3,)."""
    basis = skfem.FacetBasis(mesh, mesh.elem(), facets=facets, intorder=_DEGREE)
    arms = np.cross(np.asarray(basis.global_coordinates()) - centre[:, None, None], axis, axisa=0, axisb=0, axisc=0)
    return float((np.linalg.norm(arms, axis=0) * basis.dx).sum() / basis.dx.sum())


def _sums(basis: skfem.AbstractBasis) -> tuple[float, Floats]:
    size = float(basis.dx.sum())
    return size, np.einsum("ifq,fq->i", np.asarray(basis.global_coordinates()), basis.dx) / size
