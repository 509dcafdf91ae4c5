"""A reduced model of the problem on the refined mesh, from the modes of the coarse one and their corrections."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..eigen.blocks import cross, times
from ..eigen.linear.choice import factorize_definite
from ..eigen.pencil import Modes
from ..problem.forms import collect_powers
from ..problem.problem import Problem
from ..reduced import ReducedModel
from ..reduced.basis import ReducedBasis
from ..reduced.undamped import weighted
from ..reduced.vectors import interior_nodes, range_of, real_columns, unit_columns
from .two_level import TwoLevelSolver

_CORRECTED = 2  # values of the parameter at which modes are corrected: the ends of the sweep
_ROUNDS = 2  # of corrections at most: corrected modes are corrected again where the first correction was long
_LONG = 0.02  # energy of a correction over that of its mode beyond which it counts as long
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

    def __init__(self, model: ReducedModel, fine: Problem, E: sp.csr_array, values: np.ndarray) -> None:
        """Build the model.

        Parameters
        ----------
        model : ReducedModel
            Of the coarse problem; its linear solver factorises here, too.
        fine : Problem
            On the refined mesh.
        E : (n_fine, n_coarse) sparse
            Prolongation.
        values : (m,) float
            Of the sweep.
        """
        coarse, parameter = model.basis.problem, model.parameter
        assert isinstance(parameter, str)
        metric = {t.name: c for t, c in zip(coarse.terms, model.basis.metric, strict=True)}
        start = coarse.value(parameter)
        collected = collect_powers(fine, parameter).at({parameter: start})
        weights = [metric.get(t.name, 0.0) for t in collected.terms]
        factor = factorize_definite(weighted(coarse, model.basis.metric), model.linear_solver)
        P = weighted(collected, weights)
        solver = TwoLevelSolver(P, E, factor.solve)
        basis = ReducedBasis(collected, parameter, weights, model.basis.sigma, None, model.linear_solver)
        if model.basis.has_slow:
            basis.expect_slow_motions()
        unheld = collected.free_motions().motions
        if unheld.shape[1]:
            basis.append(unheld)
        EV = times(E, model.basis.V)
        basis.append(EV)
        chosen = values[np.unique(np.round(np.linspace(0, len(values) - 1, _CORRECTED)).astype(int))].tolist()
        for value in chosen:
            for _ in range(_ROUNDS):
                if not self._correct(basis, solver, value, self._asked(basis, value, model)):
                    break
        self.iterations = solver.iterations
        self._coordinates = cross(basis.V, times(P, EV))
        spanned = []
        for value in interior_nodes(float(values[0]), float(values[-1]), _NODES if len(values) > 1 else 1).tolist():
            modes = self._asked(basis, value, model)
            assert modes.left is not None
            spanned.append(unit_columns(modes.right, modes.left))
        W = range_of(np.hstack(spanned), _FINE, basis.free_motions(start).motions)
        self._coordinates = W.T @ self._coordinates
        self.projected = basis.restricted(W).collected()

    def _correct(self, basis: ReducedBasis, solver: TwoLevelSolver, value: float, modes: Modes) -> bool:
        """Add the corrections of modes at a value; return whether one is so long that a second round is needed."""
        right, left = basis.residuals(value, modes)
        one_side = basis.pencil(value).problem_class == "symmetric"
        long = False
        for residual in (right,) if one_side else (right, left):
            columns = real_columns(residual)
            z = solver.solve(columns)
            basis.append(z)
            length = np.linalg.norm(modes.right, axis=0).min()  # in the norm of P
            long |= bool((np.einsum("ij,ij->j", columns, z) > _LONG * length**2).any())
        return long

    def coordinates(self, shapes: np.ndarray) -> np.ndarray:
        """Return coarse modes, given in the coarse model's coordinates, in those of this one."""
        return np.asarray(self._coordinates @ shapes)

    @staticmethod
    def _asked(basis: ReducedBasis, value: float, model: ReducedModel) -> Modes:
        """Return the modes up to those asked for; of λ and −λ*, with equal shapes, one."""
        modes = basis.modes(value, model.highest)
        if not basis.problem.is_damped:
            modes = modes.select(np.flatnonzero(modes.lam.real >= 0))
        return modes
