"""How eigenvalues move with the numbers of a scene."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import scipy.sparse as sp

from ..eigen.blocks import lift
from ..eigen.pencil import Modes
from .parameters import paths_of
from .problem import Problem
from .terms import POWER


def sensitivities(
    problem: Problem, modes: Modes, positions: Sequence[int] | np.ndarray, paths: Iterable[str] | None = None
) -> dict[str, np.ndarray]:
    """Return ∂λ/∂p = −ψᴴ(λ²M' + λC' + K')φ / ψᴴ(2λM + C)φ of some modes by numbers of the scene.

    At an eigenvalue that is multiple or coalesces the derivative does not exist, and what is returned is large or
    without meaning; the mode's condition number says so. (Nelson, AIAA J. 14, 1976, for symmetric matrices.)

    Parameters
    ----------
    problem : Problem
        The problem, at the values that the modes belong to.
    modes : Modes
        With left and right vectors.
    positions : (m,) int
        Which modes.
    paths : iterable of str, optional
        Paths of numbers (default: all that change the coefficients of terms alone, which cost next to nothing; for
        others the terms are made anew twice).

    Returns
    -------
    dict of path to (m,) complex, rad/s per unit of the number

    Raises
    ------
    SceneError
        If there is no such number.
    """
    assert modes.left is not None
    positions = np.asarray(positions, int)
    lam, phi, psi = modes.lam[positions], modes.right[:, positions], modes.left[:, positions]
    if paths is None:
        paths = [p for p in problem.parameters if problem.is_affine(p)]
    forms = [_forms(psi, t.matrix, phi) for t in problem.terms]
    weight = np.zeros(len(lam), complex)
    for t, form in zip(problem.terms, forms, strict=True):
        if power := POWER[t.slot]:
            weight += t.coefficient(problem.parameters) * t.unit() * power * lam ** (power - 1) * form
    found = {}
    for path in paths:
        change = np.zeros(len(lam), complex)
        if problem.is_affine(path):
            for t, form in zip(problem.terms, forms, strict=True):
                change += sum(t.slope(p, problem.parameters) for p in paths_of(path)) * t.unit(lam) * form
        else:
            for slot, power in POWER.items():
                if (d := problem.derivative(path, slot)) is not None:
                    change += _forms(psi, d, phi) * lam**power
        with np.errstate(divide="ignore", invalid="ignore"):
            found[path] = -change / weight
    return found


def _forms(psi: np.ndarray, A: sp.csr_array, phi: np.ndarray) -> np.ndarray:
    """Return ψᴴAφ (m,) of pairs of columns."""
    return np.asarray(np.einsum("nk,nk->k", psi.conj(), lift(A, phi)))
