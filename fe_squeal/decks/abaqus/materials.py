"""*Material with *Elastic, *Density and *Damping: materials of the scene."""

from __future__ import annotations

import numpy as np

from ...errors import MeshError
from ...mesh.readers.abaqus.model import Statement
from ..draft import Value, plain_name
from ..units import SI, likely, recognise
from .content import Content, Substance, real, spoken

# What else stands under a material, and what it would mean.
_OTHERS = {
    "PLASTIC": "yielding is not simulated: vibrations are small and elastic about the static state",
    "EXPANSION": "no temperatures are simulated, so that nothing expands",
    "HYPERELASTIC": "only linear elasticity is simulated; give the moduli at the working point in [materials]",
    "HYPERFOAM": "only linear elasticity is simulated; give the moduli at the working point in [materials]",
    "VISCOELASTIC": "moduli do not depend on frequency; loss_factor and [effects.structural_damping] give losses",
}
SUBOPTIONS = {
    "ELASTIC", "DENSITY", "DAMPING", "CONDUCTIVITY", "SPECIFIC HEAT", "DEPVAR", "USER MATERIAL", "CREEP",
    "CYCLIC HARDENING",     "DAMAGE INITIATION", "DAMAGE EVOLUTION", "NO COMPRESSION", "NO TENSION", *_OTHERS,
}  # fmt: skip


def read_material(content: Content, statement: Statement) -> None:
    """Take *Material: what follows belongs to it."""
    name = statement.block.value("NAME")
    if name.upper() in content.substances:
        text = f'the deck has two materials "{name}", whose numbers are mixed here; give those that are meant'
        content.draft.find("*Material", content.where(statement), text, "missing")
    content.substance = content.substances.setdefault(name.upper(), Substance(name, content.where(statement)))


def read_suboption(content: Content, statement: Statement) -> None:
    """Take a keyword under *Material."""
    block, substance = statement.block, content.substance
    if substance is None:
        what = f"*{spoken(block.keyword)}"
        content.draft.find(what, content.where(statement), "stands under no *Material and is not taken over")
    elif block.keyword == "ELASTIC":
        _read_elastic(content, statement, substance)
    elif block.keyword == "DENSITY":
        values = content.first(block)
        substance.density = values[0] if values else None
        _only_first(content, statement, "density")
    elif block.keyword == "DAMPING":
        for key in ("alpha", "beta", "structural"):
            text = block.value(key.upper())
            if text and key.upper() in block.parameters:
                setattr(substance, key, _parameter(content, statement, text))
        if "COMPOSITE" in block.parameters:
            text = "a share of critical damping for modal analysis; it has no equivalent"
            content.draft.find("*Damping, COMPOSITE", content.where(statement), text)
    else:
        text = _OTHERS.get(block.keyword, "has no equivalent in a linear vibration and is not taken over")
        content.draft.find(f"*{spoken(block.keyword)}", content.where(statement), text)


def _parameter(content: Content, statement: Statement, text: str) -> float:
    try:
        return real(text)
    except ValueError:
        raise MeshError(
            f'{content.source}: {statement.block.where}: "{statement.block.shown(text)}" behind a parameter of'
            f" *{spoken(statement.block.keyword)} is not a number"
        ) from None


def _only_first(content: Content, statement: Statement, what: str, lines: int = 1) -> None:
    if len(statement.block.lines) > lines:
        content.draft.find(
            f"*{spoken(statement.block.keyword)}", content.where(statement),
            f"the {what} depends on temperature or other fields; the first row is taken",
        )  # fmt: skip


def _read_elastic(content: Content, statement: Statement, substance: Substance) -> None:
    block = statement.block
    kind = block.value("TYPE").upper() or "ISOTROPIC"
    values = [v or 0.0 for line in block.lines for v in _padded(content.floats(block, line), kind)]
    if kind.startswith("ISO") and len(values) >= 2:
        substance.elastic = {"youngs_modulus": [values[0]], "poisson_ratio": [values[1]]}
        _only_first(content, statement, "stiffness")
        return
    if kind == "ENGINEERING CONSTANTS" and len(values) >= 9:
        e, (nu12, nu13, nu23), (g12, g13, g23) = values[:3], values[3:6], values[6:9]
        substance.elastic = {"youngs_modulus": e, "poisson_ratio": [nu23, nu13, nu12], "shear_modulus": [g23, g13, g12]}
        _only_first(content, statement, "stiffness", 2)
        return
    if kind.startswith("ORTHO") and len(values) >= 9:
        d11, d12, d22, d13, d23, d33, g12, g13, g23 = values[:9]
        D = np.array([[d11, d12, d13], [d12, d22, d23], [d13, d23, d33]])
        try:
            S = np.linalg.inv(D)
        except np.linalg.LinAlgError:
            raise MeshError(f"{content.source}: {block.where}: this *Elastic has a singular stiffness") from None
        substance.elastic = {
            "youngs_modulus": [float(1 / S[i, i]) for i in range(3)],
            "poisson_ratio": [float(-S[i, j] / S[i, i]) for i, j in ((1, 2), (0, 2), (0, 1))],
            "shear_modulus": [g23, g13, g12],
        }
        _only_first(content, statement, "stiffness", 2)
        return
    content.draft.find(
        f"*Elastic, TYPE={kind}", content.where(statement),
        f"is not read; give youngs_modulus and poisson_ratio in [materials.{plain_name(substance.name)}]", "missing",
    )  # fmt: skip


def _padded(values: list[float | None], kind: str) -> list[float | None]:
    """Fill a row of nine constants up to its eight fields, of which the last may be blank."""
    return values if kind.startswith("ISO") else values + [None] * (-len(values) % 8 if len(values) > 1 else 0)


def find_units(content: Content) -> None:
    """Recognise the units of the deck, and say so."""
    used = _used_by_solids(content)
    numbers = [
        (s.elastic["youngs_modulus"][0], s.density)
        for s in used
        if s.elastic and s.density and s.elastic["youngs_modulus"][0] > 0 and s.density > 0
    ]
    size = float(np.ptp(content.loaded.mesh.p, axis=1).max())
    units, others = recognise(numbers, size)
    draft = content.draft
    if units is None:
        moduli = [m for s in used for m in s.elastic.get("youngs_modulus", [])]
        draft.units, draft.suggested_in = "any", likely(moduli, size)
        draft.head.append(
            "Units: no usual system makes a brake's material and size of this deck's numbers; they are left as they"
            ' are, with units = "any".'
        )
        return
    content.units = units
    modulus, density = numbers[0]
    rho, speed = density * units.density, np.sqrt(modulus / density) * units.speed
    draft.head.append(
        f"Units: the deck's numbers are taken as {units.name}: {density:g} is {rho:.4g} kg/m^3, and sound runs at"
        f" {speed:.0f} m/s." + (" They are turned into SI here." if units is not SI else "")
        + (f" (They could also be {' or '.join(u.name for u in others)}.)" if others else "")
    )  # fmt: skip


def _used_by_solids(content: Content) -> list[Substance]:
    """Return the materials of sections that have solids: dummy ones of shells and the like say nothing of units."""
    groups = content.loaded.mesh.subdomains or {}
    used = {
        s.block.value("MATERIAL").upper()
        for s in content.sections
        if content.group(groups, (s.block.value("ELSET"), s.scope))
    }
    return [s for key, s in content.substances.items() if key in used] or list(content.substances.values())


def write_materials(content: Content) -> None:
    """Write the materials that sections use, in SI units."""
    used = {s.block.value("MATERIAL").upper() for s in content.sections}
    units = content.units
    for key, substance in content.substances.items():
        if key not in used:
            text = f"material {substance.name} is of no section"
            content.draft.find("*Material", substance.where, text, "harmless")
            continue
        values: dict[str, Value] = {}
        table = content.draft.add("materials", material_name(content, key))
        for name, numbers in substance.elastic.items():
            factor = 1.0 if name == "poisson_ratio" else units.pressure
            scaled = [clean(v * factor) for v in numbers]
            values[name] = scaled if len(scaled) > 1 else scaled[0]
        if substance.density is not None:
            values["density"] = clean(substance.density * units.density)
        if substance.structural:
            values["loss_factor"] = substance.structural
        table.values = values
        table.comments.append(f"*Material {substance.name}, {substance.where}")
        if not substance.elastic:
            content.draft.ask(table, "youngs_modulus", "the deck has no linear elasticity for this material")
            content.draft.ask(table, "poisson_ratio", "and no Poisson's ratio")
        if substance.density is None:
            content.draft.ask(table, "density", "the deck has no density for this material")


def clean(value: float) -> float:
    """Return a number without the rounding of a change of units: 15 digits."""
    return float(f"{value:.15g}")


def material_name(content: Content, key: str) -> str:
    """Return the scene's name of a material of the deck."""
    names: dict[str, str] = {}
    for other, substance in content.substances.items():
        names[other] = plain_name(substance.name, names.values())
    return names[key]
