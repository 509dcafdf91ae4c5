"""What is told of onsets once they are found: windows of instability, and where two modes alone would meet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..eigen.pencil import Modes
from ..problem.forms import is_linear
from ..problem.problem import Problem
from .onset import Onset

_AT_END = 1e-6  # of the distance of two values: an onset nearer to one of them may be at that value


def windows(onsets: Sequence[Onset], low: float, high: float) -> list[tuple[float, tuple[Onset, Onset]]]:
    """Return the windows of instability between two values of a sweep: each middle, and the two onsets.

    A window goes from an onset into instability to the next onset out of instability of the same branch. It may begin
    at the first value and end at the second one, where the modes are marginal: by rounding such an onset lies on either
    side of that value.
    """
    found = []
    room = _AT_END * (high - low)
    ordered = sorted((o for o in onsets if low - room <= o.value <= high + room), key=lambda o: o.value)
    for i, into in enumerate(ordered):
        own = {into.branch_a, into.branch_b} - {None}
        later = (o for o in ordered[i + 1 :] if own & {o.branch_a, o.branch_b})
        out = next(later, None)
        if into.direction == "into" and out is not None and out.direction == "out of":
            found.append(((into.value + out.value) / 2, (into, out)))
    found.sort(key=lambda window: window[0])
    # Of equal parts of a brake windows are equal, too: the modes in their middle are the same.
    apart = [i for i, (middle, _) in enumerate(found) if not i or middle - found[i - 1][0] > room]
    return [found[i] for i in apart]


def two_mode_value(problem: Problem, parameter: str, start: float, modes: Modes, a: int, b: int) -> float:
    """Return where two modes of the first value would meet if all other modes were left out.

    NaN if they never meet, and where K is not linear in the parameter, so that the first value does not tell it.
    With F_ij = ψ_iᵀ (dK/dp) φ_j and a change δ of the parameter, the eigenvalues of the two modes are those of
    diag(θ) + δF. They meet where the discriminant (Δθ + δΔF)² + 4δ²F₁₂F₂₁ is zero; its smallest positive root is taken.

    Parameters
    ----------
    problem : Problem
        The problem in whose coordinates the modes are given.
    parameter : str
    start : float
        The first value.
    modes : Modes
        Modes at the first value, with right and left shapes.
    a, b : int
        Positions of the two modes.
    """
    if not is_linear(problem, parameter):
        return np.nan
    dK = problem.derivative(parameter, "K", {parameter: start})
    left, right = modes.left, modes.right
    moves_mass = problem.derivative(parameter, "M", {parameter: start}) is not None
    if dK is None or moves_mass or left is None or right[:, [a, b]].imag.any():
        return np.nan
    F = left[:, [a, b]].real.T @ (dK @ right[:, [a, b]].real)
    theta = -(modes.lam[[a, b]] ** 2).real
    d_theta, d_F = theta[0] - theta[1], F[0, 0] - F[1, 1]
    cross = 4 * F[0, 1] * F[1, 0]
    if abs(cross) <= 1e-12 * np.abs(F).max() ** 2:
        return np.nan  # the two modes are not coupled, or so that frequencies may cross but both stay stable
    roots = np.roots([d_F**2 + cross, 2 * d_theta * d_F, d_theta**2])
    # Two modes alone predict nothing where the change moves eigenvalues by more than their own size.
    sensible = (roots.real > 0) & (roots.real * np.abs(F).max() <= np.abs(theta).max())
    real = roots.real[(np.abs(roots.imag) <= 1e-12 * np.abs(roots)) & sensible]
    return float(start + real.min()) if len(real) else np.nan
