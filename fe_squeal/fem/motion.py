"""The steady motion of a counterface or of a body that turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_AT_REST = 1e-9  # of the largest velocity: what is slower does not slide, as on the axis
_FLAT = 1e-3  # rad: normals of a flat surface are no farther apart

@dataclass(frozen=True)
class SteadyMotion:
    """Steady motion of a counterface, or of a body: rotation about an axis, or a straight belt.

    Attributes
    ----------
    velocity : (3,) float
        Belt: direction times speed, m/s; rotation: axis times angular speed, rad/s.
    centre : (3,) float or None, m
        A point of the axis of rotation; None for a belt.
    backward : bool
        Whether the speed was given below zero: the axis or direction as it was given is that of −velocity.
    """

    velocity: np.ndarray
    centre: np.ndarray | None = None
    backward: bool = False

    @property
    def way(self) -> tuple[float, ...]:
        """What decides on the direction of sliding: all but the speed."""
        unit = np.round(self.velocity / np.linalg.norm(self.velocity), 15)
        return (*unit.tolist(), *(self.centre.tolist() if self.centre is not None else ()))

    def velocities(self, points: np.ndarray) -> np.ndarray:
        """Return the counterface's velocity at (q, 3) points, (q, 3) m/s."""
        if self.centre is None:
            return np.broadcast_to(self.velocity, points.shape)
        return np.cross(self.velocity, points - self.centre)

    def across(self, points: np.ndarray, normals: np.ndarray, weights: np.ndarray) -> float:
        """Return which part of the velocity is normal to a surface, from 0 to 1, in the mean of squares.

        Parameters
        ----------
        points, normals : (q, 3) float
        weights : (q,) float, m^2
        """
        v = self.velocities(points)
        whole = float(weights @ np.sum(v**2, axis=1))
        return float(np.sqrt(weights @ np.sum(v * normals, axis=1) ** 2 / whole)) if whole else 0.0

    def normals_across(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return the normals (q, 3) of a surface without what they have along the velocity.

        A surface that something slides on steadily is carried into itself, so that its normals are across the velocity.
        Those of a drum with straight edges are not: sliding along a facet that is not tangential would open and close
        the gap. A surface that `is_flat` had better keep its normal: there it is the direction of sliding that may be
        slightly off.

        Parameters
        ----------
        points, normals : (q, 3) float
        """
        v = self.velocities(points)
        square = np.sum(v**2, axis=1, keepdims=True)
        slides = square > (_AT_REST**2) * square.max(initial=0.0)
        along = np.divide(np.sum(v * normals, axis=1, keepdims=True), square, out=np.zeros_like(square), where=slides)
        across = normals - along * v
        size = np.linalg.norm(across, axis=1, keepdims=True)
        return np.where(size > _AT_REST, across / np.maximum(size, _AT_REST), normals)

    def speeds(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return the sliding speeds |v| in the plane across the normals, (q,) m/s."""
        v = self.velocities(points)
        return np.asarray(np.linalg.norm(v - np.sum(v * normals, axis=1, keepdims=True) * normals, axis=1))

    def directions(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return unit sliding directions t in the plane across the normals, (q, 3); zero where nothing slides."""
        v = self.velocities(points)
        tangential = v - np.sum(v * normals, axis=1, keepdims=True) * normals
        size = np.linalg.norm(tangential, axis=1, keepdims=True)
        slides = size > _AT_REST * np.linalg.norm(v, axis=1).max(initial=0.0)
        return np.divide(tangential, size, out=np.zeros_like(tangential), where=slides)


def is_flat(normals: np.ndarray) -> bool:
    """Return whether a surface is flat, from its normals (q, 3)."""
    return bool(np.linalg.norm(normals - normals.mean(axis=0), axis=1).max() <= _FLAT)
