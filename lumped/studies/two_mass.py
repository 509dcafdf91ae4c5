"""Studies of the two-mass model."""

from __future__ import annotations

from functools import partial

import numpy as np

from ..axis import axis_of
from ..models import TwoMass
from ..results import Case, Curves, solve_curves
from ..study import Notes, Study, intervals, of_curves, solve_curve

BASE = TwoMass()
_MIRROR = (
    "The claim that raising {} makes the real parts more negative and so damps the system: there is no damping. "
    "The spectrum is symmetric under λ → −λ, so that the most negative real part, {:.4f} rad/s, is the mirror "
    "image of the largest growth rate, {:+.4f} rad/s."
)


def _mirror(name: str, case: Case) -> str:
    growth = float(case.growth.max())
    return _MIRROR.format(name, -growth, growth)


def _friction_notes(result: Curves) -> Notes:
    case = result.cases[0]
    mu_c = BASE.critical_mu()[0]
    contact = TwoMass(friction="contact").critical_mu()[0]
    return Notes(
        f"The second and third frequency merge at μ_c = {mu_c:.6f} ({contact:.6f} if ky alone carries the load); "
        "the first stays apart and rises a little.",
        "Of three motions two matter: the ones that meet. Frictions above 0.2 are ordinary for brake pads, so that "
        "this pair must be moved apart.",
        _mirror("μ", case),
    )


def _stiffness_notes(name: str, advice: str, extra: str, result: Curves) -> Notes:
    case = result.cases[0]
    unit = "N/m"
    see = f"At μ = 0.4 the system is unstable for {name} in {intervals(case, 7)} {unit} (of 5 to "
    return Notes(f"{see}{result.axis.values[-1]:g} {unit}).", advice, f"{_mirror(name, case)}{extra}")


def _k() -> Curves:
    cases = {(f"μ = {mu:g}", f"μ = {mu:g}"): (BASE, mu) for mu in (0.0, 0.4)}
    return solve_curves(axis_of(BASE, "k", np.linspace(1, 80, 633)), cases)


def _k_notes(result: Curves) -> Notes:
    still, sliding = result.cases
    return Notes(
        "Without friction, as the source's table has it, every frequency rises with k and nothing grows. At μ = "
        f"0.4 the system is unstable for k in {intervals(sliding, 7)} N/m (of 1 to 80 N/m).",
        "A stiffer inclined spring lifts one frequency away from the other: above 10 N/m this pair is safe.",
        "The claim that k makes the real parts more negative, at μ = 0: K is symmetric and positive definite "
        f"there, every Re λ is {abs(still.growth).max():g} for every k. Only the imaginary parts move.",
    )


def _theta1_notes(result: Curves) -> Notes:
    return Notes(
        f"At μ = 0.4 the system is unstable for θ1 in {intervals(result.cases[0], 7)} degrees; all repeats after "
        "180°.",
        "Between 90° and 180° the inclined spring couples with the other sign and flutter is impossible at this μ: "
        "turning the link, which costs no stiffness, is the strongest measure here.",
        "The claim that the angle changes the damping: C = 0 for every angle; the real parts come in pairs of equal "
        "size.",
    )


def _damped(c: float) -> Curves:
    label = f"c1x = c2x = {c:g} N s/m"
    cases = {
        ("undamped", label): (BASE, 0.0),
        (label, label): (TwoMass(c1x=c, c2x=c), 0.0),
        (f"and cy = {c:g} N s/m", label): (TwoMass(c1x=c, c2x=c, cy=c), 0.0),
    }
    return solve_curves(axis_of(BASE, "mu", np.linspace(0, 0.6, 301)), cases)


def _damped_notes(c: float, result: Curves) -> Notes:
    model = TwoMass(c1x=c, c2x=c)
    plain, damped, all_three = (m.critical_mu()[0] for m in (BASE, model, TwoMass(c1x=c, c2x=c, cy=c)))
    trace = np.trace(np.linalg.solve(model.M, model.C))
    case = result.cases[1]
    ratio = float((-case.lam.real / np.abs(case.lam)).max())
    return Notes(
        f"The onset moves from {plain:.6f} without damping to {damped:.6f}: down, since the normal motion is "
        f"undamped. With cy = {c:g} N s/m as well it rises to {all_three:.6f}.",
        "Damp the motion that has the least of it. Damping along the belt alone does not buy friction.",
        f"The claim of critical and overdamped regimes: over 0 ≤ μ ≤ 0.6 every |Im λ| ≥ {case.lam.imag.min():.4f} "
        f"rad/s, no damping ratio exceeds {ratio:.3f}, and the largest Re λ at μ = 0.6 is {case.growth[-1]:+.3f} "
        "rad/s, growing. Nor does friction make the real parts more negative: their sum over all six λ is "
        f"−tr(M⁻¹C) = {-trace:.3g} rad/s at every μ.",
    )


def _one_damper_notes(name: str, result: Curves) -> Notes:
    case = result.cases[0]
    return Notes(
        f"At μ = 0.4 the largest growth rate falls from {case.growth[0]:.4f} to {case.growth[-1]:.4f} rad/s as "
        f"{name} goes from 0 to 0.7 N s/m.",
        "One damper slows the growth and does not stop it; a squeal that builds up more slowly is still a squeal.",
        f"The claim that a higher {name} gives stability: the growth rate stays positive over the whole sweep, "
        f"{case.growth[-1]:+.4f} rad/s at its end.",
    )


def _stiffness(name: str, high: float, advice: str, extra: str = "") -> Study:
    title = f"two-mass model over {name}, μ = 0.4"
    notes = of_curves(partial(_stiffness_notes, name, advice, extra))
    return Study(name, "1.3.3", title, lambda: solve_curve(BASE, name, 5, high, 0.4, 720), notes, spatial=True)


def _sweep_friction() -> Curves:
    return solve_curve(BASE, "mu", 0, 0.6, 0.0, 600)


STUDIES = [
    Study("friction", "1.3.2", "two-mass model over friction", _sweep_friction, of_curves(_friction_notes),
          spatial=True),
    _stiffness("k1x", 50, "Stiffen the support of the first mass beyond 13.9 N/m and the frequencies no "
    "longer meet."),
    _stiffness("k2x", 50, "Softer or stiffer both help: the window lies around the value at which two "
    "frequencies meet.",
               " Raising k2x from 5 N/m makes the system unstable first."),
    _stiffness("ky", 100, "The contact stiffness must not put the normal frequency onto a tangential one; "
    "pads that wear or heat up move along this axis.", " Raising ky from 40 N/m makes the system unstable."),
    Study("k", "1.3.3", "two-mass model over k", _k, of_curves(_k_notes), spatial=True),
    Study("theta1", "1.3.4", "two-mass model over θ1, μ = 0.4",
          lambda: solve_curve(BASE, "theta1", 0, 360, 0.4, 720), of_curves(_theta1_notes), spatial=True),
    Study("damping-0.1", "1.3.5", "two-mass model over friction, c1x = c2x = 0.1 N s/m", partial(_damped, 0.1),
          of_curves(partial(_damped_notes, 0.1)), spatial=True),
    Study("damping-0.3", "1.3.5", "two-mass model over friction, c1x = c2x = 0.3 N s/m", partial(_damped, 0.3),
          of_curves(partial(_damped_notes, 0.3)), spatial=True),
    Study("c2x", "1.3.5", "two-mass model over c2x, μ = 0.4", lambda: solve_curve(BASE, "c2x", 0, 0.7, 0.4, 280),
          of_curves(partial(_one_damper_notes, "c2x")), spatial=True),
    Study("cy", "1.3.5", "two-mass model over cy, μ = 0.4", lambda: solve_curve(BASE, "cy", 0, 0.7, 0.4, 280),
          of_curves(partial(_one_damper_notes, "cy")), spatial=True),
]  # fmt: skip
