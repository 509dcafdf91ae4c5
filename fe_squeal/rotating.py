"""Bodies of revolution that turn steadily about their axis, in the frame that does not turn.

u(x, t) is the displacement of the particle that steady rotation would have at x; w(x) = Ω × (x − c). A rate seen by
the particle is D = ∂/∂t + w·∇, so the kinetic energy T = ½∫ρ |w + Du|² and Hamilton's principle give (derived here,
no source)

    M ü + G u̇ + (K + K_Ω) u = f,
    G   = ∫ρ [δu·(w·∇)u̇ − (w·∇)δu·u̇]     gyroscopic, skew, ∝ Ω,
    K_Ω = −∫ρ (w·∇)δu·(w·∇)u             symmetric, negative, ∝ Ω²,
    f   = −∫ρ δu·(Ω × w)                 centrifugal, ∝ Ω²,

which is ∫ρ δu·D²u with ∫ div(ρ w ...) = 0: no flow through the boundary. A travelling wave e^{imθ} of the cylindrical
components of u sees w·∇ = Ω im + Ω ×, so that a bending wave of ω₀ in the body is heard at ω₀ ± mΩ.

Damping inside the body acts on the rate of the displacement in axes that turn with the body, u̇ + Lu with
Lu = (w·∇)u − Ω × u. A damping matrix βK or αM so brings the circulatory stiffness β a(δu, Lu) or α∫ρ δu·Lu; a is the
elastic form. Both are skew: turning a body of revolution about its axis changes neither energy.

The stiffness of the centrifugal stress, ∝ Ω² as K_Ω is, is not in here. Without it a body that is free to turn about
its axis or to tilt has slow spurious motions, λ = ±Ω for the turning.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import skfem

from .contact import Sliding
from .errors import SceneError
from .spaces import DisplacementSpace, _scatter, element_shapes

_SLOPE = 0.02  # of a facet out of the surface of revolution: an axis off by 2 % of the radius
_STEEPEST = 0.5  # slope allowed where the meridian is curved; the wall of a hole or of a slot has 1
_SHARP = 0.8  # change of the unit normal, about 47°, beyond which an edge is one of the body, not of the mesh
_ELEMENTS_AT_ONCE = 5000
_ON_AXIS = 1e-6  # of the facet's distance from the axis
_REVOLUTION = 1e-9  # relative change of a stiffness tensor by turning that is rounding


def gyroscopic_matrices(
    space: DisplacementSpace, elements: np.ndarray, density: float, rotation: Sliding
) -> tuple[sp.csr_array, sp.csr_array]:
    """Return the gyroscopic matrix and the stiffness of the convected inertia, on the unknowns.

    G = ∫ρ [N_I (w·∇)N_J − (w·∇)N_I N_J] ∝ Ω, K_Ω = −∫ρ (w·∇)N_I (w·∇)N_J ∝ Ω², both for each component by itself.

    Parameters
    ----------
    elements : (e,) int
        Of a body of revolution, see `check_revolution`.
    density : float, kg/m^3
    rotation : Sliding
        Not a belt; the matrices are those at its angular speed.

    Returns
    -------
    G, K : (n, n) sparse, kg/s and N/m
        G exactly skew, K exactly symmetric.
    """
    _, convected, twice = _inertia(space, elements, density, rotation)
    return _on_unknowns(space, convected - convected.T), _on_unknowns(space, -(twice + twice.T) / 2)


def circulatory_matrices(
    space: DisplacementSpace, elements: np.ndarray, stiffness_matrix: sp.csr_array, density: float, rotation: Sliding
) -> tuple[sp.csr_array, sp.csr_array]:
    """Return the circulatory stiffness per beta and per alpha of Rayleigh damping inside a turning body.

    B_K = skew part of K L_h, B_M = ∫ρ δu·((w·∇)u − Ω × u). L_h gives at each node the mean of the elements' (w·∇)u
    around it, weighted by their volumes, less Ω × u: the convected displacement itself is not continuous.

    Parameters
    ----------
    elements : (e,) int
        Of a body of revolution, see `check_revolution`; so must its supports be.
    stiffness_matrix : (n, n) sparse, N/m
        Elastic stiffness of these elements alone, on the unknowns; of a material for which `is_transversal` holds.
    density : float, kg/m^3
    rotation : Sliding
        Not a belt; the matrices are those at its angular speed.

    Returns
    -------
    B_K, B_M : (n, n) sparse, N/(m s) and kg/s
        Exactly skew, ∝ Ω; to add beta B_K + alpha B_M to the stiffness where beta K + alpha M is the damping.
    """
    turning = np.cross(rotation.velocity, np.eye(3)).T  # Ω × u = turning @ u
    everywhere = sp.eye_array(space.nodes, format="csr")
    L = _on_unknowns(space, _nodal_convection(space, elements, rotation)) - _on_unknowns(space, everywhere, turning)
    mass, convected, _ = _inertia(space, elements, density, rotation)
    B_K, B_M = stiffness_matrix @ L, _on_unknowns(space, convected) - _on_unknowns(space, mass, turning)
    return sp.csr_array((B_K - B_K.T) / 2), sp.csr_array((B_M - B_M.T) / 2)


def centrifugal_load(space: DisplacementSpace, elements: np.ndarray, density: float, rotation: Sliding) -> np.ndarray:
    """Return the forces ∫ρ δu·Ω²r e_r of steady rotation on the unknowns, (n,) N.

    Parameters
    ----------
    elements : (e,) int
    density : float, kg/m^3
    rotation : Sliding
        Not a belt.
    """
    force = np.zeros((space.nodes, 3))
    for shapes in element_shapes(space, elements):
        outward = -np.cross(rotation.velocity, rotation.velocities(np.swapaxes(shapes.points, 1, 2)))  # (e, q, 3)
        np.add.at(force, shapes.nodes, shapes.values @ (density * shapes.dx[:, :, None] * outward))
    return np.asarray(force.ravel()[space.free])


def check_revolution(mesh: skfem.Mesh, elements: np.ndarray, rotation: Sliding, name: str) -> None:
    """Refuse a body that is not one of revolution about the axis of rotation.

    Coordinates (r, θ, z) of the corners turn a surface of revolution into one that is straight along θ, and a facet on
    a cylinder, a cone or a flat face into a plane one without slope along θ, however coarse the mesh. Where the
    meridian is curved (fillets), a facet across it may have a slope; not more than between it and its neighbours.

    Parameters
    ----------
    elements : (e,) int
        The body.
    rotation : Sliding
        Not a belt.
    name : str
        Of the body, for the message.

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


def is_transversal(stiffness: np.ndarray, rotation: Sliding) -> bool:
    """Return whether turning about the axis leaves a stiffness tensor (3, 3, 3, 3) as it is."""
    axis = _axis(rotation)
    # No turn of a crystal into itself is one by 1 rad.
    K = np.cross(axis, np.eye(3)).T
    R = np.eye(3) + np.sin(1.0) * K + (1.0 - np.cos(1.0)) * K @ K
    turned = np.einsum("ip,jq,kr,ls,pqrs->ijkl", R, R, R, R, stiffness, optimize=True)
    return bool(np.abs(turned - stiffness).max() <= _REVOLUTION * np.abs(stiffness).max())


def _inertia(
    space: DisplacementSpace, elements: np.ndarray, density: float, rotation: Sliding
) -> tuple[sp.csr_array, sp.csr_array, sp.csr_array]:
    """Return ∫ρ N_I N_J, ∫ρ N_I (w·∇)N_J and ∫ρ (w·∇)N_I (w·∇)N_J, (nodes, nodes)."""
    plain = once = twice = sp.csr_array((space.nodes, space.nodes))
    for shapes in element_shapes(space, elements):
        w = rotation.velocities(np.swapaxes(shapes.points, 1, 2))  # (e, q, 3)
        N, wN = shapes.values, np.einsum("ejkq,eqk->ejq", shapes.gradients, w)
        weights = density * shapes.dx[:, None, :]
        right, convected = np.swapaxes(weights * N, 1, 2), np.swapaxes(weights * wN, 1, 2)
        plain = plain + _scatter(N @ right, shapes.nodes, space.nodes)
        once = once + _scatter(N @ convected, shapes.nodes, space.nodes)
        twice = twice + _scatter(wN @ convected, shapes.nodes, space.nodes)
    return plain, once, twice


def _nodal_convection(space: DisplacementSpace, elements: np.ndarray, rotation: Sliding) -> sp.csr_array:
    """Return the (nodes, nodes) operator of the mean of (w·∇)u in the elements around a node, by their volumes."""
    X = np.asarray(space.element.doflocs).T
    sums = sp.csr_array((space.nodes, space.nodes))
    volumes = np.zeros(space.nodes)
    for chunk in np.array_split(elements, len(elements) // _ELEMENTS_AT_ONCE + 1):
        basis = skfem.CellBasis(
            space.mesh, space.element, elements=chunk, quadrature=(X, np.ones(X.shape[1])), dofs=space.dofs,
            disable_doflocs=True,
        )  # fmt: skip
        t = space.dofs.element_dofs[:, chunk].T
        w = rotation.velocities(np.moveaxis(np.asarray(basis.global_coordinates()), 0, -1))
        blocks = np.stack([np.einsum("keq,eqk->eq", f[0].grad, w) for f in basis.basis], axis=2)  # (e, q, nodes)
        volume = np.broadcast_to(basis.dx.mean(axis=1, keepdims=True), t.shape)  # up to a factor
        sums = sums + _scatter(blocks * volume[:, :, None], t, space.nodes)
        np.add.at(volumes, t, volume)
    return sp.csr_array(sp.diags_array(1.0 / np.where(volumes > 0, volumes, 1.0)) @ sums)


def _on_unknowns(space: DisplacementSpace, scalar: sp.csr_array, components: np.ndarray | None = None) -> sp.csr_array:
    """Return a (nodes, nodes) matrix, times a (3, 3) one that mixes the components, on the unknowns."""
    components = np.eye(3) if components is None else components
    return sp.csr_array(sp.kron(scalar, components, format="csr"))[space.free][:, space.free]


def _axis(rotation: Sliding) -> np.ndarray:
    return np.asarray(rotation.velocity / np.linalg.norm(rotation.velocity))


def _boundary_corners(mesh: skfem.Mesh, elements: np.ndarray) -> np.ndarray:
    """Return the corners of the facets of a body's surface, cyclic, (f, 4) int; triangles repeat the last one."""
    facets, count = np.unique(mesh.t2f[:, elements], return_counts=True)
    facets = facets[count == 1]
    inside = np.isin(mesh.f2t[0, facets], elements)
    element = np.where(inside, mesh.f2t[0, facets], mesh.f2t[1, facets])
    local = np.argmax(mesh.t2f[:, element] == facets, axis=0)
    order = np.array([[c[0], c[1], c[2], c[-1]] for c in mesh.refdom.facets])[local]
    return np.asarray(mesh.t.T[element[:, None], order])


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
