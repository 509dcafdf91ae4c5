"""Nastran coordinate systems CORD2R, CORD2C and CORD2S, one defined in another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...raw import Floats
from .text import Card, real

SYSTEMS = ("CORD2R", "CORD2C", "CORD2S")


@dataclass(frozen=True)
class System:
    """A coordinate system: kind "R", "C" or "S", the system it is defined in (0: the basic one), points A, B, C."""

    kind: str
    reference: int
    points: Floats


def read_system(card: Card) -> tuple[int, System]:
    """Return the number and the system that a card defines; A is the origin, B on the z axis, C in the xz plane."""
    values = np.array([real(card.text(i)) for i in range(2, 11)]).reshape(3, 3)
    return int(card.text(0)), System(card.name[-1], int(card.text(1) or 0), values)


def to_global(points: Floats, number: int, systems: dict[int, System], seen: tuple[int, ...] = ()) -> Floats:
    """Return points (n, 3), given in the coordinates of a system, in those of the basic system; angles are in degrees.

    Raises
    ------
    ValueError
        A system is missing, is defined by itself, or has its three points on one line.

    Examples
    --------
    >>> polar = System("C", 0, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]))
    >>> to_global(np.array([[2.0, 90.0, 5.0]]), 1, {1: polar}).round(12).tolist()
    [[0.0, 2.0, 5.0]]
    """
    if number == 0:
        return points
    if number in seen:
        raise ValueError("it is defined by itself")
    if number not in systems:
        raise ValueError(f"it is defined in system {number}, which the file does not hold")
    system = systems[number]
    if system.kind == "C":
        angle = np.deg2rad(points[:, 1])
        points = np.column_stack([points[:, 0] * np.cos(angle), points[:, 0] * np.sin(angle), points[:, 2]])
    elif system.kind == "S":
        polar, angle = np.deg2rad(points[:, 1]), np.deg2rad(points[:, 2])
        flat = points[:, 0] * np.sin(polar)
        points = np.column_stack([flat * np.cos(angle), flat * np.sin(angle), points[:, 0] * np.cos(polar)])
    a, b, c = to_global(system.points, system.reference, systems, (*seen, number))
    z, y = b - a, np.cross(b - a, c - a)
    if not np.linalg.norm(z) > 0 or not np.linalg.norm(y) > 1e-12 * np.linalg.norm(z) * np.linalg.norm(c - a):
        raise ValueError("its three points lie on one line")
    z, y = z / np.linalg.norm(z), y / np.linalg.norm(y)
    return a + points @ np.stack([np.cross(y, z), y, z])
