"""The critical value of a change of stability by bisection, where Newton's method fails."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ..eigen.dense import solve_dense
from ..eigen.pencil import Modes
from ..eigen.request import Request
from ..eigen.solve import solve_modes
from ..errors import NotConvergedError, SquealError
from .changes import Change
from .newton import lam_of
from .onset import Onset
from .step import Step, real_direction

_BISECTED = 1e-7  # of the step: width at which a bisection ends
_SPACINGS = 4  # of floats: a step that is hardly wider than these is not halved down to `_BISECTED`
_WITHIN = 0.5  # of a mode's energy: a mode with more than this in the span of a group's shapes belongs to the group
_FAST = 4.0  # times the highest frequency: growing modes are looked for up to this |λ|
_ASIDE = 1e-3  # of the step: distance from a bisected onset at which its growth rate is measured, at least
_SEEN = 16.0  # times its uncertainty: it is measured farther away, up to the limit, until it is above this
_PROPORTIONAL = 1.2  # exponent of growth beyond an onset: with a larger one it passes zero without a slope
_NEARER = 4.0  # times: growth is compared at two distances, which differ by so much
_ROOT = 0.375, 0.75  # exponents of growth between those of a fourth root, a square root and a line
_CLEAR = 4.0  # times its uncertainty: a growth rate above this is no rounding


@dataclass
class Bisection:
    """Bisects the changes of stability of one step.

    Attributes
    ----------
    step : Step
    """

    step: Step
    # Growing modes of the reduced model at some values, and up to which |λ| they are known.
    _known: dict[float, tuple[float, Modes]] = field(default_factory=dict, repr=False)

    def onset(self, change: Change, between: tuple[float, float] | None = None) -> Onset:
        """Return the onset by bisection, by the number of unstable modes of the group of a change.

        It is bisected between two values, the limits of the change unless they are given. How growth begins is measured
        up to the limits in any case.

        Raises
        ------
        NotConvergedError
            The numbers at the two values do not differ by what the change gains, or all its copies.
        """
        # A mode that is slow where it changes may grow as fast elsewhere as the slowest ones there are.
        step, highest = self.step, max(1.1 * self._highest(change), self._lowest())

        def unstable(p: float) -> Modes:
            growing = self._growing(p, highest)
            u, _ = step.shapes(growing)
            return growing.select(np.flatnonzero(share_within(change.group, u, step.model.mass) > _WITHIN))

        low, high = between or change.limits
        before, behind = unstable(low), unstable(high)
        far = behind if change.gains > 0 else before
        if len(behind) - len(before) not in (change.gains, change.gains * change.copies):
            raise NotConvergedError(
                f"{len(before)} modes are unstable at {low:.8g} and {len(behind)} at {high:.8g} of those that take part"
            )
        # What changes at the start mostly does so as soon as the parameter leaves it: a conservative system that is no
        # longer one. That is tried first.
        least = max(_BISECTED * self.step.width, _SPACINGS * float(np.spacing(max(abs(low), abs(high)))))
        at_start = change.at_start and abs(high - low) > least
        while abs(high - low) > least:
            middle = low + np.sign(high - low) * least if at_start else (low + high) / 2
            at_start = False
            found = unstable(middle)
            if (len(found) - len(before)) * np.sign(change.gains) > 0:
                high, behind = middle, found
            else:
                low, before = middle, found
        more = behind if change.gains > 0 else before
        # The mode that became unstable last is the unstable one that grows least. Its growth rate is measured at a
        # small distance from the onset, where it is larger than its rounding.
        last = int(np.argmin(more.lam.real))
        lam, growth, blur = complex(more.lam[last]), float(more.lam[last].real), float(more.re_uncertainty[last])
        value, into = (low + high) / 2, np.sign(change.gains) * np.sign(high - low)
        room = abs((change.limits[1] if change.gains > 0 else change.limits[0]) - value)
        if measured := self._beyond(unstable, value, into, room, lam):
            growing, aside, i = measured
        else:
            growing, aside, i, growth = more, abs(high - low), last, 0.0
        law = law_of(step, change)
        if change.kind == "crossing":
            law = _law_by_growth(growing, i, unstable(value + into * aside / _NEARER))
        if law == "parting":  # the mode grows on both sides
            growth, blur = 0.0, float(growing.re_uncertainty[i])
        # A mode counts as unstable only once Re λ exceeds its uncertainty, which is a little beyond the onset itself:
        # growth has begun before it. This power of it rises in proportion to the distance.
        power = 2 if law == "root" or change.kind in ("meeting", "zero") else 1
        rise = growing.lam[i].real ** power - growth**power
        slope = (rise if rise > 0 else growing.lam[i].real ** power) / aside
        speed = slope ** (1 / power)
        unseen = float((max(growth, blur) + blur) ** power / slope) + abs(high - low)
        if change.kind == "crossing":
            unseen = self._until_stable(change, value, lam, unseen, highest)
        # If no growth rate is clear, not even at the limit, the onset is anywhere between the limits, or nowhere.
        if not any((m.lam.real > _CLEAR * m.re_uncertainty).any() for m in (growing, more, far)):
            unseen = max(unseen, *(abs(limit - value) for limit in change.limits))
        if law == "parting":  # growth does not begin there, and its distance says nothing
            speed = np.nan
        speed *= 1 if law == "root" else np.sign(change.gains)  # dRe λ/dp falls, √|p − p_c| is positive on either side
        onset = onset_of(step, change, value, lam.imag, float(speed), unseen, law)
        projection = self._reduced(change, value, more)
        return replace(onset, exact=replace(onset, uncertainty=unseen + projection).numbers if projection else None)

    def _beyond(
        self, unstable: Callable[[float], Modes], value: float, into: float, room: float, lam: complex
    ) -> tuple[Modes, float, int] | None:  # fmt: skip
        """Return the growing modes beyond an onset, at which distance, and the place of the one that continues λ.

        The distance is the least one at which the growth rate of that mode is far above its uncertainty, within `room`.
        None if no modes are known to grow there, as none do in a very narrow window.
        """
        aside, found = min(_ASIDE * self.step.width, room), None
        while True:
            growing = unstable(value + into * aside)
            if len(growing):
                i = int(np.argmin(np.abs(growing.lam - lam)))
                lam, found = complex(growing.lam[i]), (growing, aside, i)
                if growing.lam[i].real > _SEEN * growing.re_uncertainty[i]:
                    break
            if aside >= room:
                break
            aside = min(_NEARER * aside, room)
        return found

    def _reduced(self, change: Change, value: float, more: Modes) -> float:
        """Return the error of a reduced model in an onset, from the modes `more` just beyond it.

        Where two θ meet, both modes become one, which is real. Where two λ meet on the imaginary axis, the mode is a
        travelling wave, and complex. The error of a modal projection may be wider than the step, and then nothing is
        known.
        """
        step = self.step
        if step.reduced_model is None or more.left is None:
            return 0.0
        i = int(np.argmin(more.lam.real))
        lam, right, left = complex(more.lam[i]), more.right[:, i], more.left[:, i]
        if change.kind == "meeting" and step.in_theta:
            lam = lam_of(-complex(lam**2).real)
            right, left = (real_direction(u[:, None]) for u in (right, left))
        affine = step.problem.is_affine(step.parameter)
        here = None if affine else step.beside(step.problem, value).at({step.parameter: 0.0})
        return step.reduced_model.root_error(value, lam, right, left, here, change.kind == "crossing")[0]

    def _until_stable(self, change: Change, value: float, lam: complex, unseen: float, highest: float) -> float:
        """Return how far on the stable side of an onset its mode decays for sure, and `unseen` at least.

        Where Re λ passes zero without a slope, as p³ does, it is lost in its uncertainty far longer than any slope
        beside the onset tells. The distance is doubled until the mode surely decays, up to a step's width beyond the
        end of the step, where this one may have begun because of that very doubt. Where growth rises no faster than in
        proportion, the slope has told: behind two λ that meet it is a root, and the stable side may be conservative.
        """
        into = np.sign(change.high - change.low) * np.sign(change.gains)  # towards where the mode grows
        width = self.step.width
        near, far = (self._nearest(value + into * part * width, lam, highest)[0] for part in (0.25, 1.0))
        if not far > 4**_PROPORTIONAL * near > 0:
            return unseen
        room = abs((min(self.step.ends) if into > 0 else max(self.step.ends)) - value) + width
        while 0 < unseen < room:
            growth, blur = self._nearest(value - into * unseen, lam, highest)
            if not growth >= -blur:
                break
            unseen = min(2 * unseen, room)
        return unseen

    def _nearest(self, p: float, lam: complex, highest: float) -> tuple[float, float]:
        """Return Re λ and its uncertainty, 1/s, of the mode nearest to a λ; NaN where a scene has no static state."""
        try:
            modes = self._solved_at(p, highest)
        except (SquealError, ValueError):
            return np.nan, np.nan
        if not len(modes):
            return np.nan, np.nan
        i = int(np.argmin(np.abs(modes.lam - lam)))
        return float(modes.lam[i].real), float(modes.re_uncertainty[i])

    def _growing(self, p: float, highest: float) -> Modes:
        """Return the growing modes of the problem at a value with Im λ up to a frequency, rad/s.

        Those of a reduced model are kept: changes of one step are bisected between the same values.
        """
        if known := self._known.get(p):
            reach, modes = known
        if not known or reach < _FAST * highest:
            modes = self._solved_at(p, highest, growing=True)
            modes = modes.select(np.flatnonzero(modes.stability == "unstable"))
            if self.step.reduced_model is not None:
                self._known[p] = self._reach(highest), modes
        lam = modes.lam
        return modes.select(np.flatnonzero((lam.imag <= highest) & (np.abs(lam) <= _FAST * highest)))

    def _solved_at(self, p: float, highest: float, growing: bool = False) -> Modes:
        """Return the modes of the problem at a value up to a frequency, rad/s, and perhaps the growing ones alone."""
        step = self.step
        pencil = step.pencil(p)
        if step.reduced_model is None:
            # What grows fast is among the modes of a band, however large |λ| is.
            request = Request(max_frequency_hz=highest / (2 * np.pi))
            return solve_modes(pencil, request, linear_solver=step.linear_solver)
        reach = self._reach(highest)  # the matrices of a reduced model are small and dense
        return solve_dense(pencil, reach, step.linear_solver, growing=reach / _FAST if growing else None)

    def _reach(self, highest: float) -> float:
        """Return up to which |λ|, rad/s, modes of a reduced model are solved for."""
        return _FAST * max(highest, *(float(np.abs(m.lam).max(initial=0.0)) for m in self.step.modes_at_ends))

    def _lowest(self) -> float:
        """Return the least |λ|, rad/s, at that end of the step where it is larger: a slow mode may grow as fast.

        Free motions do not count, which have λ = 0 at every value.
        """
        moving = (np.abs(m.lam[m.lam != 0]) for m in self.step.modes_at_ends)
        return max(float(size.min()) if len(size) else 0.0 for size in moving)

    def _highest(self, change: Change) -> float:
        lam = change.v if not self.step.in_theta else np.sqrt(-change.v + 0j)
        return max(abs(lam.imag), abs(lam.real)) or speed_of(self.step, change)


def onset_of(
    step: Step, change: Change, value: float, omega: float, speed: float, uncertainty: float, law: str | None = None
) -> Onset:
    """Return the onset of a change at a value, with the frequency ω, rad/s; a divergence where that is zero.

    Its law of growth is that of the change unless it is given.
    """
    kind = "flutter" if omega else "divergence"
    value = float(np.clip(value, min(step.ends), max(step.ends)))  # rounding may put it just beyond
    direction = "into" if change.gains >= 0 else "out of"
    law = law_of(step, change) if law is None else law
    return Onset(
        step.parameter, value, float(omega / (2 * np.pi)), kind, direction, float(speed), 0, None,
        float(uncertainty), law=law if np.isfinite(speed) or law == "parting" else "",
    )  # fmt: skip


def law_of(step: Step, change: Change) -> str:
    """Return by which law growth begins at a change, see `Onset.law`."""
    # Without dampers two θ that become a pair, or cease to be one, grow already where they are negative.
    real = change.kind == "meeting" and step.in_theta and -change.v.real > abs(change.v.imag)
    if real or change.kind == "parting":
        return "parting"
    return "linear" if change.kind == "crossing" else "root"


def _law_by_growth(far: Modes, i: int, near: Modes) -> str:
    """Return by which law mode i grows, from its growth at a distance and at `_NEARER` times less.

    Without damping, with gyroscopic forces or without, modes that cross the axis in truth meet there, and grow like a
    root. Growth that is lost in rounding, or is neither like a root nor in proportion, has no law: "".
    """
    if not len(near):
        return ""
    j = int(np.argmin(np.abs(near.lam - far.lam[i])))
    rates = np.array([far.lam[i].real, near.lam[j].real])
    blurs = np.array([far.re_uncertainty[i], near.re_uncertainty[j]])
    if not (rates > _CLEAR * blurs).all():
        return ""
    power = float(np.log(rates[0] / rates[1]) / np.log(_NEARER))
    if _ROOT[0] < power < _ROOT[1]:
        return "root"
    return "linear" if _ROOT[1] <= power <= _PROPORTIONAL else ""


def speed_of(step: Step, change: Change) -> float:
    """Return |λ| of the eigenvalue that changes, rad/s; where that is zero, the largest |λ| at the ends of the step."""
    size = abs(change.v) if step.model.is_damped and not step.in_theta else np.sqrt(abs(change.v))
    return float(size) or max(float(np.abs(m.lam).max(initial=0.0)) for m in step.modes_at_ends) or 1.0


def share_within(group: np.ndarray, u: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Return the share (k,) of the kinetic energy of each column of u (r, k) within the span of a group (r, m)."""
    if not u.shape[1]:
        return np.zeros(0)
    gram = group.conj().T @ (M @ group)
    cross = group.conj().T @ (M @ u)
    inside = np.einsum("ij,ij->j", cross.conj(), np.linalg.pinv(gram, hermitian=True) @ cross).real
    return np.asarray(inside / np.einsum("ij,ij->j", u.conj(), M @ u).real)
