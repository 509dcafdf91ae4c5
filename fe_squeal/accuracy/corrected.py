"""A reduced model of the problem on the refined mesh, from the modes of the coarse one and their corrections."""

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
_ROUNDS = 2  # of corrections at most: corrected modes are corrected again where the first correction was long
_LONG = 0.02  # energy of a correction over that of its mode beyond which it counts as long
_ABOVE = 1.02  # times the highest frequency asked for: up to here modes are corrected
_NODES = 5  # values of the parameter whose modes span the final basis
_FINE = 1e-5  # part of a vector outside the basis, relative to it, that is left out


class CorrectedModel:
    """The Galerkin projection of the refined problem on coarse modes φ and their corrections −P⁻¹Q(λ)φ.

    On what the coarse mesh does not hold, of frequencies far beyond those of the modes, Q(λ) is close to P = K − σM,
    so that a correction is what a step of inverse iteration on the refined mesh would add. Right and left modes are
    corrected: an eigenvalue's change is then right up to the product of two errors of corrections.

    Attributes
    ----------
    projected : Problem
        With its terms collected by powers of the parameter.
    iterations : int
        Of conjugate gradients, on blocks.
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
        W = _span(basis, refined, nodes)
        self._coordinates = W.T @ cross(basis.V, times(refined.P, EV)) @ own.T
        self.projected = basis.restricted(W).collected()

    def _correct(self, basis: ReducedBasis, solver: TwoLevelSolver, value: float, modes: Modes) -> np.ndarray:
        """Add the corrections of modes at a value; return (k,) which were so long that a second round is needed."""
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
        """Return coarse modes, given in the coarse model's coordinates, in those of this one."""
        return np.asarray(self._coordinates @ shapes)


def _asked(basis: ReducedBasis, value: float, refined: Refined) -> Modes:
    """Return the modes as far as the model of the mesh itself goes; of λ and −λ*, with equal shapes, one."""
    modes = basis.modes(value, refined.model.highest)
    if not basis.problem.is_damped:
        modes = modes.select(np.flatnonzero(modes.lam.real >= 0))
    return modes


def _wanted(basis: ReducedBasis, value: float, refined: Refined) -> Modes:
    """Return those of them that are asked for, and a few above: the others stay as the mesh itself has them."""
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
    """Return the modes that are nearest to eigenvalues."""
    distance = np.abs(modes.lam[None, :] - lam[:, None])
    return modes.select(np.unique(distance.argmin(axis=1)))
