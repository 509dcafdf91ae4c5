"""What is known of a band of frequencies of a pencil with C, found by discs around shifts that together cover it.

A shift iω sees the eigenvalues in a disc around it. Discs on the imaginary axis cover the band but for its lower end,
and hold no real decaying eigenvalue, of which strong dampers make any number. A disc around a positive real shift holds
what is near zero and what grows.
"""

from __future__ import annotations

import itertools
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import NotConvergedError
from .both_sides import pairs_within
from .disc import BLOCK
from .found_pairs import SAME, FoundPairs
from .free_modes import FreeModes
from .growth import may_grow, whirls
from .linear.factor import LinearSolver, SingularError
from .multiple import rounding_of_zero
from .pencil import Modes
from .shift import BEHIND, LIGHT, light_tilt, on_ray, on_slant
from .shift_invert import ShiftInverted
from .unsearched import ALL_SEARCHED, FAST_FLUTTER, GROWTH, Unsearched

_FULL = 40  # eigenvalues expected in a disc; a band with more of them is covered by several discs
_MOST = 2.5  # times the eigenvalues expected: as many are looked for in a disc, in addition to _FULL
_DISCS = 60  # largest number of discs in addition to twice those that a range is planned with
_RESTARTS = 12  # largest number of restarts of a Krylov space
_CLEAR, _MOVE, _MOVES = 1e-4, 1.03, 3  # a shift relatively closer to an eigenvalue is multiplied, at most thrice
_TILT = 0.15  # |Re λ| / Im λ up to which a disc reaches as far as it is meant to
_TOUCHING = 0.97  # of a shift: a disc with this radius holds no real eigenvalue
_OVERLAP = 1.02  # times the ends of a range: discs overlap by so much
_SLIVER = 1e-3  # of the band: creeping motions may crowd so near zero that no disc reaches farther down than this
_GROWING, _NARROW = 0.56, 0.8  # of a real λ: the shift around which growth up to it is looked for; of that: the radius
_SHOWN = 100.0  # a growing mode is found even if the random start has so many times less of it than of others
_SLOWEST = 1e-5  # of the highest frequency: slower growth is not looked for in a crowd
# Of a frequency: the real part, and the imaginary one, of a shift around which flutter up to it is looked for that
# grows faster than the discs on the imaginary axis reach; the radius; and where the next such disc begins. These discs
# reach the left half plane only where those on the axis cover it.
_ASLANT, _ASLANT_RADIUS, _ASLANT_NEXT = 0.535, 0.608, 0.2
_FAR = 8.0  # of a rate: growth up to here is looked for around one shift
_BLOCKS = 16  # searches, each with what is known taken out, where the first one in a disc has found nothing for sure
_FARTHER = 5  # such searches, each beyond the last one
_FEW = 40  # modes beside the known ones that are looked for in the whole band
# Of a frequency: where the ray of `LIGHT` leaves the circle around `BEHIND`, or around a shift a little
# larger, through i; and the shift and the radius of a disc with all that lies between this ray, the circle and i.
_LEAVES, _END, _END_RADIUS = 0.86, -0.1 + 0.95j, 0.12
# Of the shift of a disc below those on the imaginary axis: the radius, so that the ray of `LIGHT` leaves it in these.
_SLOW_RADIUS = 1.57
_NEAR = 0.01  # of a multiple eigenvalue: how far from it the shift lies that shows further copies


@dataclass
class KnownBand:
    """What is known of a band: eigenpairs, and the frequencies between which none is missing.

    Attributes
    ----------
    found : FoundPairs
        The eigenpairs, among them those that are known from the start.
    top, low : float, rad/s
        All eigenvalues between these are known once a range is covered; nothing is known below `low`.
    near : float, rad/s
        Down to there the discs on the imaginary axis reach.
    unsearched : Unsearched
        What was not looked for, but for what is below `low`.
    crowded : bool
        Overdamped modes are so many that only some of them are known.
    """

    found: FoundPairs
    free: FreeModes | None
    linear_solver: LinearSolver | str
    top: float = 0.0
    low: float = 0.0
    near: float = 0.0
    discs: int = 0
    crowded: bool = False
    method: str = ""
    unsearched: Unsearched = ALL_SEARCHED
    _modes: Modes | None = None
    _planned: int = 0  # discs that ranges so far were divided into
    _lit: list[tuple[float, float]] = field(default_factory=list)  # rad/s: where all modes up to `LIGHT` are known

    def cover(self, start: float, end: float, expected: int) -> None:
        """Find the eigenvalues with Im λ between two frequencies, rad/s, of which about so many are expected.

        Raises
        ------
        NotConvergedError
            If too many discs do not cover the range; `partial` has the modes found.
        """
        number = int(np.ceil(expected / _FULL))
        self._planned += number
        edges = np.linspace(start, end, number + 1)
        todo = [(a, b, expected / number) for a, b in itertools.pairwise(edges)][::-1]
        while todo:
            a, b, share = todo.pop()
            if self.discs >= _DISCS + 2 * self._planned:
                raise NotConvergedError(f"{len(self.found)} modes found, the range is still not covered", self.modes())
            known = len(self.found)
            low, high = self._around(a, b, share)
            if not low < high:
                if b > 2 * _SLIVER * max(self.top, end):
                    todo += [((a + b) / 2, b, share / 2), (a, (a + b) / 2, share / 2)]
                else:  # overdamped modes crowd at zero, and nothing that stands apart is nearer
                    self.near = max(self.near, b)
                continue
            density = (len(self.found) - known) / (high - low)
            if low <= b:
                self.top = max(self.top, high)
            if high < b:
                todo.append((max(high, a), b, density * (b - high)))
            if low > a and a > 0:
                todo.append((a, min(_OVERLAP * low, b), density * (low - a)))
            elif low > a:
                self.near = low

    def _around(self, a: float, b: float, expected: float) -> tuple[float, float]:
        """Add the eigenvalues in a disc around the middle of an interval; return where on the axis they are all."""
        omega, half = (a + b) / 2, _OVERLAP * (b - a) / 2
        radius = float(np.hypot(half, _TILT * b))
        if radius > _TOUCHING * omega:
            omega = _OVERLAP * b / on_ray(1.0, _TOUCHING, _TILT)[1]
            radius = _TOUCHING * omega
        sigma, known = self._disc(1j * omega, radius, expected)
        self._lit.append(on_ray(abs(sigma), known, LIGHT))
        near = self.found.lam[np.abs(self.found.lam - sigma) <= known]
        return on_ray(abs(sigma), known, light_tilt(near))

    def add_rest(self, top: float) -> None:
        """Add what else is near: all eigenvalues around zero, and those that grow, up to a frequency, rad/s.

        A disc around a positive real shift holds the band on both sides of the real axis, and what grows or decays
        there. The modes that are known already are taken out, so that it is empty unless modes are overdamped.
        Where these are many, smaller discs look near zero and for what grows.
        """
        if self.add_beside(top):
            self.add_end(top)
            self.add_far(top)
            return
        self.crowded = True
        self.add_slow(top)
        self.add_aslant(top)
        if self.add_growing(_FAR * top, _SLOWEST * top):
            self.add_far(_FAR * top, searched=True)

    def add_end(self, top: float) -> None:
        """Add modes up to `LIGHT` just below a frequency, rad/s, where `add_beside` does not reach.

        Discs that cover many modes are narrow, and reach as far from the axis as the modes found there do.

        Raises
        ------
        NotConvergedError
            If there is no end of them; `partial` has the modes found.
        """
        if self._is_lit(_LEAVES * top, top):
            return
        sigma, known = self._emptied(_END * top, _END_RADIUS * top)
        corners = top * np.array([1j, 1j - LIGHT, _LEAVES * (1j - LIGHT)])  # of a triangle with all that is looked for
        if known < np.abs(corners - sigma).max():
            self.unsearched = self.unsearched.joined(Unsearched(damped=True))

    def _is_lit(self, low: float, high: float) -> bool:
        """Return whether all modes up to `LIGHT` are known between two frequencies, rad/s."""
        for begin, end in sorted(self._lit):
            if begin <= low:
                low = max(low, end)
        return low >= high

    def add_aslant(self, top: float) -> None:
        """Add flutter that grows too fast for the discs on the imaginary axis.

        The crowd of overdamped modes lies on the other side of that axis, so that discs in the right half plane leave
        it out. They go down as far as those on the axis do; what grows faster than it swings is left to `add_growing`.
        Where one disc on the axis ends and the next begins they are narrow, and damped modes there are left out.

        Raises
        ------
        NotConvergedError
            If there is no end of it; `partial` has the modes found.
        """
        if self._lit and not self._is_lit(self.low, top):
            self.unsearched = self.unsearched.joined(Unsearched(damped=True))
        high = top
        while high > max(self.near, _SLIVER * top):
            _, known = self._emptied(_ASLANT * high * (1 + 1j), _ASLANT_RADIUS * high)
            if known < _ASLANT_RADIUS * high * (1 - _CLEAR):
                self._leave_out(FAST_FLUTTER)
                return
            high *= _OVERLAP * _ASLANT_NEXT

    def add_growing(self, high: float, low: float) -> bool:
        """Add what grows between two rates, rad/s, and swings far more slowly; return whether that is all.

        Raises
        ------
        NotConvergedError
            If there is no end of it; `partial` has the modes found.
        """
        while high > low:
            before, shift, radius = len(self.found), _GROWING * high, _NARROW * _GROWING * high
            sigma, known = self._disc(shift, radius, 0, growing=True)
            self.add_copies(high, (sigma, known))
            if known < radius and len(self.found) == before:
                # Of equal ones rounding may show more and more copies, of which none converges before the next one is
                # there. With one block after the other taken out it does; a crowd is left to what is told.
                with suppress(NotConvergedError):
                    sigma, known = self._emptied(shift, radius, True, _BLOCKS)
            if known < _NARROW * abs(sigma) * (1 - _CLEAR):
                self._leave_out(GROWTH)
                return False
            high *= _OVERLAP * _GROWING * (1 - _NARROW)
        return True

    def add_far(self, rate: float, searched: bool = False) -> None:
        """Add what grows faster than a rate, rad/s, however fast, and swings more slowly.

        That the symmetric parts of the matrices allow no such growth is what is usual, and costs two real symmetric
        factorisations; without C one. Large gyroscopic terms may let flutter grow in spite of that: with these a disc
        is searched in any case.

        Parameters
        ----------
        searched : bool
            Whether what gyroscopic terms may do was looked for already.
        """
        always = not searched and whirls(self.found.pencil, rate)
        for _ in range(_FARTHER):
            grows = may_grow(self.found.pencil, rate, self.linear_solver)
            if grows is not False or always:
                if not self.add_growing(_FAR * rate, rate):
                    return
                rate, always = _FAR * rate, False
            if grows is None:
                break
            if not grows:
                return
        self.unsearched = self.unsearched.joined(Unsearched(rate=rate))

    def add_slow(self, top: float) -> None:
        """Add modes below the discs on the imaginary axis, down to zero unless overdamped modes crowd there.

        Raises
        ------
        NotConvergedError
            If there is no end of them; `partial` has the modes found.
        """
        while self.near > _SLIVER * top:
            reach = _OVERLAP * self.near
            sigma, known = self._disc(reach, _SLOW_RADIUS * reach, 0)
            self.add_copies(reach, (sigma, known))
            if known >= np.hypot(abs(sigma), reach):
                self._lit.append((0.0, on_slant(abs(sigma), known, LIGHT)))
                return
            low, high = self._around(0.0, reach, 0)
            self.add_copies(reach)
            if not low < min(high, self.near / 2):
                break
            self.near = low
        self.low = _OVERLAP * self.near  # the ray of `LIGHT` enters the lowest disc a little above

    def add_copies(self, top: float, disc: tuple[complex, float] | None = None) -> None:
        """Add further copies of those multiple eigenvalues up to a frequency, rad/s, that fill a block of vectors.

        With the centre and the radius of a disc these are those in it alone. They are looked for from so near that
        hardly anything else is in sight, with the known copies taken out.

        Raises
        ------
        NotConvergedError
            If there is no end of them; `partial` has the modes found.
        """
        values = self.found.lam[is_light(self.found.lam) & (self.found.lam.imag <= top)]
        if disc is not None:
            values = values[np.abs(values - disc[0]) <= disc[1]]
        while len(values):
            value = values[0]
            same = np.abs(values - value) <= SAME * np.abs(value)
            values, found = values[~same], np.count_nonzero(same)
            for _ in range(_DISCS):
                if found < BLOCK:
                    break
                before = len(self.found)
                self._disc(value * (1 + _NEAR), 2 * _NEAR * abs(value), None)
                found = BLOCK * np.count_nonzero(np.abs(self.found.lam[before:] - value) <= SAME * np.abs(value))
            else:
                number = len(self.found)
                raise NotConvergedError(f"there are more than {number} modes, many of them equal", self.modes())

    def add_beside(self, top: float) -> bool:
        """Add what is beside the known modes in a disc that reaches up to i·top, and return whether that is all.

        What it cannot part is a crowd of overdamped modes.

        Raises
        ------
        NotConvergedError
            If there is no end of them; `partial` has the modes found.
        """
        sigma, known = self._emptied(BEHIND * top, float(np.hypot(BEHIND, 1.0)) * top)
        if sigma != BEHIND * top:  # it was moved away from an eigenvalue, and farther from i·top
            sigma, known = self._emptied(sigma, float(np.hypot(abs(sigma), top)))
        if known < (1 - _CLEAR) * np.hypot(abs(sigma), top):
            return False
        self._lit.append((0.0, on_slant(abs(sigma), known, LIGHT)))
        return True

    def _emptied(
        self, sigma: complex, radius: float, growing: bool = False, rounds: int = _DISCS
    ) -> tuple[complex, float]:  # fmt: skip
        """Add what is beside the known modes in a disc; return its centre, and the radius inside which all are known.

        A Krylov space of blocks holds as many copies of a multiple eigenvalue as a block has vectors, and does not show
        that there are more; nor does it look for more than `_FEW`. With those found taken out it shows the next ones.
        So the search goes on until it finds no mode that has to be found.

        Raises
        ------
        NotConvergedError
            If there is no end of them after so many rounds; `partial` has the modes found.
        """
        for _ in range(rounds):
            before = len(self.found)
            centre, known = self._disc(sigma, radius, None, growing)
            if not is_light(self.found.lam[before:]).any():
                return centre, known
        raise NotConvergedError(f"{len(self.found)} modes found, and there are still others beside them", self.modes())

    def _disc(
        self, sigma: complex, radius: float, expected: float | None, growing: bool = False
    ) -> tuple[complex, float]:
        """Add the eigenvalues in a disc, and return its centre and the radius inside which all are known.

        Parameters
        ----------
        expected : float or None
            How many there are, about; None where few are beside the known ones, which are taken out.
        growing : bool
            Whether only what grows counts.
        """
        most, out, restarts, draw, needed, least = _FEW, None, 0, 0, None, 0
        if expected is None:
            out, draw, needed = self.found.states(), len(self.found), is_light
        else:
            most, restarts = int(_MOST * expected) + _FULL, _RESTARTS
        if growing:
            least = BLOCK * enough_steps(self.found.pencil.n, radius / abs(sigma))
        for _ in range(_MOVES):
            self.discs += 1
            try:
                operator = ShiftInverted(self.found.pencil, sigma, self.free, self.linear_solver, out)
                lam, right, left, known = pairs_within(operator, radius, most, restarts, draw, needed, least)
            except SingularError:
                sigma *= _MOVE
                continue
            if np.abs(lam - sigma).min(initial=np.inf) < _CLEAR * abs(sigma):
                sigma *= _MOVE
                continue
            self.method = self.method or f"block Krylov-Schur in discs, {operator.linear_solver.name}"
            if growing:
                here = lam.real > rounding_of_zero(self.found.pencil, lam, right)
                lam, right, left = lam[here], right[:, here], left[:, here]
            if len(lam):
                self._modes = None
            self.found.add(lam, right, left, out is None)
            return sigma, known
        return sigma, 0.0

    def _leave_out(self, kind: str) -> None:
        """Note a kind of modes that is not looked for everywhere."""
        self.unsearched = self.unsearched.joined(Unsearched((kind,)))

    def modes(self) -> Modes:
        """Return the modes found, those of free motions among them."""
        if self._modes is None:
            self._modes = self.found.modes(self.free)
        unsearched = self.unsearched.joined(Unsearched(low=float(self.low)))  # which may have grown since
        return replace(self._modes, method=self.method, unsearched=unsearched)


def is_light(lam: np.ndarray) -> np.ndarray:
    """Return (k,) bool, which of the upper half plane's eigenvalues lam (k,) grow or swing with light damping."""
    return np.asarray((lam.imag >= 0) & (lam.real > -LIGHT * lam.imag))


def enough_steps(n: int, radius: float) -> int:
    """Return how many products show an eigenvalue in a disc around a real shift 1 with a radius below 1.

    The operator has the eigenvalues 1/(λ − 1). Those of all λ with Re λ ≤ 0 lie in a circle around −1/2 with radius
    1/2; those of λ in the disc are at least 1/radius − 1/2 away from the centre of this circle. With each product the
    share of a mode in the disc rises against the others by the ratio of these distances. A random start of 2n numbers
    has √(2n) times as much of all others together as of that one mode.
    """
    return int(np.ceil(np.log(_SHOWN * np.sqrt(2 * n)) / np.log(2 / radius - 1)))
