"""What holds and joins rotating bodies by single directions: supports, held references, springs between two of them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..errors import SceneError
from ..fem.motion import SteadyMotion
from .context import Context
from .rotating_bodies import nodes_of_body, turn_alike

_LEVEL = 1e-9  # relative: what is not the same after a turn


def check_held_directions(context: Context, body: str, motion: SteadyMotion) -> None:
    """Raise where directions that are held on a rotating body with damping are not the same after a turn.

    Damping inside a turning body acts on u̇ + Lu, see `fe_squeal.fem.gyroscopics`, whose matrix is made of displacements
    that supports allow. Lu is one of these only where the held directions are those that a turn about the axis leaves
    alone: the axis, all that are across it, or all. Springs hold others.

    Raises
    ------
    SceneError
    """
    own = nodes_of_body(context, body)
    for held in np.unique(context.space.fixed.reshape(-1, 3)[own], axis=0):
        _refuse(held, motion, f"supports hold nodes of body {body}", body)
    for path, tie, table in context.references:
        if np.isin(tie.nodes, own).any():
            for held in tie.fixed.reshape(-1, 3):
                _refuse(held, motion, f'{path}.fixed: given "{table.fixed}", which holds the reference', body)


def _refuse(held: np.ndarray, motion: SteadyMotion, how: str, body: str) -> None:
    axis = motion.velocity / np.linalg.norm(motion.velocity)
    if not _mixed_by_a_turn(np.diag(held.astype(float)), axis):
        return
    along = np.flatnonzero(np.abs(axis) > 1 - _LEVEL)
    allowed = '"xyz" or nothing'
    if len(along):
        across = "".join("xyz"[i] for i in range(3) if i != along[0])
        allowed = f'"{"xyz"[along[0]]}", "{across}", "xyz" or nothing'
    letters = " and ".join("xyz"[i] for i in np.flatnonzero(held))
    raise SceneError(
        f"{how} along or about {letters} alone, and body {body} rotates with damping, which is known only where a turn"
        f" mixes no held directions with others; expected {allowed} of each three, and springs for the rest"
    )


def check_springs(context: Context, motions: Mapping[str, SteadyMotion]) -> None:
    """Raise where springs between bodies that turn alike change with a turn, or have dampers across the axis.

    Such springs turn with the bodies. The force of one of them across the axis would change with time; several are
    the same after a turn if Σ k d dᵀ is, d their directions. A damper acts on the rate that the bodies see: with
    r = mean(u) − mean'(u) that is ṙ − Ω × r, and across the axis its circulatory part is not in here. A tied contact
    with `normal_damping` has it.

    Raises
    ------
    SceneError
    """
    sums: dict[tuple[str, ...], np.ndarray] = {}
    names: dict[tuple[str, ...], list[str]] = {}
    axes: dict[tuple[str, ...], np.ndarray] = {}
    for spring in context.springs:
        ends = [spring.group, spring.to] if spring.to is not None else []
        turning = [_turned(context, motions, spring.kind, group, spring.name) for group in ends if group is not None]
        if len(turning) < 2 or turning[0] is None or turning[1] is None or not turn_alike(turning[0], turning[1]):
            continue
        axis = turning[0].velocity / np.linalg.norm(turning[0].velocity)
        d = np.array(spring.direction) / np.linalg.norm(spring.direction)
        if spring.damping and np.linalg.norm(np.cross(d, axis)) > _LEVEL:
            raise SceneError(
                f"springs.{spring.name}.damping: given {spring.damping:g} across the axis, between bodies that turn"
                ' alike (effects.rotation), where a damper turns too; expected a contact of kind = "tied" with'
                " normal_damping there, or 0"
            )
        key = tuple(sorted(str(group) for group in ends))
        sums[key] = sums.get(key, np.zeros((3, 3))) + spring.stiffness * np.outer(d, d)
        names.setdefault(key, []).append(spring.name)
        axes[key] = axis
    for key, stiffness in sums.items():
        if _mixed_by_a_turn(stiffness, axes[key]):
            raise SceneError(
                f"springs {', '.join(names[key])}: the bodies between which they act turn alike (effects.rotation), so"
                " that their force would change with time; expected equal stiffness in all directions across the axis,"
                " as of two springs at right angles"
            )


def _turned(
    context: Context, motions: Mapping[str, SteadyMotion], kind: str, group: str, name: str
) -> SteadyMotion | None:
    """Return the motion of the rotating body that an end of a spring lies on; None where there is none."""
    mesh, path = context.space.mesh, f"springs.{name}"
    if kind == "nodes":
        elements = np.flatnonzero(np.isin(mesh.t, context.nodes(group, path)).any(axis=0))
    else:
        elements = mesh.f2t[0, context.facets(group, path)]
    return next((m for body, m in motions.items() if np.isin(elements, context.bodies[body].elements).any()), None)


def _mixed_by_a_turn(A: np.ndarray, axis: np.ndarray) -> bool:
    """Return whether a form A (3, 3) on directions is another one after a turn about an axis of length 1."""
    turn = np.cross(axis, np.eye(3)).T
    return bool(np.linalg.norm(A @ turn - turn @ A) > _LEVEL * np.linalg.norm(A))
