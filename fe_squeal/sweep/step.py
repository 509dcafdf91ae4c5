"""One step of a sweep: the modes at its ends, and at any value between, by a projection of the problem."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..eigen.blocks import faster
from ..eigen.dense import solve_dense
from ..eigen.linear.factor import LinearSolver
from ..eigen.pencil import FreeMotions, Modes, Pencil
from ..problem.forms import is_linear, project
from ..problem.interpolation import interpolate, interpolate_beside
from ..problem.parameters import paths_of
from ..problem.problem import Problem
from ..reduced import ReducedModel, SlowMotions
from .nodes import Node, node_of, spread_of
from .samples import FARTHEST

_DEPENDENT = 1e-12  # of the largest eigenvalue of a Gram matrix: directions with smaller ones are left out of the basis
_BALANCED = 1e-11  # of |K||z|: if the forces Kz of a motion are smaller, they are rounding, and the motion is rigid
_KNOWN = 1e-6  # of a motion: one that differs by less from motions that nothing holds is one of these
_SPANNED = 1e-4  # of a vector's length: if its part outside the rigid motions is shorter, that is rounding
_ALIKE = 1e-6  # of θ, or of λ: the eigenvalues at the ends may differ so much from those of the step model
_NEARBY = 1e-3  # of a value: how far from it matrices are interpolated around it
_ABOVE = 1.2  # times the frequency up to which modes are known at the ends: those of the step model are taken to there
_NOISE = 1e-9  # of an eigenvalue: slopes may part copies by so much over a step
_COPIES = 0.1  # times the tolerance: by so much a projection may part eigenvalues of equal parts of a brake
_SMALL = 60  # unknowns up to which the step model is the problem itself


class Step:
    """One step of a sweep, with its step model: the projection of the problem on the modes of both ends.

    With right and left modes in the basis the error of an eigenvalue is the product of the errors of both. Inside one
    step this is small enough to see which modes change their stability, and to start Newton's method on the problem.

    The step model is not the reduced model, which is accurate over the whole sweep. If there is a reduced model, the
    step model is a projection of it; otherwise it is a projection of the problem itself.

    Attributes
    ----------
    full : Problem
        The problem itself.
    problem : Problem
        The problem that the modes are given on, with n unknowns: that of the reduced model if there is one, else
        `full`.
    reduced_model : ReducedModel or None
    parameter : str
    ends : (float, float)
        Values of the parameter at both ends.
    model : Problem
        The step model, with r unknowns.
    V : (n, r) float
        Its basis, in the coordinates of `problem`.
    MV : (n, r) float
        The basis times the mass matrix.
    rigid : (n, k) float or None
        The modes with λ = 0 at either end, M-orthonormal.
    modes_at_ends : (Modes, Modes)
    apart : float
        How far eigenvalues of copies may be apart, relatively, by the projections that are made.
    reach : float, rad/s
        Up to this |λ| modes of the step model are taken; it may be changed.
    """

    def __init__(
        self, problem: Problem, parameter: str, values: tuple[float, float], modes: tuple[Modes, Modes],
        reduced_model: ReducedModel | None, linear_solver: LinearSolver | str, known: float = 0.0,
        tolerance: float = 1e-8,
    ) -> None:  # fmt: skip
        self.reach = _ABOVE * max(known, *(float(np.abs(m.lam).max(initial=0.0)) for m in modes))
        self.full, self.parameter, self.reduced_model, self.ends = problem, parameter, reduced_model, values
        self.linear_solver, self.modes_at_ends = linear_solver, modes
        self.problem = problem = problem if reduced_model is None else reduced_model.collected
        M = faster(problem.pencil({parameter: values[0]}).M)
        rigid = np.hstack([m.right[:, m.lam == 0].real for m in modes])
        self.rigid = _orthonormal(rigid, M) if rigid.any() else None
        if problem.unknowns <= _SMALL:
            self.V = np.eye(problem.unknowns)
        else:
            vectors = [v for m in modes for v in (m.right, m.left) if v is not None]
            self.V = _orthonormal(np.hstack([p for v in vectors for p in (v.real, v.imag) if p.any()]), M)
            if self.rigid is not None:
                # Rigid motions are put into the basis exactly: even a small error of theirs deforms stiff elements.
                Z = self.rigid
                rest = self.V - Z @ (Z.T @ (M @ self.V))
                size = np.sqrt(np.maximum(np.einsum("ij,ij->j", rest, M @ rest), 0.0))
                self.V = np.hstack([Z, _orthonormal(rest[:, size > _SPANNED], M)])
            if self.V.shape[1] == problem.unknowns:  # all modes are in the basis: the step model is the problem itself
                self.V = np.eye(problem.unknowns)
        projected = reduced_model is not None or self.V.shape[1] < problem.unknowns
        self.apart = min(_COPIES * tolerance, FARTHEST) if projected else 0.0
        self._inside = interpolate(problem, parameter, *values)
        self.model = project(self._inside, self.V)
        self.MV = M @ self.V
        slow = None
        if self.rigid is not None and reduced_model is None:
            slow = SlowMotions.of(problem.pencil({parameter: values[0]}).K, self.rigid, self.rigid.T @ self.MV)
        elif self.rigid is not None and reduced_model is not None and reduced_model.basis.slow is not None:
            slow = reduced_model.basis.slow.on(self.V)
        self._cancelled = None if slow is None else slow.cancelled

    @property
    def width(self) -> float:
        """The distance between the ends."""
        return abs(self.ends[1] - self.ends[0])

    @property
    def in_theta(self) -> bool:
        """Whether eigenvalues are θ = −λ², and not λ: there is no C."""
        return not any(t.slot == "C" for t in self.model.terms)

    @property
    def is_linear(self) -> bool:
        """Whether K is linear in the parameter."""
        return self.problem.is_affine(self.parameter) and is_linear(self.model, self.parameter)

    @property
    def is_curved(self) -> bool:
        """Whether any matrix of the step model changes otherwise than linearly."""
        swept = paths_of(self.parameter)
        return any(sum(t.powers.get(path, 0) for path in swept) not in (0, 1) for t in self.model.terms)

    def near(self, value: float) -> float:
        """Return up to which distance from a value matrices are interpolated around it."""
        return _NEARBY * max(abs(value), self.width)

    def beside(self, problem: Problem, value: float) -> Problem:
        """Return a problem interpolated beside a value, over the distance from it."""
        (low, high), h = self.ends, self.near(value)
        return interpolate_beside(problem, self.parameter, max(value - h, low), min(value + h, high), value)

    def pencil(self, p: float) -> Pencil:
        """Return the matrices of `problem` at a value, with the rounding that projection has left in slow motions."""
        pencil = self.problem.pencil({self.parameter: p})
        slow = None if self.reduced_model is None else self.reduced_model.basis.slow
        return pencil if slow is None else replace(pencil, cancelled=slow.cancelled)

    def modes(self, p: float, highest: float = np.inf) -> Modes:
        """Return the modes of the step model at a value, up to |λ| = highest, rad/s."""
        return self._modes(self.model, self._inside.at({self.parameter: p}).free_motions(), p, highest)

    def _modes(self, model: Problem, known: FreeMotions, p: float, highest: float) -> Modes:
        if len(self.V) > self.V.shape[1]:
            damping = None if known.damping is None else self.V.T @ known.damping
            known = FreeMotions(self.MV.T @ known.motions, damping)
        pencil = replace(model.pencil({self.parameter: p}), cancelled=self._cancelled, free=known)
        return solve_dense(pencil, highest, self.linear_solver)

    def shapes(self, modes: Modes) -> tuple[np.ndarray, np.ndarray]:
        """Return right and left modes of `problem` in the coordinates of the step model, both (r, k)."""
        pair = (modes.right, modes.right if modes.left is None else modes.left)
        if len(self.V) == self.V.shape[1]:
            return pair
        right, left = (np.asarray(self.MV.T @ u) for u in pair)
        return right, left

    def end(self, which: int) -> Node:
        """Return the node of one of the ends, 0 or 1.

        If rounding has moved eigenvalues of the end by more than `_ALIKE`, or slopes there part copies by more than
        `_NOISE`, those of the step model are taken instead: they are smooth functions of the parameter over the step.
        """
        node = self._known[which]
        sure = node.shift <= _ALIKE and node.noise_of_copies(self.width, self.apart) <= _NOISE
        return node if sure else self.between(self.ends[which])

    @cached_property
    def _known(self) -> tuple[Node, Node]:
        first, second = (
            node_of(self.model, self.parameter, p, m, self.shapes(m), self.apart)
            for p, m in zip(self.ends, self.modes_at_ends, strict=True)
        )
        return first, second

    def between(self, p: float) -> Node:
        """Return the node of a value between the ends: modes of the step model, to above the |λ| known at these.

        The step model contains the rounding of the problem's own matrices. So each eigenvalue is taken to be at least
        as uncertain as the nearest one at the ends.
        """
        return self._node(self.model, p, self.modes(p, self.reach))

    def listed(self, p: float) -> Node:
        """Return what `between` does, without modes that decay and hardly swing if the modes at the ends have none.

        A solver that looks for the modes that swing or grow lists none of the others, of which an overdamped problem
        has many, and a projection on the first ones has them wrong. Where nothing is damped a decaying mode is the
        mirror image of a growing one and belongs to it, with gyroscopic forces too.
        """
        mirrored = self.in_theta or all(t.conservative for t in self.model.terms)
        if mirrored or any(_creeping(m).any() for m in self.modes_at_ends):
            return self.between(p)
        modes = self.modes(p, self.reach)
        return self._node(self.model, p, modes.select(np.flatnonzero(~_creeping(modes))))

    def exact(self, p: float) -> Node:
        """Return the same of matrices that are made at the value, and not interpolated.

        Raises
        ------
        SceneError, NotConvergedError
            There is no static state at the value.
        """
        if self.problem.is_affine(self.parameter):
            return self.between(p)
        here = self.problem.at({self.parameter: p})
        model = project(here, self.V)
        model = replace(model, parameters={**model.parameters, **dict.fromkeys(paths_of(self.parameter), p)})
        return self._node(model, p, self._modes(model, here.free_motions(), p, self.reach))

    def _node(self, model: Problem, p: float, modes: Modes) -> Node:
        left = modes.right if modes.left is None else modes.left
        node = node_of(model, self.parameter, p, modes, (modes.right, left), self.apart)
        at, blur = (np.concatenate([getattr(n, name) for n in self._known]) for name in ("v", "blur"))
        if not len(at):
            return node
        blur = np.maximum(node.blur, blur[np.abs(node.v[:, None] - at[None, :]).argmin(axis=1)])
        spread = blur if node.C is not None else spread_of(node.lam, blur)
        return replace(node, blur=blur, unstable=node.unstable & (node.lam.real > spread))

    def free(self, problem: Problem) -> np.ndarray | None:
        """Return the rigid motions Z (n, k) of both ends in the coordinates of a problem; None unless KZ = 0 at both.

        Parameters
        ----------
        problem : Problem
            `full`, `problem`, `model`, or `problem` on a basis with further vectors behind the others.
        """
        if self.rigid is None:
            return None
        Z = self.rigid if self.reduced_model is None else self.reduced_model.lift(self.rigid)
        for p in self.ends:
            here = self.full.at({self.parameter: p})
            known = here.free_motions().motions  # KZ = 0 holds for these by what the problem is made of
            inside = known @ np.linalg.lstsq(known, Z, rcond=None)[0]
            if np.linalg.norm(Z - inside) <= _KNOWN * np.linalg.norm(Z):
                Z = inside
                continue
            K = here.pencil().K
            if np.linalg.norm(K @ Z) > _BALANCED * np.linalg.norm(abs(K) @ np.abs(Z)):
                return None
        if problem is self.model:
            return self.rigid if len(self.V) == self.V.shape[1] else np.asarray(self.MV.T @ self.rigid)
        if problem is self.full and self.reduced_model is not None:
            return Z
        return np.pad(self.rigid, ((0, problem.unknowns - len(self.rigid)), (0, 0)))


def real_direction(vectors: np.ndarray) -> np.ndarray:
    """Return the real vector (n,) that complex columns (n, k) have in common.

    It is the leading left singular vector of their real and imaginary parts.
    """
    parts = np.hstack([vectors.real, vectors.imag])
    _, v = np.linalg.eigh(parts.T @ parts)
    return np.asarray(parts @ v[:, -1])


def _creeping(modes: Modes) -> np.ndarray:
    """Return which modes, (k,) bool, decay as fast as they swing, or faster."""
    return np.asarray(-modes.lam.real >= np.maximum(modes.lam.imag, np.finfo(float).tiny))


def _orthonormal(vectors: np.ndarray, M: sp.csr_array | np.ndarray) -> np.ndarray:
    """Return an M-orthonormal basis of the span of the columns."""
    # Columns are scaled to equal length first, since left and right vectors may differ in length by any factor.
    size = np.sqrt(np.maximum(np.einsum("ij,ij->j", vectors, M @ vectors), 0.0))
    vectors = vectors[:, size > 0] / size[size > 0]
    # The Gram matrix has the squared condition of the columns, which costs accuracy; a second pass restores it.
    for _ in range(2):
        w, v = np.linalg.eigh(vectors.T @ (M @ vectors))
        keep = w > _DEPENDENT * w.max()
        vectors = np.asarray(vectors @ (v[:, keep] / np.sqrt(w[keep])))
    return vectors
