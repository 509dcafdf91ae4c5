"""The lowest modes of a pencil, by the cheapest solver that its class allows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..errors import NotConvergedError
from .arpack import nonsymmetric_modes, quadratic_modes, symmetric_modes
from .dense import DENSE_LIMIT, LAPACK, solve_dense
from .free_modes import FreeModes, split_off
from .inertia import count_below, finite_below
from .kernel import kernel_within
from .linear_solvers import SingularError
from .pencil import FreeMotions, Modes, Pencil, is_mirror
from .shift_invert import ShiftInverted

# Of the largest ratio of diagonal stiffness to mass: far below any elastic mode, far above rounding.
_RIGID_SHIFT = 1e-9
_PENALTY = 1e6  # times the median of these ratios: larger ones stand for infinity
_LIGHT = 0.2  # damping ratio up to which all modes of a damped problem are found, beyond it the nearer ones alone
# Relative distance of the shift from an eigenvalue, below which rounding of its huge 1/(θ − σ) costs the others digits;
# the shift is then moved by a factor, some times at most.
_CLEAR, _MOVE, _MOVES = 1e-4, 1.15, 3
_BELOW = 0.05  # of the band: how far below zero the shift lies, in frequency


@dataclass(frozen=True)
class Request:
    """Which modes are wanted: the `count` lowest, or all up to a frequency.

    Attributes
    ----------
    count : int or None
    max_frequency_hz : float or None
    tolerance : float
        Largest backward error accepted.
    """

    count: int | None = None
    max_frequency_hz: float | None = None
    tolerance: float = 1e-8


@dataclass(frozen=True)
class Completeness:
    """How many of the wanted modes were found, how many there are, and whether that number is proven."""

    found: int
    expected: int | None
    proven: bool

    def without(self, count: int) -> Completeness:
        """Return the same for fewer modes."""
        return Completeness(self.found - count, None if self.expected is None else self.expected - count, self.proven)


def solve_modes(pencil: Pencil, request: Request, band: float | None = None) -> Modes:
    """Return the wanted modes, sorted by Im λ; conjugate pairs are not cut apart.

    Parameters
    ----------
    band : float, rad/s, optional
        About where the wanted modes end (from a neighbouring solve); places the shift.

    Raises
    ------
    NotConvergedError
        If a wanted mode misses the tolerance; `partial` has the modes.

    Examples
    --------
    >>> K = sp.diags_array(np.arange(1.0, 1001.0)).tocsr()
    >>> modes = solve_modes(Pencil(sp.eye_array(1000, format="csr"), K, symmetric=True), Request(count=3))
    >>> np.round(modes.lam.imag**2, 9)
    array([1., 2., 3.])
    """
    if pencil.n <= DENSE_LIMIT:
        modes = select_wanted(solve_dense(pencil), request, np.inf)
        assert modes is not None
    else:
        modes = _solve_sparse(pencil, request, band)
    worst = modes.backward_error.max(initial=0.0)
    if not worst <= request.tolerance:
        raise NotConvergedError(
            f"backward error {worst:.2g} of a mode exceeds the tolerance {request.tolerance:.2g}", partial=modes
        )
    return modes


def prove_completeness(pencil: Pencil, modes: Modes) -> Completeness:
    """Count the modes up to the highest one found by the inertia just above it (symmetric pencils).

    A θ < 0 that is missing counts as one mode here, although it makes two.

    Returns
    -------
    Completeness
        proven False where the class or the solver gives no count.
    """
    found = len(modes)
    if modes.method == LAPACK:
        return Completeness(found, found, True)
    if pencil.problem_class != "symmetric" or not found:
        return Completeness(found, None, False)
    # Of a divergence there are the two modes ±λ of one θ < 0.
    omega = np.sort(modes.lam.imag[modes.lam.real <= 0])
    # Count in the highest clear gap between two modes, so that no multiple eigenvalue is cut.
    gaps = np.flatnonzero(np.diff(omega) > 1e-5 * omega[1:])
    if not len(gaps):
        return Completeness(found, None, False)
    below = int(gaps[-1]) + 1
    counted = count_below(pencil, float(omega[below - 1] + omega[below]) / 2)
    if counted is None:
        return Completeness(found, None, False)
    return Completeness(found, found - below + counted, counted == below)


def _solve_sparse(pencil: Pencil, request: Request, band: float | None) -> Modes:
    count = request.count or 0
    if request.max_frequency_hz is not None:
        band = 2 * np.pi * request.max_frequency_hz
        # Friction and damping change the number of modes in a band by a few at most: start from the symmetric part's.
        below = count_below(symmetric_part(pencil), band)
        count = below if below is not None else 20
    sought = count + max(4, count // 10)
    if pencil.C is not None:
        # A real positive shift sees both half planes alike, and no mode is near it. In the middle of the band it takes
        # a quarter less solves than at the top, and costs the upper modes no accuracy.
        sigma = (band or _undamped_band(pencil, request)) / 2
    else:
        # Just below zero: the eigenvalues nearest are then all those of |θ| up to a limit, flutter and divergence too.
        sigma = -((_BELOW * band) ** 2) if band is not None else -_RIGID_SHIFT * _largest_ratio(pencil)
    moves, free = 0, split_off(pencil)
    operator, divergent = _shifted(pencil, sigma, free)
    while True:
        sought = min(sought, operator.most)
        try:
            if pencil.C is not None:
                modes, every = quadratic_modes(pencil, operator, sought, free)
            elif pencil.problem_class == "symmetric":
                modes, every = symmetric_modes(pencil, operator, sought, divergent, free)
            else:
                modes, every = nonsymmetric_modes(pencil, operator, sought, free)
        except SingularError:
            if moves == _MOVES:
                raise
            moves += 1
            operator, divergent = _shifted(pencil, operator.sigma * _MOVE, free)
            continue
        if moves < _MOVES and _nearest(pencil, modes, operator.sigma) < _CLEAR * abs(operator.sigma):
            moves += 1
            operator, divergent = _shifted(pencil, operator.sigma * _MOVE, free)
            continue
        sigma = operator.sigma
        radius = np.inf if every else _known_radius(pencil, modes, sigma)
        wanted = select_wanted(modes, request, radius)
        if wanted is not None:
            return wanted
        if sought == operator.most:
            raise NotConvergedError(f"{len(modes)} modes found, the wanted range is still not covered", partial=modes)
        limit = band or float(modes.lam.imag.max(initial=0.0))
        growth = (limit / radius) ** 1.5 if 0 < radius < limit else 1.4
        sought = int(np.clip(growth, 1.2, 3.0) * sought) + 4


def _shifted(pencil: Pencil, sigma: float, free: FreeModes | None) -> tuple[ShiftInverted, int]:
    """Return the shift-inverted operator at a shift, or beside it where that is an eigenvalue; θ below it (symmetric).
    """
    for _ in range(_MOVES):
        try:
            operator = ShiftInverted(pencil, sigma, free)
            break
        except SingularError:
            sigma *= _MOVE
    else:
        operator = ShiftInverted(pencil, sigma, free)
    divergent = 0
    if pencil.problem_class == "symmetric":
        divergent = finite_below(pencil, operator.negative_pivots) or 0
    return operator, divergent


def _nearest(pencil: Pencil, modes: Modes, sigma: float) -> float:
    """Return the distance of the shift from the nearest θ, with C from the nearest λ."""
    values = modes.lam if pencil.C is not None else -(modes.lam**2)
    return float(np.abs(values - sigma).min(initial=np.inf))


def _known_radius(pencil: Pencil, modes: Modes, sigma: float) -> float:
    """Return the |λ| (undamped), or Im λ (damped), up to which all modes are among those nearest sigma.

    With damping it is Im λ along the ray Re λ = −tilt Im λ: of the most damped modes where K is complex, which damps
    all, else of the lightly damped ones and of the partners of growing ones, as far to the left as these to the right.
    """
    if not len(modes):
        return 0.0
    tilt = _tilt(pencil, modes) if pencil.is_complex else _light(modes) if pencil.C is not None else 0.0
    if pencil.C is not None:
        # |λ − σ| on the ray: (1 + tilt²) Im² + 2 tilt σ Im + σ² = reach².
        a, b, c = 1 + tilt**2, tilt * sigma, np.abs(modes.lam - sigma).max() ** 2 - sigma**2
        return float((np.sqrt(b**2 + a * max(c, 0.0)) - b) / a)
    # All divergent modes of a symmetric pencil are known, however far they are.
    near = modes.lam[modes.lam.real == 0] if pencil.problem_class == "symmetric" else modes.lam
    reach = np.abs(near**2 + sigma).max(initial=0.0)
    return float(np.sqrt(max(reach - abs(sigma), 0.0) / (1 + tilt**2)))


def _tilt(pencil: Pencil, modes: Modes) -> float:
    """Return the largest −Re λ / Im λ of the modes found, or that by the largest loss angle: arg λ − π/2 is half of it.

    Above one there is no law.
    """
    damped = modes.select(np.flatnonzero(~is_beside(modes) & (modes.lam.imag > 0))).lam
    by_loss = np.tan(np.clip(np.angle(pencil.K.diagonal()), 0.0, np.pi / 2) / 2)
    return float(np.max(np.append(-damped.real / damped.imag, by_loss)))


def _light(modes: Modes) -> float:
    """Return the largest |Re λ| / Im λ of growing and lightly damped modes."""
    oscillating = modes.lam[modes.lam.imag > 0]
    ratio = oscillating.real / oscillating.imag
    return float(np.abs(ratio[ratio > -_LIGHT]).max(initial=0.0))


def select_wanted(modes: Modes, request: Request, radius: float) -> Modes | None:
    """Return the modes asked for, or None if they reach beyond the radius (rad/s) inside which all are known."""
    omega = modes.lam.imag
    if request.max_frequency_hz is not None:
        limit = 2 * np.pi * request.max_frequency_hz
        return modes.select(np.flatnonzero(omega <= limit)) if radius > limit else None
    count = wanted_count(modes, request)
    if np.count_nonzero(~is_beside(modes)) < (request.count or 0) and np.isfinite(radius):
        return None
    if count and omega[count - 1] > radius:
        return None
    return modes.select(np.arange(count))


def wanted_count(modes: Modes, request: Request) -> int:
    """Return how many of the modes, lowest first, were asked for.

    Real eigenvalues, and those near them for which a complex stiffness has no law, come besides: in a heavily damped
    problem they would crowd out every oscillating mode. A pair λ, −λ* is not cut apart.
    """
    if request.max_frequency_hz is not None:
        return int(np.count_nonzero(modes.frequency_hz <= request.max_frequency_hz))
    beside, omega = is_beside(modes), modes.lam.imag
    counted = np.flatnonzero(~beside)[: request.count or 0]
    count = len(counted) + int((beside & (omega <= omega[counted].max(initial=0.0))).sum())
    return count + int(0 < count < len(modes) and is_mirror(modes.lam[count - 1], modes.lam[count]))


def is_beside(modes: Modes) -> np.ndarray:
    """Return which modes (m,) bool come besides those that are counted: real, or so uncertain that they may be."""
    lam = modes.lam
    return np.asarray((lam != 0) & ((lam.imag == 0) | (modes.re_uncertainty >= np.abs(lam))))


def symmetric_part(pencil: Pencil) -> Pencil:
    """Return the pencil without damping, its K made symmetric.

    The equation of an unknown without mass may stand there with either sign: with the one that a multiplier's
    constraint has in [[K, −Bᵀ], [B, 0]], nothing of it would be left.
    """
    if pencil.problem_class == "symmetric":
        return pencil
    K = pencil.K.real
    turned = (pencil.M.diagonal() == 0) & (np.asarray(K.multiply(K.T).sum(axis=1)) < 0)
    if turned.any():
        K = sp.csr_array(sp.diags_array(np.where(turned, -1.0, 1.0)) @ K)
    symmetric = Pencil(pencil.M, sp.csr_array((K + K.T) / 2), symmetric=True)
    if pencil.free is None:
        return symmetric
    return replace(symmetric, free=FreeMotions(kernel_within(symmetric, pencil.free.motions)))


def shift_below(pencil: Pencil, band: float | None) -> float:
    """Return a shift σ of θ = −λ² just below zero, measured by the band of the wanted modes where that is known."""
    return -((_BELOW * band) ** 2) if band is not None else -_RIGID_SHIFT * _largest_ratio(pencil)


def _undamped_band(pencil: Pencil, request: Request) -> float:
    """Return about where the wanted modes end: the undamped ones without friction, a little more than half of them."""
    count = min(max(request.count or 1, 2), pencil.n - 2)
    modes = _solve_sparse(symmetric_part(pencil), Request(count=count), None)
    return float(np.abs(modes.lam).max(initial=0.0)) or float(np.sqrt(_RIGID_SHIFT * _largest_ratio(pencil)))


def _largest_ratio(pencil: Pencil) -> float:
    """Return the largest ratio of diagonal stiffness to mass that is not one of a penalty."""
    mass, stiffness = pencil.M.diagonal(), np.abs(pencil.K.real.diagonal())
    both = (mass > 0) & (stiffness > 0)
    if not both.any():
        return 1.0
    ratios = stiffness[both] / mass[both]
    return float(ratios[ratios <= _PENALTY * np.median(ratios)].max())
