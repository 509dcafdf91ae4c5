"""From an Ansys archive to the draft of a scene: MPDATA, D, contact pairs, MODOPT."""

from __future__ import annotations

import re

import numpy as np

from ..errors import MeshError
from ..mesh.building import build_mesh
from ..mesh.raw import RawMesh
from ..mesh.readers.ansys import mesh_of, read_archive
from ..mesh.readers.sources import Sources
from .draft import Draft, Value, Weight
from .units import SI, Units, recognise

Line = tuple[list[str], str]  # fields in capitals, and where they stand
_HELD = {"UX": "x", "UY": "y", "UZ": "z", "ALL": "xyz"}
LEFT_OUT: dict[str, tuple[str, Weight]] = {
    **dict.fromkeys(("CE", "CERIG", "CP", "RBE3"),
                    ("ties nodes and is not read; give [[rigid]] or [[averaged]]", "missing")),
    **dict.fromkeys(("F", "SFE", "SF", "SFA", "BF", "ACEL"),
                    ("is a load that is not read; [effects.preload] takes pressures on surfaces", "changes")),
    **dict.fromkeys(("CMROTATE", "CMOMEGA", "OMEGA"),
                    ("a motion: give sliding in [[contacts]], or [effects.rotation]", "changes")),
}  # fmt: skip
BECOMES: dict[str, str] = {
    "NBLOCK, EBLOCK": "nodes and SOLID185, 186, 187 and 285",
    "CMBLOCK": "volume groups and node sets", "MP, MPDATA": "`[materials.material_N]`: EX, NUXY or PRXY, DENS, DMPR;"
    " isotropic ones; MU is `mu`",
    "D": "`[[supports]]` of the nodes that are held alike",
    "CONTA173, CONTA174, TARGE170": "surfaces contact_N and target_N by real constant, and `[[contacts]]`; stiffness"
    " (FKN) and motion are asked for",
    "MODOPT": "`[solve] modes`",
}  # fmt: skip


def draft_ansys(sources: Sources, mesh_file: str) -> Draft:
    """Return the draft of the scene that an Ansys archive describes; the other parameters as of `draft_abaqus`.

    Raises
    ------
    MeshError
    """
    source = sources.path.name
    archive = read_archive(sources)
    raw = mesh_of(archive, source)
    loaded = build_mesh(raw, source)
    lines = _commands(sources)
    draft = Draft(sources.path.stem)
    draft.head.append(f"Made by fe-squeal new from the Ansys archive {source}.")
    materials = _materials(lines, source)
    numbers = [(m["EX"], m["DENS"]) for m in materials.values() if m.get("EX", 0) > 0 and m.get("DENS", 0) > 0]
    units, others = recognise(numbers, float(np.ptp(loaded.mesh.p, axis=1).max()))
    if units is None:
        draft.units, units = "any", SI
        draft.head.append('Units: no usual system makes sense of these numbers; they are left, with units = "any".')
    else:
        more = f" (They could also be {' or '.join(u.name for u in others)}.)" if others else ""
        draft.head.append(f"Units: the archive's numbers are taken as {units.name}.{more}")
    draft.add("mesh", values={"file": mesh_file, "length_unit": units.length_unit, "order": 2})
    _write_bodies(draft, raw, materials, units)
    _write_supports(draft, lines, raw, source)
    _write_contacts(draft, raw, max((m.get("MU", 0.0) for m in materials.values()), default=0.0))
    for fields, _ in lines:
        if fields[0] == "MODOPT" and len(fields) > 2 and fields[2].isdigit() and int(fields[2]):
            draft.add("solve", values={"modes": int(fields[2])})
            break
    for word, (text, weight) in LEFT_OUT.items():
        for fields, where in lines:
            if fields[0] == word and not _is_nothing(fields):
                draft.find(word, where, text, weight)
                break
    return draft


def _is_nothing(fields: list[str]) -> bool:
    """Whether a command sets zeros alone, as CDWRITE writes ACEL and OMEGA."""
    return fields[0] in ("ACEL", "OMEGA") and all(not f or re.fullmatch(r"0*\.?0*", f) for f in fields[1:])


def _commands(sources: Sources) -> list[Line]:
    found = []
    for number, line in enumerate(sources.lines(sources.path, 0, "an Ansys archive"), 1):
        text = line.partition("!")[0].strip()
        if text[:1].isalpha():
            found.append(([part.strip().upper() for part in text.split(",")], f"line {number}"))
    return found


def _materials(lines: list[Line], source: str) -> dict[int, dict[str, float]]:
    found: dict[int, dict[str, float]] = {}
    for fields, where in lines:
        if fields[0] == "MPDATA" and len(fields) > 6 and fields[1].startswith("R"):
            label, material, first, value = fields[3], fields[4], fields[5], fields[6]
        elif fields[0] == "MP" and len(fields) > 3:
            label, material, first, value = fields[1], fields[2], "1", fields[3]
        else:
            continue
        try:
            if int(first) == 1:
                found.setdefault(int(material), {}).setdefault(label, float(value))
        except ValueError:
            raise MeshError(f'{source}: {where}: "{",".join(fields)[:60]}" is no material value') from None
    return found


def _write_bodies(draft: Draft, raw: RawMesh, materials: dict[int, dict[str, float]], units: Units) -> None:
    for group in [g for g in raw.volume_groups if g.startswith("material_")]:
        values = materials.get(int(group.rpartition("_")[2]), {})
        table = draft.add("materials", group)
        if any(key in values and values[key] != values.get("EX") for key in ("EY", "EZ")):
            table.open.append(("youngs_modulus = [E1, E2, E3]", "orthotropic: give its lists, and axes of the body"))
        elif "EX" in values:
            table.values["youngs_modulus"] = _clean(values["EX"] * units.pressure)
        else:
            table.open.append(("youngs_modulus = 2.1e11", "the archive has no EX for this material, Pa"))
        ratio = values.get("PRXY", values.get("NUXY"))
        if ratio is None:
            table.open.append(("poisson_ratio = 0.3", "the archive has no NUXY or PRXY for this material"))
        else:
            table.values["poisson_ratio"] = ratio
        if "DENS" in values:
            table.values["density"] = _clean(values["DENS"] * units.density)
        else:
            table.open.append(("density = 7800.0", "the archive has no DENS for this material, kg/m^3"))
        draft.add("bodies", group, values={"material": group})


def _write_supports(draft: Draft, lines: list[Line], raw: RawMesh, source: str) -> None:
    held: dict[int, set[str]] = {}
    known = set(raw.node_labels.tolist())
    for fields, where in lines:
        if fields[0] != "D" or len(fields) < 3 or fields[2] not in _HELD:
            continue
        if not fields[1].isdigit() or int(fields[1]) not in known:
            if fields[1].isdigit():
                continue  # a pilot node, or one that no solid has
            raise MeshError(f'{source}: {where}: D at "{fields[1][:20]}"; expected the number of a node')
        if len(fields) > 3 and fields[3] and not re.fullmatch(r"[-+]?0*\.?0*", fields[3]):
            draft.find("D", where, "a displacement that is prescribed is held; its static state is not simulated")
        held.setdefault(int(fields[1]), set()).update(_HELD[fields[2]])
    alike: dict[str, list[str]] = {}
    for node in sorted(held):
        alike.setdefault("".join(sorted(held[node])), []).append(str(node))
    for fixed, nodes in alike.items():
        draft.add("supports", is_entry=True, values={"nodes": ", ".join(nodes), "fixed": fixed})


def _write_contacts(draft: Draft, raw: RawMesh, mu: float) -> None:
    pairs = [name.rpartition("_")[2] for name in raw.surfaces if name.startswith("contact_")]
    for real in pairs:
        if f"target_{real}" not in raw.surfaces:
            text = f"contact_{real} has no target elements of the same real constant on solids"
            draft.find("TARGE170", "", text, "missing")
            continue
        values: dict[str, Value] = {"name": f"contact_{real}", "surface": f"contact_{real}",
                                    "counterface": f"target_{real}"}  # fmt: skip
        table = draft.add("contacts", is_entry=True, values=values)
        table.open.append(("normal_stiffness = 1.0e13", "FKN is not read: a stiffness in N/m per m^2; some 10 E/h"))
        if mu:
            table.open.append(("sliding = { axis = [0.0, 0.0, 1.0], centre = [0.0, 0.0, 0.0], speed = 1.0 }",
                               "how the counterface moves (CMROTATE), or kind = \"tied\""))  # fmt: skip
        else:
            values["kind"] = table.values["kind"] = "frictionless"
    if pairs and mu:
        draft.add("effects", "friction", values={"mu": mu})


def _clean(value: float) -> float:
    return float(f"{value:.15g}")
