"""Follow a stability boundary: pseudo-arclength continuation with Newton's method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import NotConvergedError
from .boundary import Boundary, Residual

_STEP, _LEAST, _MOST = 0.01, 1e-6, 0.03  # length of a step in u: the first, the smallest and the largest
_TURN = 0.97  # smallest cosine of the angle between the tangents at two neighbouring points
_ROUNDS = 8  # steps of Newton's method, at most
_POINTS = 4000  # points of a curve in one direction, at most
_SMALL = 1e-10  # length of a Newton step in u: with shorter ones that no longer shrink, rounding is reached
_SINGULAR = "boundary: the equations are singular"
_SAME = 1e-6  # distance in u: two points that are closer together are the same point


@dataclass(frozen=True)
class CurvePoint:
    """A point of a boundary.

    Attributes
    ----------
    u : (2,) or (3,) float
        The point, see `Boundary`.
    tangent : (2,) or (3,) float
        Unit vector along the boundary.
    residual : Residual
        The equations and their derivatives at the point.
    uncertainty : float
        How far the boundary may be from the point, as a part of the map's width: rounding, and the last Newton step.
    """

    u: np.ndarray
    tangent: np.ndarray
    residual: Residual
    uncertainty: float


def solve_point(boundary: Boundary, u: np.ndarray, fixed: np.ndarray) -> CurvePoint:
    """Return the point of the boundary in the plane through u with the normal `fixed`, by Newton's method.

    Parameters
    ----------
    boundary : Boundary
    u, fixed : (2,) or (3,) float

    Raises
    ------
    NotConvergedError
        The iteration does not converge, or the equations are singular.
    """
    start, last = u, np.inf
    for _ in range(_ROUNDS):
        residual = _regular(boundary, u)
        try:
            step = np.linalg.solve(
                np.vstack([residual.J, fixed]), np.append(-residual.F, -float(fixed @ (u - start)))
            )
        except np.linalg.LinAlgError as error:
            raise NotConvergedError(_SINGULAR) from error
        size = float(np.linalg.norm(step))
        if not np.isfinite(size) or size > 1.0:
            break
        u = u + step
        if boundary.kind != "divergence" and u[0] <= 0:
            break
        if size < _SMALL or (size < 1e-7 and size > 0.25 * last):
            residual = _regular(boundary, u)
            boundary.rebase(residual.right, residual.left)
            slope = float(np.hypot(*residual.slopes))
            rounding = residual.rounding / slope if slope else np.inf
            return CurvePoint(u, _tangent(residual.J), residual, size + rounding)
        last = size
    raise NotConvergedError("boundary: Newton's method did not converge")


def _regular(boundary: Boundary, u: np.ndarray) -> Residual:
    """Return the equations at u; raises NotConvergedError where they are singular."""
    try:
        return boundary.at(u)
    except np.linalg.LinAlgError as error:
        raise NotConvergedError(_SINGULAR) from error


def _tangent(J: np.ndarray) -> np.ndarray:
    """Return the unit vector that J maps to zero."""
    return np.asarray(np.linalg.svd(J)[2][-1])


@dataclass(frozen=True)
class Curve:
    """A boundary from one end to the other.

    Attributes
    ----------
    boundary : Boundary
        Its equations.
    points : list of CurvePoint
        Its points in order.
    closed : bool
        Whether it returns to its first point.
    ends : (str, str)
        Why it ends at either side: "box" (it leaves the map), "closed", or a sentence on why it could not be followed.
    """

    boundary: Boundary
    points: list[CurvePoint]
    closed: bool
    ends: tuple[str, str]

    @property
    def u(self) -> np.ndarray:
        """The points (m, 2) or (m, 3)."""
        return np.stack([p.u for p in self.points])

    def passes(self, u: np.ndarray, fixed: int) -> bool:
        """Return whether the curve goes through a point u (2,) or (3,) that was found with coordinate `fixed` held."""
        U = self.u
        if U.shape[1] != len(u):
            return False
        across = np.zeros(len(u))
        across[fixed] = 1.0
        # Where the curve meets the plane of this coordinate: both sides of a narrow tongue do, close to each other.
        off = U[:, fixed] - u[fixed]
        meets = np.flatnonzero(off[:-1] * off[1:] <= 0)
        part = off[meets] / np.where(off[meets] == off[meets + 1], 1.0, off[meets] - off[meets + 1])
        starts = U[meets] + part[:, None] * (U[meets + 1] - U[meets])
        nearest = int(np.argmin(np.linalg.norm(U - u, axis=1)))
        places, starts = np.append(meets, nearest), np.vstack([starts, U[nearest]])
        starts[:, fixed] = u[fixed]
        for i in np.flatnonzero(np.linalg.norm(starts - u, axis=1) <= 2 * _MOST).tolist():
            residual = self.points[places[i]].residual
            self.boundary.rebase(residual.right, residual.left)
            try:
                if np.linalg.norm(solve_point(self.boundary, starts[i], across).u - u) < _SAME:
                    return True
            except NotConvergedError:
                continue
        return False


def follow(boundary: Boundary, start: CurvePoint) -> Curve:
    """Follow a boundary from one of its points in both directions, until it leaves the map or returns to the point."""
    ahead, end = _one_way(boundary, start, start.tangent)
    if end == "closed":
        return Curve(boundary, [start, *ahead, start], True, (end, end))
    boundary.rebase(start.residual.right, start.residual.left)
    behind, begin = _one_way(boundary, start, -start.tangent)
    return Curve(boundary, [*reversed(behind), start, *ahead], False, (begin, end))


def _one_way(boundary: Boundary, start: CurvePoint, tangent: np.ndarray) -> tuple[list[CurvePoint], str]:
    points: list[CurvePoint] = []
    here, step, first = start, _STEP, tangent
    while len(points) < _POINTS:
        try:
            new = solve_point(boundary, here.u + step * tangent, tangent)
            forward = new.tangent * np.sign(new.tangent @ tangent or 1.0)
            good = forward @ tangent > _TURN and np.linalg.norm(new.u - here.u) < 1.5 * step
        except NotConvergedError:
            good = False
        if not good:
            boundary.rebase(here.residual.right, here.residual.left)
            step /= 2
            if step < _LEAST:
                return points, "the curve could not be followed further"
            continue
        s = new.u[-2:]
        if (s < 0).any() or (s > 1).any():
            last = _at_the_edge(boundary, here, new)
            return (points if last is None else [*points, last]), "box"
        points.append(new)
        if _returns(boundary, start, first, here, new):
            return points, "closed"
        here, tangent, step = new, forward, min(1.5 * step, _MOST)
    return points, f"more than {_POINTS} points"


def _returns(boundary: Boundary, start: CurvePoint, first: np.ndarray, here: CurvePoint, new: CurvePoint) -> bool:
    """Return whether the boundary goes through its start between two points, in the direction `first` that it left in.

    The other side of a narrow tongue may lie as near, but goes the other way, and not through the start.
    """
    a, b = (here.u - start.u) @ first, (new.u - start.u) @ first
    if not a < 0 <= b:
        return False
    u = here.u + a / (a - b) * (new.u - here.u)
    if np.linalg.norm(u - start.u) > np.linalg.norm(new.u - here.u):
        return False
    try:
        found = bool(np.linalg.norm(solve_point(boundary, u, first).u - start.u) < _SAME)
    except NotConvergedError:
        found = False
    boundary.rebase(new.residual.right, new.residual.left)
    return found


def _at_the_edge(boundary: Boundary, here: CurvePoint, beyond: CurvePoint) -> CurvePoint | None:
    """Return the point where the boundary leaves the map between two points, one inside and one outside, or None."""
    best = None
    for i in (-2, -1):
        for edge in (0.0, 1.0):
            a, b = here.u[i] - edge, beyond.u[i] - edge
            if a * b >= 0:
                continue
            u = here.u + (a / (a - b)) * (beyond.u - here.u)
            u[i] = edge
            across = np.zeros(len(u))
            across[i] = 1.0
            try:
                point = solve_point(boundary, u, across)
            except NotConvergedError:
                continue
            point.u[i] = edge
            other = point.u[-1 if i == -2 else -2]
            if -1e-12 <= other <= 1 + 1e-12 and best is None:
                best = point
    return best
