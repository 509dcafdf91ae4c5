"""The lowest modes of a pencil, by the cheapest solver that its class allows."""

from __future__ import annotations

import numpy as np

from ..errors import NotConvergedError
from .band import band_modes, with_far_growth
from .counted import counted_modes, parting_frequency
from .dense import DENSE_LIMIT, solve_dense
from .disc import BLOCK
from .free_modes import FreeModes, split_off
from .inertia import count_below, finite_below
from .inverse_iteration import improved
from .linear.factor import LinearSolver, SingularError
from .multiple import unit_mass
from .nearest import UnpairedError, nonsymmetric_modes, quadratic_modes, symmetric_modes
from .pencil import Modes, Pencil
from .quality import backward_errors, in_upper_half
from .request import Completeness, Request, select_wanted
from .shift import BEHIND, distance_to_nearest, known_radius, shift_below, symmetric_part
from .shift_invert import ShiftInverted
from .threads import one_openblas_thread

# A shift nearer to an eigenvalue than this, relatively, makes its 1/(θ − σ) so large that rounding of it costs the
# other eigenvalues digits. The shift is then multiplied by a factor, at most so many times.
_CLEAR, _MOVE, _MOVES = 1e-4, 1.15, 3
_WIDER = 3  # times at most that twice as many modes are sought where right and left ones do not pair
_SMALL = 2 * DENSE_LIMIT  # unknowns up to which LAPACK finds all modes where discs do not find those asked for
_FREE = 1e-8  # of a mode: a part outside the known free motions that is smaller is rounding
_GAP = 1e-5  # of a frequency: frequencies that are nearer to each other may be a multiple one
_AMPLE = 1.1  # times the frequency where the wanted modes are thought to end: they seldom end above it
_ROUGHLY = 1e-3  # accuracy of undamped frequencies that only say where a band ends


@one_openblas_thread()
def solve_modes(
    pencil: Pencil, request: Request, band: float | None = None, linear_solver: LinearSolver | str = "auto",
    expected: int | None = None,
) -> Modes:  # fmt: skip
    """Return the wanted modes, sorted by Im λ; conjugate pairs are not cut apart.

    Parameters
    ----------
    band : float, rad/s, optional
        About where the wanted modes end (from a neighbouring solve); places the shift.
    linear_solver : LinearSolver or str
        Factorises the shifted matrices.
    expected : int, optional
        About how many modes there are up to a highest frequency (from a neighbouring solve); else they are counted
        without friction and damping, by a factorisation.

    Raises
    ------
    NotConvergedError
        If a wanted mode misses the tolerance, or not all are found. `partial` has the `Modes` that were found with
        their backward errors, perhaps without left ones and with infinite uncertainties; None if there are none.

    Examples
    --------
    >>> import scipy.sparse as sp
    >>> K = sp.diags_array(np.arange(1.0, 1001.0)).tocsr()
    >>> modes = solve_modes(Pencil(sp.eye_array(1000, format="csr"), K, symmetric=True), Request(count=3))
    >>> np.round(modes.lam.imag**2, 9)
    array([1., 2., 3.])
    """
    try:
        if pencil.n <= DENSE_LIMIT:
            modes = select_wanted(solve_dense(pencil, linear_solver=linear_solver), request, np.inf)
            assert modes is not None
        else:
            modes = _solve_sparse(pencil, request, band, linear_solver, expected)
    except NotConvergedError as error:
        if isinstance(error.partial, tuple):
            error.partial = _unfinished(pencil, *error.partial)
        raise
    inexact = _inexact(pencil, modes, request)
    if inexact.any():
        modes = improved(pencil, modes, inexact, request.tolerance, linear_solver)
        inexact = _inexact(pencil, modes, request)
    if inexact.any():
        worst = modes.backward_error[inexact].max()
        raise NotConvergedError(
            f"backward error {worst:.2g} of a mode exceeds the tolerance {request.tolerance:.2g}", partial=modes
        )
    return modes


def _inexact(pencil: Pencil, modes: Modes, request: Request) -> np.ndarray:
    """Return (k,) bool, which modes miss the tolerance, but for motions that are known to be free."""
    inexact = ~(modes.backward_error <= request.tolerance)
    return inexact & ~_are_free_motions(pencil, modes) if inexact.any() else inexact


def _unfinished(pencil: Pencil, lam: np.ndarray, right: np.ndarray) -> Modes | None:
    """Return the modes of λ (k,) and vectors (n, k) that a search had found when it failed; None without any.

    They have no left ones, without which it is not known how uncertain their λ are.
    """
    upper = np.flatnonzero(in_upper_half(pencil, lam))
    upper = upper[np.argsort(lam[upper].imag, kind="stable")]
    lam, right = lam[upper], unit_mass(pencil, right[:, upper])
    unknown = np.full(len(lam), np.inf)
    modes = Modes(lam, right, None, backward_errors(pencil, lam, right), unknown, unknown, "unfinished")
    return modes if len(lam) else None


def _are_free_motions(pencil: Pencil, modes: Modes) -> np.ndarray:
    """Return (k,) bool, whether modes are motions that are known to be held by nothing: of λ = 0, or of a decay.

    That K Z = 0 was seen where they come from. Where K was projected since, what is left of K Z is rounding of far
    larger forces, which its entries do not show, and no error of these modes.
    """
    if pencil.free is None or not pencil.free.motions.shape[1]:
        return np.zeros(len(modes), bool)
    d = pencil.units[0][:, None]
    Z, right = pencil.free.motions / d, modes.right / d
    outside = right - Z @ np.linalg.lstsq(Z, right, rcond=None)[0]
    return np.asarray(np.linalg.norm(outside, axis=0) <= _FREE * np.linalg.norm(right, axis=0))


def prove_completeness(
    pencil: Pencil, modes: Modes, linear_solver: LinearSolver | str = "auto", limit: float | None = None
) -> Completeness:  # fmt: skip
    """Count the modes by the inertia in a gap above them (symmetric pencils).

    The gap is the highest one between two of the modes, so that what lies above it, one mode or several of about one
    frequency, is not counted: more modes than are needed are expected. The inertia counts values of θ. One that is
    negative makes two modes ±λ, so where such a one is missing `expected` is too small by one, but still larger than
    what was found.

    Parameters
    ----------
    limit : float, rad/s, optional
        Up to which modes were asked for: the place to count at where all those found lie below it.

    Returns
    -------
    Completeness
        proven False where the class or the solver gives no count.
    """
    found = len(modes)
    if modes.exhaustive:
        return Completeness(found, found, True)
    if pencil.problem_class != "symmetric" or not found:
        return Completeness(found, None, False)
    # A divergence has two modes ±λ for one θ < 0; only the decaying one is counted.
    omega = np.sort(modes.lam.imag[modes.lam.real <= 0])
    # Count in a clear gap between two modes, so that no multiple eigenvalue is cut.
    ends = omega if limit is None or not len(omega) else np.append(omega, max(limit, omega[-1]))
    gaps = np.flatnonzero(np.diff(ends) > _GAP * ends[1:])
    if not len(gaps):
        return Completeness(found, None, False)
    below = int(gaps[-1]) + 1
    # Close below the highest frequency: rounding decides whether a mode just there was asked for.
    place = (ends[below - 1] + ends[below]) / 2 if below < len(omega) else ends[below] * (1 - _GAP / 2)
    counted = count_below(pencil, float(place), linear_solver)
    if counted is None:
        return Completeness(found, None, False)
    return Completeness(found, found - below + counted, counted == below)


def _solve_sparse(
    pencil: Pencil, request: Request, band: float | None, linear_solver: LinearSolver | str, expected: int | None
) -> Modes:  # fmt: skip
    """Return the wanted modes from those nearest a shift: more of them are sought until the wanted ones are covered."""
    count, counted = request.count or 0, None
    if request.max_frequency_hz is not None:
        band = 2 * np.pi * request.max_frequency_hz
        # Friction and damping change the number of modes in a band by a few at most: start from the symmetric part's.
        counted = None if expected else count_below(symmetric_part(pencil), band, linear_solver)
        below = expected or counted
        count = below if below is not None else 20
    free = split_off(pencil, linear_solver)
    if pencil.C is not None and not pencil.is_complex:
        try:
            band = band or _undamped_band(pencil, request, linear_solver)
            return band_modes(pencil, request, band, free, linear_solver, expected)
        except NotConvergedError:
            if pencil.n > _SMALL:
                raise
        modes = select_wanted(solve_dense(pencil, linear_solver=linear_solver), request, np.inf)
        assert modes is not None
        return modes
    sought = count + max(4, count // 10)
    moves = wider = 0
    if pencil.C is None:
        sigma = shift_below(pencil, band, None if free is None else free.right)
    else:
        # Structural damping reaches every mode, so that heavily damped ones count, too. A real positive shift sees all
        # that grows up to the band's end, and no mode is near it.
        sigma = _AMPLE * BEHIND * (band or _undamped_band(pencil, request, linear_solver))
    operator, divergent = _shifted(pencil, sigma, free, linear_solver)
    while True:
        sigma = float(operator.sigma.real)
        sought = min(sought, operator.size)
        try:
            if pencil.C is not None:
                modes, reach = quadratic_modes(pencil, operator, sought, free)
            elif pencil.problem_class == "symmetric":
                modes, reach = symmetric_modes(pencil, operator, sought, free)
            else:
                modes, reach = nonsymmetric_modes(pencil, operator, sought, free)
        except SingularError:
            if moves == _MOVES:
                raise
            moves += 1
            operator, divergent = _shifted(pencil, sigma * _MOVE, free, linear_solver)
            continue
        except UnpairedError:  # an eigenvalue of which both have some copies, and no clear ring around the others
            if sought == operator.size or wider == _WIDER:
                raise
            wider, sought = wider + 1, 2 * sought
            continue
        if moves < _MOVES and distance_to_nearest(pencil, modes, sigma) < _CLEAR * abs(sigma):
            moves += 1
            operator, divergent = _shifted(pencil, sigma * _MOVE, free, linear_solver)
            continue
        radius = known_radius(pencil, modes, sigma, reach)
        wanted = select_wanted(modes, request, radius)
        if wanted is not None and np.isinf(reach):
            return wanted
        if wanted is not None and pencil.problem_class != "symmetric":
            far = abs(sigma) if pencil.C is not None else abs(sigma) ** 0.5  # a shift of λ with C, of θ without
            limit = float(wanted.lam.imag.max(initial=0.0)) or _lowest(modes, far)
            if request.max_frequency_hz is not None:
                limit = 2 * np.pi * request.max_frequency_hz
            known = pencil.C is not None and sigma >= BEHIND * limit and _shows_every_copy(operator, modes)
            del operator  # and its factors, before there are others
            whole = with_far_growth(pencil, modes, limit, free, linear_solver, known)
            wanted = select_wanted(whole, request, np.inf)
            assert wanted is not None
            return wanted
        at = None if wanted is None else parting_frequency(modes, wanted, request)
        if at is not None:
            del operator
            below = counted if request.max_frequency_hz is not None and at == band else None
            whole = counted_modes(pencil, modes, at, sigma, divergent, linear_solver, below)
            wanted = select_wanted(whole, request, radius)
            assert wanted is not None
            return wanted
        if sought == operator.size:
            raise NotConvergedError(f"{len(modes)} modes found, the wanted range is still not covered", partial=modes)
        limit = band or float(modes.lam.imag.max(initial=0.0))
        growth = (limit / radius) ** 1.5 if 0 < radius < limit else 1.4
        sought = int(np.clip(growth, 1.2, 3.0) * sought) + 4


def _shows_every_copy(operator: ShiftInverted, modes: Modes) -> bool:
    """Return whether blocks of vectors have found the modes, and no eigenvalue is as often there as a block is wide."""
    near = np.abs(modes.lam[:, None] - modes.lam) <= _GAP * np.abs(modes.lam)
    return operator.in_blocks and int(near.sum(axis=0).max(initial=0)) < BLOCK


def _lowest(modes: Modes, otherwise: float) -> float:
    """Return the lowest frequency of modes that swings, rad/s: the range to look for growth in beside rigid motions."""
    return float(modes.lam.imag[modes.lam.imag > 0].min(initial=np.inf) if modes.lam.imag.any() else otherwise)


def _shifted(
    pencil: Pencil, sigma: float, free: FreeModes | None, linear_solver: LinearSolver | str
) -> tuple[ShiftInverted, int]:
    """Return the shift-inverted operator at a shift, or beside it where the shift is an eigenvalue.

    With it comes the number of finite θ below the shift, counted for a symmetric pencil and 0 for others.
    """
    for _ in range(_MOVES):
        try:
            operator = ShiftInverted(pencil, sigma, free, linear_solver)
            break
        except SingularError:
            sigma *= _MOVE
    else:
        operator = ShiftInverted(pencil, sigma, free, linear_solver)
    divergent = 0
    if pencil.problem_class == "symmetric":
        divergent = finite_below(pencil, operator.negative_pivots, linear_solver) or 0
    return operator, divergent


def _undamped_band(pencil: Pencil, request: Request, linear_solver: LinearSolver | str) -> float:
    """Return about where the wanted modes end, rad/s: the highest of as many modes without damping and friction."""
    count = min(max(request.count or 1, 2), pencil.n - 2)
    undamped = symmetric_part(pencil)
    free = split_off(undamped, linear_solver)
    sigma = shift_below(undamped, None, None if free is None else free.right)
    operator, _ = _shifted(undamped, sigma, free, linear_solver)
    try:
        theta, _ = operator.largest_symmetric(count, "LM", _ROUGHLY)
    except NotConvergedError as error:  # whose modes are not those of the pencil
        raise NotConvergedError(f"without damping and friction: {error}") from error
    return float(np.sqrt(np.abs(theta).max(initial=0.0))) or float(np.sqrt(-sigma))
