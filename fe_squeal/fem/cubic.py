"""Hexahedra of order 3: Lagrange polynomials on a lattice of 4 × 4 × 4 nodes, and the numbering of these."""

from __future__ import annotations

import itertools

import numpy as np
import skfem
from numpy.polynomial.polynomial import polyval
from skfem.assembly import Dofs
from skfem.element import ElementH1
from skfem.refdom import RefHex

_PLACES = np.linspace(0.0, 1.0, 4)
_COEFFICIENTS = np.linalg.inv(_PLACES[:, None] ** np.arange(4))  # (power, node) of the functions along one axis
_SLOPES = np.arange(1, 4)[:, None] * _COEFFICIENTS[1:]


def _nodes() -> np.ndarray:
    """Return the nodes of the reference cube, (64, 3): corners, then those of edges, faces and the inside.

    An edge has two nodes and a face has four, each nearest to one of its corners, in whose order they stand.
    """
    p = RefHex.p.T
    found = [*p]
    for ends in RefHex.edges:
        found += [(2 * p[a] + p[b]) / 3 for a, b in (ends, ends[::-1])]
    for corners in RefHex.facets:  # in cyclic order
        found += [(4 * p[corners[k]] + 2 * p[corners[k - 1]] + 2 * p[corners[k - 3]] + p[corners[k - 2]]) / 9
                  for k in range(4)]  # fmt: skip
    return np.array([*found, *itertools.product(_PLACES[1:3], repeat=3)])


class ElementHex3(ElementH1):
    """Scalar hexahedron of order 3, which scikit-fem does not have."""

    nodal_dofs, edge_dofs, facet_dofs, interior_dofs = 1, 2, 4, 8
    maxdeg = 9
    dofnames = ["u"] * 15
    doflocs = _nodes()
    refdom = RefHex
    _lattice = np.rint(3 * doflocs).astype(int)

    def lbasis(self, X: np.ndarray, i: int) -> tuple[np.ndarray, np.ndarray]:
        """Return function i and its derivatives (3, ...) at reference points X (3, ...)."""
        (a, b, c), (da, db, dc) = (
            [polyval(x, of[:, n]) for x, n in zip(X, self._lattice[i], strict=True)] for of in (_COEFFICIENTS, _SLOPES)
        )
        return a * b * c, np.stack([da * b * c, a * db * c, a * b * dc])


class CubicDofs(Dofs):
    """Numbering of the nodes of a mesh of such elements.

    Elements that share an edge or a face see its corners in different orders. So its nodes are numbered in the order of
    the numbers that the corners nearest to them have in the mesh.
    """

    def __init__(self, mesh: skfem.Mesh) -> None:
        super().__init__(mesh, ElementHex3())
        row = 8
        for part, of, numbers in ((RefHex.edges, mesh.t2e, self.edge_dofs), (RefHex.facets, mesh.t2f, self.facet_dofs)):
            for corners, which in zip(part, of, strict=True):
                rank = np.argsort(np.argsort(mesh.t[corners], axis=0), axis=0)
                self.element_dofs[row : row + len(corners)] = numbers[rank, which]
                row += len(corners)
