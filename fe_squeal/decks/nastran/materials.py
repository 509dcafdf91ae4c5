"""MAT1, MAT9, MAT11 and PSOLID: materials and bodies."""

from __future__ import annotations

import numpy as np

from ...mesh import LoadedMesh
from ...mesh.readers.nastran.text import Card
from ..draft import Value, plain_name
from ..units import SI, likely, recognise
from .cards import Deck

Numbers = dict[str, list[float]]


def read_materials(deck: Deck) -> dict[int, tuple[Card, Numbers]]:
    """Return the numbers of each material in the deck's units: moduli, ratios, density, loss_factor."""
    found: dict[int, tuple[Card, Numbers]] = {}
    for card in deck.of("MAT1"):
        E, G, nu = (deck.number(card, i) for i in (1, 2, 3))
        if not card.text(3) and E and G:
            nu = E / (2 * G) - 1
        if not E and G:
            E = 2 * G * (1 + nu)
        values = {"youngs_modulus": [E], "poisson_ratio": [nu]} if E else {}
        found[deck.whole(card, 0)] = card, values | _rest(deck, card, 4, 7)
    for card in deck.of("MAT11"):
        moduli, (n12, n13, n23), (g12, g13, g23) = (
            [deck.number(card, i) for i in range(first, first + 3)] for first in (1, 4, 7)
        )
        values = {"youngs_modulus": moduli, "poisson_ratio": [n23, n13, n12], "shear_modulus": [g23, g13, g12]}
        found[deck.whole(card, 0)] = card, values | _rest(deck, card, 10, 15)
    for card in deck.of("MAT9"):
        found[deck.whole(card, 0)] = card, _from_stiffness(deck, card) | _rest(deck, card, 22, 30)
    return found


def _rest(deck: Deck, card: Card, density: int, loss: int) -> Numbers:
    found: Numbers = {}
    if card.text(density):
        found["density"] = [deck.number(card, density) * deck.mass_factor]
    eta = deck.number(card, loss) + deck.loss_factor  # PARAM G and GE add up: K(1 + iG) + i ΣGE K_e
    if eta:
        found["loss_factor"] = [eta]
    return found


def _from_stiffness(deck: Deck, card: Card) -> Numbers:
    """Return engineering constants of the upper triangle of MAT9, in the order xx, yy, zz, xy, yz, zx."""
    C = np.zeros((6, 6))
    C[np.triu_indices(6)] = [deck.number(card, i) for i in range(1, 22)]
    C += np.triu(C, 1).T
    mixed = C.copy()
    mixed[:3, :3] = 0
    mixed[[3, 4, 5], [3, 4, 5]] = 0
    size = np.abs(C).max()
    if not size or np.abs(mixed).max() > 1e-9 * size or np.linalg.cond(C) > 1e12:
        deck.find(card, "is not orthotropic about its own axes, which is all that is simulated", "missing")
        return {}
    S = np.linalg.inv(C[:3, :3])
    return {
        "youngs_modulus": [float(1 / S[i, i]) for i in range(3)],
        "poisson_ratio": [float(-S[i, j] / S[i, i]) for i, j in ((1, 2), (0, 2), (0, 1))],
        "shear_modulus": [float(C[4, 4]), float(C[5, 5]), float(C[3, 3])],
    }


def find_units(deck: Deck, materials: dict[int, tuple[Card, Numbers]], size: float) -> None:
    """Recognise the units of the deck, and say so."""
    numbers = [
        (v["youngs_modulus"][0], v["density"][0])
        for _, v in materials.values()
        if "density" in v and "youngs_modulus" in v and v["youngs_modulus"][0] > 0 and v["density"][0] > 0
    ]
    units, others = recognise(numbers, size)
    if units is None:
        moduli = [m for _, v in materials.values() for m in v.get("youngs_modulus", [])]
        deck.draft.units, deck.draft.suggested_in = "any", likely(moduli, size)
        deck.draft.head.append(
            "Units: no usual system makes a brake's material and size of this deck's numbers; they are left as they"
            ' are, with units = "any".'
        )
        return
    deck.units = units
    modulus, density = numbers[0]
    speed = np.sqrt(modulus / density) * units.speed
    deck.draft.head.append(
        f"Units: the deck's numbers are taken as {units.name}: {density:g} is {density * units.density:.4g} kg/m^3, and"
        f" sound runs at {speed:.0f} m/s." + (" They are turned into SI here." if units is not SI else "")
        + (f" (They could also be {' or '.join(u.name for u in others)}.)" if others else "")
    )  # fmt: skip


def write_bodies(deck: Deck, loaded: LoadedMesh, materials: dict[int, tuple[Card, Numbers]]) -> None:
    """Write the materials that properties use, and a body for each property."""
    properties = {deck.whole(card, 0): card for card in deck.of("PSOLID")}
    groups = loaded.mesh.subdomains or {}
    titles: dict[str, str] = {}  # a name of the preprocessor for each property's number
    for name, elements in groups.items():
        same = next((n for n, e in groups.items() if n.isdigit() and np.array_equal(e, elements)), None)
        if same is not None and not name.isdigit():
            titles.setdefault(same, name)
    used = {deck.whole(card, 1) for pid, card in properties.items() if str(pid) in groups}
    for mid in sorted(used & set(materials)):
        card, numbers = materials[mid]
        table = deck.draft.add("materials", f"mat_{mid}")
        table.comments.append(f"{card.name} {mid}, {deck.where(card)}")
        for key, values in numbers.items():
            factor = {"youngs_modulus": deck.units.pressure, "shear_modulus": deck.units.pressure,
                      "density": deck.units.density}.get(key, 1.0)  # fmt: skip
            scaled = [clean(v * factor) for v in values]
            table.values[key] = scaled if len(scaled) > 1 else scaled[0]
        if "density" not in numbers:
            deck.draft.ask(table, "density", "the deck has no density for this material")
        if "youngs_modulus" not in numbers:
            deck.draft.ask(table, "youngs_modulus", "the deck has no linear elasticity that is read")
    taken: list[str] = []
    for group, elements in groups.items():
        if not group.isdigit():
            continue
        owner = properties.get(int(group))
        if owner is None or deck.whole(owner, 1) not in materials:
            text = f"{len(elements)} solid elements are of property {group}, which has no PSOLID with a known material"
            deck.draft.find("PSOLID", "", text, "missing")
            continue
        name = plain_name(titles.get(group, f"property_{group}"), taken)
        taken.append(name)
        mid = deck.whole(owner, 1)
        table = deck.draft.add("bodies", name, values={"material": f"mat_{mid}", "groups": [group]})
        table.comments.append(f"PSOLID {group}, {deck.where(owner)}")
        if "shear_modulus" in materials[mid][1]:
            axes = _axes(deck, owner)
            if axes is not None:
                table.values["axes"] = axes


def _axes(deck: Deck, card: Card) -> Value | None:
    number = deck.whole(card, 2)
    if number == 0:
        return None
    system = deck.systems.get(number)
    if system is None or system.kind != "R" or system.reference != 0:
        text = (
            f"has its material axes in system {number}: only one that is the same throughout, CORD2R or CORD1R, is"
            " simulated"
        )
        deck.find(card, text, "missing")
        return None
    a, b, c = system.points
    z = (b - a) / np.linalg.norm(b - a)
    x = (c - a) - ((c - a) @ z) * z
    x /= np.linalg.norm(x)
    return [[clean(round(float(v), 15)) + 0.0 for v in axis] for axis in (x, np.cross(z, x))]


def clean(value: float) -> float:
    """Return a number without the rounding of a change of units: 15 digits."""
    return float(f"{value:.15g}")
