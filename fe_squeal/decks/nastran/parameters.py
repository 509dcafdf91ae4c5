"""PARAM: mass from weight, damping of the whole, and what else would change the answer."""

from __future__ import annotations

import re

from ...mesh.readers.nastran.text import Card
from ..draft import Value, Weight
from .cards import Deck
from .materials import Numbers, clean

_IN_CASE_CONTROL = re.compile(r"^\s*PARAM\s*,\s*(\w+)\s*,\s*([^,$\s]+)", re.IGNORECASE)
_TAKEN = {"WTMASS", "G", "ALPHA1", "ALPHA2"}
# What is left out, and what that means.
LEFT_OUT: dict[str, tuple[str, Weight]] = {
    **dict.fromkeys(("CB1", "CK1", "CM1"),
                    ("multiplies the damping, stiffness or mass of the whole, and is not read", "missing")),
    "LGDISP": ("large displacements: the static state is linear here; [effects.stress_stiffening] adds the stiffness"
               " of its stresses", "changes"),
    "INREL": ("inertia relief is not simulated: the static state has only what [effects.preload] says", "changes"),
}  # fmt: skip
_UNKNOWN: tuple[str, Weight] = ("is not known here and is left out", "changes")
# Values with which they do nothing.
_IDLE = {"LGDISP": (-1.0, 0.0), "INREL": (0.0,), **dict.fromkeys(("CB1", "CK1", "CM1"), (1.0,))}
# Output and checks; numerics of the solver (singular freedoms, sequence, modes that a reduction keeps); mass matrices
# are consistent here in any case (COUPMASS), shells have no stiffness (K6ROT, SNORM), and W3 and W4 serve transients.
SILENT = {
    "AUTOSPC", "AUTOSPCR", "BAILOUT", "BIGER", "CHECKEL", "CHECKMAT", "COUPMASS", "CURV", "CURVPLOT", "DDRMM",
    "EPPRT", "EPZERO", "FZERO", "GRDPNT", "HFREQ", "K6ROT", "LFREQ", "LMODES", "MAXLINES", "MAXRATIO", "MDK4OPT",
    "NEWSEQ", "NOCOMPS", "NOELOF", "NOELOP", "NUMOUT", "OGEOM", "OMACHPR", "OMID", "OUGCORD", "PATVER", "POST",
    "POSTEXT", "PRGPAR", "PRGPST", "PRTMAXIM", "PRTRESLT", "RESVEC", "RESVINER", "SEQOUT", "SNORM", "SPCGEN",
    "SRCOMPS", "UNITSYS", "USETPRT", "W3", "W4", "XYUNIT",
}  # fmt: skip


def in_case_control(lines: list[tuple[str, str]]) -> list[Card]:
    """Return the cards PARAM that stand before BEGIN BULK, of (line, file and number of the line)."""
    found: list[Card] = []
    for line, place in lines:
        if " ".join(line.upper().split()).startswith("BEGIN BULK"):
            return found
        match = _IN_CASE_CONTROL.match(line)
        if match:
            found.append(Card("PARAM", [match[1], match[2]], place))
    return []  # without BEGIN BULK all lines are bulk data


def read_parameters(deck: Deck) -> None:
    """Keep WTMASS and G in the deck, and list what is not taken over.

    Raises
    ------
    MeshError
        A parameter that is taken over is no number, or not one that makes sense.
    """
    for card in deck.of("PARAM"):
        name = card.text(0).upper()
        text, weight = LEFT_OUT.get(name, _UNKNOWN)
        if name not in _TAKEN | SILENT and not (name in _IDLE and deck.number(card, 1) in _IDLE[name]):
            deck.draft.find(f"PARAM {name[:20]}", deck.where(card), text, weight)
    deck.mass_factor = _value(deck, "WTMASS", 1.0)
    deck.loss_factor = _value(deck, "G", 0.0)
    if deck.mass_factor != 1.0:
        deck.draft.head.append(f"PARAM WTMASS: the deck's densities and masses are multiplied by {deck.mass_factor:g}.")


def write_damping(deck: Deck, materials: dict[int, tuple[Card, Numbers]]) -> None:
    """Write structural damping of GE and G, and Rayleigh damping of ALPHA1 and ALPHA2, after all other tables."""
    draft, time = deck.draft, deck.units.time
    if any("loss_factor" in numbers for _, numbers in materials.values()):
        source = "GE of the materials, and PARAM G added to it" if deck.loss_factor else "GE of the materials"
        draft.add("effects", "structural_damping").comments.append(f"{source}: loss_factor above")
    alpha, beta = _value(deck, "ALPHA1", 0.0), _value(deck, "ALPHA2", 0.0)
    if alpha or beta:
        values: dict[str, Value] = {"alpha": clean(alpha / time), "beta": clean(beta * time)}
        draft.add("effects", "rayleigh", values=values).comments.append("PARAM ALPHA1, ALPHA2: of mass and stiffness")
    # There the factors multiply the matrices of the whole; here those of the bodies' elements.
    sprung = any(t.path[0] in ("contacts", "springs") or "springs" in t.values for t in draft.tables)
    weighted = any("mass" in t.values for t in draft.tables)
    for card in deck.of("PARAM"):
        name = card.text(0).upper()
        if sprung and name in ("G", "ALPHA2") and deck.number(card, 1):
            text = "damps contacts and springs too, which is not simulated: here it damps the bodies alone"
            draft.find(f"PARAM {name}", deck.where(card), text)
        if weighted and name == "ALPHA1" and deck.number(card, 1):
            text = "damps CONM2 too, which is not simulated: here it damps the bodies alone"
            draft.find("PARAM ALPHA1", deck.where(card), text)


def _value(deck: Deck, name: str, default: float) -> float:
    """Return a parameter; of one that the deck gives several times, differently, the last, which is told."""
    cards = [card for card in deck.of("PARAM") if card.text(0).upper() == name]
    values = [deck.number(card, 1, default) for card in cards]
    for card, value in zip(cards, values, strict=True):
        if value < 0 or (value == 0 and name == "WTMASS"):
            raise deck.fault(card, f"is {value:g}; expected a number {'above 0' if name == 'WTMASS' else 'from 0 on'}")
    if len(set(values)) > 1:
        text = f"is given {len(values)} times, differently; {values[-1]:g} is taken"
        deck.draft.find(f"PARAM {name}", deck.where(cards[-1]), text)
    return values[-1] if values else default
