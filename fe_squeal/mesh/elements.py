"""Reference cells: node positions, faces, shape functions, and the change from VTK's node order to scikit-fem's.

scikit-fem's node order is not written down here: it is found by matching the reference coordinates of the nodes.
"""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
import skfem
from numpy.typing import NDArray
from skfem.quadrature import get_quadrature

from .raw import Floats, Ints

# Corners in VTK order. Hexahedron, wedge and tetrahedron lie in [0, 1]^3; the pyramid's base is [-1, 1]^2, so that
# its rational functions keep their usual form.
_CORNERS: dict[str, list[tuple[float, ...]]] = {
    "tetra": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "hexahedron": [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
    "wedge": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)],
    "pyramid": [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (0, 0, 1)],
}

# Edges in the order of VTK's midside nodes (vtkQuadraticTetra, vtkQuadraticHexahedron, ...).
EDGES: dict[str, tuple[tuple[int, int], ...]] = {
    "tetra": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hexahedron": ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
    "wedge": ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    "pyramid": ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
}

# Faces by their corners, counterclockwise seen from outside.
FACES: dict[str, tuple[tuple[int, ...], ...]] = {
    "tetra": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)),
    "hexahedron": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    "wedge": ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "pyramid": ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}

# Centres that follow the midside nodes: of faces (by their corners) and of the cell.
CENTRES: dict[str, tuple[tuple[int, ...], ...]] = {
    "hexahedron27": (
        (0, 3, 7, 4),
        (1, 2, 6, 5),
        (0, 1, 5, 4),
        (2, 3, 7, 6),
        (0, 1, 2, 3),
        (4, 5, 6, 7),
        tuple(range(8)),
    ),
    "wedge18": ((0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "pyramid14": ((0, 1, 2, 3),),
}

SHAPE = {
    "tetra": "tetra", "tetra10": "tetra",
    "hexahedron": "hexahedron", "hexahedron20": "hexahedron", "hexahedron27": "hexahedron",
    "wedge": "wedge", "wedge15": "wedge", "wedge18": "wedge",
    "pyramid": "pyramid", "pyramid13": "pyramid", "pyramid14": "pyramid",
}  # fmt: skip
QUADRATIC = {"tetra": "tetra10", "hexahedron": "hexahedron20", "wedge": "wedge15", "pyramid": "pyramid13"}
SPOKEN = {"tetra": "tetrahedra", "hexahedron": "hexahedra", "wedge": "wedges", "pyramid": "pyramids"}


def _reference(kind: str) -> Floats:
    shape = SHAPE[kind]
    corners = np.array(_CORNERS[shape], dtype=float)
    if kind == shape:
        return corners
    mids = [corners[list(edge)].mean(axis=0) for edge in EDGES[shape]]
    return np.vstack([corners, *mids, *(corners[list(ids)].mean(axis=0) for ids in CENTRES.get(kind, ()))])


REFERENCE: dict[str, Floats] = {kind: _reference(kind) for kind in SHAPE}


def corner_count(kind: str) -> int:
    """Return the number of corners of a kind of cell; they are the first of its nodes.

    Examples
    --------
    >>> corner_count("wedge15")
    6
    """
    return len(_CORNERS[SHAPE[kind]])


def _exponents(kind: str) -> list[tuple[int, int, int]]:
    cube: list[tuple[int, int, int]] = list(product(range(3), repeat=3))  # type: ignore[arg-type]
    if kind in ("tetra", "tetra10"):
        return [e for e in cube if sum(e) <= (1 if kind == "tetra" else 2)]
    if kind.startswith("hexahedron"):
        # The number of exponents of a monomial that may be 2. The serendipity space of 20 nodes allows one (D. N.
        # Arnold, G. Awanou, "The serendipity family of finite elements", Found. Comput. Math. 11, 2011).
        most = {"hexahedron": 0, "hexahedron20": 1, "hexahedron27": 3}[kind]
        return [e for e in cube if e.count(2) <= most]
    if kind == "wedge":
        return [e for e in cube if e[0] + e[1] <= 1 and e[2] <= 1]
    flat = 1 if kind == "wedge15" else 2
    return [e for e in cube if e[0] + e[1] <= (2 if e[2] < 2 else flat)]


def _basis(kind: str, x: NDArray) -> NDArray:
    """Return the values (q, k) of a basis of the cell's space at the points x (q, 3), both real or complex."""
    if SHAPE[kind] != "pyramid":
        return np.stack([np.prod(x ** np.array(e), axis=1) for e in _exponents(kind)], axis=1)
    a, b, c = x.T
    # The pyramid's rational functions: G. Bedrosian, Int. J. Numer. Meth. Eng. 35 (1992) 95-108. ab/(1 - c) tends to 0
    # at the apex c = 1.
    top = 1.0 - c
    r = a * b / np.where(np.abs(top) < 1e-14, 1.0, top)
    one = np.ones_like(a)
    columns = [one, a, b, c, r]
    if kind != "pyramid":
        columns += [a * a, b * b, c * c, a * b, a * c, b * c, a * r, b * r]
    if kind == "pyramid14":
        columns += [r * r]
    return np.stack(columns, axis=1)


@cache
def _coefficients(kind: str) -> Floats:
    return np.linalg.inv(_basis(kind, REFERENCE[kind]))


def shape_functions(kind: str, x: Floats) -> Floats:
    """Return the value (q, k) of every node's shape function at the reference points x (q, 3).

    Examples
    --------
    >>> shape_functions("tetra", np.array([[0.25, 0.25, 0.25]]))
    array([[0.25, 0.25, 0.25, 0.25]])
    """
    # Rounded, so that a node's function is exactly 1 at the node, and nodes of the file keep their coordinates exactly.
    return np.round(_basis(kind, np.asarray(x, dtype=float)) @ _coefficients(kind), 13)


def shape_gradients(kind: str, x: Floats) -> Floats:
    """Return the gradients (q, k, 3) of the shape functions at the reference points x (q, 3).

    They are taken by complex steps, Im f(x + ih)/h, which is exact up to rounding for the polynomials and rational
    functions here.
    """
    step = 1e-40
    parts = [np.imag(_basis(kind, x + 1j * step * np.eye(3)[j])) / step @ _coefficients(kind) for j in range(3)]
    return np.stack(parts, axis=2)


@cache
def quadrature(kind: str) -> tuple[Floats, Floats]:
    """Return points (q, 3) and weights (q,) of a rule on the reference cell.

    It integrates det J, and so the volume, exactly; on pyramids, where det J is no polynomial, nearly so.
    """
    order = 2 if kind == SHAPE[kind] else 6
    shape = SHAPE[kind]
    if shape == "tetra":
        x, w = get_quadrature(skfem.ElementTetP1.refdom, 3 if kind == "tetra10" else 1)
        return x.T, w
    line, weight = np.polynomial.legendre.leggauss(order // 2 + 1)
    line, weight = (line + 1) / 2, weight / 2
    if shape == "wedge":
        flat, flat_weight = get_quadrature(skfem.ElementTriP1.refdom, 2 if kind == "wedge" else 5)
        x = np.array([(*p, z) for p in flat.T for z in line])
        return x, np.array([a * b for a in flat_weight for b in weight])
    x = np.array(list(product(line, repeat=3)))
    w = np.array([a * b * c for a, b, c in product(weight, repeat=3)])
    if shape == "pyramid":
        w = 4 * w * (1 - x[:, 2]) ** 2
        x = np.column_stack([(2 * x[:, :2] - 1) * (1 - x[:, 2:]), x[:, 2]])
    return x, w


def matching(wanted: Floats, given: Floats) -> Ints:
    """Return the permutation p (k,) with given[p] equal to wanted: one node order in terms of another.

    Parameters
    ----------
    wanted, given : (k, d) float
        Reference coordinates of the same nodes in two orders.

    Raises
    ------
    ValueError
        They are not the same nodes.

    Examples
    --------
    >>> matching(np.array([[0.0], [1.0]]), np.array([[1.0], [0.0]]))
    array([1, 0])
    """
    distance = np.abs(wanted[:, None] - given[None]).max(axis=2)
    nearest = distance.argmin(axis=1)
    if len(wanted) != len(given) or distance.min(axis=1).max() > 1e-12 or len(np.unique(nearest)) != len(given):
        raise ValueError("the two sets of reference nodes differ")
    return nearest


MESH_CLASS: dict[str, type[skfem.Mesh]] = {
    "tetra": skfem.MeshTet1, "tetra10": skfem.MeshTet2,
    "hexahedron": skfem.MeshHex1, "hexahedron27": skfem.MeshHex2,
}  # fmt: skip


@cache
def skfem_order(kind: str) -> Ints:
    """Return p (k,) so that nodes[:, p] are in scikit-fem's order if nodes (n, k) are in VTK's, for a kind of cell."""
    return matching(np.asarray(MESH_CLASS[kind].elem.doflocs), REFERENCE[kind])


@cache
def mirror_order(kind: str) -> Ints:
    """Return p (k,) so that nodes[:, p] is the cell of nodes (n, k) with the other handedness: x and y exchanged."""
    return matching(REFERENCE[kind][:, [1, 0, 2]], REFERENCE[kind])
