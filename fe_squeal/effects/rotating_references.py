"""Inertia at a reference point that a rotating body is tied to."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..errors import SceneError
from ..fem.motion import SteadyMotion
from ..fem.spaces import DisplacementSpace
from ..fem.ties import Tie
from ..problem.terms import Term
from .ties import Rigid, inertia_tensor

_SAME = 1e-6  # of the inertia, and of the distance of the tied nodes: what is smaller is rounding in the scene


def reference_terms(
    space: DisplacementSpace, tie: Tie, table: Rigid, path: str, body: str, motion: SteadyMotion
) -> list[Term]:
    """Return the gyroscopic term of the inertia at a reference point; none without inertia.

    A rigid part that spins about the unit vector a has the angular momentum I_t θ̇ + I_p Ω (a + θ × a) across the axis,
    with small tilts θ; its rate brings the moment I_p Ω θ̇ × a, that is C = −I_p Ω [a]×, skew. A mass on the axis stays
    where it is and adds nothing.

    Parameters
    ----------
    path : str
        Path of the tie's table in the scene, for messages.
    body : str
        The rotating body that the tie holds nodes of.
    motion : SteadyMotion
        Its rotation.

    Raises
    ------
    SceneError
        Mass or inertia is not the same all around the axis: then it changes with time, and there are no modes.
    """
    speed = float(np.linalg.norm(motion.velocity))
    a = motion.velocity / speed
    J = np.zeros((3, 3)) if table.inertia is None else inertia_tensor(table.inertia)
    if not table.mass and not J.any():
        return []
    off = np.linalg.norm(np.cross(a, tie.point - motion.centre))
    size = np.linalg.norm(space.coordinates[tie.nodes] - tie.point, axis=1).max()
    polar = float(a @ J @ a)
    across = (np.trace(J) - polar) / 2
    uneven = np.abs(J - across * np.eye(3) - (polar - across) * np.outer(a, a)).max()
    what = None
    if off > _SAME * size:
        what = f"its reference point, with mass or inertia, lies {off:.3g} m beside the axis"
    elif uneven > _SAME * np.abs(J).max():
        what = "its inertia is not the same all around the axis"
    if what is not None:
        raise SceneError(f"{path}: body {body} rotates, and {what}; expected what does not change as it turns")
    if not polar:
        return []
    rows = space.reference(tie)[3:]
    C = -polar * speed * np.cross(a, np.eye(3)).T  # (a × θ) = np.cross(a, I)ᵀ θ
    matrix = sp.csr_array(rows.T @ sp.csr_array(C) @ rows)
    matrix = sp.csr_array((matrix - matrix.T) / 2)
    return [Term(f"gyroscopic.{tie.name}", "C", matrix, symmetric=False, skew=True)]
