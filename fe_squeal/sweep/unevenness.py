"""Whether matrices that are made anew at each value change too unevenly within a step to be interpolated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..errors import NotConvergedError, SceneError
from ..problem.terms import sum_matrices
from .changes import Change
from .nodes import Node
from .step import Step

_PLACES = 0.25, 0.75  # of the step: in the middle of what lies between two values that matrices are interpolated from
# How far interpolation may move an eigenvalue: as a part of its distance to where stability would change, and of
# itself. The smaller two are for the difference from a straight line, where matrices need not be made to see it.
_ALLOWED, _BENT = (0.3, 2e-5), (0.03, 2e-6)
_CHANGING = 1e-2  # of |λ|: a mode nearer than this to one whose stability changes is not looked at, since that is found


def is_uneven(step: Step, changes: Sequence[Change], below: float) -> bool:
    """Return whether a change of stability may be missed since matrices were interpolated over a step.

    As a contact opens they bend within a small part of it. The modes of the interpolated matrices are compared with
    those of the matrices themselves a quarter of the way, on the vectors of the step model; and three quarters of it if
    matrices differ from a straight line so much that it matters. A contact that opens just in the middle shows at both.

    Parameters
    ----------
    step : Step
    changes : sequence of Change
        Those that were found.
    below : float, rad/s
        Frequency up to which modes matter.
    """
    if step.problem.is_affine(step.parameter):
        return False
    known = np.array([abs(c.v) ** (0.5 if step.in_theta else 1.0) for c in changes])
    bends = any(_bends(step, step.end(i), known, below) for i in (0, 1))
    low, high = step.ends
    for share in _PLACES if bends else _PLACES[:1]:
        p = low + share * (high - low)
        try:
            exact = step.exact(p)
        except (SceneError, NotConvergedError):  # at both ends there is a static state
            return True
        node = step.between(p)
        distance = np.abs(node.v[:, None] - exact.v[None, :])
        mine, other = linear_sum_assignment(distance)
        moved = np.full(len(node), np.inf)
        moved[mine] = distance[mine, other]
        if _matters(node, moved, known, below, _ALLOWED):
            return True
    return False


def _bends(step: Step, node: Node, known: np.ndarray, below: float) -> bool:
    """Return whether the middle of the step, put on a straight line between its ends, would move eigenvalues."""
    low, high = step.ends
    values = [step.model.pencil({step.parameter: p}) for p in (low, (low + high) / 2, high)]
    rest = 0.0
    for slot in ("M", "C", "K"):
        # Without friction there may be no C, as of friction damping.
        weighted = zip((-0.5, 1.0, -0.5), (getattr(pencil, slot) for pencil in values), strict=True)
        bent = sum_matrices((A, weight) for weight, A in weighted if A is not None)
        if bent is None:
            continue
        power = {"M": 2, "C": 1, "K": 0}[slot]
        rest = rest + np.einsum("ij,ij->j", node.left.conj(), bent @ node.right) * node.lam**power
    slope = np.einsum("ij,ij->j", node.left.conj(), node.M @ node.right)
    if node.C is not None:
        slope = 2 * node.lam * slope + np.einsum("ij,ij->j", node.left.conj(), node.C @ node.right)
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = np.nan_to_num(np.abs(rest / slope), nan=np.inf)
    return _matters(node, moved, known, below, _BENT)


def _matters(
    node: Node, moved: np.ndarray, known: np.ndarray, below: float, allowed: tuple[float, float]
) -> bool:  # fmt: skip
    """Return whether eigenvalues of a node move (k,) so far that a change of stability might come or go."""
    v, size = node.v, np.abs(node.lam)
    if node.paired:
        apart = np.abs(v[:, None] - v[None, :])
        np.fill_diagonal(apart, np.inf)
        away = np.minimum(apart.min(axis=1, initial=np.inf), np.abs(v))
    else:  # a mode crosses the axis by itself: where θ is real, or λ imaginary
        away = np.abs(v.imag if node.C is None else v.real)
    near = (np.abs(size[:, None] - known[None, :]) <= _CHANGING * size[:, None]).any(axis=1)
    looked_at = (node.lam != 0) & (np.abs(node.lam.imag) <= below) & ~near
    return bool((moved > allowed[0] * away + allowed[1] * np.abs(v))[looked_at].any())
