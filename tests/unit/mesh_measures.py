"""Volumes and areas of scikit-fem meshes by quadrature, and small meshes, for the mesh tests."""

from __future__ import annotations

from itertools import product

import numpy as np
from skfem import Basis, FacetBasis, Functional

from fe_squeal.mesh.elements import REFERENCE, SHAPE, shape_functions
from fe_squeal.mesh.raw import CellBlock, RawMesh


@Functional
def _one(w):
    return 1.0 + 0.0 * w.x[0]


def volume(mesh, elements=None):
    """Return the volume of a mesh; the quadrature is exact for its quadratic maps (degree 6 at most)."""
    return _one.assemble(Basis(mesh, mesh.elem(), intorder=8, elements=elements))


def area(mesh, facets):
    return _one.assemble(FacetBasis(mesh, mesh.elem(), facets=facets, intorder=10))


def centre(mesh, facets):
    """Return the mean (3,) of the corners of some facets."""
    return mesh.p[:, np.unique(mesh.facets[:, facets])].mean(axis=1)


def single(kind, move=lambda x: x):
    """Return one cell of a kind, with its reference nodes moved."""
    nodes = np.arange(len(REFERENCE[kind]))
    return RawMesh(
        move(REFERENCE[kind]), nodes + 1, (CellBlock(kind, nodes[None], np.array([7])),), {"body": np.array([0])}, {}
    )


def grid_of_kinds(n, kinds, move, seed):
    """Return a grid of n³ unit cubes cut into cells of some kinds in turn; its nodes are numbered at random.

    The cubes of "pyramid" consist of six pyramids about their centre.
    """
    rng = np.random.default_rng(seed)
    places: dict[tuple, int] = {}
    cells: dict[str, list] = {}

    def node(x):
        return places.setdefault(tuple(np.round(x, 9)), len(places))

    cube = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], float)
    sixths = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))
    sides = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))
    base = {
        "hexahedron": [cube],
        "tetra": [cube[list(t)] for t in sixths],
        "wedge": [cube[[0, 1, 2, 4, 5, 6]], cube[[0, 2, 3, 4, 6, 7]]],
        "pyramid": [np.vstack([cube[list(f)], [[0.5] * 3]]) for f in sides],
    }
    for i, corner in enumerate(product(range(n), repeat=3)):
        kind = kinds[i // n % len(kinds)]  # all cubes of a column have one kind, since triangles of wedges have to fit
        for shape in base[SHAPE[kind]]:
            x = shape_functions(SHAPE[kind], REFERENCE[kind]) @ (shape + np.array(corner))
            cells.setdefault(kind, []).append([node(p) for p in x])
    points = np.array(list(places))
    new = rng.permutation(len(points))
    shuffled = np.empty_like(points)
    shuffled[new] = points
    blocks = tuple(CellBlock(kind, new[np.array(rows)], np.arange(len(rows))) for kind, rows in cells.items())
    return RawMesh(move(shuffled / n), np.arange(len(points)), blocks, {}, {})
