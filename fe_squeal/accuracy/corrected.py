"""A reduced model of the problem on the refined mesh, from the modes of the mesh itself and their corrections.

"Coarse" is the mesh whose error is asked for, "refined" or "fine" the same with every element cut into eight.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..eigen.blocks import combine, cross, times
from ..eigen.pencil import Modes
from ..reduced.basis import ReducedBasis
from ..reduced.vectors import interior_nodes, range_of, real_columns, unit_columns
from .refined import Refined
from .two_level import TwoLevelSolver

_CORRECTED = 2  # values of the parameter at which modes are corrected: the ends of the sweep
_ROUNDS = 2  # corrections of a mode, at most: the second follows where the first one was long
_LONG = 0.02  # of the energy of a mode: a correction with more energy than this counts as long
_ABOVE = 1.02  # times the highest frequency asked for: modes up to this frequency are corrected
_NODES = 5  # values of the parameter whose modes span the final basis
_FINE = 1e-5  # of a vector's norm: if its part outside the basis is smaller, the basis is not enlarged by it


class CorrectedModel:
    """The Galerkin projection of the refined problem on coarse modes φ and their corrections −P⁻¹Q(λ)φ.

    What the coarse mesh cannot represent vibrates at frequencies far above those of the modes, and there Q(λ) is close
    to P = K − σM. So the correction is about what a step of inverse iteration on the refined mesh would add. Right and
    left modes are corrected: the error of an eigenvalue's change is then the product of the errors of both corrections.

    Parameters
    ----------
    refined : Refined

    Attributes
    ----------
    projected : Problem
        The projection, with its terms collected by powers of the parameter.
    iterations : int
        Steps of conjugate gradients that the corrections took, each on a block of right-hand sides.

    Raises
    ------
    NotConvergedError
        The conjugate gradients on the refined mesh do not settle.
    """

    def __init__(self, refined: Refined) -> None:
        model, collected, parameter = refined.model, refined.problem, refined.parameter
        values = refined.values
        basis = ReducedBasis(collected, parameter, refined.metric, model.basis.sigma, None, model.linear_solver)
        if model.basis.has_slow:
            basis.expect_slow_motions()
        unheld = collected.free_motions().motions
        if unheld.shape[1]:
            basis.append(unheld)
        nodes = interior_nodes(float(values[0]), float(values[-1]), _NODES if len(values) > 1 else 1).tolist()
        own = _span(model.basis, refined, [*nodes, float(values[0]), float(values[-1])])
        EV = times(refined.prolongation, combine(model.basis.V, own))
        basis.append(EV)
        chosen = values[np.unique(np.round(np.linspace(0, len(values) - 1, _CORRECTED)).astype(int))].tolist()
        for value in chosen:
            asked = _wanted(basis, value, refined)
            for _ in range(_ROUNDS):
                long = self._correct(basis, refined.solver, value, asked)
                if not long.any():
                    break
                asked = _nearest(_wanted(basis, value, refined), asked.lam[long])
        self.iterations = refined.solver.iterations
        self.basis = basis
        W = _span(basis, refined, nodes)
        self._coordinates = W.T @ cross(basis.V, times(refined.P, EV)) @ own.T
        self.projected = basis.restricted(W).collected()

    def _correct(self, basis: ReducedBasis, solver: TwoLevelSolver, value: float, modes: Modes) -> np.ndarray:
        """Add the corrections of modes at a value to the basis; return (k,) bool, which of them were long."""
        right, left = basis.residuals(value, modes)
        one_side = basis.pencil(value).problem_class == "symmetric"
        long = np.zeros(len(modes), dtype=bool)
        for residual in (right,) if one_side else (right, left):
            columns = real_columns(residual)
            z = solver.solve(columns)
            basis.append(z)
            length = np.linalg.norm(modes.right, axis=0).min()  # in the norm of P
            found = np.einsum("ij,ij->j", columns, z) > _LONG * length**2
            long |= found.reshape(-1, len(modes)).any(axis=0)
        return long

    def coordinates(self, shapes: np.ndarray) -> np.ndarray:
        """Return modes of the coarse mesh (r, k) in the coordinates of this model.

        Parameters
        ----------
        shapes : (r_coarse, k) float or complex
            The modes in the coordinates of `Refined.model`.
        """
        return np.asarray(self._coordinates @ shapes)


def _asked(basis: ReducedBasis, value: float, refined: Refined) -> Modes:
    """Return the modes up to the highest frequency of the coarse mesh's model.

    Without damping λ and −λ* have the same shape, and only the one with Re λ ≥ 0 is returned.
    """
    modes = basis.modes(value, refined.model.highest)
    if not basis.problem.is_damped:
        modes = modes.select(np.flatnonzero(modes.lam.real >= 0))
    return modes


def _wanted(basis: ReducedBasis, value: float, refined: Refined) -> Modes:
    """Return the modes up to `_ABOVE` times the highest frequency asked for: those that are to be corrected."""
    modes = _asked(basis, value, refined)
    return modes.select(np.flatnonzero(modes.lam.imag <= _ABOVE * refined.highest))


def _span(basis: ReducedBasis, refined: Refined, values: Sequence[float]) -> np.ndarray:
    """Return (r, k) orthonormal columns on a basis that span its right and left modes at some values."""
    spanned = []
    for value in values:
        modes = _asked(basis, value, refined)
        assert modes.left is not None
        spanned.append(unit_columns(modes.right, modes.left))
    return range_of(np.hstack(spanned), _FINE, basis.free_motions(float(refined.values[0])).motions)


def _nearest(modes: Modes, lam: np.ndarray) -> Modes:
    """Return, of some modes, those whose eigenvalues are nearest to given ones."""
    distance = np.abs(modes.lam[None, :] - lam[:, None])
    return modes.select(np.unique(distance.argmin(axis=1)))
