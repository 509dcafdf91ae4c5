"""The parts of a change, which may cancel in it, by body, direction and place.

Refining the mesh changes a growth rate or an onset by a sum of parts p_g of groups of elements, see `shares`. Each part
falls at a rate of its own, so that the exact value lies Σ s_g p_g away, with factors s_g between the limits of `bars`.
Parts of opposite sign cancel in Σ p_g, and need not in Σ s_g p_g: Σ |p_g| tells by how much that may differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..eigen.blocks import cross, lift
from ..eigen.pencil import Modes
from ..sweep.result import Sweep, SweepPoint
from .bars import Parts
from .corrected import CorrectedModel
from .groups import element_groups, singular_groups
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


def parts_of(
    result: Sweep, refined: Refined, corrected: CorrectedModel, growing: Sequence[tuple[np.ndarray, Asked]]
) -> tuple[tuple[Parts, ...], Parts]:
    """Return the parts of the growth rates, 1/s, of every point, unknown for modes that do not grow, and of the onsets.

    They are unknown of an onset, too, that has no mode of its frequency: a divergence.

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
    found = _parts(refined, corrected, [*(asked for _, asked in growing), *onsets])
    by_point = [_among(grows, parts) for (grows, _), parts in zip(growing, found, strict=False)]
    has_mode = np.array([len(asked.modes) > 0 for asked in onsets], bool)
    return tuple(by_point), _among(has_mode, _joined(found[len(growing) :]))


def _joined(every: Sequence[Parts]) -> Parts:
    none = np.zeros((2, 0))
    kinds = [p.sums for p in every], [p.sizes for p in every], [p.scatter for p in every]
    return Parts(*(np.hstack([none, *of]) for of in kinds))


def _among(own: np.ndarray, parts: Parts) -> Parts:
    """Return parts of all quantities from those of some, `own` (k,) bool; those of the others are not known."""
    found = Parts.unknown(len(own))
    found.sums[:, own], found.sizes[:, own], found.scatter[:, own] = parts.sums, parts.sizes, parts.scatter
    return found


def _parts(refined: Refined, corrected: CorrectedModel, asked: Sequence[Asked]) -> list[Parts]:
    """Return the parts of the changes of quantities, in their own units, for each of `asked`.

    P⁻¹r is taken from the corrected model's basis, which holds the corrections of modes at the ends of the sweep.
    """
    counts = [len(a.modes) for a in asked]
    if not sum(counts):
        return [Parts.unknown(0) for _ in asked]
    own = [a for a in asked if len(a.modes)]
    residuals = Residuals(refined, [a.modes for a in own])
    rho = np.hstack([residuals.left(a.value, a.modes) for a in own])
    V = corrected.basis.V
    z = lift(V, np.hstack([cross(V, residuals.right(a.value, a.modes)) for a in own]))
    del residuals
    hierarchy = refined.hierarchy
    names, groups = element_groups(refined.coarse)
    factors = np.concatenate([a.factors for a in own])
    at_nodes = hierarchy.at_nodes(rho, z)
    ends, singular = np.cumsum([0, *counts]).tolist(), singular_groups(names)
    found = []
    for first, end in pairwise(ends):  # of one value after the other, since all elements' parts take memory
        single = np.real(factors[first:end] * (hierarchy.elements @ at_nodes[:, first:end]))
        found.append(Parts.of(groups @ single, singular, groups @ single**2))
    return found
