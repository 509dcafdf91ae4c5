"""Where the shift of a sparse solve lies, and how far around it all modes are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from .kernel import kernel_within
from .linear.spread_matrix import in_rows, sizes_times
from .multiple import ROUNDING
from .pencil import FreeMotions, Modes, Pencil
from .request import is_beside

# Of the largest ratio of diagonal stiffness to mass, which is about the highest θ: far below any elastic mode, and far
# above what rounding makes of a zero.
_RIGID_SHIFT = 1e-9
_ROUNDINGS = 16  # times the rounding of one sum: that of a factorisation
_PENALTY = 1e6  # a ratio so many times the median is that of a penalty, which stands for an infinite stiffness
# Damping ratio up to which every mode below the wanted frequency is found. Of more heavily damped modes those alone are
# found that happen to lie near the shift: to reach for all of them would take many more modes than are asked for.
LIGHT_RATIO = 0.2
LIGHT = 0.2042  # −Re λ / Im λ of that ratio −Re λ / |λ|, which is 0.2 / √(1 − 0.2²), rounded up
# Of the highest frequency of a band: a real shift. A circle around it through the band's end, i, has inside what grows
# in the band at most as fast as `growth.may_grow` allows: a² − 0.1a < b² + ¼ of λ = a + ib, a = 1.17 at the end.
BEHIND = 0.59
BELOW = 0.05  # how far below zero the shift lies, as a frequency, in parts of the frequency where the wanted modes end


def shift_below(pencil: Pencil, band: float | None, free: np.ndarray | None = None) -> float:
    """Return a shift σ of θ = −λ² just below zero.

    From there the nearest eigenvalues are all those of |θ| up to a limit: flutter, and divergence (θ < 0) too. A band
    beyond all modes tells no more than where the highest of them is: from a shift far beyond these they all look alike.

    Parameters
    ----------
    band : float or None, rad/s
        About where the wanted modes end, if that is known.
    free : (n, k), optional
        Motions that nothing holds. Stiff links between moving parts, such as penalties, leave rounding of large forces
        in place of their θ = 0: the shift lies below it, so that none of them counts as a divergence.
    """
    highest, rounding = _largest_ratio(pencil), 0.0 if free is None else _rounding_of_zero(pencil, free)
    if band is None:
        return -max(_RIGID_SHIFT * (highest or 1.0), rounding)
    return -max((BELOW * min(band, float(np.sqrt(highest or np.inf)))) ** 2, rounding)


def distance_to_nearest(pencil: Pencil, modes: Modes, sigma: float) -> float:
    """Return the distance of the shift from the nearest eigenvalue: θ without C, λ with it."""
    values = modes.lam if pencil.C is not None else -(modes.lam**2)
    return float(np.abs(values - sigma).min(initial=np.inf))


def known_radius(pencil: Pencil, modes: Modes, sigma: float, reach: float) -> float:
    """Return the frequency, rad/s, up to which all modes are among those that were found nearest the shift.

    Without damping it bounds |λ|. With damping it bounds Im λ, and holds for the modes above the ray
    Re λ = −tilt · Im λ in the left half plane: the circle around the shift that the found eigenvalues fill cuts this
    ray at the frequency that is returned. The tilt is that of the most damped mode where K is complex, since structural
    damping reaches every mode. With C alone it is that of the lightly damped modes. A mode that grows counts with
    |Re λ|, because its decaying partner −λ* lies as far on the other side of the imaginary axis.

    Parameters
    ----------
    modes : Modes
        Those found nearest the shift.
    sigma : float
        The shift, of λ with C (rad/s), of θ without it (rad²/s²).
    reach : float
        The distance from the shift, in its unit, within which all eigenvalues were found; infinite if they are all.
    """
    if not len(modes) or np.isinf(reach):
        return reach
    swinging = modes.lam[~is_beside(modes)]
    tilt = loss_tilt(pencil, swinging) if pencil.is_complex else light_tilt(modes.lam) if pencil.C is not None else 0.0
    if pencil.C is not None:
        return on_slant(sigma, reach, tilt)
    return float(np.sqrt(max(reach - abs(sigma), 0.0) / (1 + tilt**2)))


def on_slant(sigma: float, radius: float, tilt: float) -> float:
    """Return the Im λ, rad/s, at which the ray Re λ = −tilt · Im λ leaves a circle around a real shift.

    On the ray |λ − σ|² = (1 + tilt²) (Im λ)² + 2 tilt σ Im λ + σ². Zero where the circle does not hold λ = 0.
    """
    a, b, c = 1 + tilt**2, tilt * sigma, radius**2 - sigma**2
    return float((np.sqrt(b**2 + a * max(c, 0.0)) - b) / a)


def on_ray(omega: float, radius: float, tilt: float) -> tuple[float, float]:
    """Return the two Im λ, rad/s, between which the rays Re λ = ∓tilt · Im λ lie in a disc around iω.

    On these |λ − iω|² = (1 + tilt²)(Im λ)² − 2ω Im λ + ω². Both are equal if the rays miss the disc.
    """
    a = 1 + tilt**2
    root = omega**2 - a * (omega**2 - radius**2)
    if root < 0:
        return omega, omega
    return max((omega - np.sqrt(root)) / a, 0.0), float((omega + np.sqrt(root)) / a)


def loss_tilt(pencil: Pencil, lam: np.ndarray) -> float:
    """Return the largest −Re λ / Im λ of eigenvalues, or what the largest loss angle of the stiffness allows.

    An undamped mass on a stiffness of loss angle δ has −λ² of argument δ, and so −Re λ / Im λ = tan(δ/2). The angle is
    taken as at most π/2, beyond which the real part of the stiffness would be negative.
    """
    damped = lam[lam.imag > 0]
    by_loss = np.tan(np.clip(np.angle(pencil.K.diagonal()), 0.0, np.pi / 2) / 2)
    return float(np.max(np.append(-damped.real / damped.imag, by_loss)))


def light_tilt(lam: np.ndarray) -> float:
    """Return the largest |Re λ| / Im λ of those eigenvalues lam (k,) that grow or are lightly damped."""
    oscillating = lam[lam.imag > 0]
    ratio = oscillating.real / oscillating.imag
    return float(np.abs(ratio[ratio > -LIGHT]).max(initial=0.0))


def symmetric_part(pencil: Pencil) -> Pencil:
    """Return the pencil without damping, and with the symmetric part of K, see `turned_stiffness`."""
    if pencil.problem_class == "symmetric":
        return pencil
    K = turned_stiffness(pencil)
    symmetric = Pencil(pencil.M, in_rows((K + K.T) / 2), symmetric=True)
    if pencil.free is None:
        return symmetric
    return replace(symmetric, free=FreeMotions(kernel_within(symmetric, pencil.free.motions)))


def turned_stiffness(pencil: Pencil) -> sp.csr_array:
    """Return the real part of K with rows turned that its symmetric part would lose.

    The row of an unknown without mass may be multiplied by −1 without changing the problem. Programs write constraints
    with Lagrange multipliers as [[K, Bᵀ], [B, 0]] or as [[K, −Bᵀ], [B, 0]]; of the second form the symmetric part would
    have lost B.
    """
    K = pencil.K.real
    massless = pencil.M.diagonal() == 0
    if not massless.any():
        return K
    turned = massless & (np.asarray(K.multiply(K.T).sum(axis=1)) < 0)
    return sp.csr_array(sp.diags_array(np.where(turned, -1.0, 1.0)) @ K) if turned.any() else K


def _rounding_of_zero(pencil: Pencil, Z: np.ndarray) -> float:
    """Return what rounding may make of θ = 0 of motions Z (n, k), rad²/s²: Σ|z||K||z| over Σ zMz, with a margin."""
    mass = np.sum(Z * (pencil.M @ Z), axis=0)
    parts = np.sum(np.abs(Z) * sizes_times(pencil.K, np.abs(Z)), axis=0)
    return float((_ROUNDINGS * ROUNDING * parts[mass > 0] / mass[mass > 0]).max(initial=0.0))


def _largest_ratio(pencil: Pencil) -> float | None:
    """Return the largest ratio of diagonal stiffness to mass that does not come from a penalty, rad²/s².

    None where no unknown has both.
    """
    mass, stiffness = pencil.M.diagonal(), np.abs(pencil.K.real.diagonal())
    both = (mass > 0) & (stiffness > 0)
    if not both.any():
        return None
    ratios = stiffness[both] / mass[both]
    return float(ratios[ratios <= _PENALTY * np.median(ratios)].max())
