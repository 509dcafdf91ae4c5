"""Along which directions freedoms act: displacement systems (CD) of grid points, and systems that elements name."""

from __future__ import annotations

from collections.abc import Iterable

from ...mesh.raw import Floats
from ...mesh.readers.nastran.coordinates import axes_at
from ...mesh.readers.nastran.text import Card
from ..directions import held_projector
from .cards import Deck


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
    """Return the projector (3, 3) onto the directions of some of the freedoms 1 to 3."""
    return held_projector(axes, [f in set(freedoms) for f in (1, 2, 3)])
