"""Complex mode shapes on the nodes and cells of a grid, as VTK needs them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from skfem import CellBasis

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Integers = NDArray[np.int64]

TETRA, HEXAHEDRON, QUADRATIC_TETRA, TRIQUADRATIC_HEXAHEDRON, LAGRANGE_HEXAHEDRON = 10, 12, 24, 29, 72

_TETRA = [(0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 2)]
_HEXAHEDRON = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]

# Twice the reference coordinates of the nodes of each cell type, in VTK's order (vtkCell::GetParametricCoords; a test
# compares them).
_DOUBLED_NODES = {
    TETRA: _TETRA,
    QUADRATIC_TETRA: [*_TETRA, (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)],
    HEXAHEDRON: _HEXAHEDRON,
    TRIQUADRATIC_HEXAHEDRON: [
        *_HEXAHEDRON,
        (1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2),
        (0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1),
        (0, 1, 1), (2, 1, 1), (1, 0, 1), (1, 2, 1), (1, 1, 0), (1, 1, 2), (1, 1, 1),
    ],
}  # fmt: skip


def _cubic_nodes() -> Floats:
    """Return the nodes of a hexahedron of order 3, (64, 3), in VTK's order."""
    a, b = 1, 2
    around = [(a, 0), (b, 0), (3, a), (3, b), (a, 3), (b, 3), (0, a), (0, b)]
    inside = [(i, j) for j in (a, b) for i in (a, b)]
    return np.array([
        *(tuple(1.5 * x for x in node) for node in _HEXAHEDRON),
        *((i, j, k) for k in (0, 3) for i, j in around),
        *((i, j, k) for i, j in ((0, 0), (3, 0), (3, 3), (0, 3)) for k in (a, b)),
        *((i, j, k) for i in (0, 3) for j, k in inside), *((i, j, k) for j in (0, 3) for i, k in inside),
        *((i, j, k) for k in (0, 3) for i, j in inside), *((i, j, k) for k in (a, b) for i, j in inside),
    ]) / 3.0  # fmt: skip


REFERENCE_NODES: dict[int, Floats] = {
    **{kind: np.array(nodes) / 2.0 for kind, nodes in _DOUBLED_NODES.items()}, LAGRANGE_HEXAHEDRON: _cubic_nodes()
}  # fmt: skip


@dataclass(frozen=True)
class ShapeGrid:
    """The mesh on which shapes are written.

    Attributes
    ----------
    points : (n, 3) float, m
        The nodes.
    cells : (ne, nn) int
        Nodes of each cell, in VTK's order, so that its volume is positive.
    vtk_cell_type : int
        10 or 24 (linear or quadratic tetrahedron); 12, 29 or 72 (hexahedron of order 1, 2 or 3).
    body : (ne,) int
        Body of each cell, as a position in `body_names`.
    body_names : tuple of str
    surface : (nt, 3) int and (nt,) int, or None
        Triangles of the outer surface of all bodies, with the body of each, where `surface_of` has kept no more.
    """

    points: Floats
    cells: Integers
    vtk_cell_type: int
    body: Integers
    body_names: tuple[str, ...]
    surface: tuple[Integers, Integers] | None = None

    @property
    def size(self) -> float:
        """Diagonal of the bounding box, m."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))


def shape_grid(basis: CellBasis, body: Integers, body_names: tuple[str, ...]) -> ShapeGrid:
    """Return the grid whose points are the degrees of freedom of a scalar nodal basis.

    Point i of the grid is degree of freedom i of the basis, so nodal arrays of the basis are point arrays of the grid.

    Parameters
    ----------
    basis : CellBasis
        Its element is `ElementTetP1`, `ElementTetP2`, `ElementHex1`, `ElementHex2` or `fem.cubic.ElementHex3`.
    body : (ne,) int
        Body of each element of the basis, as a position in `body_names`.
    body_names : tuple of str

    Raises
    ------
    ValueError
        The element of the basis is none of these.

    Examples
    --------
    >>> import skfem
    >>> mesh = skfem.MeshHex()
    >>> shape_grid(skfem.CellBasis(mesh, skfem.ElementHex2()), np.zeros(1, dtype=int), ("block",)).cells.shape
    (1, 27)
    """
    nodes = np.asarray(basis.elem.doflocs, dtype=float)
    kinds = [kind for kind, reference in REFERENCE_NODES.items() if reference.shape == nodes.shape
             and np.isin(_keys(reference), _keys(nodes)).all()]  # fmt: skip
    if not kinds:
        name = type(basis.elem).__name__
        raise ValueError(f"no VTK cell for {name}; expected scalar TetP1, TetP2, Hex1, Hex2 or Hex3")
    reference = REFERENCE_NODES[kinds[0]]
    dofs = np.asarray(basis.element_dofs, dtype=np.int64).T
    cells = dofs[:, _match(nodes, reference)]
    # For VTK an element with a negative Jacobian is inside out. Its nodes are reordered as if x and y of the reference
    # element were exchanged.
    centre = reference[: 4 if len(reference) in (4, 10) else 8].mean(axis=0)
    turned = np.asarray(basis.mapping.detDF(centre[:, None]))[:, 0] < 0
    if basis.tind is not None:
        turned = turned[basis.tind]
    cells[turned] = dofs[turned][:, _match(nodes, reference[:, [1, 0, 2]])]
    points = np.ascontiguousarray(np.asarray(basis.doflocs, dtype=float).T)
    return ShapeGrid(points, cells, kinds[0], np.asarray(body, dtype=np.int64), tuple(body_names))


def semi_major_amplitude(u: Complexes) -> Floats:
    """Return the largest displacement of each point over one period.

    The point moves on an ellipse, Re(u e^{iφ}), with the semi-major axis

        max_φ |Re(u e^{iφ})| = √((uᴴu + |uᵀu|) / 2),

    since Re(z)·Re(z) = (zᴴz + Re zᵀz)/2 for any complex vector z, and the largest value of Re((uᵀu) e^{2iφ}) is |uᵀu|.

    Parameters
    ----------
    u : (n, 3) complex

    Returns
    -------
    (n,) float, unit of `u`

    Examples
    --------
    >>> semi_major_amplitude(np.array([[3.0, 4.0j, 0.0], [3.0, 4.0, 0.0]])).tolist()
    [4.0, 5.0]
    """
    u = np.asarray(u, dtype=complex)
    return np.sqrt((np.sum(np.abs(u) ** 2, axis=1) + np.abs(np.sum(u * u, axis=1))) / 2)


def normalise_shape(u: Complexes) -> Complexes:
    """Return `u` times a complex number, so that shapes can be compared and drawn.

    The phase is such that Σ|Re u|² is as large as possible (Σuᵀu is real and positive): Re u is the standing part of
    the shape, and Im u the travelling part. The sign is such that the largest entry of Re u is positive. The largest
    `semi_major_amplitude` is 1. A shape that is zero everywhere stays zero.

    Parameters
    ----------
    u : (n, 3) complex

    Examples
    --------
    >>> normalise_shape(np.array([[0.0, 2.0j, 0.0], [0.0, 0.0, -4.0j]])).real.sum(axis=1).round(12).tolist()
    [-0.5, 1.0]
    """
    u = np.array(u, dtype=complex)
    largest = semi_major_amplitude(u).max(initial=0.0)
    if largest == 0.0:
        return u
    u /= largest
    square = np.sum(u * u)
    if abs(square) > 1e-9 * np.sum(np.abs(u) ** 2):
        u *= np.exp(-0.5j * np.angle(square))
    else:
        # For a purely travelling wave Σ|Re u|² does not depend on the phase: its largest entry is made real.
        u *= np.exp(-1j * np.angle(u.flat[np.argmax(np.abs(u))]))
    return u * np.sign(u.real.flat[np.argmax(np.abs(u.real))])


def boundary_triangles(grid: ShapeGrid, body: int | None = None) -> tuple[Integers, Integers]:
    """Return the outer surface of all bodies, or of one, as flat triangles.

    A face is outer if no other cell of the same body shares it. The faces of quadratic cells are cut at their middle
    nodes, into four or eight triangles.

    Returns
    -------
    triangles : (nt, 3) int
        Nodes of each triangle, in no particular orientation.
    body : (nt,) int
        The body of each.

    Raises
    ------
    ValueError
        There is no surface, as where every cell is there twice.
    """
    if grid.surface is not None:
        triangles, owner = grid.surface
        return grid.surface if body is None else (triangles[owner == body], owner[owner == body])
    cells = grid.cells if body is None else grid.cells[grid.body == body]
    bodies = grid.body if body is None else grid.body[grid.body == body]
    patterns = _face_patterns(REFERENCE_NODES[grid.vtk_cell_type])
    corners = np.concatenate([cells[:, face] for face, _ in patterns])
    owner = np.tile(bodies, len(patterns))
    keys = np.column_stack([owner, np.sort(corners, axis=1)])
    _, first, count = np.unique(keys, axis=0, return_index=True, return_counts=True)
    outer = first[count == 1]
    if not len(outer):
        raise ValueError("its cells have no surface")
    pattern, cell = np.divmod(outer, len(cells))
    cuts = np.array([cut for _, cut in patterns])  # (faces, triangles of a face, 3)
    triangles = np.take_along_axis(cells[cell], cuts[pattern].reshape(len(outer), -1), axis=1).reshape(-1, 3)
    return triangles, np.repeat(owner[outer], cuts.shape[1])


def surface_of(grid: ShapeGrid) -> tuple[ShapeGrid, Integers]:
    """Return the surface of a grid as one without cells, and the nodes (m,) of the grid that are its points.

    It is all that is needed to show or to compare shapes on the surface, and much smaller.

    Raises
    ------
    ValueError
        It has no surface.
    """
    triangles, body = boundary_triangles(grid)
    nodes, place = np.unique(triangles, return_inverse=True)
    kept = ShapeGrid(
        grid.points[nodes], grid.cells[:0], grid.vtk_cell_type, grid.body[:0], grid.body_names,
        (np.asarray(place).reshape(-1, 3), body),
    )  # fmt: skip
    return kept, nodes


def sharp_edges(points: Floats, triangles: Integers, degrees: float = 35.0) -> Integers:
    """Return the edges (m, 2) of a surface where its triangles meet at more than `degrees`, or where it ends."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    order = np.lexsort(edges.T)
    edges, normal = edges[order], np.tile(normal, (3, 1))[order]
    paired = np.append((edges[1:] == edges[:-1]).all(axis=1), False)
    first = np.flatnonzero(paired)
    # The triangles have no common orientation, so normals are compared up to their sign.
    sharp = np.abs(np.sum(normal[first] * normal[first + 1], axis=1)) < np.cos(np.radians(degrees))
    lonely = ~(paired | np.append(False, paired[:-1]))
    return np.concatenate([edges[first[sharp]], edges[lonely]])


def _face_patterns(nodes: Floats) -> list[tuple[list[int], list[tuple[int, int, int]]]]:
    """Return, for each face of a reference cell, its corners and the triangles that it is cut into."""
    tetra = len(nodes) in (4, 10)
    place = {key: i for i, key in enumerate(_keys(nodes))}
    planes = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)] if tetra else [
        (0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]  # fmt: skip

    def middle(*corners: int) -> int:
        return place[int(_keys(nodes[list(corners)].mean(axis=0)[None])[0])]

    def at(face: Sequence[int], s: int, t: int) -> int:  # thirds along two edges of a face of order 3
        a, b, _, d = (nodes[i] for i in face)
        return place[int(_keys((a + s / 3 * (b - a) + t / 3 * (d - a))[None])[0])]

    patterns: list[tuple[list[int], list[tuple[int, int, int]]]] = []
    for face in planes:
        if len(nodes) in (4, 8):
            cut = [(face[0], face[i], face[i + 1]) for i in range(1, len(face) - 1)]
        elif tetra:
            a, b, c = face[:3]
            ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
            cut = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        elif len(nodes) == 64:
            cut = [(at(face, s, t), at(face, s + 1, t), at(face, s + 1, t + 1)) for s in range(3) for t in range(3)]
            cut += [(at(face, s + 1, t + 1), at(face, s, t + 1), at(face, s, t)) for s in range(3) for t in range(3)]
        else:
            ring = [n for i in range(4) for n in (face[i], middle(face[i], face[(i + 1) % 4]))]
            cut = [(ring[i], ring[(i + 1) % 8], middle(*face)) for i in range(8)]
        patterns.append((list(face), cut))
    return patterns


def _keys(nodes: Floats) -> Integers:
    """Return one integer for each node of a reference cell, whose coordinates are all multiples of 1/2 or of 1/3."""
    return np.asarray(np.rint(6 * nodes) @ np.array([1, 7, 49]), dtype=np.int64)


def _match(nodes: Floats, wanted: Floats) -> Integers:
    """Return the position in `nodes` of each node in `wanted`."""
    order = np.argsort(_keys(nodes))
    return np.asarray(order[np.searchsorted(_keys(nodes)[order], _keys(wanted))], dtype=np.int64)


def axis_frame(axis: Sequence[float]) -> Floats:
    """Return a rotation (3, 3) whose rows are a right-handed frame with the unit vector along `axis` as the third.

    Examples
    --------
    >>> axis_frame([0, 0, 2]).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    third = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    # The first row is made from the coordinate axis that is farthest from `axis`; x if several are, so that the frame
    # of z is the identity.
    first = np.eye(3)[int(np.argmin(np.abs(third).round(9)))]
    first = first - (first @ third) * third
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(third, first), third])
