"""Contact operators: gap and slip at the quadrature points of a pad's contact surface."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.sparse as sp
import skfem
from scipy.spatial import cKDTree

from ..errors import SceneError
from .cells import geometry_map
from .closing import default_gap_tolerance
from .facets import facet_points, scattered_quadrature
from .meeting import locate_along
from .motion import SteadyMotion, is_flat
from .spaces import ROUNDED, DisplacementSpace

_MOST_PARTS = 8  # largest number of parts that a pad facet's edge is cut into for quadrature if meshes do not match
_CORNER = 0.99  # of the way from the middle of a facet to a corner: what lies farther out does not count
# Surfaces no farther apart than this part of a facet's size, or of the coordinates, lie on each other but for rounding.
_CLOSED, _ROUNDING = 1e-9, 1e-14


@dataclass(frozen=True)
class ContactOperators:
    """Sparse operators of one contact on the unknowns, at the q points in contact.

    n points out of the counterface into the pad, t along the counterface's velocity relative to the pad, b = n × t. On
    a curved surface n is across that velocity, see `SteadyMotion.normals_across`.

    Attributes
    ----------
    gap, slip, cross : (q, n) sparse
        (u_pad − u_counter)·n, ·t and ·b.
    values : (q, nodes) sparse
        u_pad − u_counter of a nodal field.
    weights : (q,) float, m^2
    points, normals, directions : (q, 3) float
    separation : (q,) float, m
        Distance that the mesh leaves between the surfaces (negative: overlap); treated as closed.
    coverage : float
        Part of the pad's surface that is in contact.
    lifting : float
        Which part of the velocity is normal to the surface of the mesh, see `SteadyMotion.across`; 0 without sliding.
    """

    gap: sp.csr_array
    slip: sp.csr_array
    cross: sp.csr_array
    values: sp.csr_array
    weights: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    directions: np.ndarray
    separation: np.ndarray
    coverage: float
    lifting: float = 0.0

    @property
    def area(self) -> float:
        """Area in contact, m^2."""
        return float(self.weights.sum())


def contact_operators(
    space: DisplacementSpace,
    pad_facets: np.ndarray,
    counter_facets: np.ndarray | None,
    sliding: SteadyMotion | None,
    gap_tolerance: float | None = None,
    name: str = "contact",
    is_tied: bool = False,
) -> ContactOperators:
    """Return the operators that couple a pad's surface to a counterface; the meshes need not match.

    From each quadrature point of the pad's surface a line along the normal meets the counterface; the displacement
    there comes from the counterface's own shape functions. Points that meet nothing within the tolerance are not in
    contact; all others count as touching, and what the operators say of them does not depend on the gap. A facet of
    which a part alone meets the counterface has more points, see `scattered_quadrature`.

    That is otherwise in a tied contact, whose springs along the surface would feel a rotation of the whole across a gap
    or overlap s: the counterface's displacement is continued by s ∂u/∂n to the pad's point. Both sides then meet in one
    point, so that rigid motions cost no energy.

    Parameters
    ----------
    counter_facets : (f,) int or None
        None for a rigid counterface.
    sliding : SteadyMotion or None
        None for a contact that does not slide; slip and cross then lie along two arbitrary tangents.
    gap_tolerance : float, m, optional
        Default `default_gap_tolerance`; with 0 surfaces touch that lie on each other but for rounding.
    is_tied : bool
        Whether the contact couples all three directions.

    Raises
    ------
    SceneError
        If the surfaces do not touch; the message has the gap.
    """
    parts = 1 if counter_facets is None else _parts(space.mesh, pad_facets, counter_facets)
    pad = space.surface(pad_facets, parts)
    # Decided for the whole surface: of a drum a column of facets is flat by itself.
    curving = None if sliding is None or is_flat(pad.normals) else sliding
    n = _normals(pad.points, pad.normals, curving)
    values, separation, keep = pad.values, np.zeros(len(pad.points)), np.ones(len(pad.points), bool)
    if counter_facets is not None:
        tolerance = gap_tolerance
        if tolerance is None:
            tolerance = default_gap_tolerance(space.mesh, pad, counter_facets)
        touching = max(_CLOSED * np.sqrt(pad.area / len(pad_facets)), _ROUNDING * float(np.abs(pad.points).max()))
        reach = max(tolerance, touching)
        locate = partial(locate_along, space.mesh, counter_facets, farthest=reach)
        hit, corners = locate(pad.points, n), _corners(space, pad_facets)
        beyond = locate(corners[0], _normals(*corners, curving))
        inside = np.hstack([(np.abs(at.distance) <= reach).reshape(len(pad_facets), -1) for at in (hit, beyond)])
        cut = np.asarray(inside.any(axis=1) & ~inside.all(axis=1))  # facets of which a part alone meets the counterface
        if cut.any():
            rim = space.surface(pad_facets[cut], quadrature=scattered_quadrature(space.mesh.brefdom))
            across = _normals(rim.points, rim.normals, curving)
            whole = np.repeat(~cut, len(n) // len(cut))
            pad, n = space.surface(pad_facets[~cut], parts).joined(rim), np.concatenate([n[whole], across])
            hit = hit.joined(whole, locate(rim.points, across))
        values, separation = pad.values, hit.distance
        keep = np.abs(separation) <= reach
        if not keep.any():
            nearest = np.abs(separation[np.isfinite(separation)])
            if len(nearest):
                gap = f"the gap along the normal is {nearest.min():.3g} m"
            else:
                away = cKDTree(space.surface(counter_facets).points).query(pad.points)[0].min()
                gap = f"their points are {away:.3g} m apart, and none lies opposite the other within reach"
            raise SceneError(
                f"{name}: the surface and its counterface do not touch: {gap}; expected at most gap_tolerance ="
                f" {tolerance:.3g} m; check the groups, or set gap_tolerance"
            )
        far = is_tied & (np.abs(separation) > touching)
        beside = np.where(far, separation, 0.0)[keep, None] * n[keep]
        counter = interpolation(space, hit.elements[keep], hit.reference[:, keep], beside)
        values = values[keep] - counter
    points, n, weights = pad.points[keep], n[keep], pad.weights[keep]
    t = _tangents(n) if sliding is None else sliding.directions(points, n)
    if sliding is not None and not t.any():
        raise SceneError(
            f"{name}.sliding: the counterface moves straight along the normal {np.round(n[0], 6).tolist()} of the"
            " contact surface; expected a motion along the surface"
        )
    return ContactOperators(
        gap=space.along(values, n),
        slip=space.along(values, t),
        cross=space.along(values, np.cross(n, t)),
        values=values,
        weights=weights,
        points=points,
        normals=n,
        directions=t,
        separation=separation[keep],
        coverage=float(weights.sum() / pad.area),
        lifting=0.0 if sliding is None else sliding.across(points, pad.normals[keep], weights),
    )


def _normals(points: np.ndarray, outward: np.ndarray, curving: SteadyMotion | None) -> np.ndarray:
    """Return the normals (q, 3) out of the counterface at points of the pad, from those out of the pad.

    On a curved surface that something slides on they are across its motion `curving`.
    """
    return -outward if curving is None else curving.normals_across(points, -outward)


def _corners(space: DisplacementSpace, facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points next to the corners of facets, (f corners, 3) m, and the outward normals there."""
    X = np.asarray(space.mesh.brefdom.p, float)
    X = X.mean(axis=1, keepdims=True) + _CORNER * (X - X.mean(axis=1, keepdims=True))
    at = facet_points(space.mesh, space.element, facets, (X, np.ones(X.shape[1])))
    return at.points.reshape(-1, 3), at.normals.reshape(-1, 3)


def _parts(mesh: skfem.Mesh, pad: np.ndarray, counter: np.ndarray) -> int:
    """Return how often to cut the edges of the pad's facets: not where the meshes match.

    Elsewhere the counterface's shape functions have kinks inside a facet of the pad. With a rule for smooth functions a
    uniform pressure would not arrive as a uniform one on the other side. A rule on pieces of half the counterface's
    facet size nearly does so.
    """
    centres = [mesh.p[:, mesh.facets[:, f]].mean(axis=1).T for f in (pad, counter)]
    sizes = [float(np.median(np.ptp(mesh.p[:, mesh.facets[:, f]], axis=1).max(axis=0))) for f in (pad, counter)]
    distance, nearest = cKDTree(centres[1]).query(centres[0])
    spans = [np.linalg.norm(np.ptp(mesh.p[:, mesh.facets[:, f]], axis=1), axis=0) for f in (pad, counter)]
    # Equal centres are not enough: those of a mesh three times finer are among them.
    if distance.max() <= 1e-6 * sizes[0] and np.allclose(spans[0], spans[1][nearest], rtol=1e-6):
        return 1
    return int(np.clip(np.ceil(2 * sizes[0] / sizes[1]), 2, _MOST_PARTS))


def interpolation(
    space: DisplacementSpace, elements: np.ndarray, X: np.ndarray, beside: np.ndarray | None = None
) -> sp.csr_array:  # fmt: skip
    """Return the (q, nodes) operator that evaluates a nodal field at reference points X (3, q) of elements (q,).

    With `beside` (q, 3), m, it is continued linearly from there by these vectors: u + (beside·∇)u.
    """
    nodes = space.dofs.element_dofs[:, elements]
    basis = [space.element.lbasis(X, i) for i in range(len(nodes))]
    data = np.stack([np.broadcast_to(value, elements.shape) for value, _ in basis])
    if beside is not None and beside.any():
        J = geometry_map(space.mesh, elements, X)[1]
        moved = np.linalg.solve(np.moveaxis(J, 2, 0), beside[:, :, None])[:, :, 0].T
        slopes = (np.broadcast_to(slope, moved.shape) for _, slope in basis)
        data = data + np.stack([np.einsum("ak,ak->k", moved, slope) for slope in slopes])
    data[np.abs(data) < ROUNDED] = 0.0
    rows = np.broadcast_to(np.arange(len(elements)), nodes.shape)
    some = data != 0.0
    return sp.csr_array((data[some], (rows[some], nodes[some])), shape=(len(elements), space.nodes))


def _tangents(normals: np.ndarray) -> np.ndarray:
    """Return one unit tangent per normal: across the coordinate axis that the normal is least along."""
    axes = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    t = np.cross(normals, axes)
    return t / np.linalg.norm(t, axis=1, keepdims=True)
