"""CONTA174 and TARGE170 with real constants, KEYOPT(12) and MU, CMROTATE and CMOMEGA: contacts of the scene."""

from __future__ import annotations

import numpy as np

from ...mesh.measures import area_of
from ..draft import Table, Value
from .content import Content, clean, is_zero

_FKN, _TAUMAX, _FACT, _DC = 2, 8, 20, 21  # places among the real constants
_NO_LIMIT = 1e19  # of the shear stress: TAUMAX is 1e20 by default
_KIND, _CLOSED = 12, (2, 4)  # number of the key option, and its values without separation
_TIED = {1: "rough", 3: "bonded", 5: "bonded", 6: "bonded"}
_TIE = 100.0  # times E/h of the softer side, as for *Tie
_ALGORITHM, _MPC = 2, 2
_SIDES, _ONE_SIDE = 8, 2  # key option of pairs that are one contact from both sides, and its value for one of them


def write_contacts(content: Content) -> float | None:
    """Write a contact for each pair of contact and target elements; return the largest friction coefficient."""
    surfaces = content.loaded.mesh.boundaries or {}
    pairs = _without_mirrors(content, sorted({int(n.rpartition("_")[2]) for n in surfaces if n.startswith("contact_")}))
    tied = {real: _tied(content, real) for real in pairs}
    coefficients = {real: None if tied[real] else _friction(content, real) for real in pairs}
    mu = max((m for m in coefficients.values() if m), default=None)
    motions = _motions(content)
    for name, why in content.loaded.unusable.items():
        if name.startswith("contact_"):
            content.draft.find("CONTA174", "", f"{name} is left out: {why}", "missing")
    for real in pairs:
        if f"target_{real}" not in surfaces:
            why = content.loaded.unusable.get(f"target_{real}", "")
            text = f"contact_{real} has no target elements of the same real constant on solids" + (why and f": {why}")
            content.draft.find("TARGE170", "", text, "missing")
            continue
        names, sliding = [f"contact_{real}", f"target_{real}"], None
        for component, motion in motions:
            moves = [_is_in(content, name, component) for name in names]
            if moves[0] != moves[1]:
                sliding = motion
                names = names if moves[1] else names[::-1]  # the counterface is what moves
        values: dict[str, Value] = {"name": f"contact_{real}", "surface": names[0], "counterface": names[1]}
        table = content.draft.add("contacts", is_entry=True, values=values)
        _write_stiffness(content, table, real, names, tied[real])
        if tied[real]:
            table.values["kind"] = "tied"
            table.comments.append(f"{tied[real]} in the archive")
            text = f"{tied[real]} contact is taken as tied, by stiff springs; compare with ten times as much"
            content.draft.find("KEYOPT(12)", "", text)
            continue
        if not coefficients[real]:
            table.values["kind"] = "frictionless"
            continue
        _tell_laws(content, real)
        if sliding is not None:
            table.values["sliding"] = sliding
            if coefficients[real] != mu:
                table.values["friction_ratio"] = clean((coefficients[real] or 0.0) / (mu or 1.0))
        else:
            table.open.append(("sliding = { axis = [0.0, 0.0, 1.0], centre = [0.0, 0.0, 0.0], speed = 1.0 }",
                               "how the counterface moves (CMROTATE), or kind = \"tied\""))  # fmt: skip
    return mu


def _without_mirrors(content: Content, pairs: list[int]) -> list[int]:
    """Leave out one of two pairs that are one contact from both sides, where KEYOPT(8) lets only one of them act.

    Which of the two acts is chosen there at the solution; it is the same contact (Mechanical APDL element reference,
    CONTA174). Without the option both act, there and here.
    """
    surfaces = content.loaded.mesh.boundaries or {}
    sides = {real: [surfaces.get(f"{word}_{real}") for word in ("contact", "target")] for real in pairs}
    kept: list[int] = []
    for real in pairs:
        mirrors = [r for r in kept if all(map(_same_facets, sides[real], sides[r][::-1]))]
        one = any(_options(content, r).get(_SIDES) == _ONE_SIDE for r in (real, *mirrors))
        if mirrors and one:
            text = f"one of contact_{mirrors[0]} and contact_{real} acts, which are one contact: the first is taken"
            content.draft.find("KEYOPT(8)", "", text, "harmless")
        else:
            kept.append(real)
    return kept


def _same_facets(some: np.ndarray | None, others: np.ndarray | None) -> bool:
    return some is not None and others is not None and np.array_equal(np.asarray(some), np.asarray(others))


def _write_stiffness(content: Content, table: Table, real: int, names: list[str], tied: str) -> None:
    constants = content.archive.reals.get(real, np.zeros(0))
    factor = float(constants[_FKN]) if len(constants) > _FKN else 0.0
    unit = content.units.pressure / content.units.length
    soft = _softer(content, names) * unit
    if factor < 0:
        table.values["normal_stiffness"] = clean(-factor * unit)
        table.comments.append(f"FKN = {factor:g}: absolute")
    elif tied and soft:
        table.values["normal_stiffness"] = clean(float(f"{_TIE * soft:.6g}"))
    else:
        value = float(f"{(factor or 1.0) * (soft or 1e12):.2g}")
        table.open.append((
            f"normal_stiffness = {value!r}",
            f"FKN = {factor or 1.0:g} is a factor of the program's own stiffness; give N/m per m^2, e.g. FKN E/h ="
            f" {value:.2g} of the softer side, and see how onsets move with it",
        ))  # fmt: skip


def _elements(content: Content, real: int) -> np.ndarray:
    types = [int(row[0]) for row in content.archive.ekey if int(row[1]) in (173, 174)]
    rows = content.archive.elem
    return rows[(rows[:, 2] == real) & np.isin(rows[:, 1], types)]


def _friction(content: Content, real: int) -> float | None:
    used = np.unique(_elements(content, real)[:, 0])
    return max((content.materials.get(int(m), {}).get("MU", 0.0) for m in used), default=0.0) or None


def _tell_laws(content: Content, real: int) -> None:
    """Tell of real constants of friction that are left out.

    The coefficient is MU (1 + (FACT - 1) exp(-DC v)) at the sliding speed v (Ansys contact guide, Static and dynamic
    friction coefficients).
    """
    constants = content.archive.reals.get(real, np.zeros(0))
    limit, ratio, decay = (float(constants[i]) if len(constants) > i else 0.0 for i in (_TAUMAX, _FACT, _DC))
    if ratio not in (0.0, 1.0):
        text = (
            f"FACT = {ratio:g} and DC = {decay:g} of real constants {real} are left out: MU is taken, which is that of"
            " fast sliding; [effects.falling_friction] slope gives dmu/dv"
        )
        content.draft.find("FACT", "", text)
    if 0 < limit < _NO_LIMIT:
        text = f"the limit of the shear stress of real constants {real}, {limit:g}, is not simulated"
        content.draft.find("TAUMAX", "", text)


def stay_closed(content: Content) -> list[bool]:
    """Return for each contact that is not tied whether its key options let it open no more."""
    names = content.loaded.mesh.boundaries or {}
    pairs = _without_mirrors(content, sorted(int(n.rpartition("_")[2]) for n in names if n.startswith("contact_")))
    free = [real for real in pairs if f"target_{real}" in names and not _tied(content, real)]
    return [_options(content, real).get(_KIND, 0) in _CLOSED for real in free]


def _options(content: Content, real: int) -> dict[int, int]:
    """Return the key options of the contact elements of a set of real constants."""
    kinds = {str(int(t)) for t in np.unique(_elements(content, real)[:, 1])}
    found = {}
    for fields, where in content.lines:
        if fields[0] in ("KEYOP", "KEYOPT") and len(fields) > 3 and fields[1] in kinds:
            key, value = (content.number(text, where, fields) for text in fields[2:4])
            found[int(key)] = int(value)
    return found


def _tied(content: Content, real: int) -> str:
    """Return what ties a contact by its key options, "" if it may slide."""
    options = _options(content, real)
    kind = options.get(_KIND, 0)
    is_bonded = options.get(_ALGORITHM) == _MPC and kind not in _CLOSED
    return _TIED.get(kind, "bonded" if is_bonded else "")


def _softer(content: Content, names: list[str]) -> float:
    """Return E/h of the softer side in the archive's units, 0 if no material says it."""
    mesh, found = content.loaded.mesh, []
    for name in names:
        facets = np.asarray((mesh.boundaries or {})[name])
        size = np.sqrt(area_of(mesh, facets)[0] / len(facets))
        for number, values in content.materials.items():
            cells = (mesh.subdomains or {}).get(f"material_{number}", np.zeros(0, int))
            if values.get("EX", 0.0) > 0 and np.isin(cells, mesh.f2t[0, facets]).any():
                found.append(min(values.get(key, values["EX"]) for key in ("EX", "EY", "EZ")) / size)
    return min(found, default=0.0)


def _is_in(content: Content, surface: str, component: str) -> bool:
    mesh = content.loaded.mesh
    cells = next((c for n, c in (mesh.subdomains or {}).items() if n.upper() == component), np.zeros(0, int))
    facets = np.asarray((mesh.boundaries or {})[surface])
    return bool(np.isin(mesh.f2t[0, facets], cells).mean() > 0.5)


def _motions(content: Content) -> list[tuple[str, dict[str, Value]]]:
    """Return the components that turn, with `sliding` of the scene.

    ROTATX, Y, Z is the vector of the speed, about a line through X1, Y1, Z1; with X2, Y2, Z2 the line goes from one
    point to the other, and ROTATX is the speed; a second point at zero is none (Mechanical APDL command reference,
    CMROTATE).
    """
    found = []
    known = {name.upper() for name in content.loaded.mesh.subdomains or {}}
    for fields, where in content.lines:
        if fields[0] not in ("CMROTATE", "CMOMEGA") or len(fields) < 3:
            continue
        texts = (fields[2:11] + [""] * 9)[:9]
        v = np.array([content.number(text, where, fields) for text in texts])
        is_line = not all(is_zero(text) for text in texts[6:])
        way = v[6:] - v[3:6] if is_line else v[:3]
        speed = float(v[0] if is_line else np.linalg.norm(v[:3]))
        if not speed or not np.linalg.norm(way):
            continue
        if fields[1] not in known:
            text = f'its component "{fields[1]}" has no solids; give sliding in [[contacts]]'
            content.draft.find(fields[0], where, text)
            continue
        sliding: dict[str, Value] = {"axis": [clean(round(float(x), 15)) for x in way / np.linalg.norm(way)]}
        if np.any(v[3:6]):
            sliding["centre"] = [clean(float(x) * content.units.length) for x in v[3:6]]
        sliding["speed"] = clean(speed / content.units.time)
        found.append((fields[1], sliding))
    return found
