"""Nastran coordinate systems: CORD2R, CORD2C and CORD2S, one defined in another, CORD1R, ... by grid points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...raw import Floats, Ints, rows_of
from .text import Card, real

SYSTEMS = ("CORD2R", "CORD2C", "CORD2S")
OF_GRIDS = ("CORD1R", "CORD1C", "CORD1S")


@dataclass(frozen=True)
class System:
    """A coordinate system: kind "R", "C" or "S", the system it is defined in (0: the basic one), points A, B, C."""

    kind: str
    reference: int
    points: Floats


@dataclass(frozen=True)
class SystemOfGrids:
    """A coordinate system by the rows (3,) of grid points that are its points A, B, C."""

    kind: str
    rows: Ints


def read_system(card: Card) -> tuple[int, System]:
    """Return the number and the system that a card defines; A is the origin, B on the z axis, C in the xz plane."""
    values = np.array([real(card.text(i)) for i in range(2, 11)]).reshape(3, 3)
    return int(card.text(0)), System(card.name[-1], int(card.text(1) or 0), values)


def read_systems_of_grids(card: Card, labels: Ints) -> dict[int, SystemOfGrids]:
    """Return the one or two systems of a CORD1R, CORD1C or CORD1S by their numbers; labels (n,) are of grid points.

    Raises
    ------
    ValueError
        A field is no whole number, or no grid point has that number.
    """
    found = {}
    for first in (0, 4):
        if card.text(first):
            grids = [int(card.text(first + i)[:18]) for i in (1, 2, 3)]  # a number of more digits is no grid point's
            rows = rows_of(np.array(grids), labels)
            if (rows < 0).any():
                raise ValueError(f"GRID {card.text(first + 1 + int(np.argmin(rows)))} does not exist")
            found[int(card.text(first))] = SystemOfGrids(card.name[-1], rows)
    return found


def with_systems_of_grids(
    systems: Mapping[int, System], of_grids: Mapping[int, SystemOfGrids], points: Floats, numbers: Ints
) -> dict[int, System]:
    """Return systems together with those that grid points define, in basic coordinates.

    Those whose points have no place, because a system is missing or depends on itself, are left out.

    Parameters
    ----------
    systems, of_grids : mapping
    points : (n, 3) float
        Coordinates of the grid points, in the systems of the given numbers (n,) int.
    """
    found, waiting = dict(systems), dict(of_grids)
    while waiting:
        ready = {}
        for number, given in waiting.items():
            try:
                places = [to_global(points[[row]], int(numbers[row]), found)[0] for row in given.rows]
            except ValueError:  # perhaps it is defined in one of those that are waiting
                continue
            ready[number] = System(given.kind, 0, np.array(places))
        if not ready:
            break
        found |= ready
        waiting = {number: given for number, given in waiting.items() if number not in ready}
    return found


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
