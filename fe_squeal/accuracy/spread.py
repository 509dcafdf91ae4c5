"""How far the parts of a change, which cancel in it, spread: by body, direction and place.

Refining the mesh changes a growth rate or an onset by a sum of parts p_g of groups of elements, see `shares`. Each part
falls at a rate of its own, so that the exact value lies Σ s_g p_g away, with factors s_g between the limits of `bars`.
Parts of opposite sign cancel in Σ p_g, and need not in Σ s_g p_g: Σ |p_g| tells by how much that may differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..eigen.blocks import cross, lift
from ..eigen.pencil import Modes
from ..sweep.result import Sweep, SweepPoint
from .corrected import CorrectedModel
from .groups import element_groups
from .rates import by_eigenvalue, onset_factor
from .refined import Refined
from .residuals import Residuals


@dataclass(frozen=True)
class Asked:
    """Quantities at one value of the parameter.

    Attributes
    ----------
    value : float
        Of `Refined.parameter`.
    modes : Modes
        Of the model of the mesh itself, with left ones, (k,).
    factors : (k,) complex
        The quantity's change is Re(factor ρᴴP⁻¹r).
    """

    value: float
    modes: Modes
    factors: np.ndarray


def growth_asked(
    refined: Refined, point: SweepPoint, value: float, before: Modes, near: np.ndarray
) -> tuple[np.ndarray, Asked]:
    """Return which modes of a point grow (k,) bool, and their growth rates as what is asked for.

    Parameters
    ----------
    refined : Refined
    point : SweepPoint
    value : float
        Of `Refined.parameter`.
    before : Modes
        Those of the model of the mesh itself there.
    near : (k,) int
        Which of these each mode of the point is.
    """
    grows = (point.modes.stability == "unstable") & (point.modes.lam.imag > 0)
    modes = before.select(near[grows])
    return grows, Asked(value, modes, 1 / by_eigenvalue(refined, value, modes))


def spreads_of(
    result: Sweep, refined: Refined, corrected: CorrectedModel, growing: Sequence[tuple[np.ndarray, Asked]]
) -> tuple[tuple[np.ndarray, ...], tuple[float, ...]]:
    """Return sums of the sizes of parts: (k,) 1/s of every point, NaN for modes that do not grow, and of each onset.

    It is NaN of an onset, too, that has no mode of its frequency: a divergence.

    Parameters
    ----------
    result : Sweep
    refined : Refined
        Of this sweep.
    corrected : CorrectedModel
        Of `refined`.
    growing : sequence of (k,) bool and Asked
        Of each point, see `growth_asked`.
    """
    onsets = []
    for onset in result.onsets if len(refined.values) > 1 else ():
        modes = refined.model.modes(onset.value)
        modes = modes.select(np.flatnonzero(modes.lam.imag > 0))
        k, factor = onset_factor(refined, onset, modes) or (None, 0j)
        chosen = np.array([] if k is None else [k], int)
        onsets.append(Asked(onset.value, modes.select(chosen), np.full(len(chosen), factor)))
    found = spreads(refined, corrected, [*(asked for _, asked in growing), *onsets])
    by_point = []
    for (grows, _), spread in zip(growing, found[: len(growing)], strict=True):
        own = np.full(len(grows), np.nan)
        own[grows] = spread
        by_point.append(own)
    return tuple(by_point), tuple(float(s[0]) if len(s) else np.nan for s in found[len(growing) :])


def spreads(refined: Refined, corrected: CorrectedModel, asked: Sequence[Asked]) -> list[np.ndarray]:
    """Return Σ_g |p_g| (k,) of quantities, in their own units, for each of `asked`.

    P⁻¹r is taken from the corrected model's basis, which holds the corrections of modes at the ends of the sweep.
    """
    counts = [len(a.modes) for a in asked]
    if not sum(counts):
        return [np.zeros(0) for _ in asked]
    own = [a for a in asked if len(a.modes)]
    residuals = Residuals(refined, [a.modes for a in own])
    rho = np.hstack([residuals.left(a.value, a.modes) for a in own])
    V = corrected.basis.V
    z = lift(V, np.hstack([cross(V, residuals.right(a.value, a.modes)) for a in own]))
    del residuals
    hierarchy = refined.hierarchy
    _, groups = element_groups(refined.coarse)
    factors = np.concatenate([a.factors for a in own])
    parts = np.real(factors * ((groups @ hierarchy.elements) @ hierarchy.at_nodes(rho, z)))
    return np.split(np.abs(parts).sum(axis=0), np.cumsum(counts)[:-1])
