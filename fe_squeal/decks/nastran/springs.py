"""CELAS, CDAMP and CBUSH: springs and dampers between grid points and to the ground."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...mesh.raw import Floats
from ...mesh.readers.nastran.text import Card
from ..draft import Value, plain_name
from .axes import axes_of, displacement_axes, projector
from .cards import Deck
from .holding import Held
from .materials import clean

_SAME = 1e-9  # of unit vectors that count as one
_LOSS = "GE of springs is not simulated: [effects.structural_damping] damps the bodies alone; damping is viscous"


@dataclass(frozen=True)
class Spring:
    """A spring or damper between two grid points, or between one and the ground.

    Attributes
    ----------
    key : "stiffness" or "damping"
    size : float
        In the deck's units.
    ends : list of (int, (3,) float)
        Grid points, and along which unit vector in the basic system each of them moves it.
    turns : bool
        Whether it acts on rotations about these vectors.
    """

    card: Card
    key: str
    size: float
    ends: list[tuple[int, Floats]]
    turns: bool


def springs(deck: Deck) -> Iterator[Spring]:
    """Yield scalar springs and dampers, and bushes one direction at a time.

    Raises
    ------
    MeshError
        A property or a grid point does not exist, or a number cannot be read.
    """
    sizes: dict[str, dict[int, float]] = {"CELAS1": {}, "CDAMP1": {}}
    lossy = set()
    for card in deck.of("PELAS"):
        for i in (0, 4):
            if card.text(i):
                sizes["CELAS1"][deck.whole(card, i)] = deck.number(card, i + 1)
                if deck.number(card, i + 2):
                    lossy.add(deck.whole(card, i))
    for card in deck.of("PDAMP"):
        sizes["CDAMP1"] |= {deck.whole(card, i): deck.number(card, i + 1) for i in (0, 2, 4, 6) if card.text(i)}
    for name, key in (("CELAS1", "stiffness"), ("CDAMP1", "damping")):
        for card in deck.of(name):
            pid = deck.whole(card, 1) or deck.whole(card, 0)
            if pid not in sizes[name]:
                raise deck.fault(card, f"is of property {pid}, which does not exist")
            if key == "stiffness" and pid in lossy:
                deck.find(card, _LOSS)
            yield from _scalar(deck, card, key, sizes[name][pid])
    for name, key in (("CELAS2", "stiffness"), ("CDAMP2", "damping")):
        for card in deck.of(name):
            if key == "stiffness" and deck.number(card, 6):
                deck.find(card, _LOSS)
            yield from _scalar(deck, card, key, deck.number(card, 1))
    bushes = {deck.whole(card, 0): card for card in deck.of("PBUSH")}
    for card in deck.of("CBUSH"):
        pid = deck.whole(card, 1) or deck.whole(card, 0)
        if pid not in bushes:
            raise deck.fault(card, f"is of property {pid}, which does not exist")
        yield from _bush(deck, card, bushes[pid])


def _scalar(deck: Deck, card: Card, key: str, size: float) -> Iterator[Spring]:
    """Yield the spring of a scalar element, whose freedoms are those of its grid points' displacement systems."""
    given = [(deck.whole(card, i), deck.whole(card, i + 1)) for i in (2, 4) if deck.whole(card, i)]
    freedoms = [freedom for _, freedom in given]
    if any(not 1 <= f <= 6 for f in freedoms) or len({f > 3 for f in freedoms}) > 1 or size < 0:
        text = " and ".join(map(str, freedoms))
        deck.find(card, f"acts on freedoms {text} with {size:g}, which is not simulated", "missing")
        return
    ends = []
    for grid, freedom in given:
        axes = displacement_axes(deck, card, grid)
        if axes is None:
            return
        ends.append((grid, axes[(freedom - 1) % 3]))
    if ends:
        yield Spring(card, key, size, ends, freedoms[0] > 3)


def _bush(deck: Deck, card: Card, owner: Card) -> Iterator[Spring]:
    """Yield the springs and dampers of a bush along, and about, the axes that CID names."""
    numbers = _sizes(deck, owner)
    grids = [grid for grid in (deck.whole(card, 2), deck.whole(card, 3)) if grid]
    points = [deck.points[deck.row(card, grid)] for grid in grids]
    apart = len(points) > 1 and not np.array_equal(*points)
    directed = any(len(set(v[:3])) > 1 or any(v[3:]) for v in numbers.values())
    system = deck.systems.get(deck.whole(card, 7))
    # Without CID the axes follow from GO, X or both grid points; those of a polar system differ from point to point.
    if (not card.text(7) and directed) or (system is not None and system.kind != "R" and apart):
        text = "acts along axes of its own, which are not read; expected CID of CORD2R or CORD1R, or 0"
        deck.find(card, text, "missing")
        return
    axes = axes_of(deck, card, deck.whole(card, 7), grids[0]) if grids else None
    if axes is None:
        return
    for key, values in numbers.items():
        for freedom, size in enumerate(values):
            if size < 0:
                deck.find(card, f"acts with {size:g}, which is not simulated", "missing")
            elif size:
                yield Spring(card, key, size, [(grid, axes[freedom % 3]) for grid in grids], freedom >= 3)


def _sizes(deck: Deck, card: Card) -> dict[str, list[float]]:
    """Return the six numbers of each kind that a PBUSH has."""
    found: dict[str, list[float]] = {}
    for i in range(1, len(card.fields)):
        word = card.text(i).upper()
        if word == "RIGID":
            deck.find(card, "ties grid points rigidly, which is not read", "missing")
        if word not in ("K", "B", "GE", "M"):
            continue
        values = [deck.number(card, i + j) if not card.text(i + j).isalpha() else 0.0 for j in range(1, 7)]
        if word in ("K", "B"):
            found["stiffness" if word == "K" else "damping"] = values
        elif any(values):
            deck.find(card, _LOSS if word == "GE" else "adds mass that is left out: frequencies come out too high")
    return found


def write_springs(deck: Deck, held: Held, references: dict[int, list[dict[str, Value]]]) -> None:
    """Write springs and dampers: to the ground, between two nodes, or at a reference grid point."""
    taken: list[str] = []
    for spring in springs(deck):
        card, key = spring.card, spring.key
        ends = [end for end in spring.ends if not _is_held(deck, held, card, end, spring.turns)]
        rows = [deck.row(card, grid) for grid, _ in ends]
        if not ends or not spring.size:
            continue
        grid, way = ends[0]
        direction: Value = [clean(round(float(v), 12)) + 0.0 for v in way]
        size = spring.size * (deck.units.stiffness if key == "stiffness" else deck.units.damping)
        if len(ends) == 1 and grid in references:
            if card.name == "CBUSH" and _is_offset(deck, spring):
                text = "acts off its grid point, with a moment about it, which is not simulated: give [[rigid.springs]]"
                deck.find(card, text, "missing")
            total = clean(size * (deck.units.length**2 if spring.turns else 1.0))
            references[grid].append({"axis" if spring.turns else "direction": direction, key: total})
        elif spring.turns or not all(deck.on_solids[rows]):
            deck.find(card, "ends at a grid point, or a freedom, that neither solids nor [[rigid]] have", "missing")
        elif np.abs(ends[-1][1] - way).max() > _SAME:
            deck.find(card, "moves its ends along different directions, which is not simulated", "missing")
        else:
            name = plain_name(f"{card.name}_{card.text(0)}", taken)
            taken.append(name)
            values: dict[str, Value] = {"name": name, "nodes": str(grid)}
            if len(ends) == 2:
                values["to"] = str(ends[1][0])
            values |= {"direction": direction, key: clean(size)}
            deck.draft.add("springs", is_entry=True, values=values).comments.append(f"{card.name}, {deck.where(card)}")


def _is_held(deck: Deck, held: Held, card: Card, end: tuple[int, Floats], turns: bool) -> bool:
    """Return whether an end cannot move; one that is held along another direction moves as far as it is free."""
    freedoms = {f - 3 * turns for f in held.get(end[0], set()) if (f > 3) == turns}
    axes = displacement_axes(deck, card, end[0]) if freedoms else None
    return axes is not None and bool(np.linalg.norm(projector(axes, freedoms) @ end[1]) > 1 - _SAME)


def _is_offset(deck: Deck, spring: Spring) -> bool:
    """Return whether a bush acts elsewhere than at its first grid point: between two, or at an offset (OCID)."""
    first, *others = (deck.points[deck.row(spring.card, grid)] for grid, _ in spring.ends)
    return deck.whole(spring.card, 9, -1) >= 0 or any(not np.array_equal(first, other) for other in others)
