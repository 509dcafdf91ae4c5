"""Where modes turn unstable: changes of stability on the step model, refined on the problem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..eigen.linear.factor import LinearSolver
from ..eigen.pencil import Modes
from ..errors import NotConvergedError
from ..problem.problem import Problem
from ..reduced import ReducedModel
from .balance import unshown
from .changes import FINEST, Change
from .doubts import Doubt, lost_in_rounding, split_doubtful
from .onset import Onset
from .refined import Refiner
from .scale import LINEAR, Scale
from .scan import Open, scan
from .step import Step
from .tracking import mirror_partners, modal_assurance

_BEYOND = 1.05  # of the frequency up to which modes matter: what is found just above it is listed
_TOGETHER = 4  # times `FINEST`: changes nearer to each other than this may be one, or none
_SLOW = 1e-3  # of the largest |λ|: how far |λ| of such changes may differ
_RIM = 0.9  # of the highest |λ| known: a mode above may vanish by leaving the range, which is no fault


@dataclass(frozen=True)
class Found:
    """What one step of a sweep holds.

    Attributes
    ----------
    onsets : list of Onset
    warnings : list of str
        Sentences about changes of stability that could not be settled.
    missing : list of str
        Sentences about modes that vanish inside the range of frequencies, where no branch can end: the solver has
        overlooked them at one of the values.
    width : float
        Every window of instability wider than this was found, in the parameter.
    doubts : list of Doubt
        Intervals in which rounding hides whether two modes turn unstable.
    """

    onsets: list[Onset] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    width: float = 0.0
    doubts: list[Doubt] = field(default_factory=list)


def find_step_onsets(
    problem: Problem, parameter: str, values: tuple[float, float], modes: tuple[Modes, Modes],
    branches: tuple[np.ndarray, np.ndarray], below: float, reduced_model: ReducedModel | None = None,
    precise: bool = False, linear_solver: LinearSolver | str = "auto", scale: Scale = LINEAR, starts: bool = True,
) -> Found:  # fmt: skip
    """Return the onsets between two neighbouring values of a sweep, and what they leave unexplained.

    Parameters
    ----------
    values : (a, b)
    modes : at a and at b, with shapes
    branches : (k,) int each, the branch of every mode
    below : float, rad/s
        Frequency up to which modes matter.
    reduced_model : ReducedModel, optional
        The one that the modes come from; without it they are those of the problem itself.
    precise : bool
        Refine the onsets of a reduced model on the problem itself, whatever it costs.
    linear_solver : LinearSolver or str
    scale : Scale
        Of the sweep.
    starts : bool
        Whether the first value is that of the sweep: two modes of equal frequency may couple as soon as it is left.
    """
    if not len(modes[0]) or not len(modes[1]):
        return Found()
    step = Step(problem, parameter, values, modes, reduced_model, linear_solver)
    limit = _BEYOND * below
    seen = scan(step.end(0), step.end(1), step.between, limit, scale)
    if seen.open and problem.is_damped:  # a pair that parts into two real ones: the decaying one may not be listed
        seen = scan(step.between(values[0]), step.between(values[1]), step.between, limit, scale)
    found = Found(width=seen.width)
    refiner = Refiner(step, precise, starts)
    for changes in _told_apart(step, [c for c in seen.changes if _frequency(step, c) <= limit]):
        refined: list[Onset] = []
        failed: list[str] = []
        for change in changes:
            try:
                onset = refiner.onset(change)
            except (NotConvergedError, ValueError, np.linalg.LinAlgError) as error:
                if (doubt := lost_in_rounding(step, change)) is not None:
                    found.doubts.append(doubt)
                    continue
                failed.append(
                    f"an onset between {parameter} = {change.low:.8g} and {change.high:.8g} was not refined: {error}"
                )
                continue
            first, second = _names(step, change, branches)
            refined.append(replace(onset, branch_a=first, branch_b=second))
        if failed and len(changes) > 1:  # nearer to each other than can be told: only their sum is known
            refined, failed = _sum(refined, sum(c.gains for c in changes), failed)
        found.onsets.extend(refined)
        found.warnings.extend(failed)
    for a, b, omega in seen.unsettled:
        if omega <= 1.02 * below:
            found.warnings.append(
                f"between {parameter} = {a:.8g} and {b:.8g} modes near {omega / (2 * np.pi):.5g} Hz change too much for"
                " their stability to be followed"
            )
    found.onsets[:], unclear = split_doubtful(step, found.onsets)
    found.doubts.extend(unclear)
    rim = _RIM * min(float(np.abs(m.lam).max(initial=0.0)) for m in modes)
    if not found.warnings and (told := unshown(step, found.onsets, min(rim, below))):
        found.warnings.append(told)
    for group in seen.open:
        _tell_open(found, group, parameter, below)
    return found


def _told_apart(step: Step, changes: list[Change]) -> list[list[Change]]:
    """Return changes, by rising value, in runs of those that are too near to each other to be told apart."""
    width = _TOGETHER * FINEST * abs(step.ends[1] - step.ends[0])
    near = _SLOW * max(float(np.abs(m.lam).max(initial=0.0)) for m in step.modes_at_ends)
    runs: list[list[Change]] = []
    for change in changes:
        for run in runs:
            if change.low - run[-1].high <= width and abs(_frequency(step, change) - _frequency(step, run[-1])) <= near:
                run.append(change)
                break
        else:
            runs.append([change])
    return runs


def _sum(onsets: list[Onset], gains: int, failed: list[str]) -> tuple[list[Onset], list[str]]:
    """Return the surest onsets of a run of changes, as many as it gains or loses modes in all, and no warning.

    Where fewer onsets than that could be refined, return all of them, with the warnings.
    """
    direction = "into" if gains > 0 else "out of"
    likely = sorted((o for o in onsets if o.direction == direction), key=lambda o: o.uncertainty)
    return (likely[: abs(gains)], []) if len(likely) >= abs(gains) else (onsets, failed)


def _frequency(step: Step, change: Change) -> float:
    """Return |λ| of the eigenvalue that changes, rad/s."""
    plain = not any(t.slot == "C" for t in step.model.terms)
    return float(np.sqrt(abs(change.v)) if plain else abs(change.v))


def _names(step: Step, change: Change, branches: tuple[np.ndarray, np.ndarray]) -> tuple[int, int | None]:
    """Return the branches whose shapes are like those of a change, by preference at the end where they are unstable."""
    pair = change.kind == "meeting"
    plane = np.column_stack([change.right.real, change.right.imag]) if pair else change.right[:, None]
    best: tuple[float, list[int]] = (-1.0, [0])
    for end in (1, 0) if change.gains > 0 else (0, 1):
        modes = step.modes_at_ends[end]
        shapes, _ = step.shapes(modes)
        likeness = modal_assurance(plane, shapes, step.model.mass).max(axis=0)
        likeness[modes.lam == 0] = 0.0
        growing = modes.stability == "unstable"
        partner = mirror_partners(modes)
        if pair and growing.any():
            i = int(np.argmax(np.where(growing, likeness, -1.0)))
            if partner[i] >= 0 and likeness[i] > 0.5:
                return _named([int(branches[end][i]), int(branches[end][partner[i]])])
        order = np.argsort(-likeness)[: 2 if pair else 1]
        score = float(likeness[order].sum())
        if score > best[0] + (0.2 if best[0] >= 0 else 0.0):
            best = score, [int(branches[end][i]) for i in order]
    return _named(best[1])


def _named(branches: list[int]) -> tuple[int, int | None]:
    first, *rest = sorted(branches)
    return first, rest[0] if rest else None


def _tell_open(found: Found, group: Open, parameter: str, below: float) -> None:
    """Add a sentence where modes at one value have no counterpart at the other although they lie inside the range."""
    (a, b), (s0, s1) = group.nodes, group.members
    more, own = (a, s0) if len(s0) > len(s1) else (b, s1)
    rim = _RIM * min(float(np.abs(n.lam).max(initial=0.0)) for n in group.nodes)
    lam = more.lam[own]
    inside = (lam.imag > 0) & (-lam.real < lam.imag) & (np.abs(lam) < rim) & (lam.imag <= below)
    if inside.sum() >= abs(len(s0) - len(s1)):
        at = f"{lam[inside].imag.mean() / (2 * np.pi):.5g} Hz"
        found.missing.append(
            f"{abs(len(s0) - len(s1))} modes are missing between {parameter} = {a.value:g} and {b.value:g} near {at}:"
            f" they are there at {more.value:g} alone"
        )
    growing = [(n, s[n.unstable[s]]) for n, s in zip(group.nodes, group.members, strict=True)]
    for node, s in growing:
        if len(s) and (node.lam[s].imag <= below).any() and len(growing[0][1]) != len(growing[1][1]):
            found.warnings.append(
                f"a mode at {node.lam[s[0]].imag / (2 * np.pi):.5g} Hz is unstable at {parameter} = {node.value:g} and"
                " is not known on the other side: its onset is not found; ask for more modes or a finer sweep"
            )


def windows(onsets: Sequence[Onset], low: float, high: float) -> list[tuple[float, tuple[Onset, Onset]]]:
    """Return the middles of windows of instability between two values of a sweep, and the onsets that bound them.

    A window goes from an onset into instability to the next one out of it of the same branch.
    """
    found = []
    ordered = sorted((o for o in onsets if low < o.value < high), key=lambda o: o.value)
    for i, into in enumerate(ordered):
        own = {into.branch_a, into.branch_b} - {None}
        later = (o for o in ordered[i + 1 :] if own & {o.branch_a, o.branch_b})
        out = next(later, None)
        if into.direction == "into" and out is not None and out.direction == "out of":
            found.append(((into.value + out.value) / 2, (into, out)))
    return found


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
        return np.nan  # the two are not coupled: their frequencies may cross, but both stay stable
    roots = np.roots([d_F**2 + cross, 2 * d_theta * d_F, d_theta**2])
    # Two modes alone predict nothing about a change so large that it shifts eigenvalues by more than their size.
    sensible = (roots.real > 0) & (roots.real * np.abs(F).max() <= theta.max())
    real = roots.real[(np.abs(roots.imag) <= 1e-12 * np.abs(roots)) & sensible]
    return float(start + real.min()) if len(real) else np.nan
