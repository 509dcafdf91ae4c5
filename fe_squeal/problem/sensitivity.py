"""How eigenvalues move with the numbers of a scene."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..eigen.pencil import Modes, Pencil
from .problem import Problem
from .terms import POWER


def sensitivities(
    problem: Problem, modes: Modes, index: int, paths: Iterable[str] | None = None, pencil: Pencil | None = None
) -> dict[str, complex]:
    """Return ∂λ/∂p = −ψᴴ(λ²M' + λC' + K')φ / ψᴴ(2λM + C)φ of one mode by numbers of the scene.

    At an eigenvalue that is multiple or coalesces the derivative does not exist, and what is returned is large or
    without meaning; the mode's condition number says so. (Nelson, AIAA J. 14, 1976, for symmetric matrices.)

    Parameters
    ----------
    problem : Problem
        The problem, at the values that the modes belong to.
    modes : Modes
        With left and right vectors.
    paths : iterable of str, optional
        Paths of numbers (default: all that change the coefficients of terms alone, which cost next to nothing; for
        others the terms are made anew twice).
    pencil : Pencil, optional
        Pencil of the problem, if it is at hand.

    Returns
    -------
    dict of path to complex, rad/s per unit of the number

    Raises
    ------
    SceneError
        If there is no such number.
    """
    assert modes.left is not None
    lam, phi, psi = complex(modes.lam[index]), modes.right[:, index], modes.left[:, index]
    pencil = problem.pencil() if pencil is None else pencil
    weight = complex(np.vdot(psi, pencil.derivative(np.array([lam]), phi[:, None])[:, 0]))
    if paths is None:
        paths = [p for p in problem.parameters if problem.is_affine(p)]
    forms = [complex(np.vdot(psi, t.matrix @ phi)) * t.unit(lam) for t in problem.terms]
    found = {}
    for path in paths:
        if problem.is_affine(path):
            change = sum(t.slope(path, problem.parameters) * form for t, form in zip(problem.terms, forms, strict=True))
        else:
            change = 0j
            for slot, power in POWER.items():
                d = problem.derivative(path, slot)
                if d is not None:
                    change += complex(np.vdot(psi, d @ phi)) * lam**power
        with np.errstate(divide="ignore", invalid="ignore"):
            found[path] = complex(np.divide(-change, weight))
    return found
