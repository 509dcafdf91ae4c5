"""Where modes turn unstable: brackets from a tracked sweep, refined on the full problem."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..eigen.linear.factor import LinearSolver
from ..eigen.pencil import Modes
from ..problem.problem import Problem
from ..reduced import ReducedModel
from .step import Onset, Step
from .tracking import mirror_partners

_INNER = 4  # values inside a step at which the small model is asked for hidden instabilities
_OVERALL = 80  # of these values in a sweep: with more steps than that there is one in each


def find_step_onsets(
    problem: Problem, parameter: str, values: tuple[float, float], modes: tuple[Modes, Modes],
    branches: tuple[np.ndarray, np.ndarray], below: float, steps: int, model: ReducedModel | None = None,
    precise: bool = False, linear_solver: LinearSolver | str = "auto",
) -> tuple[list[Onset], list[tuple[int, float, float]], float | None]:  # fmt: skip
    """Return the onsets between two neighbouring values of a sweep, and what they leave unexplained.

    Parameters
    ----------
    values : (a, b)
    modes : at a and at b, with shapes
    branches : (k,) int each, the branch of every mode
    below : float, rad/s
        Frequency up to which modes matter.
    steps : int
        Of the whole sweep.
    model : ReducedModel, optional
        Of which the modes are.
    precise : bool
        Refine the onsets of this model on the problem itself, whatever it costs.
    linear_solver : LinearSolver or str

    Returns
    -------
    onsets : list of Onset
    unknown : list of (branch, value where it is unstable, value where it is not known)
    hidden : float or None
        A value inside the step where the number of unstable modes is not what these onsets make it.
    """
    onsets: list[Onset] = []
    unknown: list[tuple[int, float, float]] = []
    if not len(modes[0]) or not len(modes[1]):
        return onsets, unknown, None
    step = Step(problem, parameter, values, modes, model, precise, linear_solver)
    for inner, outer, direction in ((0, 1, "into"), (1, 0, "out of")):
        stable_end, unstable_end = values[inner], values[outer]
        unstable = {int(b) for b, s in zip(branches[inner], modes[inner].stability, strict=True) if s == "unstable"}
        known = {int(b) for b in branches[inner]}
        partners = mirror_partners(modes[outer])
        for j in np.flatnonzero(modes[outer].stability == "unstable"):
            branch = int(branches[outer][j])
            partner = int(branches[outer][partners[j]]) if partners[j] >= 0 else None
            if unstable & {branch, partner}:
                continue
            if not known & {branch, partner}:
                unknown.append((branch, unstable_end, stable_end))
                continue
            mode, ends = modes[outer].select(np.array([j])), (stable_end, unstable_end)
            if problem.is_damped:
                found = step.crossing(ends, mode)
            else:
                found = step.flutter(ends, mode) if mode.lam[0].imag else step.divergence(ends, mode)
            pair = sorted({branch, partner}) if partner is not None and found.kind == "flutter" else [branch]
            onsets.append(replace(found, direction=direction, branch_a=pair[0], branch_b=pair[1] if pair[1:] else None))
    return onsets, unknown, step.hidden(values, modes[0], onsets, below, min(_INNER, -(-_OVERALL // steps)))


def two_mode_value(problem: Problem, parameter: str, start: float, modes: Modes, a: int, b: int) -> float:
    """Return where two modes of the start value meet if the sweep only recombines these two; NaN if nowhere.

    With F_ij = ψ_iᵀ K' φ_j the reduced pencil is diag(θ) + δF, and the discriminant (Δθ + δΔF)² + 4δ²F_12F_21 is a
    quadratic in the parameter's change δ; its smallest positive root counts.
    """
    dK = problem.derivative(parameter, "K", {parameter: start})
    left, right = modes.left, modes.right
    moves_mass = problem.derivative(parameter, "M", {parameter: start}) is not None
    if dK is None or moves_mass or left is None or right[:, [a, b]].imag.any():
        return np.nan
    F = left[:, [a, b]].real.T @ (dK @ right[:, [a, b]].real)
    theta = modes.lam[[a, b]].imag ** 2
    d_theta, d_F = theta[0] - theta[1], F[0, 0] - F[1, 1]
    cross = 4 * F[0, 1] * F[1, 0]
    if abs(cross) <= 1e-12 * np.abs(F).max() ** 2:
        return np.nan  # the two do not feel each other: they may cross, but not couple
    roots = np.roots([d_F**2 + cross, 2 * d_theta * d_F, d_theta**2])
    # A change that would shift eigenvalues by more than their own size is outside what two modes can tell.
    sensible = (roots.real > 0) & (roots.real * np.abs(F).max() <= theta.max())
    real = roots.real[(np.abs(roots.imag) <= 1e-12 * np.abs(roots)) & sensible]
    return float(start + real.min()) if len(real) else np.nan
