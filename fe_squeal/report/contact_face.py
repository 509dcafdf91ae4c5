"""Pressure and directions on the face of a contact, as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fe_squeal.report.shapes import Floats


@dataclass(frozen=True)
class ContactFace:
    """Pressure and directions at the points of one contact's face.

    Attributes
    ----------
    points : (q, 3) float, m
        Quadrature points.
    normals : (q, 3) float
        Unit normals, out of the counterface.
    directions : (q, 3) float
        Unit vectors along the counterface's velocity relative to the pad; zero where nothing slides.
    weights : (q,) float, m²
        Area that each point stands for.
    pressure : (q,) float, Pa
    closed : (q,) bool
        Whether pad and counterface touch.
    normal_force : float, N
    torque : float, N m
        Torque of the friction forces about the axis of rotation; NaN if there is no such axis.
    """

    points: Floats
    normals: Floats
    directions: Floats
    weights: Floats
    pressure: Floats
    closed: NDArray[np.bool_]
    normal_force: float
    torque: float = np.nan

    @property
    def closed_part(self) -> float:
        """Closed area over the whole area."""
        return float(self.weights[self.closed].sum() / self.weights.sum())
