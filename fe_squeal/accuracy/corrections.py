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


@one_openblas_thread()
def right_corrections(result: Sweep, refined: Refined) -> dict[float, Correction]:
    """Return the corrections of right modes, by the value: those in the range at both ends, and those of onsets.

    An onset without a mode of its frequency, a divergence, has none.

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


def _chosen(result: Sweep, refined: Refined) -> Mapping[float, Modes]:
    model, values = refined.model, refined.values
    chosen = {float(v): _in_range(model.modes(float(v)), refined) for v in (values[0], values[-1])}
    own: dict[float, list[int]] = {}
    for onset in result.onsets if len(values) > 1 else ():
        found = onset_factor(refined, onset, model.modes(onset.value)) if onset.value not in chosen else None
        if found is not None:
            own.setdefault(float(onset.value), []).append(found[0])
    return chosen | {value: model.modes(value).select(np.unique(which)) for value, which in own.items()}


def _in_range(modes: Modes, refined: Refined) -> Modes:
    """Return the modes up to `ABOVE` times the highest frequency asked for.

    Without damping λ and −λ* have the same shape and equal errors, and only the one with Re λ ≥ 0 is returned.
    """
    keep = modes.lam.imag <= ABOVE * refined.highest
    return modes.select(np.flatnonzero(keep & (refined.problem.is_damped | (modes.lam.real >= 0))))


def _real_if_it_is(x: np.ndarray) -> np.ndarray:
    """Return a copy of vectors, a real one if they have no imaginary parts."""
    return x.copy() if x.imag.any() else x.real.copy()
