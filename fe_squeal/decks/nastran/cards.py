"""The cards of a Nastran deck by name, and their numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ...errors import MeshError
from ...mesh.raw import Rows
from ...mesh.readers.nastran.coordinates import System
from ...mesh.readers.nastran.text import Card, real
from ..draft import Draft
from ..units import SI, Units


@dataclass
class Deck:
    """A bulk data deck with its grid points and the draft that it becomes.

    Attributes
    ----------
    labels, points : (n,) int, (n, 3) float
        All grid points, in the basic system and the deck's own unit.
    on_solids : (n,) bool
        Which of them solid elements have.
    selected : dict
        Set numbers that count in the case control, by command.
    systems : dict
        The coordinate systems that the deck defines, by number.
    turned : dict
        The cards of grid points whose displacements are counted in a system of their own (CD).
    mass_factor, loss_factor : float
        What PARAM WTMASS multiplies densities and masses by, and what PARAM G adds to the loss factor of each material.
    """

    source: str
    cards: dict[str, list[Card]]
    labels: np.ndarray
    points: np.ndarray
    on_solids: np.ndarray
    draft: Draft
    selected: dict[str, set[int]] = field(default_factory=dict)
    systems: dict[int, System] = field(default_factory=dict)
    turned: dict[int, Card] = field(default_factory=dict)
    units: Units = SI
    mass_factor: float = 1.0
    loss_factor: float = 0.0

    @cached_property
    def _rows(self) -> Rows:
        return Rows(self.labels)

    def of(self, *names: str) -> Iterator[Card]:
        """Yield the cards of these names."""
        for name in names:
            yield from self.cards.get(name, [])

    def number(self, card: Card, i: int, default: float = 0.0) -> float:
        """Return a real field, a default where it is blank.

        Raises
        ------
        MeshError
        """
        try:
            value = real(card.text(i)) if card.text(i) else default
            if np.isfinite(value):
                return value
        except ValueError:
            pass
        raise self.fault(card, f'has "{card.text(i)[:40]}" where a number is expected')

    def whole(self, card: Card, i: int, default: int = 0) -> int:
        """Return a whole field, a default where it is blank.

        Raises
        ------
        MeshError
        """
        text = card.text(i)
        if not text:
            return default
        if re.fullmatch(r"[+-]?\d{1,18}", text):
            return int(text)
        raise self.fault(card, f'has "{text[:40]}" where a whole number is expected')

    def fault(self, card: Card, what: str) -> MeshError:
        """Return an error about a card."""
        return MeshError(f"{self.source}: {card.where}: {card.name} {card.text(0)[:20]} {what}")

    def where(self, card: Card) -> str:
        """Return where a card stands, without the deck's own name."""
        return card.where.removeprefix(f"{self.source} ")

    def find(self, card: Card, text: str, weight: str = "changes") -> None:
        """Note something about a card that is not taken over."""
        self.draft.find(card.name, self.where(card), text, weight)  # type: ignore[arg-type]

    def row(self, card: Card, grid: int) -> int:
        """Return the row of a grid point.

        Raises
        ------
        MeshError
        """
        row = int(self._rows(np.array([grid]))[0])
        if row < 0:
            raise self.fault(card, f"refers to GRID {grid}, which does not exist")
        return row

    def grids(self, card: Card, start: int) -> list[int]:
        """Return the grid points from a field on, with THRU written out; words end the list."""
        found: list[int] = []
        i = start
        while i < len(card.fields):
            text = card.text(i).upper()
            if text == "THRU" and found:
                last = self.whole(card, i + 1)
                if last - found[-1] > 10**7:
                    raise self.fault(card, f"goes THRU {last}, which is too far")
                there = self.labels[(self.labels > found[-1]) & (self.labels <= last)]
                found += there.tolist()
                i += 2
                continue
            if text and not re.fullmatch(r"\d{1,18}", text):
                break
            if text:
                found.append(int(text))
            i += 1
        return found
