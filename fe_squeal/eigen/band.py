"""Oscillating modes of a damped pencil in a band of frequencies, from complex shifts that together cover it.

A shift iω sees the eigenvalues in a disc around it. A disc that touches the origin holds the band up to 2ω and no real
decaying eigenvalue, of which strong dampers make any number close to a real shift. Where a disc with so many
eigenvalues would be too large, several cover the band, each with the part of it that it is sure of.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from scipy.optimize import linear_sum_assignment

from ..errors import NotConvergedError
from .arpack import method_of, quadratic_pairs
from .free_modes import FreeModes
from .inertia import count_below
from .linear.choice import factorize
from .linear.factor import LinearSolver, SingularError
from .multiple import rounding_of_zero
from .pencil import Modes, Pencil
from .quality import in_upper_half, modes_from_lambda
from .request import Request, is_beside, select_wanted
from .shift import light_tilt, symmetric_part
from .shift_invert import ShiftInverted

_FULL = 150  # largest number of eigenvalues in a disc; a disc that holds more is replaced by several smaller ones
_SPARE = 1.15  # so many times the number of eigenvalues expected in a disc are asked for
_DISCS = 24  # largest number of discs
_RESTARTS = 12  # largest number of restarts of a Krylov space; a usual disc takes two to four
_FEWER = 0.9  # if not all eigenvalues converge, this part of the number that did is asked for in a second try
_CLEAR, _MOVE, _MOVES = 1e-4, 1.03, 3  # a shift relatively closer to an eigenvalue is multiplied, at most thrice
_OVERLAP = 1.2  # times the lower end of a disc: the next one below reaches up to here, since discs have no sharp rim
_SLIVER = 1e-3  # part of the band: creeping motions may crowd so near zero that no disc reaches farther down than this
_ROUNDING = 1e-12  # what rounding may leave of zero, relative to |λ| or to the largest ratio of stiffness to mass
_REAL, _NEAR = 8, 0.05  # real growth is looked for among 8 eigenvalues around a shift at this part of the band


@dataclass
class _Band:
    """What is known of a band: eigenpairs, and the frequencies between which none is missing."""

    pencil: Pencil
    free: FreeModes | None
    linear_solver: LinearSolver | str
    lam: np.ndarray = field(default_factory=lambda: np.zeros(0, complex))
    right: np.ndarray | None = None
    left: np.ndarray | None = None
    top: float = 0.0  # rad/s: all eigenvalues up to here are known once a range is covered
    low: float = 0.0  # rad/s: nothing is known below
    discs: int = 0
    thin: bool = False  # only what lies near the imaginary axis is known in some part
    every: bool = False  # all eigenvalues of the pencil were found at once
    method: str = ""

    def cover(self, start: float, end: float, expected: int) -> None:
        """Find the eigenvalues with Im λ between two frequencies, rad/s, of which about so many are expected."""
        parts = np.linspace(start, end, int(np.ceil(expected / _FULL)) + 1)
        todo = [(a, b, min(expected, _FULL)) for a, b in itertools.pairwise(parts)][::-1]
        while todo and not self.every:
            a, b, number = todo.pop()
            if self.discs >= _DISCS:
                raise NotConvergedError(f"{len(self.lam)} modes found, the range is still not covered", self.modes())
            known = len(self.lam)
            low, high = self._disc(a, b, int(_SPARE * number) + 4)
            if not low < high and not a:  # creeping motions crowd at zero, and nothing that stands apart is nearer
                self.low = b
                continue
            if not low < high:
                todo += [((a + b) / 2, b, _some(number / 2)), (a, (a + b) / 2, _some(number / 2))]
                continue
            density = (len(self.lam) - known) / (high - low)
            if low <= b:
                self.top = max(self.top, high)
            if high < b:
                todo.append((max(high, a), b, _some(density * (b - high))))
            if low > max(a, _SLIVER * end):
                todo.append((a, min(_OVERLAP * low, b), _some(density * (low - a))))
            elif low > a:
                self.low = low

    def _disc(self, a: float, b: float, number: int) -> tuple[float, float]:
        """Add the eigenvalues around the middle of an interval; return between which frequencies they are all."""
        sigma = 0.5j * (a + b)
        for _ in range(_MOVES):
            self.discs += 1
            try:
                operator = ShiftInverted(self.pencil, sigma, self.free, self.linear_solver)
                found = self._nearest(operator, number)
            except SingularError:
                sigma *= _MOVE
                continue
            if found is None:
                break
            lam, right, left, radius = found
            if np.abs(lam - sigma).min(initial=np.inf) < _CLEAR * abs(sigma):
                sigma *= _MOVE
                continue
            self.method, self.every = method_of(operator), not np.isfinite(radius)
            self._add(lam, right, left)
            whole = _on_ray(abs(sigma), radius, light_tilt(lam))
            if whole[0] < whole[1]:
                return whole
            self.thin = True
            return _on_ray(abs(sigma), radius, 0.0)
        return abs(sigma), abs(sigma)

    def _nearest(
        self, operator: ShiftInverted, count: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, float] | None:
        """Return the eigenvalues nearest the shift, their vectors, and the radius they fill.

        Where many eigenvalues lie at the same distance a Krylov space does not part them: fewer are then asked for.
        None where not even a few converge.
        """
        while True:
            count = min(count, operator.most)
            try:
                lam, right, left, every = quadratic_pairs(operator, count, _RESTARTS)
                return lam, right, left, np.inf if every else float(np.abs(lam - operator.sigma).max(initial=0.0))
            except NotConvergedError as error:
                converged = len(error.partial) if isinstance(error.partial, np.ndarray) else 0
                count = min(max(int(_FEWER * converged), count // 3), count - 1)
                if not count:
                    return None

    def _add(self, lam: np.ndarray, right: np.ndarray, left: np.ndarray) -> None:
        """Add eigenpairs that are not known yet."""
        lam = np.where(np.abs(lam.imag) <= _ROUNDING * np.abs(lam), lam.real, lam)
        if self.right is None or self.left is None:
            self.lam, self.right, self.left = lam, right, left
            return
        new = np.ones(len(lam), bool)
        if len(self.lam) and len(lam):
            # Every known eigenvalue accounts for one of the new ones, so that a multiple one keeps its number.
            apart = np.abs(self.lam[:, None] - lam[None, :])
            near = apart <= 1e-7 * np.abs(lam)[None, :]
            i, j = linear_sum_assignment(np.where(near, apart, 1e3 * np.abs(lam).max()))
            new[j[near[i, j]]] = False
        self.lam = np.concatenate([self.lam, lam[new]])
        self.right = np.hstack([self.right, right[:, new]])
        self.left = np.hstack([self.left, left[:, new]])

    def modes(self) -> Modes:
        """Return the modes found, those of free motions among them."""
        n = self.pencil.n
        lam = self.lam
        right, left = (np.zeros((n, 0)) if u is None else u for u in (self.right, self.left))
        upper = in_upper_half(self.pencil, lam)
        lam, right, left = lam[upper], right[:, upper], left[:, upper]
        if self.free is not None:
            lam, right, left = self.free.beside(lam, right, left)
        method = self.method
        if self.low:
            method += f", above {self.low / (2 * np.pi):.3g} Hz"
        if self.thin:
            method += ", near the imaginary axis"
        return modes_from_lambda(self.pencil, lam, right, left, method)


def _some(expected: float) -> int:
    """Return how many eigenvalues to ask for if about `expected` are expected."""
    return int(np.ceil(1.1 * expected)) + 5


def band_modes(
    pencil: Pencil, request: Request, band: float, free: FreeModes | None, linear_solver: LinearSolver | str
) -> Modes:
    """Return the wanted modes of a real pencil with C: oscillating ones, and real ones that do not decay.

    Heavily damped modes, and real decaying ones, are found only if they happen to lie in a disc.

    Parameters
    ----------
    band : float, rad/s
        Approximate frequency at which the wanted modes end.

    Raises
    ------
    NotConvergedError
        If the range is not covered; `partial` has the modes found.
    """
    known, count = _Band(pencil, free, linear_solver), request.count
    if request.max_frequency_hz is not None:
        band = 2 * np.pi * request.max_frequency_hz * (1 + _CLEAR)
    expected = count_below(symmetric_part(pencil), band, linear_solver) if count is None else count
    known.cover(0.0, band, expected or 20)
    while True:
        modes, top = known.modes(), max(known.top, band)
        wanted = select_wanted(modes, request, np.inf if known.every else top)
        if wanted is not None:
            break
        inside = np.sort(modes.lam.imag[(modes.lam.imag <= top) & ~is_beside(modes)])
        missing = max((count or 0) - len(inside), 1)
        upper = inside[inside > 0.5 * top]
        density = max(len(upper), 1) / (0.5 * top)
        band = top + float(np.clip(1.3 * (missing + 2) / density, 0.05 * top, top))
        known.cover(top, band, missing + 4)
    if not known.every:
        _add_growing(known, float(np.abs(wanted.lam).max(initial=0.0)) or top)
        modes = known.modes()
        wanted = select_wanted(modes, request, top)
        if wanted is None:
            raise NotConvergedError("beside real eigenvalues that grow the others are too uncertain to be told", modes)
    return wanted


def _on_ray(omega: float, radius: float, tilt: float) -> tuple[float, float]:
    """Return the two Im λ between which the rays Re λ = ∓tilt · Im λ lie in a disc around iω; equal if they miss it.

    On these |λ − iω|² = (1 + tilt²)(Im λ)² − 2ω Im λ + ω².
    """
    if not np.isfinite(radius):
        return 0.0, np.inf
    a = 1 + tilt**2
    root = omega**2 - a * (omega**2 - radius**2)
    if root < 0:
        return omega, omega
    return max((omega - np.sqrt(root)) / a, 0.0), float((omega + np.sqrt(root)) / a)


def _add_growing(band: _Band, top: float) -> None:
    """Add real eigenvalues λ > 0 up to `top`.

    For real λ > 0 and its real vector x, λ²xᵀMx + λxᵀCx + xᵀKx = 0 needs xᵀKx < 0 or xᵀCx < 0. So there is none where
    the symmetric parts of K and C are positive semidefinite. Otherwise a few eigenvalues around
    a small positive shift are looked at, since a divergence begins at zero; where none converges, `method` says so.
    Those that rounding makes of zero are left out: the motions of a free body are known.
    """
    pencil = band.pencil
    assert pencil.C is not None
    if all(_is_positive(A, pencil.M, band.linear_solver) for A in (pencil.K, pencil.C)):
        return
    operator = ShiftInverted(pencil, _NEAR * top, band.free, band.linear_solver)
    found = band._nearest(operator, _REAL)
    if found is None:
        band.method += ", without a search for real eigenvalues that grow"
        return
    lam, right, left, _ = found
    growing = (lam.real > rounding_of_zero(pencil, lam, right)) & (np.abs(lam.imag) <= 1e-6 * np.abs(lam))
    band._add(lam[growing], right[:, growing], left[:, growing])


def _is_positive(A: sp.csr_array, M: sp.csr_array, linear_solver: LinearSolver | str) -> bool:
    """Whether the symmetric part of A is positive semidefinite but for rounding, by its inertia."""
    mass, size = M.diagonal(), np.abs(A.diagonal())
    both = (mass > 0) & (size > 0)
    shift = _ROUNDING * float((size[both] / mass[both]).max()) if both.any() else 0.0
    symmetric = A if (A != A.T).nnz == 0 else (A + A.T) / 2
    try:
        return factorize(sp.csr_array(symmetric + shift * M), True, linear_solver).negative_pivots == 0
    except NotConvergedError:
        return False
