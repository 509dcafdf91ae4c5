"""SPC, CELAS, CDAMP, CBUSH, RBE2, RBE3 and CONM2: supports, springs, rigid bodies and averaged references."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...mesh.readers.nastran.text import Card
from ..draft import Value, plain_name
from .cards import Deck
from .materials import clean

_FREEDOMS = ("x", "y", "z", "rx", "ry", "rz")


def find_held(deck: Deck) -> dict[int, set[int]]:
    """Return the freedoms, 1 to 6, that are held at each grid point."""
    chosen = _selected_supports(deck)
    held: dict[int, set[int]] = {}
    turned = {deck.whole(card, 0): card for card in deck.of("GRID") if deck.whole(card, 5) > 0}

    def hold(card: Card, grid: int, text: str) -> None:
        if not text.isdigit() or set(text) - set("123456"):
            if text not in ("", "0"):
                raise deck.fault(card, f'holds "{text[:20]}"; expected freedoms, digits of 1 to 6')
            return
        deck.row(card, grid)
        freedoms = {int(c) for c in text}
        if grid in turned and freedoms & {1, 2, 3} and not {1, 2, 3} <= freedoms:
            deck.find(turned[grid], "is held in part in a displacement system of its own, which is not read", "missing")
        held.setdefault(grid, set()).update(freedoms)

    for card in deck.of("SPC"):
        if deck.whole(card, 0) in chosen:
            for i in (1, 4):
                if card.text(i):
                    hold(card, deck.whole(card, i), card.text(i + 1))
                    if deck.number(card, i + 2):
                        deck.find(card, "a displacement that is prescribed is held; its static state is not simulated")
    for card in deck.of("SPC1"):
        if deck.whole(card, 0) in chosen:
            for grid in deck.grids(card, 2):
                hold(card, grid, card.text(1))
    for card in deck.of("GRID"):
        if card.text(6):
            hold(card, deck.whole(card, 0), card.text(6))
    return held


def _selected_supports(deck: Deck) -> set[int]:
    named = deck.selected.get("SPC", set())
    sets = {deck.whole(card, 0) for card in deck.of("SPC", "SPC1")}
    if not named:
        if len(sets) > 1:
            text = f"sets {sorted(sets)}: the case control selects none; all of them are taken"
            deck.draft.find("SPC", "", text)
        return sets
    for card in deck.of("SPCADD"):
        if deck.whole(card, 0) in named:
            named = named | set(deck.grids(card, 1))
    return named


def write_supports(deck: Deck, held: dict[int, set[int]]) -> None:
    """Write a support for all grid points that are held alike."""
    alike: dict[str, list[str]] = {}
    rows = dict(zip(deck.labels.tolist(), deck.on_solids.tolist(), strict=True))
    for grid in sorted(held):
        fixed = "".join(_FREEDOMS[f - 1] for f in sorted(held[grid]) if f <= 3)
        if fixed and rows.get(grid):
            alike.setdefault(fixed, []).append(str(grid))
    for fixed, grids in alike.items():
        table = deck.draft.add("supports", is_entry=True, values={"nodes": ", ".join(grids), "fixed": fixed})
        table.comments.append("SPC, SPC1 and GRID: grid points that are held so")


Ends = tuple[int, int, int, int]  # grid point and freedom, twice; 0 is the ground


def springs(deck: Deck) -> Iterator[tuple[Card, str, float, Ends]]:
    """Yield (card, "stiffness" or "damping", size, ends) of scalar springs, dampers and bushes."""

    def ends(card: Card) -> Ends:
        return deck.whole(card, 2), deck.whole(card, 3), deck.whole(card, 4), deck.whole(card, 5)

    tables = {
        "CELAS1": {deck.whole(c, i): deck.number(c, i + 1) for c in deck.of("PELAS") for i in (0, 4) if c.text(i)},
        "CDAMP1": {
            deck.whole(c, i): deck.number(c, i + 1) for c in deck.of("PDAMP") for i in (0, 2, 4, 6) if c.text(i)
        },
    }  # fmt: skip
    for name, key in (("CELAS1", "stiffness"), ("CDAMP1", "damping")):
        for card in deck.of(name):
            pid = deck.whole(card, 1) or deck.whole(card, 0)
            if pid not in tables[name]:
                raise deck.fault(card, f"is of property {pid}, which does not exist")
            yield card, key, tables[name][pid], ends(card)
    for name, key in (("CELAS2", "stiffness"), ("CDAMP2", "damping")):
        for card in deck.of(name):
            yield card, key, deck.number(card, 1), ends(card)
    bushes = {deck.whole(card, 0): card for card in deck.of("PBUSH")}
    for card in deck.of("CBUSH"):
        pid = deck.whole(card, 1) or deck.whole(card, 0)
        if pid not in bushes:
            raise deck.fault(card, f"is of property {pid}, which does not exist")
        numbers = _bush(deck, bushes[pid])
        directed = any(len(set(v[:3])) > 1 or any(v[3:]) for v in numbers.values())
        if (card.text(7) not in ("0",) and directed) or (card.text(7) not in ("", "0")):
            deck.find(card, "acts along axes of its own, which are not read; expected CID = 0", "missing")
            continue
        for key, values in numbers.items():
            for freedom, size in enumerate(values, 1):
                if size:
                    second = deck.whole(card, 3)
                    yield card, key, size, (deck.whole(card, 2), freedom, second, freedom if second else 0)


def _bush(deck: Deck, card: Card) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {}
    for i in range(1, len(card.fields)):
        key = {"K": "stiffness", "B": "damping"}.get(card.text(i).upper())
        if key:
            found[key] = [deck.number(card, i + j) if not card.text(i + j).isalpha() else 0.0 for j in range(1, 7)]
    return found


def write_springs(
    deck: Deck, held: dict[int, set[int]], references: dict[int, list[dict[str, Value]]]
) -> None:
    """Write springs and dampers: to the ground, between two nodes, or at a reference grid point."""
    taken: list[str] = []
    for card, key, size, (a, ca, b, cb) in springs(deck):
        unit = deck.units.stiffness if key == "stiffness" else deck.units.damping
        ends = [(g, c) for g, c in ((a, ca), (b, cb)) if g and c and c not in held.get(g, set())]
        if any(not 1 <= c <= 6 for _, c in ends) or size < 0:
            deck.find(card, f"acts on freedoms {ca} and {cb} with {size:g}, which is not simulated", "missing")
            continue
        rows = [deck.row(card, g) for g, _ in ends]
        if not ends or not size:
            continue
        direction = [float(i == ends[0][1] - 1) for i in range(3)] if ends[0][1] <= 3 else None
        if len(ends) == 1 and ends[0][0] in references:
            turns = ends[0][1] > 3
            way = [float(i == (ends[0][1] - 1) % 3) for i in range(3)]
            total = clean(size * unit * (deck.units.length**2 if turns else 1.0))
            references[ends[0][0]].append({"axis" if turns else "direction": way, key: total})
        elif direction is None or (len(ends) == 2 and ends[0][1] != ends[1][1]) or not all(deck.on_solids[rows]):
            deck.find(card, "ends at a grid point, or a freedom, that neither solids nor [[rigid]] have", "missing")
        else:
            name = plain_name(f"{card.name}_{card.text(0)}", taken)
            taken.append(name)
            values: dict[str, Value] = {"name": name, "nodes": str(ends[0][0])}
            if len(ends) == 2:
                values["to"] = str(ends[1][0])
            values |= {"direction": direction, key: clean(size * unit)}
            deck.draft.add("springs", is_entry=True, values=values).comments.append(f"{card.name}, {deck.where(card)}")


def find_ties(deck: Deck) -> dict[int, tuple[Card, bool, list[int]]]:
    """Return by reference grid point: the card, whether it is rigid, and the grid points tied."""
    found: dict[int, tuple[Card, bool, list[int]]] = {}
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
        if len(weights) > 1:
            deck.find(card, "weights of its own for each grid point are not simulated; all count alike")
        _add_tie(deck, found, card, False, deck.whole(card, 2), grids)
    return found


def _add_tie(
    deck: Deck, found: dict[int, tuple[Card, bool, list[int]]], card: Card, rigid: bool, reference: int,
    grids: list[int],
) -> None:  # fmt: skip
    row = deck.row(card, reference)
    for grid in grids:
        deck.row(card, grid)
    if deck.on_solids[row] or reference in found or not grids:
        text = f"its reference GRID {reference} belongs to a solid or to another one, or ties nothing"
        deck.find(card, text, "missing")
        return
    found[reference] = card, rigid, grids


def write_ties(
    deck: Deck, ties: dict[int, tuple[Card, bool, list[int]]], held: dict[int, set[int]],
    references: dict[int, list[dict[str, Value]]],
) -> None:  # fmt: skip
    """Write [[rigid]] and [[averaged]] with mass, inertia, held freedoms and springs of their references."""
    masses = _masses(deck, ties)
    units = deck.units
    for reference, (card, rigid, grids) in ties.items():
        point = [clean(float(v) * units.length) for v in deck.points[deck.row(card, reference)]]
        values: dict[str, Value] = {
            "name": f"{card.name}_{card.text(0)}", "nodes": ", ".join(map(str, grids)), "reference": point,
            **masses.get(reference, {}),
        }  # fmt: skip
        fixed = " ".join(_FREEDOMS[f - 1] for f in sorted(held.get(reference, set())))
        if fixed:
            values["fixed"] = fixed
        if references[reference]:
            values["springs"] = list(references[reference])
        table = deck.draft.add("rigid" if rigid else "averaged", is_entry=True, values=values)
        table.comments.append(f"{card.name}, {deck.where(card)}, reference GRID {reference}")


def _masses(deck: Deck, ties: dict[int, tuple[Card, bool, list[int]]]) -> dict[int, dict[str, Value]]:
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
