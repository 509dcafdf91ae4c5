"""BCTSET, BCTABLE, BCTABL1 and BCONECT: contacts of the scene. Formats after the NX and MSC quick reference guides."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...mesh import LoadedMesh
from ...mesh.measures import area_of
from ...mesh.readers.nastran.text import Card, ranges
from ..draft import Value
from .cards import Deck
from .materials import Numbers, clean

_ASK = "give [[contacts]] with surface, counterface, normal_stiffness and sliding"
_SECONDARY, _PRIMARY = ("SECNDRY", "SLAVE"), ("PRIMARY", "MASTER")
_DETAILS = ("FBSH", "BKGL", "SEGS", "HHHB")  # lines of BCTABLE on how contact is searched, and heat
_STIFF, _STIFF_TIE = 10.0, 100.0  # times E/h of the softer side: stiff beside an element of size h


@dataclass(frozen=True)
class Pair:
    """Two surfaces in contact, by their regions or, of BCTABLE and BCONECT, bodies.

    Attributes
    ----------
    friction : str
        As it stands in the deck, "" where the pair has none of its own.
    """

    card: Card
    first: int
    second: int
    friction: str = ""
    glued: bool = False


def write_contacts(deck: Deck, loaded: LoadedMesh, materials: dict[int, tuple[Card, Numbers]]) -> float | None:
    """Write a contact for each pair; return the largest friction coefficient, None without friction.

    Raises
    ------
    MeshError
    """
    found = []
    for pair in [*_sets(deck), *_unique(deck, _tables(deck))]:
        names, friction = _surfaces(deck, loaded, pair), _friction(deck, pair)
        if names is not None and friction is not None:
            found.append((pair, names, 0.0 if pair.glued else friction))
    mu = max((friction for *_, friction in found), default=0.0) or None
    for i, (pair, names, friction) in enumerate(found, 1):
        values: dict[str, Value] = {"name": f"contact_{i}", "surface": names[0], "counterface": names[1]}
        table = deck.draft.add("contacts", is_entry=True, values=values)
        table.comments.append(f"{pair.card.name}, {deck.where(pair.card)}")
        soft = _softer(deck, loaded, materials, names) * deck.units.pressure / deck.units.length
        if pair.glued and soft:
            table.values |= {"kind": "tied", "normal_stiffness": clean(float(f"{_STIFF_TIE * soft:.2g}"))}
            table.comments.append(f"IGLUE: stiff springs of {_STIFF_TIE:g} E/h; compare with ten times as much")
            deck.find(pair.card, "glue is exact there, and here a tied contact of finite stiffness")
            continue
        if pair.glued:
            table.values["kind"] = "tied"
        elif not friction:
            table.values["kind"] = "frictionless"
        elif mu and friction != mu:
            table.values["friction_ratio"] = clean(friction / mu)
        value = clean(float(f"{_STIFF * soft:.2g}")) or 1.0e13
        text = (
            "the deck has hard contact: give normal_stiffness in N/m per m^2, e.g. 10 E/h of the softer side, and see"
            " how onsets move with it"
        )
        table.open.append((f"normal_stiffness = {value!r}", text))
        if friction:
            table.open.append(("sliding = { axis = [0.0, 0.0, 1.0], centre = [0.0, 0.0, 0.0], speed = 1.0 }",
                               "how the counterface moves: rad/s about an axis, or direction and m/s"))  # fmt: skip
    return mu


def _sets(deck: Deck) -> list[Pair]:
    """Return the pairs of BCTSET, whose sides are regions, of the sets that BCSET selects, itself or by BCTADD."""
    named = deck.selected.get("BCSET", set())
    chosen = named | {one for card in deck.of("BCTADD") if deck.whole(card, 0) in named for one in deck.grids(card, 1)}
    cards = [card for card in deck.of("BCTSET") if not named or deck.whole(card, 0) in chosen]
    first = next(deck.of("BCTSET"), None)
    if first is not None and not cards:
        deck.find(first, f"contact: BCSET in the case control selects none of the deck's sets; {_ASK}", "missing")
    elif first is not None and not named:
        sets = ", ".join(map(str, sorted({deck.whole(card, 0) for card in cards})))
        deck.find(first, f"contact: BCSET in the case control selects none of {sets}: all are taken")
    return [
        Pair(card, deck.whole(card, i), deck.whole(card, i + 1), card.text(i + 2))
        for card in cards
        for i in range(1, len(card.fields), 8)
        if card.text(i)
    ]


def _tables(deck: Deck) -> list[Pair]:
    """Return the pairs of the tables that the case control selects, whose sides are bodies."""
    tables = list(deck.of("BCTABLE", "BCTABL1")) or list(deck.of("BCONECT"))
    named = deck.selected.get("BCONTACT", set())
    # Number 0 is for what happens before the first load.
    chosen = [card for card in tables if deck.whole(card, 0) in named] if named else (
        [card for card in tables if deck.whole(card, 0)] or tables)  # fmt: skip
    alone = next(deck.of("BCBODY", "BCBODY1", *(() if deck.cards.get("BCTSET") else ("BSURF",))), None)
    if not tables and alone is not None:
        deck.find(alone, f"contact: no table says which bodies touch; {_ASK}", "missing")
    if tables and (not chosen or (len(chosen) > 1 and not named)):
        text = "selects none of the deck's" if named else "does not select one of the deck's"
        deck.find(tables[0], f"contact: BCONTACT in the case control {text} contact tables; {_ASK}", "missing")
        return []
    pairs: list[Pair] = []
    for card in chosen:
        if card.name == "BCTABLE":
            pairs += _of_table(deck, card)
            continue
        for connection in _connections(deck, card) if card.name == "BCTABL1" else [card]:
            pairs += _of_connection(deck, connection)
    return pairs


def _unique(deck: Deck, pairs: list[Pair]) -> list[Pair]:
    """Return each pair of bodies once: tables often name both directions."""
    found: dict[frozenset[int], Pair] = {}
    for pair in pairs:
        known = found.setdefault(frozenset((pair.first, pair.second)), pair)
        if pair.first == pair.second:
            deck.find(pair.card, f"contact of body {pair.first} with itself is not simulated", "missing")
        elif (known.friction, known.glued) != (pair.friction, pair.glued):
            text = f"contact: bodies {pair.first} and {pair.second} are paired twice, and differently; {_ASK}"
            deck.find(pair.card, text, "missing")
    return [pair for bodies, pair in found.items() if len(bodies) > 1]


def _of_table(deck: Deck, card: Card) -> list[Pair]:
    groups = deck.whole(card, 3)
    if not groups and card.text(1) and card.text(2):
        return [Pair(card, deck.whole(card, 1), deck.whole(card, 2))]
    pairs: list[Pair] = []
    current: Pair | None = None
    count, is_list = 0, False
    for i in range(8, len(card.fields), 8):
        word = card.text(i).upper()
        if word in _SECONDARY and card.text(i + 1):
            glued = bool(deck.whole(card, i + 6))
            current = Pair(card, deck.whole(card, i + 1), 0, card.text(i + 4), glued)
            count, is_list = count + 1, False
        elif word in _PRIMARY and current is not None:
            is_list = True
        elif (word and word not in _DETAILS) or current is None or "TIED" in str(card.fields).upper():
            count = -1
            break
        if is_list and current is not None:
            given = [j for j in range(i + 1, i + 8) if card.text(j)]
            pairs += [replace(current, second=deck.whole(card, j)) for j in given]
    if not pairs or count != groups:
        text = f"contact: not of the form NGROUP, then SECNDRY and PRIMARY (or SLAVE and MASTER) of each group; {_ASK}"
        deck.find(card, text, "missing")
        return []
    return pairs


def _connections(deck: Deck, card: Card) -> list[Card]:
    known = {deck.whole(c, 0): c for c in deck.of("BCONECT")}
    found: list[Card] = []
    try:
        for some in ranges(card, 1):
            if len(some) == 1 and some[0] not in known:
                raise deck.fault(card, f"names BCONECT {some[0]}, which does not exist")
            found += [c for number, c in known.items() if number in some]
    except (ValueError, OverflowError):
        raise deck.fault(card, "has no list of numbers of BCONECT") from None
    return found


def _of_connection(deck: Deck, card: Card) -> list[Pair]:
    sides: dict[tuple[str, ...], list[int]] = {
        words: [deck.whole(card, i)] if card.text(i) else [] for words, i in ((_SECONDARY, 3), (_PRIMARY, 4))
    }
    short = {words for words, bodies in sides.items() if bodies}
    current: tuple[str, ...] = ()
    for i in range(8, len(card.fields), 8):
        word = card.text(i).upper()
        current = next((words for words in sides if word in words), () if word else current)
        if current and current not in short:
            sides[current] += [deck.whole(card, j) for j in range(i + 1, i + 8) if card.text(j)]
    if not all(sides.values()):
        deck.find(card, f"contact: names no pair of bodies; {_ASK}", "missing")
        return []
    geometry, physics = _parameters(deck, card, "BCONPRG", 1), _parameters(deck, card, "BCONPRP", 2)
    if "FRIC" in geometry:
        deck.find(card, f"contact: FRIC belongs to BCONPRP, and stands on BCONPRG; {_ASK}", "missing")
        return []
    glued = geometry.get("IGLUE", "0").lstrip("+0") != "" or geometry.get("METHOD", "").upper().startswith("TIED")
    return [Pair(card, a, b, physics.get("FRIC", ""), glued) for a in sides[_SECONDARY] for b in sides[_PRIMARY]]


def _parameters(deck: Deck, card: Card, name: str, i: int) -> dict[str, str]:
    """Return names and values of a card of parameters that field i names, none where it is blank."""
    if not card.text(i):
        return {}
    for other in deck.of(name):
        if deck.whole(other, 0) == deck.whole(card, i):
            texts = [text for text in other.fields[1:] if text]
            return {key.upper(): value for key, value in zip(texts[::2], texts[1::2], strict=False)}
    raise deck.fault(card, f"refers to {name} {card.text(i)}, which does not exist")


def _body(deck: Deck, pair: Pair, number: int) -> Card:
    for card in deck.of("BCBODY", "BCBODY1"):
        if deck.whole(card, 0) == number:
            return card
    raise deck.fault(pair.card, f"names body {number}, which no BCBODY or BCBODY1 defines")


def _surfaces(deck: Deck, loaded: LoadedMesh, pair: Pair) -> list[str] | None:
    known, found = loaded.mesh.boundaries or {}, []
    for number in (pair.first, pair.second):
        region = number
        if pair.card.name != "BCTSET":
            body = _body(deck, pair, number)
            behaviour, surface = (2, 3) if body.name == "BCBODY" else (3, 4)
            if body.text(behaviour).upper() not in ("", "DEFORM"):
                text = f'contact: is {body.text(behaviour)[:20]}; give [[contacts]] with counterface = "rigid"'
                deck.find(body, text, "missing")
                return None
            region = deck.whole(body, surface)
        name = next((n for n in (f"BSURFS_{region}", f"BSURF_{region}") if n in known), None)
        if name is None:
            deck.find(pair.card, f"contact: region {region} is no BSURF or BSURFS on solids; {_ASK}", "missing")
            return None
        found.append(name)
    return found


def _friction(deck: Deck, pair: Pair) -> float | None:
    """Return the coefficient of a pair, None where it has to be asked for."""
    card, text = pair.card, pair.friction
    if card.name != "BCTSET" and not text and not pair.glued:
        for number in (pair.first, pair.second):
            body = _body(deck, pair, number)
            own = body.text(5) if body.name == "BCBODY" else _parameters(deck, body, "BCBDPRP", 1).get("FRIC", "")
            if own:
                deck.find(body, f"contact: friction stands at the body, and not at the pair; {_ASK}", "missing")
                return None
    if card.name != "BCTSET" and not pair.glued and text.isdigit() and int(text):
        deck.find(card, f"contact: FRIC {text} is a table; give mu and {_ASK.removeprefix('give ')}", "missing")
        return None
    value = deck.number(Card(card.name, [card.text(0), text], card.where), 1)
    if value < 0:
        raise deck.fault(card, f"has a friction coefficient of {value:g}; expected one that is not negative")
    return value


def _softer(deck: Deck, loaded: LoadedMesh, materials: dict[int, tuple[Card, Numbers]], names: list[str]) -> float:
    """Return E/h of the softer side, in the deck's units; 0 where no modulus is known."""
    mesh, found = loaded.mesh, []
    used = {str(deck.whole(card, 0)): deck.whole(card, 1) for card in deck.of("PSOLID")}
    for name in names:
        facets = np.asarray((mesh.boundaries or {})[name])
        size = np.sqrt(area_of(mesh, facets)[0] / len(facets))
        for group, elements in (mesh.subdomains or {}).items():
            numbers = materials[used[group]][1] if used.get(group) in materials else {}
            if "youngs_modulus" in numbers and np.isin(elements, mesh.f2t[0, facets]).any():
                found.append(min(numbers["youngs_modulus"]) / size)
    return float(min((value for value in found if value > 0), default=0.0))
