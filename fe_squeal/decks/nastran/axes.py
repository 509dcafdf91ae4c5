"""Along which directions freedoms act: displacement systems (CD) of grid points, and systems that elements name."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ...mesh.raw import Floats
from ...mesh.readers.nastran.coordinates import axes_at
from ...mesh.readers.nastran.text import Card
from .cards import Deck

SAME = 1e-9  # of unit vectors that count as one


def axes_of(deck: Deck, card: Card, number: int, grid: int) -> Floats | None:
    """Return the axes (3, 3), in rows, of a system at a grid point; None, and a finding, where it is not read."""
    try:
        return axes_at(deck.points[deck.row(card, grid)], number, deck.systems)
    except ValueError:
        deck.find(card, f"acts along axes of coordinate system {number}, which is not read", "missing")
        return None


def displacement_axes(deck: Deck, card: Card, grid: int) -> Floats | None:
    """Return the axes (3, 3), in rows, along which the freedoms 1 to 3 of a grid point are counted, those of its CD."""
    own = deck.turned.get(grid)
    return axes_of(deck, card, deck.whole(own, 5) if own else 0, grid)


def projector(axes: Floats, freedoms: Iterable[int]) -> Floats:
    """Return the matrix (3, 3) that takes from a motion what some of the freedoms 1 to 3 hold of it."""
    held = axes[[f - 1 for f in sorted(freedoms)]]
    return held.T @ held


def held_directions(axes: Floats, freedoms: set[int]) -> str | None:
    """Return which of x, y and z freedoms 1 to 3 in turned axes hold, None where they hold other directions.

    Examples
    --------
    >>> polar = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    >>> held_directions(polar, {3}), held_directions(polar, {1, 2}), held_directions(polar, {1})
    ('z', 'xy', None)
    """
    P = projector(axes, freedoms)
    along = np.diag(P).round()
    if np.abs(P - np.diag(along)).max() > SAME:
        return None
    return "".join(letter for letter, value in zip("xyz", along, strict=True) if value)
