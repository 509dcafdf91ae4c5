"""How far the parts of a change, which cancel in it, spread: by body, direction and place.

Refining the mesh changes a growth rate or an onset by a sum of parts p_g of groups of elements, see `shares`. Each part
falls at a rate of its own, so that the exact value lies Σ s_g p_g away, with factors s_g between the limits of `bars`.
Parts of opposite sign cancel in Σ p_g, and need not in Σ s_g p_g: Σ |p_g| tells by how much that may differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from ..eigen.blocks import combine, cross, times
from ..eigen.pencil import Modes
from ..reduced.vectors import lift, unit_columns
from ..sweep.result import Sweep, SweepPoint
from .corrected import CorrectedModel
from .groups import element_groups
from .rates import by_eigenvalue, onset_factor
from .refined import Refined

_SAME = 1e-4  # part of a mode outside the span of others, relative to it, that is left out


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
    rho, z, factors = _residuals(refined, corrected, [a for a in asked if len(a.modes)])
    hierarchy = refined.hierarchy
    _, groups = element_groups(refined.coarse)
    parts = np.real(factors * ((groups @ hierarchy.elements) @ hierarchy.at_nodes(rho, lift(corrected.basis.V, z))))
    return np.split(np.abs(parts).sum(axis=0), np.cumsum(counts)[:-1])


def _residuals(
    refined: Refined, corrected: CorrectedModel, asked: Sequence[Asked]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return ρ (n_fine, k), P⁻¹r in coordinates of the corrected basis (r, k), and the factors (k,), of all asked.

    The terms are multiplied once, with what spans the modes asked for.
    """
    basis = refined.model.basis
    U, size, _ = la.svd(np.hstack([unit_columns(*_both(a.modes)) for a in asked]), full_matrices=False)
    S = U[:, size > _SAME * size[0]]
    X = times(refined.prolongation, combine(basis.V, S))
    V = corrected.basis.V
    on_basis, adjoint = [], []
    for term in refined.problem.terms:
        AX = times(term.matrix, X)
        on_basis.append(cross(V, AX))
        adjoint.append(AX if term.symmetric else times(term.matrix.T.tocsr(), X))
    rho, z = [], []
    for a in asked:
        right, left = (S.T @ side for side in _both(a.modes))
        at = refined.problem.at({refined.parameter: a.value})
        factors = [np.broadcast_to(t.factor(a.modes.lam, at.parameters), len(a.modes)) for t in at.terms]
        z.append(sum(B @ (right * c) for B, c in zip(on_basis, factors, strict=True)))
        rho.append(sum(lift(B, left * np.conj(c)) for B, c in zip(adjoint, factors, strict=True)))
    return np.hstack(rho), np.hstack(z), np.concatenate([a.factors for a in asked])


def _both(modes: Modes) -> tuple[np.ndarray, np.ndarray]:
    assert modes.left is not None
    return modes.right, modes.left
