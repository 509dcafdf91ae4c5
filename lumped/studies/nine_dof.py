"""Studies of the nine-degree-of-freedom model."""

from __future__ import annotations

import numpy as np

from ..axis import axis_of
from ..models import NineDof
from ..results import Curves, solve_curves
from ..study import Notes, Study, intervals, of_curves, solve_curve

BASE = NineDof()
DAMPED = NineDof(c1=0.1, c2=0.1, c3=0.1, c4=0.1, c5=0.1, c6=0.1, c7=0.1, c8=0.1, c9=0.1)
_RECONSTRUCTION = "The model is a reconstruction: the source prints neither its matrices nor its dimensions. "


def _friction_notes(result: Curves) -> Notes:
    found = ", ".join(f"{o.mu:.6f} (at {o.omega:.3f} rad/s)" for o in BASE.critical_points(0, 4))
    return Notes(
        f"{_RECONSTRUCTION}Flutter begins at μ = {found}; the source reports the first two, as 0.9 and 2.7. Other "
        "frequencies meet and cross without any effect.",
        "In a system of many modes most crossings are harmless; only pairs that friction couples with opposite "
        "signs merge. Looking at frequencies alone overstates the danger.",
        "The claim that eigenvalues move from negative to positive real parts: without damping none is ever "
        f"negative without its positive mirror image (±{result.cases[0].growth[-1]:.4f} rad/s at μ = 4).",
    )


def _kc_notes(result: Curves) -> Notes:
    case = result.cases[0]
    return Notes(
        f"At μ = 0.5 one narrow window is unstable, kc in {intervals(case)} N/m, with a growth rate of at most "
        f"{case.growth.max():.4f} rad/s.",
        "A stiff contact is safe here, a soft one passes through a window; contact stiffness changes with brake "
        "pressure, so that the window is crossed at some pressure.",
    )


def _k_notes(result: Curves) -> Notes:
    case = result.cases[0]
    end = next(low for low, high in case.unstable if low <= 4 <= high)
    return Notes(
        f"At μ = 0.5, with k1 to k4 together, the system is unstable in {intervals(case)} N/m. Of the stable ranges "
        f"that the source names, 5 to 6 N/m lies in a gap, and 3 to 4 N/m does but for its end, from {end:.2f} on.",
        "Stability comes and goes with stiffness: between two tested values that are quiet there may be one that "
        "is not. Sweep finely, or look for the onsets themselves.",
    )


def _damping() -> Curves:
    label = "friction"
    cases = {("undamped", label): (BASE, 0.0), ("c1 to c9 = 0.1 N s/m", label): (DAMPED, 0.0)}
    return solve_curves(axis_of(BASE, "mu", np.linspace(0, 4, 801)), cases)


def _damping_notes(result: Curves) -> Notes:
    plain, damped = BASE.critical_points(0, 4), [o for o in DAMPED.critical_points(0, 4) if o.into]
    later = ", ".join(f"{o.mu:.5f}" for o in damped)
    return Notes(
        f"Equal dampers on all nine coordinates move the first onset from {plain[0].mu:.5f} to {damped[0].mu:.5f} "
        f"(at {damped[0].omega:.4f} rad/s); onsets up to μ = 4: {later}. Every Re λ is shifted down by 0.05 rad/s "
        "on average.",
        "A weak flutter is cured by little damping: the first onset has a growth of 0.055 √(μ − μ_c) rad/s, which "
        "0.05 rad/s of damping outweighs for a long way.",
    )


STUDIES = [
    Study("friction", "1.4.1", "nine-dof model over friction",
          lambda: solve_curve(BASE, "mu", 0, 4, 0.0, 800), of_curves(_friction_notes)),
    Study("kc", "1.4.2", "nine-dof model over kc1 = kc2, μ = 0.5",
          lambda: solve_curve(BASE, ("kc1", "kc2"), 0, 15, 0.5, 1500), of_curves(_kc_notes)),
    Study("k", "1.4.2", "nine-dof model over k1 = k2 = k3 = k4, μ = 0.5",
          lambda: solve_curve(BASE, ("k1", "k2", "k3", "k4"), 0, 10, 0.5, 1000), of_curves(_k_notes)),
    Study("damping", "1.4.2", "nine-dof model over friction, damped and undamped", _damping, of_curves(_damping_notes)),
]  # fmt: skip
