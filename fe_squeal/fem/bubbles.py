"""Bubble functions on faces and in cells, which let displacements follow the pressures of the mixed formulation.

On the reference cell let ℓ_G be the distance to face G. The bubble of face F is Π_{G≠F} ℓ_G, that of the cell Π_G ℓ_G,
each scaled to one at the centre: they vanish on all other faces, so they are continuous, and at all nodes, so nodal
displacements stay what they are. A face has one unknown, along its normal n: the flux through it. Discontinuous
pressures p of order k − 1 with displacements of order k are then stable (an inf-sup condition with a constant that
depends on the shape of the cells alone):

- p constant in each cell: the flux of any displacement through each face is matched by its bubble
  (Bernardi and Raugel, Math. Comp. 44, 1985; Girault and Raviart, Finite Element Methods for Navier–Stokes Equations,
  1986, II.2);
- p linear on tetrahedra: a cell bubble along ∇p, too, whose divergence meets the part of p that varies in the cell (as
  above; Boffi, Brezzi and Fortin, Mixed Finite Element Methods and Applications, 2013, chapter 8);
- p linear on hexahedra, with displacements of order 2: their space has such functions without bubbles in the cells.

Faces on the boundary of the mixed elements need no bubble: the condition for pressures of mean zero uses displacements
that vanish there, and the mean of the pressure is met by the nodal ones. The same holds for faces inside that are held.
So contacts, supports and neighbours never see them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import skfem
from skfem.refdom import RefTet

from .cells import geometry_map


@dataclass(frozen=True)
class Bubbles:
    """The bubbles of a displacement space; function i < facets is that of face i, facets + e that of cell e.

    Attributes
    ----------
    elements : (elements,) bool
        Which elements are of the mixed formulation.
    in_cells : bool
        Whether cells have one, beside the faces between them.
    directions : (3 functions, unknowns) sparse
        Column: the unit vectors along which one unknown moves its function; row 3 i + c is component c of function i.
    """

    elements: np.ndarray
    in_cells: bool
    directions: sp.csr_array

    @property
    def functions(self) -> int:
        """Number of functions, those without an unknown included."""
        return self.directions.shape[0] // 3

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return int(self.directions.shape[1])

    def functions_of(self, mesh: skfem.Mesh, elements: np.ndarray) -> np.ndarray:
        """Return (b, e) int: the functions of elements in the order of `bubble_functions`."""
        faces = mesh.t2f[:, elements]
        return np.vstack([faces, mesh.nfacets + elements]) if self.in_cells else faces


def make_bubbles(mesh: skfem.Mesh, order: int, elements: np.ndarray, held: np.ndarray) -> Bubbles | None:
    """Return the bubbles that pressures of order − 1 need in some elements; None where none are needed.

    Parameters
    ----------
    elements : (elements,) bool
    held : (faces,) bool
        Faces that supports hold in any component.
    """
    if not elements.any() or (order > 1 and mesh.refdom is not RefTet):
        return None
    one, other = mesh.f2t
    faces = np.flatnonzero((other >= 0) & elements[one] & elements[other] & ~held)
    cells = np.flatnonzero(elements) if order == 2 else np.zeros(0, int)
    i = np.concatenate([np.repeat(faces, 3), np.repeat(mesh.nfacets + cells, 3)])
    component = np.tile(np.arange(3), len(faces) + len(cells))
    column = np.concatenate([np.repeat(np.arange(len(faces)), 3), len(faces) + np.arange(3 * len(cells))])
    data = np.concatenate([_normals(mesh, faces).ravel(), np.ones(3 * len(cells))])
    functions = mesh.nfacets + (mesh.nelements if order == 2 else 0)
    shape = (3 * functions, len(faces) + 3 * len(cells))
    return Bubbles(elements, order == 2, sp.csr_array((data, (3 * i + component, column)), shape=shape))


def bubble_functions(refdom: type, X: np.ndarray, in_cells: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the bubbles of a reference cell: of its faces in scikit-fem's order, then, if wanted, that of the cell.

    Parameters
    ----------
    X : (3, q) float

    Returns
    -------
    values : (b, q) float
    gradients : (b, 3, q) float

    Examples
    --------
    >>> bubble_functions(RefTet, np.array([[1 / 3], [1 / 3], [0.0]]), False)[0].round(12).ravel().tolist()
    [1.0, 0.0, 0.0, 0.0]
    """
    corners, faces = np.asarray(refdom.p), refdom.facets  # type: ignore[attr-defined]
    normals = np.asarray(refdom.normals)  # type: ignore[attr-defined]
    on_face = np.stack([corners[:, f].mean(axis=1) for f in faces])

    def distances(x: np.ndarray) -> np.ndarray:
        return np.asarray(np.sum(normals * on_face, axis=1)[:, None] - normals @ x)

    chosen = [[g for g in range(len(faces)) if g != f] for f in range(len(faces))]
    centres = list(on_face)
    if in_cells:
        chosen.append(list(range(len(faces))))
        centres.append(corners.mean(axis=1))
    here = distances(X)
    values, gradients = [], []
    for factors, centre in zip(chosen, centres, strict=True):
        scale = 1 / np.prod(distances(centre[:, None])[factors])
        values.append(scale * np.prod(here[factors], axis=0))
        others = [np.prod(here[[h for h in factors if h != g]], axis=0) for g in factors]
        gradients.append(-scale * normals[factors].T @ np.stack(others))
    return np.stack(values), np.stack(gradients)


def _normals(mesh: skfem.Mesh, faces: np.ndarray) -> np.ndarray:
    """Return unit normals (f, 3) at the centres of faces."""
    elements = mesh.f2t[0, faces]
    local = np.argmax(mesh.t2f[:, elements] == faces, axis=0)
    centres = np.stack([np.asarray(mesh.refdom.p)[:, f].mean(axis=1) for f in mesh.refdom.facets], axis=1)
    _, J = geometry_map(mesh, elements, centres[:, local])
    normals = np.linalg.solve(np.transpose(J, (2, 1, 0)), mesh.refdom.normals[local][:, :, None])[:, :, 0]
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))
