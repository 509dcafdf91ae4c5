"""PLOAD4 and LOAD: friction and preload of the scene."""

from __future__ import annotations

from collections.abc import Sequence

from ...mesh.raw import CellBlock
from ...mesh.readers.nastran.faces import is_directed, pressed_faces
from ..draft import Value
from .cards import Deck
from .materials import clean

# What a load set may be made of.
_LOADS = (
    "PLOAD4", "LOAD", "PLOAD", "PLOAD1", "PLOAD2", "PLOADX1", "FORCE", "FORCE1", "FORCE2", "MOMENT", "MOMENT1",
    "MOMENT2", "GRAV", "ACCEL", "ACCEL1", "RFORCE", "SLOAD", "SPCD", "TEMP", "TEMPD",
)  # fmt: skip


def write_effects(deck: Deck, blocks: Sequence[CellBlock], mu: float | None) -> None:
    """Write friction, and the pressures that the case control selects, all of the deck where it selects none.

    Parameters
    ----------
    deck : Deck
    blocks : sequence of CellBlock
        The solid elements.
    mu : float, optional
        Friction coefficient of the contacts.

    Raises
    ------
    MeshError
        A number cannot be read, or a LOAD has a set without a factor.
    """
    if mu:
        deck.draft.add("effects", "friction", values={"mu": mu}).comments.append("the contacts' largest coefficient")
    factors = _factors(deck)
    solids = {label for block in blocks for label in block.labels.tolist()}
    for card in deck.of("PLOAD4"):
        if factors is None or deck.whole(card, 0) in factors:
            if deck.whole(card, 1) not in solids:
                deck.find(card, "acts on a shell and is left out: [effects.preload] takes pressures on solids")
                continue
            if is_directed(card):
                deck.find(card, "acts along a direction of its own and is left out: pressures act along normals here")
                continue
            value = deck.number(card, 2)
            if any(card.text(i) and deck.number(card, i) != value for i in (3, 4, 5)):
                deck.find(card, "differs from corner to corner; the first corner's pressure is taken")
    pressed = [card for card in deck.of("PLOAD4") if not is_directed(card)]
    pressures: dict[str, Value] = {
        name: clean(value * (1.0 if factors is None else factors[sid]) * deck.units.pressure)
        for name, (sid, value, _) in pressed_faces(pressed, blocks, deck.labels, deck.source).items()
        if factors is None or sid in factors
    }
    if pressures:
        table = deck.draft.add("effects", "preload", values={"pressures": pressures})
        more = "; all sets of the deck" if factors is None else ""
        table.comments.append(f"PLOAD4: Pa, against the outward normal{more}")


def _factors(deck: Deck) -> dict[int, float] | None:
    """Return what the pressures of each load set are multiplied by; None where the case control selects no loads.

    A LOAD that is selected gives S S_i to the set L_i, another set counts as it is.
    """
    named = deck.selected.get("LOAD", set())
    cards = [card for card in deck.of("LOAD") if not named or deck.whole(card, 0) in named]
    if not named:
        for card in cards[:1]:
            deck.find(card, "is selected by no case control and left out: the sets of PLOAD4 are taken as they are")
        return None
    there = {card.text(0) for card in deck.of(*_LOADS)}
    for missing in sorted(sid for sid in named if str(sid) not in there):
        deck.draft.find("LOAD", "", f"the case control selects set {missing}, which the deck does not have", "missing")
    found = dict.fromkeys(named, 1.0)
    pressures = {deck.whole(card, 0) for card in deck.of("PLOAD4")}
    for card in cards:
        others: list[int] = []
        for i in range(2, len(card.fields), 2):
            if not card.text(i) and not card.text(i + 1):
                continue
            if not card.text(1) or not card.text(i) or not card.text(i + 1):
                raise deck.fault(card, "has a set without a factor, or a factor without a set; expected S, S1, L1, ...")
            sid = deck.whole(card, i + 1)
            found[sid] = found.get(sid, 0.0) + deck.number(card, 1) * deck.number(card, i)
            others += [] if sid in pressures else [sid]
        if others:
            sets = ", ".join(map(str, dict.fromkeys(others)))
            text = f"combines loads that are not simulated, sets {sets}: [effects.preload] takes pressures on surfaces"
            deck.find(card, text)
    return found
