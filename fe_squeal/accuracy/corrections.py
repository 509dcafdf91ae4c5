"""What the mesh itself leaves out of its modes: their corrections on the refined mesh, at the ends and the onsets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..eigen.pencil import Modes
from ..eigen.threads import one_openblas_thread
from ..errors import NotConvergedError
from ..sweep.result import Sweep
from .rates import onset_factor
from .refined import ABOVE, Refined
from .residuals import Residuals
from .two_level import TwoLevelSolver

_FARTHER = 2.0  # times as much as those below it may a mode above the range fall on the refined mesh; a choice

@dataclass(frozen=True)
class Correction:
    """Corrections of k modes of the mesh itself at one value of the parameter, on the refined mesh.

    Attributes
    ----------
    modes : Modes
        In the coordinates of `Refined.model`, right ones φ and left ones ψ.
    left_residuals : (n_fine, k) float or complex
        ρ = Q(λ)ᴴψ.
    right : (n_fine, k) float or complex
        z = P⁻¹Q(λ)φ.
    energies : (k,) float
        zᴴPz.
    """

    modes: Modes
    left_residuals: np.ndarray
    right: np.ndarray
    energies: np.ndarray

    def with_more(self, other: Correction, modes: Modes) -> Correction:
        """Return these and those of the modes behind them; `modes` are all of both."""
        left = np.hstack([self.left_residuals, other.left_residuals])
        right = np.hstack([self.right, other.right])
        return Correction(modes, left, right, np.append(self.energies, other.energies))


@one_openblas_thread()
def right_corrections(result: Sweep, refined: Refined) -> dict[float, Correction]:
    """Return the corrections of right modes, by the value: those in the range at both ends, and those of onsets.

    An onset without a mode of its frequency, a divergence, has none. Modes above the range are among those at the ends
    if they are so little above it that they may be inside on the refined mesh, by how far those below it come down.

    Parameters
    ----------
    result : Sweep
        On the mesh itself.
    refined : Refined
        The problem of this sweep on the refined mesh.

    Raises
    ------
    NotConvergedError
        There are no modes.
    TooLargeError
        As of `TwoLevelSolver.solve`.
    """
    chosen = {value: modes for value, modes in _chosen(result, refined).items() if len(modes)}
    if not chosen:
        raise NotConvergedError(
            "no mode was found on the mesh, so that its error is not known; expected a higher solve.max_frequency"
        )
    found = _corrected(refined, chosen)
    if result.max_frequency is None:
        return found
    above = 1 + _FARTHER * max(_fall(correction, refined.highest) for correction in found.values())
    if above > ABOVE:
        begins = {value: len(found[value].modes) if value in found else 0 for value in _ends(refined)}
        whole = {value: _in_range(refined, value, above) for value in begins}
        more = {v: m.select(np.arange(begins[v], len(m))) for v, m in whole.items() if len(m) > begins[v]}
        for value, correction in _corrected(refined, more).items():
            found[value] = found[value].with_more(correction, whole[value]) if value in found else correction
    return found


def _corrected(refined: Refined, chosen: Mapping[float, Modes]) -> dict[float, Correction]:
    """Return the corrections of modes, by the value."""
    if not chosen:
        return {}
    residuals = Residuals(refined, list(chosen.values()))
    right, left = (
        np.hstack([side(value, modes) for value, modes in chosen.items()]) for side in (residuals.right, residuals.left)
    )
    del residuals
    z, energies = solved(refined.solver, right)
    ends = np.cumsum([len(modes) for modes in chosen.values()])
    own = [slice(end - len(modes), end) for end, modes in zip(ends.tolist(), chosen.values(), strict=True)]
    return {
        value: Correction(modes, _real_if_it_is(left[:, i]), _real_if_it_is(z[:, i]), energies[i])
        for (value, modes), i in zip(chosen.items(), own, strict=True)
    }


def solved(solver: TwoLevelSolver, residuals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return z = P⁻¹r and the energies zᴴPz (k,) of residuals r (n_fine, k), real or complex."""
    if not residuals.imag.any():
        residuals = residuals.real
        z = solver.solve(residuals)
        return z, np.einsum("ij,ij->j", residuals, z)
    k = residuals.shape[1]
    columns = np.hstack([residuals.real, residuals.imag])
    parts = solver.solve(columns)
    energies = np.einsum("ij,ij->j", columns, parts)
    return parts[:, :k] + 1j * parts[:, k:], energies[:k] + energies[k:]


def _fall(correction: Correction, highest: float) -> float:
    """Return by which share a frequency near the highest one, rad/s, falls, or more than that.

    Without damping θ = ω² becomes less by the energy zᴴPz of the correction.
    """
    size = np.maximum(np.abs(correction.modes.lam), highest / 2)
    return float((correction.energies / (2 * size**2)).max(initial=0.0))


def _ends(refined: Refined) -> set[float]:
    """Return the first value and the last one."""
    return {float(refined.values[0]), float(refined.values[-1])}


def _chosen(result: Sweep, refined: Refined) -> Mapping[float, Modes]:
    model, values = refined.model, refined.values
    chosen = {value: _in_range(refined, value, ABOVE) for value in sorted(_ends(refined))}
    own: dict[float, list[int]] = {}
    for onset in result.onsets if len(values) > 1 else ():
        found = onset_factor(refined, onset, model.modes(onset.value)) if onset.value not in chosen else None
        if found is not None:
            own.setdefault(float(onset.value), []).append(found[0])
    return chosen | {value: model.modes(value).select(np.unique(which)) for value, which in own.items()}


def _in_range(refined: Refined, value: float, above: float) -> Modes:
    """Return the modes at a value, by rising frequency, up to so many times the highest one asked for.

    Without damping λ and −λ* have the same shape and equal errors, and only the one with Re λ ≥ 0 is returned.
    """
    modes = refined.model.modes(value)
    keep = (modes.lam.imag <= above * refined.highest) & (refined.problem.is_damped | (modes.lam.real >= 0))
    return modes.select(np.flatnonzero(keep))


def _real_if_it_is(x: np.ndarray) -> np.ndarray:
    """Return a copy of vectors, a real one if they have no imaginary parts."""
    return x.copy() if x.imag.any() else x.real.copy()
