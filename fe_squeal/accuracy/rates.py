"""What divides a change of Q(λ; p) in the directions of a mode to give that of an eigenvalue or of an onset."""

from __future__ import annotations

import numpy as np

from ..eigen.pencil import Modes
from ..sweep.onset import Onset
from ..sweep.scale import Scale
from .refined import Refined

_NEAR = 0.01  # of an onset's frequency: a mode that is farther away is not that of the onset
_STEP = 1e-4  # of the sweep, in its coordinate: how far apart the values are that ∂Q/∂p is formed from


def by_eigenvalue(refined: Refined, value: float, modes: Modes) -> np.ndarray:
    """Return ψᴴQ′(λ)φ (k,) of modes of the model of the mesh itself at a value of `Refined.parameter`."""
    assert modes.left is not None
    pencil = refined.model.basis.pencil(value)
    return np.asarray(np.einsum("ij,ij->j", modes.left.conj(), pencil.derivative(modes.lam, modes.right)))


def by_parameter(refined: Refined, value: float, modes: Modes) -> np.ndarray:
    """Return ψᴴ ∂Q/∂p φ (k,) of the same."""
    scale = Scale.of(refined.values)
    h = _STEP * (scale.x(float(refined.values[-1])) - scale.x(float(refined.values[0]))) * scale.slope(value)
    high, low = (refined.model.basis.pencil(value + s * h).apply(modes.lam, modes.right) for s in (0.5, -0.5))
    assert modes.left is not None
    return np.asarray(np.einsum("ij,ij->j", modes.left.conj(), high - low) / h)


def onset_factor(refined: Refined, onset: Onset, modes: Modes) -> tuple[int, complex] | None:
    """Return which of the modes at an onset's value is the one of the onset, and the factor of its change.

    Refining the mesh changes the onset by Re(factor ψᴴδQφ). Where two modes meet, ψᴴ(δQ + ∂Q/∂p δp)φ = 0; where one
    crosses alone, Re(δλ + ∂λ/∂p δp) = 0. None where none of the modes has the onset's frequency, as with a divergence.
    """
    omega = 2 * np.pi * onset.frequency_hz
    away = np.abs(modes.lam.imag - omega)
    if not (away <= _NEAR * omega).any() or not omega:
        return None
    k = int(np.argmin(away))
    own = modes.select(np.array([k]))
    rate = by_parameter(refined, onset.value, own)[0]
    if onset.branch_b is not None and not refined.problem.is_damped:
        return k, complex(1 / rate)
    turn = by_eigenvalue(refined, onset.value, own)[0]
    return k, complex((1 / turn) / (rate / turn).real)
