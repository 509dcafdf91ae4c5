"""Studies of the disc without diagonal springs, and the counter-example."""

from __future__ import annotations

import math

import numpy as np

from ..models import RigidPad, UncoupledDisc
from ..results import Curves
from ..study import Notes, Study, of_curves, solve_curve

BASE = UncoupledDisc()


def _friction_notes(result: Curves) -> Notes:
    moved = float(np.ptp(BASE.eigenvalues(np.linspace(0, 5, 101)).imag, axis=0).max())
    return Notes(
        "A reconstruction of the kind of model that the source describes. Friction drives the tangential motion, "
        f"and nothing comes back: K is block triangular. Over 0 ≤ μ ≤ 5 no frequency moves by more than {moved:.1g} "
        "rad/s.",
        "A model without a path from tangential to normal motion cannot squeal by mode coupling. If a "
        "finite-element model shows no friction dependence at all, look for the missing path.",
    )


def _rigid_pad_notes(result: Curves) -> Notes:
    return Notes(
        "A rigid pad that moves along the normal and rotates, on two unequal contact springs, with no inclined "
        f"spring: K = [[3, 1], [1 − 3μ, 4 − μ]] flutters from μ = 7 − 2√11 = {RigidPad().critical_mu()[0]:.5f}.",
        "Any path will do: here the moment of the friction force about the centre of the pad. Low pads and centred "
        "pressure lower the coupling.",
        "The claim that mode coupling needs a diagonal stiffness: this pad has none and flutters from "
        f"{7 - 2 * math.sqrt(11):.5f} on.",
    )


STUDIES = [
    Study("friction", "1.5", "disc with two pads and no diagonal spring, over friction",
          lambda: solve_curve(BASE, "mu", 0, 2, 0.0, 200), of_curves(_friction_notes)),
    Study("rigid-pad", "1.5", "rigid pad that rotates: the counter-example",
          lambda: solve_curve(RigidPad(), "mu", 0, 1, 0.0, 400), of_curves(_rigid_pad_notes)),
]  # fmt: skip
