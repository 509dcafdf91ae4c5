"""Stress stiffening: the static stress resists, or helps, rotations of the material."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
import scipy.sparse as sp

from ..fem.element_matrices import scatter_scalar
from ..fem.materials import Elasticity
from ..fem.rigid_prestress import rigid_stiffness
from ..fem.spaces import DisplacementSpace
from ..fem.stress import element_stress
from ..fem.ties import Tie
from ..problem.terms import Term
from .cache import Same
from .context import BodyPart, Context
from .effect import Effect
from .preload import Preload
from .static_forces import static_forces
from .static_state import StaticState

_FLAT = 1e-3  # one less the length of the mean normal: more is a curved surface, whose normals differ by 0.1 rad



class StressStiffening(Effect):
    """Geometric stiffness K_σ = ∫ σ0_ij ∂_iδu·∂_ju dV of the preload's stress σ0 = σ(u0).

    Tension stiffens, pressure softens. Needs `[effects.preload]`; where a body rotates, σ0 includes the centrifugal
    stress. (Zienkiewicz and Taylor, The Finite Element Method, vol. 2.) In a `[[rigid]]` body, and between an
    `[[averaged]]` reference and its nodes, the forces on the nodes stand for the stress, see
    `fe_squeal.fem.rigid_prestress`. It has no keys.
    """

    name: ClassVar[str] = "stress_stiffening"
    summary: ClassVar[str] = "Geometric stiffness of the preload's stress; without keys."
    needs: ClassVar[Mapping[str, str]] = {"preload": ", whose stress acts; expected [effects.preload]"}

    def warnings(self, context: Context, others: Sequence[Term], parameters: Mapping[str, float]) -> list[str]:
        """Return a sentence for each pressed contact on a curved surface.

        Along a surface of revolution the pressure has no moment about the axis, however the body is turned. With
        g₂ = ½ κ_ab s_a s_b − s_a n·∂_a u, the gap to second order in the slip s and the curvature κ, the stiffness of
        the contact itself, ∫ p (δs_a n·∂_a u + s_a n·∂_a δu − κ_ab δs_a s_b), takes away what K_σ has in that turn:
        ∫ f·x over the forces f on the body. It is not in the equations.
        """
        found = []
        for name, contact in context.contacts.items():
            pressed = contact.operators.weights * contact.pressure if contact.state is not None else np.zeros(0)
            if contact.kind == "tied" or not pressed.any():
                continue
            mean = pressed @ contact.operators.normals / pressed.sum()
            if 1 - np.linalg.norm(mean) <= _FLAT:
                continue
            size = ""
            if contact.motion is not None and contact.motion.centre is not None:
                axis = contact.motion.velocity / np.linalg.norm(contact.motion.velocity)
                arms = contact.operators.points - contact.motion.centre
                arms = arms - np.outer(arms @ axis, axis)
                turn = abs(pressed @ np.einsum("qi,qi->q", contact.operators.normals, arms))
                size = f" of about {turn:.3g} N m/rad about the axis"
            found.append(
                f"contact {name}: its surface is curved and pressed, and of its geometric stiffness only the part of"
                f" the stress inside the bodies is known: bodies that can turn along it have a stiffness{size}, or the"
                " negative of it, that does not exist; hold them against turning, or do without"
                " [effects.stress_stiffening]"
            )
        return found

    def terms(self, context: Context) -> list[Term]:
        """Return the geometric stiffness of every body, and of what ties nodes to references."""
        state = context.static_state
        if state is None:
            return []
        found = [_kept_term(context, body, state) for body in context.bodies.values()]
        for _, tie, table in context.references:
            if not tie.fixed[3:].all() and (tie.rigid or table.is_loaded):
                found.append(_kept_rigid_term(context, tie, state))
        return found


def _kept_term(context: Context, body: BodyPart, state: StaticState) -> Term:
    return context.cache.get(
        f"stress_stiffening.{body.name}", Same(state),
        lambda: stiffening_term(context.space, body.name, body.elements, body.elasticity(), state.u),
    )  # fmt: skip


def _kept_rigid_term(context: Context, tie: Tie, state: StaticState) -> Term:
    preload = context.table(Preload)
    pressures = {} if preload is None else preload.pressures

    def made() -> Term:
        forces = static_forces(context, state, pressures, tie.nodes)
        matrix = rigid_stiffness(context.space, tie, forces)
        return Term(f"stress_stiffening.reference.{tie.name}", "K", matrix, symmetric=True)

    return context.cache.get(f"stress_stiffening.reference.{tie.name}", Same(state), made)


def stiffening_term(
    space: DisplacementSpace, body: str, elements: np.ndarray, law: Elasticity, u: np.ndarray
) -> Term:
    """Return the geometric stiffness of one body.

    Parameters
    ----------
    elements : (e,) int
    law : Elasticity
    u : (n,) float, m
        Static displacements.
    """
    K = sp.csr_array((space.unknowns, space.unknowns))
    for shapes, stress in element_stress(space, elements, law, u):
        weighted = np.einsum("eabq,ejbq,eq->ejaq", stress, shapes.gradients, shapes.dx, optimize=True)
        e, j = shapes.nodes.shape
        blocks = shapes.gradients.reshape(e, j, -1) @ np.transpose(weighted.reshape(e, j, -1), (0, 2, 1))
        K = K + scatter_scalar(space, blocks, shapes.nodes)
    return Term(f"stress_stiffening.{body}", "K", sp.csr_array((K + K.T) / 2), symmetric=True)
