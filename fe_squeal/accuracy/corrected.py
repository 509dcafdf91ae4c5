"""A reduced model of the problem on the refined mesh, from the modes of the mesh itself and their corrections.

"Coarse" is the mesh whose error is asked for, "refined" or "fine" the same with every element cut into eight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..eigen.blocks import combine, cross, times
from ..eigen.pencil import Modes
from ..reduced.basis import ReducedBasis
from ..reduced.vectors import interior_nodes, range_of, real_columns, unit_columns
from ..sweep.scale import Scale
from .corrections import Correction, solved
from .refined import Refined
from .two_level import TwoLevelSolver

# A mode whose correction has more than _LONG of its energy is corrected once more; of that second correction, energies
# below _NEGLIGIBLE times that of the first need not be found. Chosen on three coarse meshes of a brake: the
# changes of λ came out right to 2.5 %, and the changes of onsets to 6 %.
_LONG, _NEGLIGIBLE = 0.005, 0.001
_NODES = 5  # values of the parameter whose modes span the final basis
_FINE = 1e-5  # of a vector's norm: if its part outside the basis is smaller, the basis is not enlarged by it
# Of the energy of a complex correction, that is about of the change of its eigenvalue: parts with less are left out, as
# the imaginary parts of lightly damped modes.
_FAINT = 1e-3


class CorrectedModel:
    """The Galerkin projection of the refined problem on coarse modes φ and their corrections −P⁻¹Q(λ)φ.

    What the coarse mesh cannot represent vibrates at frequencies far above those of the modes, and there Q(λ) is close
    to P = K − σM. So the correction is about what a step of inverse iteration on the refined mesh would add. Right and
    left modes are corrected: the error of an eigenvalue's change is then the product of the errors of both corrections.

    Parameters
    ----------
    refined : Refined
    corrections : mapping of float to Correction
        Those of right modes, see `right_corrections`; those of left modes at both ends of the sweep are added here.

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

    def __init__(self, refined: Refined, corrections: Mapping[float, Correction]) -> None:
        model, collected, parameter = refined.model, refined.problem, refined.parameter
        values = refined.values
        basis = ReducedBasis(collected, parameter, refined.metric, model.basis.sigma, None, model.linear_solver)
        if model.basis.has_slow:
            basis.expect_slow_motions()
        unheld = collected.free_motions().motions
        if unheld.shape[1]:
            basis.append(unheld)
        nodes = _nodes(values)
        own = _span(model.basis, refined, [*nodes, float(values[0]), float(values[-1])])
        EV = times(refined.prolongation, combine(model.basis.V, own))
        basis.append(EV)
        for correction in corrections.values():
            basis.append(_main_columns(correction.right, correction.energies, refined))
        for value in sorted({float(values[0]), float(values[-1])}):
            self._correct_left(basis, refined, value, corrections[value])
        self.iterations = refined.solver.iterations
        self.basis = basis
        W = _span(basis, refined, nodes)
        self._coordinates = W.T @ cross(basis.V, times(refined.P, EV)) @ own.T
        self.projected = basis.restricted(W).collected()

    def _correct_left(self, basis: ReducedBasis, refined: Refined, value: float, first: Correction) -> None:
        """Add the corrections of left modes at a value to the basis; then correct modes again that changed much."""
        modes, energies = first.modes, [first.energies]
        assert modes.left is not None
        if basis.pencil(value).problem_class != "symmetric":
            z, of_left = solved(refined.solver, first.left_residuals)
            basis.append(_main_columns(z, of_left, refined))
            energies.append(of_left)
        sides = zip(energies, (modes.right, modes.left), strict=False)
        long = np.any([own > _LONG * np.linalg.norm(side, axis=0) ** 2 for own, side in sides], axis=0)
        if long.any():
            now = _asked(basis, value, refined)
            rows, same = linear_sum_assignment(np.abs(modes.lam[:, None] - now.lam))
            again = long[rows]
            self._correct(basis, refined.solver, value, now.select(same[again]), [e[rows[again]] for e in energies])

    def _correct(
        self, basis: ReducedBasis, solver: TwoLevelSolver, value: float, modes: Modes, energies: Sequence[np.ndarray]
    ) -> None:  # fmt: skip
        """Add corrections of modes of the projection to the basis, right ones and maybe left ones.

        The energies (k,) are those of the corrections that the basis has already.
        """
        for residual, own in zip(basis.residuals(value, modes), energies, strict=False):
            loaded = residual.any(axis=0)
            limits = _NEGLIGIBLE * np.tile(own, residual.shape[1] // len(own))
            basis.append(solver.solve(np.compress(loaded, residual, axis=1), limits[loaded]))

    def coordinates(self, shapes: np.ndarray) -> np.ndarray:
        """Return modes of the coarse mesh (r, k) in the coordinates of this model.

        Parameters
        ----------
        shapes : (r_coarse, k) float or complex
            The modes in the coordinates of `Refined.model`.
        """
        return np.asarray(self._coordinates @ shapes)


def _main_columns(z: np.ndarray, energies: np.ndarray, refined: Refined) -> np.ndarray:
    """Return real columns that span corrections z (n, k), but for parts of complex ones with less than `_FAINT`.

    The energies (k,) are zᴴPz.
    """
    if not np.iscomplexobj(z):
        return z
    loaded = energies > 0
    parts = real_columns(z[:, loaded] / np.sqrt(energies[loaded]))
    w, v = np.linalg.eigh(cross(parts, times(refined.P, parts)))
    return combine(parts, v[:, w > _FAINT])


def _asked(basis: ReducedBasis, value: float, refined: Refined) -> Modes:
    """Return the modes up to the highest frequency of the coarse mesh, of all values of the sweep.

    Without damping λ and −λ* have the same shape, and only the one with Re λ ≥ 0 is returned.
    """
    modes = basis.modes(value, refined.reach)
    if not basis.problem.is_damped:
        modes = modes.select(np.flatnonzero(modes.lam.real >= 0))
    return modes


def _nodes(values: np.ndarray) -> list[float]:
    """Return values of the parameter whose modes span the final basis: Chebyshev's nodes in the sweep's coordinate.

    Over decades modes may change fast towards an end, and both ends are among them.
    """
    scale, ends = Scale.of(values), [float(values[0]), float(values[-1])]
    low, high = map(scale.x, ends)
    nodes = [scale.p(float(x)) for x in interior_nodes(low, high, _NODES if len(values) > 1 else 1)]
    return [ends[0], *nodes, ends[1]] if scale.logarithmic else nodes


def _span(basis: ReducedBasis, refined: Refined, values: Sequence[float]) -> np.ndarray:
    """Return (r, k) orthonormal columns on a basis that span its right and left modes at some values."""
    spanned = []
    for value in values:
        modes = _asked(basis, value, refined)
        assert modes.left is not None
        spanned.append(unit_columns(modes.right, modes.left))
    return range_of(np.hstack(spanned), _FINE, basis.free_motions(float(refined.values[0])).motions)
