"""Warnings that follow from the modes: frequencies lost in rounding, or lowered by the finite stiffness of a tie."""

from __future__ import annotations

import numpy as np

from ..eigen.pencil import Modes
from ..eigen.quality import ROUNDING
from ..errors import SquealError
from ..problem.dependence import depends_on
from ..problem.problem import Problem

_ROUGH = 1e-4  # of a frequency: there is a warning if its error by rounding is larger
# Of a frequency: there is a warning if the finite stiffness of a tie lowers it by more. Chosen: the error of a mesh is
# usually of this size.
_SOFT_TIE = 5e-3


def flat_warnings(problem: Problem, parameter: str, values: np.ndarray) -> list[str]:
    """Return a sentence where nothing in a problem depends on the parameter of a sweep over values (m,).

    Terms that are made anew are compared at its last, first and middle value. What fails there is told by the sweep.
    """
    try:
        if len(values) == 1 or depends_on(problem, parameter, values[[-1, 0, len(values) // 2]].tolist()):
            return []
    except SquealError:
        return []
    return [
        f"nothing in the problem depends on {parameter}, so that every branch is flat: effects that read it are not on,"
        " or do nothing here"
    ]


def rounding_warnings(modes: Modes) -> list[str]:
    """Return a sentence about modes with λ = 0, and one about modes whose frequency is lost in rounding of entries."""
    warnings = []
    free, lam = modes.lam == 0, np.abs(modes.lam)
    if free.any():
        text = f"{free.sum()} of the modes are rigid motions of frequency 0: no support or spring holds a body against"
        text += " them"
        blur = modes.re_uncertainty[free].max() / (2 * np.pi)
        if free.all() or 2 * np.pi * blur > _ROUGH * lam[~free].min():
            text += f", or they are slower than {blur:.2g} Hz, which rounding of the matrices hides"
        warnings.append(text)
    error = ROUNDING * modes.condition[~free]
    if (error > _ROUGH).any():
        warnings.append(
            f"{np.count_nonzero(error > _ROUGH)} of the modes have frequencies that rounding of the matrices may move,"
            f" by up to {100 * error.max():.2g} %: something is far stiffer than what they bend (thin cells, springs)"
        )
    return warnings


def tie_warnings(problem: Problem, modes: Modes) -> list[str]:
    """Return a sentence for each tied contact that is so soft that it lowers frequencies.

    A tie has a stiffness k for each area. Its share e = φᴴK_tφ / φᴴKφ in the energy of a mode is d ln θ / d ln k. For a
    stiff tie θ = θ_∞ − a/k, and so θ is lower than θ_∞, that of a rigid tie, by e θ.
    """
    found = []
    for name in dict.fromkeys(t.name for t in problem.terms if t.penalty):
        own = [t for t in problem.terms if t.name == name and t.penalty]
        energy = sum(
            t.coefficient(problem.parameters) * np.einsum("ij,ij->j", modes.right.conj(), t.matrix @ modes.right).real
            for t in own
        )
        moving = modes.lam != 0
        shares = np.divide(energy, np.abs(modes.lam) ** 2, out=np.zeros(len(modes)), where=moving)
        if shares.max(initial=0.0) / 2 > _SOFT_TIE:
            where = name.replace(".", " ", 1)
            found.append(
                f"{where}: tied by a stiffness that lets frequencies drop by up to {50 * shares.max():.2g} %;"
                " made stiffer, this error falls in proportion"
            )
    return found
