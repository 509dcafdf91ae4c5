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
    origin, axes = _frame(number, systems, seen)
    system = systems[number]
    if system.kind == "C":
        angle = np.deg2rad(points[:, 1])
        points = np.column_stack([points[:, 0] * np.cos(angle), points[:, 0] * np.sin(angle), points[:, 2]])
    elif system.kind == "S":
        polar, angle = np.deg2rad(points[:, 1]), np.deg2rad(points[:, 2])
        flat = points[:, 0] * np.sin(polar)
        points = np.column_stack([flat * np.cos(angle), flat * np.sin(angle), points[:, 0] * np.cos(polar)])
    return origin + points @ axes


def axes_at(point: Floats, number: int, systems: dict[int, System]) -> Floats:
    """Return the unit vectors (3, 3), in rows and in the basic system, along which coordinates grow at a point (3,).

    Those of a cylindrical system are radial, tangential and axial; those of a spherical one radial, along the polar
    angle and along the angle about the axis. On the axis itself, where these have no direction, they are those of the
    rectangular system with the same three points.

    Raises
    ------
    ValueError
        As of `to_global`.

    Examples
    --------
    >>> polar = System("C", 0, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]))
    >>> axes_at(np.array([0.0, 2.0, 5.0]), 1, {1: polar}).round(12).tolist()
    [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    if number == 0:
        return np.eye(3)
    origin, axes = _frame(number, systems)
    x, y, z = axes @ (point - origin)
    flat = np.hypot(x, y)
    if systems[number].kind == "R" or flat <= 1e-9 * np.linalg.norm(point - origin) or not flat:
        return axes
    outward, around, along = np.array([[x / flat, y / flat, 0.0], [-y / flat, x / flat, 0.0], [0.0, 0.0, 1.0]])
    if systems[number].kind == "C":
        return np.stack([outward, around, along]) @ axes
    cosine, sine = np.array([z, flat]) / np.hypot(flat, z)
    return np.stack([sine * outward + cosine * along, cosine * outward - sine * along, around]) @ axes


def _frame(number: int, systems: dict[int, System], seen: tuple[int, ...] = ()) -> tuple[Floats, Floats]:
    """Return the origin (3,) of a system and its axes (3, 3), in rows, of its three points."""
    if number in seen:
        raise ValueError("it is defined by itself")
    if number not in systems:
        raise ValueError(f"it is defined in system {number}, which the file does not hold")
    system = systems[number]
    a, b, c = to_global(system.points, system.reference, systems, (*seen, number))
    z, y = b - a, np.cross(b - a, c - a)
    if not np.linalg.norm(z) > 0 or not np.linalg.norm(y) > 1e-12 * np.linalg.norm(z) * np.linalg.norm(c - a):
        raise ValueError("its three points lie on one line")
    z, y = z / np.linalg.norm(z), y / np.linalg.norm(y)
    return a, np.stack([np.cross(y, z), y, z])
