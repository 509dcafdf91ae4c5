"""Whether bodies, supports and materials are the same all around an axis."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import skfem

from ..errors import SceneError
from .facets import facet_corners
from .materials import VOIGT
from .motion import SteadyMotion

_SLOPE = 0.02  # allowed slope of a facet out of the surface of revolution; an axis off by 2 % of the radius gives it
_STEEPEST = 0.5  # largest slope allowed where the meridian is curved; the wall of a hole or of a slot has 1
_SHARP = 0.8  # change of the unit normal, about 47°, beyond which an edge belongs to the body, not to its mesh
_ON_AXIS = 1e-6  # part of a facet's distance from the axis: a corner nearer to the axis than this lies on it
_ALIKE = 1e-3  # part of the energy of a strain by which a turn may change it: moduli of data sheets are rounded
_TURNS = 5  # turns by 2π/5, ...: harmonics of a tensor of rank 4, up to the fourth, have no part in the mean over these
_CENTRAL = 1e-3  # part of an element: a place nearer to the axis than this is on it, also in files of few digits
_PAST = 0.55 * np.pi  # rad from the middle of a cell: with a corner beyond, the axis passes through it, not beside it
_ORDERS = 16  # number of harmonics around the axis by which a ring is told from a part of a ring
_WHOLE = 1e-6  # of a number of cells: rounding of one that is whole
_EVEN = 0.05  # part of the area: the largest harmonic that a ring may have; exactly it has none, on coarse meshes too


def check_revolution(mesh: skfem.Mesh, elements: np.ndarray, rotation: SteadyMotion, name: str) -> None:
    """Refuse a body that is not one of revolution about the axis of rotation.

    Coordinates (r, θ, z) of the corners turn a surface of revolution into one that is straight along θ, and a facet on
    a cylinder, a cone or a flat face into a plane one without slope along θ, however coarse the mesh. Where the
    meridian is curved (fillets), a facet across it may have a slope; not more than between it and its neighbours.

    Parameters
    ----------
    elements : (e,) int
        The body.
    rotation : SteadyMotion
        Not a belt.
    name : str
        Name of the body, for the message.

    Raises
    ------
    SceneError
        If the slope of a facet out of the surface of revolution is too large.
    """
    corners, axis, centre = _boundary_corners(mesh, elements), _axis(rotation), rotation.centre
    x = mesh.p.T[corners] - centre  # (f, corners, 3)
    z = x @ axis
    flat = x - z[:, :, None] * axis
    r = np.linalg.norm(flat, axis=2)
    radius, middle = r.mean(axis=1, keepdims=True), flat.mean(axis=1)
    # Angles from the middle of the facet; a corner on the axis has none.
    angle = np.arctan2(np.cross(middle[:, None], flat) @ axis, np.einsum("fk,fck->fc", middle, flat))
    angle[r < _ON_AXIS * radius] = 0.0
    mapped = np.stack([r, radius * angle, z], axis=2)
    normal, area = _area_vectors(mapped), np.linalg.norm(_area_vectors(x), axis=1, keepdims=True)
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    # A facet that the axis passes through has no angles, and there is none around the axis that it could hide.
    through = np.ptp(angle, axis=1, keepdims=True) > 0.9 * np.pi
    through |= np.linalg.norm(middle, axis=1, keepdims=True) < _ON_AXIS * radius
    normal = np.divide(normal, size, out=np.zeros_like(normal), where=(size > _ON_AXIS * area) & ~through)
    slope = np.abs(normal[:, 1])
    allowed = _SLOPE + np.minimum(_bend(corners, normal), _STEEPEST - _SLOPE)
    worst = int(np.argmax(slope - allowed))
    if slope[worst] > allowed[worst]:
        at = np.round(mesh.p.T[corners[worst]].mean(axis=0), 6).tolist()
        raise SceneError(
            f'effects.rotation: body "{name}" is not a body of revolution about the axis'
            f" {np.round(axis, 6).tolist()} through {np.round(np.asarray(centre), 6).tolist()}: its surface at {at}"
            f" has a slope of {slope[worst]:.3g} out of the surface of revolution; expected at most"
            f" {allowed[worst]:.2g} there; check the axis and the centre of the rotation, and that the body"
            " has no holes or slots beside the axis"
        )


def check_ring(mesh: skfem.Mesh, facets: np.ndarray, rotation: SteadyMotion, key: str, name: str) -> None:
    """Refuse a surface that does not go evenly around the axis: what holds a turning body there would have to turn too.

    The harmonics ∫ e^{imθ} dA of a ring vanish, as do those of what lies on the axis; those of bolts or a sector not.

    Parameters
    ----------
    facets : (f,) int
        Facets of the rotating body's surface.
    rotation : SteadyMotion
        Not a belt.
    key, name : str
        Where the surface is named, and the body, for the message.

    Raises
    ------
    SceneError
    """
    x = mesh.p.T[mesh.facets[:, facets].T]
    area = np.linalg.norm(_area_vectors(x[:, [0, 1, 2, -1]]), axis=1)
    place = _across(x, rotation)
    middle, width = _angles(place, np.abs(place).max(axis=1))
    _check_even(middle, area, width, f'{key} acts on the rotating body "{name}" on a surface that does not go', "area")


def check_ring_of_nodes(
    mesh: skfem.Mesh, nodes: np.ndarray, elements: np.ndarray, rotation: SteadyMotion, key: str, name: str
) -> None:
    """Refuse nodes that do not go evenly around the axis, as `check_ring` refuses surfaces.

    Parameters
    ----------
    nodes : (m,) int
        Corners of elements.
    elements : (e,) int
        Elements of the rotating body: their width around the axis tells how dense a ring of nodes would be.

    Raises
    ------
    SceneError
    """
    near = elements[np.isin(mesh.t[:, elements], nodes).any(axis=0)]
    beside = _across(mesh.p.T[mesh.t[:, near].T], rotation)
    _, width = _angles(beside, np.abs(beside).max(axis=1))
    middle, _ = _angles(_across(mesh.p.T[nodes][:, None], rotation), np.full(len(nodes), np.abs(beside).max()))
    where = f'{key} acts on the rotating body "{name}" at nodes that do not go'
    _check_even(middle, np.ones(len(nodes)), width, where, "number")


def _across(x: np.ndarray, rotation: SteadyMotion) -> np.ndarray:
    """Return where points (..., 3) are in the plane across the axis, (...) complex: r e^{iθ} in m."""
    axis = _axis(rotation)
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    x = x - rotation.centre
    return np.asarray(x @ first + 1j * (x @ np.cross(axis, first)))


def _angles(place: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the middle of each cell around the axis, (f,) complex e^{iθ}, and the width of the widest, rad.

    A corner on the axis has no angle. A cell that lies on the axis, or that the axis passes through, has the middle 0.

    Parameters
    ----------
    place : (f, c) complex
        Corners.
    reach : (f,) float, m
        Distances from the axis of which `_CENTRAL` counts as none.
    """
    r = np.abs(place)
    points = np.divide(place, r, out=np.zeros_like(place), where=r > _CENTRAL * reach[:, None])
    total = points.sum(axis=1)
    size = np.abs(total)
    middle = np.divide(total, size, out=np.zeros_like(total), where=size > 0)
    off = np.where(points != 0, np.abs(np.angle(points * middle.conj()[:, None])), 0.0).max(axis=1)
    around = off < _PAST
    width = 2 * float(off[around].max()) if around.any() else 2 * np.pi
    return np.where(around, middle, 0.0), width


def _check_even(middle: np.ndarray, weight: np.ndarray, width: float, what: str, of_what: str) -> None:
    # A cell stands for its middle: harmonics shorter than two cells are not those of the ring.
    orders = np.arange(1, np.clip(int(np.pi / max(width, 1e-9) + _WHOLE), 1, _ORDERS) + 1)
    share = np.abs(middle ** orders[:, None] @ weight) / weight.sum()
    if share.max() > _EVEN:
        raise SceneError(
            f"effects.rotation: {what} evenly around"
            f" the axis (harmonic {share.argmax() + 1} has {share.max():.2g} of its {of_what}); expected one of"
            " revolution, because what acts on the body has to be the same all around it"
        )


def is_transversal(stiffness: np.ndarray, rotation: SteadyMotion) -> bool:
    """Return whether turning about the axis leaves a stiffness tensor (3, 3, 3, 3) as it is, but for rounded moduli.

    That is, no strain has an energy that is farther from its mean over a turn than `_ALIKE` of this mean. By Rayleigh's
    quotient a frequency of the body is then within half as much of that with the mean tensor.
    """
    K = np.cross(_axis(rotation), np.eye(3)).T
    turned = []
    for angle in 2 * np.pi * np.arange(_TURNS) / _TURNS:
        R = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
        turned.append(np.einsum("ip,jq,kr,ls,pqrs->ijkl", R, R, R, R, stiffness, optimize=True))
    i, j = np.array(VOIGT).T
    own, mean = (C[i[:, None], j[:, None], i, j] for C in (stiffness, np.mean(turned, axis=0)))
    return bool(np.abs(la.eigvalsh(own - mean, mean)).max() <= _ALIKE)


def _axis(rotation: SteadyMotion) -> np.ndarray:
    return np.asarray(rotation.velocity / np.linalg.norm(rotation.velocity))


def _boundary_corners(mesh: skfem.Mesh, elements: np.ndarray) -> np.ndarray:
    """Return the corners of the facets of a body's surface, cyclic, (f, 4) int; triangles repeat the last one."""
    facets, count = np.unique(mesh.t2f[:, elements], return_counts=True)
    facets = facets[count == 1]
    inside = np.isin(mesh.f2t[0, facets], elements)
    return facet_corners(mesh, facets, np.where(inside, mesh.f2t[0, facets], mesh.f2t[1, facets]))


def _area_vectors(x: np.ndarray) -> np.ndarray:
    """Return twice the area times the normal of facets with corners (f, 4, 3)."""
    return np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])


def _bend(corners: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the largest change of the unit normal from a facet to its neighbours, sharp edges left out, (f,)."""
    edges = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    facet, proper = np.repeat(np.arange(len(corners)), 4), edges[:, 0] != edges[:, 1]
    facet, edges = facet[proper], edges[proper]
    order = np.lexsort(edges.T)
    same = np.flatnonzero((edges[order[1:]] == edges[order[:-1]]).all(axis=1))
    a, b = facet[order[same]], facet[order[same + 1]]
    # Corners may run either way around a facet.
    change = np.minimum(np.linalg.norm(normal[a] - normal[b], axis=1), np.linalg.norm(normal[a] + normal[b], axis=1))
    bend = np.zeros(len(corners))
    smooth = change < _SHARP
    for side in (a, b):
        np.maximum.at(bend, side[smooth], change[smooth])
    return bend
