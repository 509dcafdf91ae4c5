"""Volumes, areas, centres and normals of bodies and groups."""

from __future__ import annotations

import numpy as np
import skfem

from .raw import Floats, Ints

_DEGREE = 6  # of the quadrature: curved hexahedra are integrated exactly


def volume_of(mesh: skfem.Mesh, elements: Ints) -> tuple[float, Floats]:
    """Return volume and centre (3,) of some elements."""
    basis = skfem.CellBasis(mesh, mesh.elem(), elements=elements, intorder=_DEGREE)
    return _sums(basis)


def area_of(mesh: skfem.Mesh, facets: Ints) -> tuple[float, Floats, Floats]:
    """Return area, centre (3,) and mean unit normal (3,) of some facets; the normal is shorter where they are bent."""
    basis = skfem.FacetBasis(mesh, mesh.elem(), facets=facets, intorder=_DEGREE)
    area, centre = _sums(basis)
    return area, centre, np.einsum("ifq,fq->i", np.asarray(basis.normals), basis.dx) / area


def _sums(basis: skfem.AbstractBasis) -> tuple[float, Floats]:
    size = float(basis.dx.sum())
    return size, np.einsum("ifq,fq->i", np.asarray(basis.global_coordinates()), basis.dx) / size
