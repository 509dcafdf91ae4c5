"""SPC, SPC1, SPCADD and PS of GRID: which freedoms are held, and the supports that they become."""

from __future__ import annotations

from ...mesh.readers.nastran.text import Card
from ..directions import along_axes
from .axes import displacement_axes, projector
from .cards import Deck

Held = dict[int, set[int]]  # freedoms, 1 to 6, that are held at each grid point, in its own displacement system


def find_held(deck: Deck) -> Held:
    """Return the freedoms that are held at each grid point.

    Raises
    ------
    MeshError
        Something else than freedoms is held, or at a grid point that does not exist.
    """
    chosen = _selected_supports(deck)
    held: Held = {}

    def hold(card: Card, grid: int, text: str) -> None:
        if not text.isdigit() or set(text) - set("123456"):
            if text not in ("", "0"):
                raise deck.fault(card, f'holds "{text[:20]}"; expected freedoms, digits of 1 to 6')
            return
        deck.row(card, grid)
        held.setdefault(grid, set()).update(int(c) for c in text)

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
        if sets:
            text = f"the case control selects none of {', '.join(map(str, sorted(sets)))}: all are taken"
            deck.draft.find("SPC", "", text)
        return sets
    there = sets | {deck.whole(card, 0) for card in deck.of("SPCADD")}
    for missing in sorted(named - there):
        deck.draft.find("SPC", "", f"the case control selects set {missing}, which the deck does not have", "missing")
    for card in deck.of("SPCADD"):
        if deck.whole(card, 0) in named:
            named = named | set(deck.grids(card, 1))
    return named


def held_along(deck: Deck, held: Held, grid: int, turning: bool) -> str:
    """Return what is held of a grid point's motions, or of its rotations, along the basic axes, such as "xz".

    In a displacement system of its own it may hold other directions; then it is "", and the deck has a finding.
    """
    freedoms = {f - 3 * turning for f in held.get(grid, set()) if (f > 3) == turning}
    own = deck.turned.get(grid)
    if own is None or not freedoms or freedoms == {1, 2, 3}:
        return "".join("xyz"[f - 1] for f in sorted(freedoms))
    axes = displacement_axes(deck, own, grid)
    found = None if axes is None else along_axes(projector(axes, freedoms))
    if axes is not None and found is None:
        text = "is held in part in a displacement system of its own, along other directions than x, y and z"
        deck.find(own, text, "missing")
    return found or ""


def write_supports(deck: Deck, held: Held) -> None:
    """Write a support for all grid points of solids that are held alike."""
    alike: dict[str, list[str]] = {}
    rows = dict(zip(deck.labels.tolist(), deck.on_solids.tolist(), strict=True))
    for grid in sorted(held):
        fixed = held_along(deck, held, grid, turning=False) if rows.get(grid) else ""
        if fixed:
            alike.setdefault(fixed, []).append(str(grid))
    for fixed, grids in alike.items():
        table = deck.draft.add("supports", is_entry=True, values={"nodes": ", ".join(grids), "fixed": fixed})
        table.comments.append("SPC, SPC1 and GRID: grid points that are held so")
