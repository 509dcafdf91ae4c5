"""The scenes of effects_cost.py: the disc with two pads with each effect on and off."""

from __future__ import annotations

import copy
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fe_squeal.effects import EFFECTS

ROOT = Path(__file__).parents[1]
FRICTION = "friction"  # name of the case that all others are compared with
# Further cases of an effect, by its name: the name of the case, and the keys of its table.
VARIANTS: dict[str, dict[str, dict[str, Any]]] = {"structural_damping": {"frozen": {"reference_frequency_hz": 3000.0}}}


@dataclass(frozen=True)
class Case:
    """A scene to measure; with `unreachable` calls of other effects raise; with `by_hand` this file sums the terms."""

    name: str
    scene: dict[str, Any]
    unreachable: bool = False
    by_hand: bool = False


def scene_of(rung: str) -> dict[str, Any]:
    """Return the scene with friction alone: "fine" on the mesh in the repository, or "coarse" on one made for it."""
    scene = tomllib.loads((ROOT / "examples/disc_pad.toml").read_text(encoding="utf-8"))
    del scene["sweep"]
    if rung == "fine":
        scene["mesh"]["file"] = str(ROOT / "examples" / scene["mesh"]["file"])
    else:
        del scene["mesh"]["file"]
        scene["mesh"] |= {"order": 1}
        scene["mesh"]["disc_pad"]["size"] = 0.02
    return scene


def effect_cases(scene: dict[str, Any]) -> list[Case]:
    """Return the scene without friction, with friction, and with friction and each other effect.

    Numbers are those of the example with all effects; an effect that the example does not have gets its defaults.
    """
    example = tomllib.loads((ROOT / "examples/disc_pad_effects.toml").read_text(encoding="utf-8"))["effects"]
    tables = {kind.name: example.get(kind.name, {}) for kind in EFFECTS}

    def with_effects(name: str, effects: dict[str, Any], damper: float = 0.0) -> Case:
        case = copy.deepcopy(scene)
        case["effects"] |= effects
        if "structural_damping" in effects:
            case["materials"]["lining"]["loss_factor"] = 0.05
        if damper:
            case["springs"] = [{**s, "damping": damper} for s in case["springs"]]
        return Case(name, case)

    cases = [Case("no friction", {**scene, "effects": {}}), Case(FRICTION, scene)]
    for kind in EFFECTS:
        if kind.name == FRICTION:
            continue
        table = tables[kind.name] | ({"contact_pressure": 1.0e6} if "contact_pressure" in kind.model_fields else {})
        needed = {name: tables[name] for name in kind.needs if name != FRICTION}
        cases.append(with_effects(", ".join([*needed, kind.name]), {**needed, kind.name: table}))
        for variant, keys in VARIANTS.get(kind.name, {}).items():
            cases.append(with_effects(f"{kind.name}, {variant}", {kind.name: table | keys}))
    frozen = tables["structural_damping"] | VARIANTS["structural_damping"]["frozen"]
    return [
        *cases,
        with_effects("springs' damping", {}, damper=100.0),
        with_effects("all, loss frozen", tables | {"structural_damping": frozen}, damper=100.0),
        with_effects("all", tables, damper=100.0),
    ]


def absence_cases(scene: dict[str, Any]) -> list[Case]:
    """Return variants of friction alone, which all cost the same if absent effects cost nothing."""
    zero = copy.deepcopy(scene)
    zero["effects"] |= {"rayleigh": {"alpha": 0.0, "beta": 0.0}}
    zero["effects"] |= {"falling_friction": {"contact_pressure": 1.0e6, "slope": 0.0}}
    zero["effects"] |= {"structural_damping": {}}  # no material has a loss factor
    return [
        Case("as it is", scene),
        Case("as it is, again", scene),
        Case("other effects out of reach", scene, unreachable=True),
        Case("matrices summed by hand", scene, by_hand=True),
        Case("tables with zeros", zero),
    ]
