"""RBE2, RBE3 and CONM2: rigid bodies and averaged references, with what acts on them."""

from __future__ import annotations

import numpy as np

from ...mesh.readers.nastran.text import Card
from ..directions import along_axes
from ..draft import Value
from ..released import drop_released, said_of_both, said_of_dropped
from .axes import displacement_axes, projector
from .cards import Deck
from .holding import Held, held_along
from .materials import clean

Ties = dict[int, tuple[Card, bool, list[int]]]  # by reference: the card, whether it is rigid, and what it ties
_ALL = "123456"


def find_ties(deck: Deck) -> Ties:
    """Return by reference grid point: the card, whether it is rigid, and the grid points tied."""
    found: Ties = {}
    for card in deck.of("RBE2"):
        if not set("123") <= set(card.text(2)):
            deck.find(card, f"ties the freedoms {card.text(2)} alone; a rigid body has 1, 2 and 3", "missing")
            continue
        _add_tie(deck, found, card, True, deck.whole(card, 1), deck.grids(card, 3))
    for card in deck.of("RBE3"):
        grids: list[int] = []
        weights: set[str] = set()
        i = 4
        while i < len(card.fields) and not card.text(i).isalpha():
            weights.add(card.text(i))
            if not set("123") <= set(card.text(i + 1)):
                deck.find(card, f"weights the freedoms {card.text(i + 1)} alone; expected 123", "missing")
            i += 2
            while i < len(card.fields) and (not card.text(i) or card.text(i).isdigit()):
                if card.text(i):
                    grids.append(deck.whole(card, i))
                i += 1
        if i < len(card.fields) and card.text(i).upper() not in ("UM", "ALPHA"):
            raise deck.fault(card, f'has "{card.text(i)[:20]}" among its grid points; expected them written out')
        if len(weights) > 1:
            deck.find(card, "weights of its own for each grid point are not simulated; all count alike")
        _add_tie(deck, found, card, False, deck.whole(card, 2), grids)
    return found


def _add_tie(deck: Deck, found: Ties, card: Card, rigid: bool, reference: int, grids: list[int]) -> None:
    row = deck.row(card, reference)
    for grid in grids:
        deck.row(card, grid)
    if deck.on_solids[row] or reference in found or not grids:
        text = f"its reference GRID {reference} belongs to a solid or to another one, or ties nothing"
        deck.find(card, text, "missing")
        return
    found[reference] = card, rigid, grids


def write_ties(deck: Deck, ties: Ties, held: Held, references: dict[int, list[dict[str, Value]]]) -> None:
    """Write [[rigid]] and [[averaged]] with mass, inertia, held freedoms and springs of their references."""
    masses = _masses(deck, ties)
    units = deck.units
    for reference, (card, rigid, grids) in ties.items():
        point = [clean(float(v) * units.length) for v in deck.points[deck.row(card, reference)]]
        values: dict[str, Value] = {
            "name": f"{card.name}_{card.text(0)}", "nodes": ", ".join(map(str, grids)), "reference": point,
            **masses.get(reference, {}),
        }  # fmt: skip
        turns = [f"r{letter}" for letter in held_along(deck, held, reference, turning=True)]
        fixed = " ".join([*held_along(deck, held, reference, turning=False), *turns])
        if fixed:
            values["fixed"] = fixed
        if references[reference]:
            values["springs"] = list(references[reference])
        if not rigid and (digits := _followed(deck, card)) != _ALL:
            _release(deck, card, reference, digits, values)
        table = deck.draft.add("rigid" if rigid else "averaged", is_entry=True, values=values)
        table.comments.append(f"{card.name}, {deck.where(card)}, reference GRID {reference}")


def _followed(deck: Deck, card: Card) -> str:
    """Return the freedoms of its reference that an RBE3 ties, REFC, in order.

    Raises
    ------
    MeshError
        REFC has something else than digits of 1 to 6.
    """
    text = card.text(3)
    if not text or set(text) - set(_ALL):
        raise deck.fault(card, f'has "{text[:20]}" as freedoms of its reference (REFC); expected digits of 1 to 6')
    return "".join(sorted(set(text)))


def _release(deck: Deck, card: Card, reference: int, digits: str, values: dict[str, Value]) -> None:
    """Take out of the table of a reference what acts on freedoms that an RBE3 does not tie; ask for what is of both."""
    axes, node, tied = displacement_axes(deck, card, reference), f"GRID {reference}", set[int]()
    for first in (1, 4):
        freedoms = {int(digit) - first + 1 for digit in digits} & {1, 2, 3}
        letters = along_axes(projector(axes, freedoms)) if axes is not None else None
        if letters is None:
            text = f"ties freedoms of {node} in a system that is not along x, y and z (CD): give [[averaged]]"
            deck.find(card, text, "missing")
            return
        tied |= {first + "xyz".index(letter) for letter in letters}
    dropped, both = drop_released(values, tied)
    if both:
        deck.find(card, said_of_both(tied, node, both), "missing")
    if dropped:
        deck.find(card, said_of_dropped(tied, node, dropped), "harmless")


def _masses(deck: Deck, ties: Ties) -> dict[int, dict[str, Value]]:
    found: dict[int, dict[str, Value]] = {}
    units = deck.units
    for card in deck.of("CONM2"):
        grid = deck.whole(card, 1)
        if grid not in ties:
            deck.find(card, "at a grid point that is no reference of a tie is left out: frequencies come out too high")
            continue
        if any(deck.number(card, i) for i in (4, 5, 6)) or deck.whole(card, 2) or grid in found:
            deck.find(card, "off its grid point, in a system of its own, or one of several, is not read", "missing")
            continue
        mass = units.mass * deck.mass_factor
        found[grid] = {"mass": clean(deck.number(card, 3) * mass)}
        xx, yx, yy, zx, zy, zz = (deck.number(card, i) for i in range(8, 14))
        six = np.array([xx, yy, zz, -yx, -zx, -zy]) * mass * units.length**2  # I21 is ∫ρ x y dV there
        if six.any():
            found[grid]["inertia"] = [clean(float(v)) + 0.0 for v in six]
    return found
