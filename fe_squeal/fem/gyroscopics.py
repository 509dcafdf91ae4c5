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
elastic form. Both are skew: turning a body of revolution about its axis changes neither energy. Where its moduli are
rounded, so that a is a form of revolution and a rest r with |r(u, v)| ≤ ε √(a(u, u) a(v, v)), the skew part alone of
a(δu, Lu) is taken: what acts is exactly skew, and off by at most ε in the same norm.

The stiffness of the centrifugal stress, ∝ Ω² as K_Ω is, is not in here. Without it a body that is free to turn about
its axis or to tilt has slow spurious motions, λ = ±Ω for the turning.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from .cells import cell_points, shape_functions
from .element_matrices import element_shapes
from .motion import SteadyMotion
from .node_sums import scatter
from .spaces import DisplacementSpace

_ELEMENTS_AT_ONCE = 5000


def gyroscopic_matrices(
    space: DisplacementSpace, elements: np.ndarray, density: float, rotation: SteadyMotion
) -> tuple[sp.csr_array, sp.csr_array]:
    """Return the gyroscopic matrix and the stiffness of the convected inertia, on the unknowns.

    G = ∫ρ [N_I (w·∇)N_J − (w·∇)N_I N_J] ∝ Ω, K_Ω = −∫ρ (w·∇)N_I (w·∇)N_J ∝ Ω², both for each component by itself.

    Parameters
    ----------
    elements : (e,) int
        Elements of a body of revolution, see `fe_squeal.fem.revolution`.
    density : float, kg/m^3
    rotation : SteadyMotion
        Not a belt; the matrices are those at its angular speed.

    Returns
    -------
    G, K : (n, n) sparse, kg/s and N/m
        G exactly skew, K exactly symmetric.
    """
    _, convected, twice = _inertia(space, elements, density, rotation)
    return _on_unknowns(space, convected - convected.T), _on_unknowns(space, -(twice + twice.T) / 2)


def circulatory_matrices(
    space: DisplacementSpace, elements: np.ndarray, stiffness_matrix: sp.csr_array, density: float,
    rotation: SteadyMotion,
) -> tuple[sp.csr_array, sp.csr_array]:  # fmt: skip
    """Return the circulatory stiffness per beta and per alpha of Rayleigh damping inside a turning body.

    B_K = skew part of K L_h, B_M = ∫ρ δu·((w·∇)u − Ω × u). L_h gives at each node the mean of the elements' (w·∇)u
    around it, weighted by their volumes, less Ω × u: the convected displacement itself is not continuous.

    Parameters
    ----------
    elements : (e,) int
        Elements of a body of revolution, see `fe_squeal.fem.revolution`; its supports must be of revolution too.
    stiffness_matrix : (n, n) sparse, N/m
        Elastic stiffness of these elements alone, on the unknowns; of a material for which `is_transversal` holds.
    density : float, kg/m^3
    rotation : SteadyMotion
        Not a belt; the matrices are those at its angular speed.

    Returns
    -------
    B_K, B_M : (n, n) sparse, N/(m s) and kg/s
        Exactly skew, ∝ Ω; to add beta B_K + alpha B_M to the stiffness where beta K + alpha M is the damping.
    """
    turning = np.cross(rotation.velocity, np.eye(3)).T  # Ω × u = turning @ u
    everywhere = sp.eye_array(space.functions, format="csr")
    L = space.operator(_mixed(_nodal_convection(space, elements, rotation)) - _mixed(everywhere, turning))
    mass, convected, _ = _inertia(space, elements, density, rotation)
    B_K, B_M = stiffness_matrix @ L, _on_unknowns(space, convected) - _on_unknowns(space, mass, turning)
    return sp.csr_array((B_K - B_K.T) / 2), sp.csr_array((B_M - B_M.T) / 2)


def centrifugal_load(
    space: DisplacementSpace, elements: np.ndarray, density: float, rotation: SteadyMotion
) -> np.ndarray:
    """Return the forces ∫ρ δu·Ω²r e_r of steady rotation on the unknowns, (n,) N.

    Parameters
    ----------
    elements : (e,) int
    density : float, kg/m^3
    rotation : SteadyMotion
        Not a belt.
    """
    return space.loads(nodal_centrifugal_forces(space, elements, density, rotation))


def nodal_centrifugal_forces(
    space: DisplacementSpace, elements: np.ndarray, density: float, rotation: SteadyMotion
) -> np.ndarray:
    """Return the same forces on the nodes, (nodes, 3) N."""
    force = np.zeros((space.nodes, 3))
    for shapes in element_shapes(space, elements):
        outward = -np.cross(rotation.velocity, rotation.velocities(np.swapaxes(shapes.points, 1, 2)))  # (e, q, 3)
        np.add.at(force, shapes.nodes, shapes.values @ (density * shapes.dx[:, :, None] * outward))
    return force


def _inertia(
    space: DisplacementSpace, elements: np.ndarray, density: float, rotation: SteadyMotion
) -> tuple[sp.csr_array, sp.csr_array, sp.csr_array]:
    """Return ∫ρ N_I N_J, ∫ρ N_I (w·∇)N_J and ∫ρ (w·∇)N_I (w·∇)N_J, (functions, functions)."""
    plain = once = twice = sp.csr_array((space.functions, space.functions))
    for shapes in element_shapes(space, elements):
        w = rotation.velocities(np.swapaxes(shapes.points, 1, 2))  # (e, q, 3)
        N, wN = shapes.values, np.einsum("ejkq,eqk->ejq", shapes.gradients, w)
        weights = density * shapes.dx[:, None, :]
        right, convected = np.swapaxes(weights * N, 1, 2), np.swapaxes(weights * wN, 1, 2)
        plain = plain + scatter(N @ right, shapes.nodes, space.functions)
        once = once + scatter(N @ convected, shapes.nodes, space.functions)
        twice = twice + scatter(wN @ convected, shapes.nodes, space.functions)
    return plain, once, twice


def _nodal_convection(space: DisplacementSpace, elements: np.ndarray, rotation: SteadyMotion) -> sp.csr_array:
    """Return the operator of the mean of (w·∇)u in the elements around a node, by volumes; a row per function."""
    X = np.asarray(space.element.doflocs).T
    dN = shape_functions(space.element, X)[1]
    sums = sp.csr_array((space.functions, space.functions))
    volumes = np.zeros(space.functions)
    for chunk in np.array_split(elements, len(elements) // _ELEMENTS_AT_ONCE + 1):
        points, inverse, determinant = cell_points(space.mesh, chunk, X)
        t = space.dofs.element_dofs[:, chunk].T
        w = rotation.velocities(np.swapaxes(points, 1, 2))
        blocks = np.einsum("jiq,eikq,eqk->eqj", dN, inverse, w, optimize=True)  # (e, q, nodes)
        volume = np.broadcast_to(np.abs(determinant).mean(axis=1, keepdims=True), t.shape)  # up to a factor
        sums = sums + scatter(blocks * volume[:, :, None], t, space.functions)
        np.add.at(volumes, t, volume)
    return sp.csr_array(sp.diags_array(1.0 / np.where(volumes > 0, volumes, 1.0)) @ sums)


def _on_unknowns(space: DisplacementSpace, scalar: sp.csr_array, components: np.ndarray | None = None) -> sp.csr_array:
    """Return the form of a (functions, functions) matrix, times one that mixes the components, on the unknowns."""
    return space.restricted(_mixed(scalar, components))


def _mixed(scalar: sp.csr_array, components: np.ndarray | None = None) -> sp.csr_array:
    """Return a (functions, functions) matrix times a (3, 3) one that mixes the components, which without it stay."""
    return sp.kron(scalar, np.eye(3) if components is None else components, format="csr")
