"""Find the onsets of one step of a sweep: changes of stability of the step model, refined on the problem itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ..eigen.linear.factor import LinearSolver
from ..eigen.pencil import Modes
from ..problem.problem import Problem
from ..reduced import ReducedModel
from .balance import unshown
from .changes import FINEST, Change
from .doubts import Doubt, lost_in_rounding, one_in_rounding, split_doubtful
from .nodes import Node
from .onset import Onset
from .refined import Refiner
from .roots import FAILURES
from .scale import LINEAR, Scale
from .scan import Open, Scan, joined, scan
from .step import Step
from .tracking import mirror_partners, modal_assurance
from .unevenness import is_uneven

_BEYOND = 1.05  # times the highest frequency that matters: changes of stability up to here are looked for
_MATTERS = 1.02  # times that frequency: up to here it is told where stability is not decided
_TOGETHER = 4  # times `FINEST`: changes that are closer together than this may be a single one, or cancel
_SLOW = 1e-3  # of |λ|, or of as much of the largest one: changes that differ by more are never taken for the same one
_DIGITS = 6  # of a likeness of shapes: beyond these two shapes are one
_RIM = 0.9  # of the highest |λ| known: a mode above this may leave the range of modes, so its absence is no error


@dataclass(frozen=True)
class Found:
    """The onsets that were found in one step of a sweep, and what could not be decided.

    Attributes
    ----------
    onsets : list of Onset
    warnings : list of str
        Sentences about changes of stability that could not be refined or followed.
    missing : list of str
        Sentences about modes that are known at one end of the step alone, inside the range of frequencies. Since no
        branch can end there, the solver must have missed them at the other end.
    width : float
        Every window of instability wider than this, in the parameter, was found.
    doubts : list of Doubt
        Intervals in which rounding hides whether two modes turn unstable.
    """

    onsets: list[Onset] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    width: float = 0.0
    doubts: list[Doubt] = field(default_factory=list)

    def tell(self, told: str | Doubt, parameter: str, halved: bool) -> None:
        """Add what a balance says; a doubt is a warning if the step is halved, so that its interval becomes small."""
        if isinstance(told, str):
            self.warnings.append(told)
        elif halved:
            self.warnings.append(told.sentence(parameter))
        else:
            self.doubts.append(told)


def find_step_onsets(
    problem: Problem, parameter: str, values: tuple[float, float], modes: tuple[Modes, Modes],
    branches: tuple[np.ndarray, np.ndarray], below: float, reduced_model: ReducedModel | None = None,
    precise: bool = False, linear_solver: LinearSolver | str = "auto", scale: Scale = LINEAR, starts: bool = True,
    halved: bool = False, known: float = 0.0, tolerance: float = 1e-8,
) -> Found:  # fmt: skip
    """Return the onsets between two neighbouring values of a sweep, and what could not be decided.

    Parameters
    ----------
    problem : Problem
    parameter : str
    values : (float, float)
        The two values, ascending.
    modes : (Modes, Modes)
        The modes at these values, with shapes.
    branches : ((k,) int, (l,) int)
        The branch of each of these modes.
    below : float, rad/s
        Frequency up to which modes matter.
    reduced_model : ReducedModel, optional
        The reduced model that the modes are given on; without it they are given on the problem itself.
    precise : bool
        Whether to refine onsets on the problem itself even if the reduced model gives them accurately enough.
    linear_solver : LinearSolver or str
    scale : Scale
        Whether steps go along the parameter or its logarithm.
    starts : bool
        Whether the first value is the first of the whole sweep: two modes of equal frequency may couple as soon as the
        parameter leaves it.
    halved : bool
        Whether the step is halved and searched again if anything is not decided: the search then ends at the first
        thing that is not, with what it has found so far.
    known : float, rad/s
        Frequency up to which all modes are known at both values, if it is higher than those of the modes there.
    tolerance : float
        Of eigenvalues, relative.
    """
    if not len(modes[0]) or not len(modes[1]):
        return Found(width=values[1] - values[0])  # nothing is known of one of them
    step = Step(problem, parameter, values, modes, reduced_model, linear_solver, known, tolerance)
    limit, mattering = _BEYOND * below, _MATTERS * below
    deciding = mattering if halved else None

    def search(first: Node, second: Node, between: Callable[[float], Node] = step.between) -> Scan:
        return scan(
            first, second, between, limit, scale, deciding, step.is_linear, known, step.apart, step.is_curved
        )

    seen = search(step.end(0), step.end(1), step.listed)
    if seen.open:
        # A mode may come into the range of frequencies between the ends. And a pair that becomes two real eigenvalues
        # may leave a strongly decaying one that the solver does not list. The step model has all of them, so its own
        # modes are taken at the ends too, however high they are.
        step.reach = np.inf
        ends = step.between(values[0]), step.between(values[1])
        rim = _RIM * max(known, min(float(np.abs(m.lam).max(initial=0.0)) for m in modes))
        if problem.is_damped or not any(_lacks(step.end(i), ends[i], rim) for i in (0, 1)):
            seen = search(*ends)
    found = Found(width=seen.width)
    unsettled = []
    if is_uneven(step, seen.changes, mattering):
        found = Found(width=step.width)
        unsettled.append(
            f"between {parameter} = {values[0]:.8g} and {values[1]:.8g} matrices change unevenly, as where contacts"
            " open: an onset may be missing"
        )
    lost = []
    for a, b, omega in seen.unsettled:
        if omega > mattering:
            continue
        if not halved and (doubt := one_in_rounding(step, a, b, omega)) is not None:
            found.doubts.append(doubt)
            continue
        lost.append((a, b, omega))
    unsettled += [
        f"between {parameter} = {a:.8g} and {b:.8g} modes near {omega / (2 * np.pi):.5g} Hz change too much for"
        " their stability to be followed"
        for a, b, omega in joined(lost)
    ]
    left_open = Found()
    for group in seen.open:
        _tell_open(left_open, group, parameter, below, halved, known)
    if halved and (unsettled or left_open.warnings or left_open.missing):
        return replace(left_open, warnings=unsettled + left_open.warnings)
    refiner = Refiner(step, precise, starts)
    for changes in _told_apart(step, [c for c in seen.changes if _frequency(step, c) <= limit]):
        refined: list[Onset] = []
        failed: list[str] = []
        for change in changes:
            try:
                onset = refiner.onset(change)
            except FAILURES as error:
                if (doubt := lost_in_rounding(step, change)) is not None:
                    found.doubts.append(doubt)
                    continue
                failed.append(
                    f"an onset between {parameter} = {change.low:.8g} and {change.high:.8g} was not refined: {error}"
                )
                continue
            first, second = _names(step, change, branches)
            refined.append(replace(onset, branch_a=first, branch_b=second))
        if failed and _is_narrow(step, changes):  # too close together to be distinguished: only their sum is certain
            refined, failed = _sum(refined, sum(c.gains for c in changes), failed)
        found.onsets.extend(refined)
        found.warnings.extend(failed)
        if halved and failed:
            return found
    found.warnings.extend(unsettled)
    found.onsets[:], unclear = split_doubtful(step, found.onsets, halved, starts)
    found.doubts.extend(unclear)
    rim = _RIM * max(known, min(float(np.abs(m.lam).max(initial=0.0)) for m in modes))
    if not found.warnings and (told := unshown(step, found.onsets, min(rim, below))):
        found.tell(told, parameter, halved)
    return replace(found, warnings=found.warnings + left_open.warnings, missing=left_open.missing)


def _lacks(listed: Node, whole: Node, rim: float) -> bool:
    """Return whether a solver lost a mode: there are fewer below a frequency than the step model has."""
    counts = [int(np.count_nonzero((n.lam.imag > 0) & (np.abs(n.lam) < rim))) for n in (listed, whole)]
    return counts[0] < counts[1]


def _told_apart(step: Step, changes: list[Change]) -> list[list[Change]]:
    """Return the changes, ascending, in runs; those in a run may be too close together to be distinguished.

    They are known to lie between two values alone, which are apart by far more where a mode crosses the axis.
    """
    width = _TOGETHER * FINEST * step.width
    least = _SLOW * max(float(np.abs(m.lam).max(initial=0.0)) for m in step.modes_at_ends)
    runs: list[list[Change]] = []
    for change in changes:
        omega = _frequency(step, change)
        for run in runs:
            near = _SLOW * max(omega, least)
            if change.low - run[-1].high <= width and abs(omega - _frequency(step, run[-1])) <= near:
                run.append(change)
                break
        else:
            runs.append([change])
    return runs


def _is_narrow(step: Step, changes: list[Change]) -> bool:
    """Return whether several changes surely are so close together that a window between them is not looked for."""
    spread = max(c.high for c in changes) - min(c.low for c in changes)
    return len(changes) > 1 and spread <= _TOGETHER * FINEST * step.width


def _sum(onsets: list[Onset], gains: int, failed: list[str]) -> tuple[list[Onset], list[str]]:
    """Return the onsets that a run of changes amounts to, and the warnings that remain.

    Parameters
    ----------
    onsets : list of Onset
        Those changes of the run that were refined.
    gains : int
        Number of unstable modes that the whole run gains (negative: loses). As many onsets are kept, those of least
        uncertainty, and no warning remains. If fewer were refined, all of them and the warnings are returned.
    failed : list of str
        Warnings about the changes that were not refined.
    """
    direction = "into" if gains > 0 else "out of"
    likely = sorted((o for o in onsets if o.direction == direction), key=lambda o: o.uncertainty)
    return (likely[: abs(gains)], []) if len(likely) >= abs(gains) else (onsets, failed)


def _frequency(step: Step, change: Change) -> float:
    """Return |λ| of the eigenvalue that changes, rad/s."""
    return float(np.sqrt(abs(change.v)) if _is_plain(step) else abs(change.v))


def _is_plain(step: Step) -> bool:
    """Whether nothing depends on velocity, so that changes are told in θ = −λ² instead of λ."""
    return not any(t.slot == "C" for t in step.model.terms)


def _names(step: Step, change: Change, branches: tuple[np.ndarray, np.ndarray]) -> tuple[int, int | None]:
    """Return the one or two branches whose shapes are most like those of a change.

    The shapes at that end of the step are compared first where the modes are unstable. An unstable mode there whose
    branch is not unstable at the other end comes before all others: just before two modes meet both have that shape.
    """
    pair, plain = change.kind == "meeting", _is_plain(step)
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
        if not pair and end == (1 if change.gains > 0 else 0):
            others = step.modes_at_ends[1 - end]
            also = branches[1 - end][others.stability == "unstable"]
            i = int(np.argmax(np.where(growing & ~np.isin(branches[end], also), likeness, -1.0)))
            if growing[i] and likeness[i] > 0.5 and branches[end][i] not in also:
                return _named([int(branches[end][i])])
        # The two real modes of an overdamped one have one shape: the nearer eigenvalue decides, not rounding.
        away = np.abs(modes.lam**2 + change.v if plain else modes.lam - change.v)
        order = np.lexsort((away, -likeness.round(_DIGITS)))[: 2 if pair else 1]
        score = float(likeness[order].sum())
        if score > best[0] + (0.2 if best[0] >= 0 else 0.0):
            best = score, [int(branches[end][i]) for i in order]
    return _named(best[1])


def _named(branches: list[int]) -> tuple[int, int | None]:
    first, *rest = sorted(branches)
    return first, rest[0] if rest else None


def _tell_open(found: Found, group: Open, parameter: str, below: float, halved: bool, known: float) -> None:
    """Add a sentence to `found.missing` if modes of a group have no counterpart at the other value, inside the range.

    Modes that decay without swinging need not be known: free motions that friction alone damps, for instance, are not
    among the modes without friction. Where they begin to grow they are known. If such modes are the reason and the step
    is not `halved`, or if the numbers of unstable modes of the group differ, a warning is added.
    """
    (a, b), (s0, s1) = group.nodes, group.members
    more, lam, other = (a, a.lam[s0], b.lam[s1]) if len(s0) > len(s1) else (b, b.lam[s1], a.lam[s0])
    rim = _RIM * max(known, min(float(np.abs(n.lam).max(initial=0.0)) for n in group.nodes))
    inside = (lam.imag > 0) & (-lam.real < lam.imag) & (np.abs(lam) < rim) & (lam.imag <= below)
    # Without velocity-dependent forces a mode that grows without swinging has one that decays beside it.
    sure = -lam.real, -other.real
    if a.C is not None:
        sure = np.abs(lam.real), np.abs(other.real)
    still, also = (int(np.count_nonzero(s >= np.abs(x.imag))) for s, x in zip(sure, (lam, other), strict=True))
    lacking = len(lam) - len(other)
    explained = 0 if halved else max(still - also, 0)
    if inside.sum() >= lacking > 0:
        at = f"{lam[inside].imag.mean() / (2 * np.pi):.5g} Hz"
        if lacking > explained:
            found.missing.append(
                f"{lacking - explained} modes are missing between {parameter} = {a.value:g} and {b.value:g} near {at}:"
                f" they are there at {more.value:g} alone"
            )
        else:
            found.warnings.append(
                f"onsets near {at} between {parameter} = {a.value:g} and {b.value:g} are not found: modes that do not"
                f" swing are known at {more.value:g} alone"
            )
    growing = [(n, s[n.unstable[s]]) for n, s in zip(group.nodes, group.members, strict=True)]
    for node, s in growing:
        if len(s) and (node.lam[s].imag <= below).any() and len(growing[0][1]) != len(growing[1][1]):
            found.warnings.append(
                f"a mode at {node.lam[s[0]].imag / (2 * np.pi):.5g} Hz is unstable at {parameter} = {node.value:g} and"
                " is not known on the other side: its onset is not found; ask for more modes or a finer sweep"
            )
