# ruff: noqa: E501
"""The reference of all scene keys, made from the sections' own docstrings: python -m fe_squeal.scene.reference."""

from __future__ import annotations

import inspect
import re
import sys
from typing import Any, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from ..effects import known_effects
from . import MatrixScene
from .faults import options, toml_text
from .scene import scene_with

_UNIT = r"(1|degrees|length|(kg|rad|Pa|Hz|N|J|W|K|m|s)(\^\d)?)"
_UNITS = re.compile(rf"{_UNIT}(( |/| per | or ){_UNIT})*")  # such as "N s/m per m^2"
_TYPES = {"float": "number", "int": "whole number", "str": "text", "vector": "list of 3 numbers", "two vectors":
          "list of 2 vectors", "list of str": "list of texts", "list of float": "list of numbers"}  # fmt: skip
_HEAD = """\
# The scene file, key by key

Made by `python -m fe_squeal.scene.reference` from the program itself; do not edit it.

TOML; SI units (m, kg, s, N, Pa, rad/s). A key that is not listed here is an error. An effect whose table is absent is not
simulated. `NAME` is a name of your own, without commas, which stand between the paths of several numbers. Two are not free:
in `[bodies.NAME]` it is a volume group of the mesh where the body has no `groups`, and in `[study.parameters.NAME]` the path
of a number, or several paths. A mesh file is looked for relative to the scene file, so a copy of an example in another folder
needs its `mesh.file` changed, or its mesh copied along.

**Units of length.** `mesh.length_unit` holds for the coordinates in the mesh file and for the lengths marked *length unit*
in `[mesh.disc_pad]` and `[mesh.block]`. Everything else, `gap_tolerance` and `centre` too, is in metres always.

**Orthotropic materials.** youngs_modulus = [E1, E2, E3], shear_modulus = [G23, G13, G12],
poisson_ratio = [nu23, nu13, nu12], with nu_ij = −strain_j/strain_i under a stress along i alone. `axes` of the body gives the
material axes 1 and 2 in global coordinates.
"""

_MATRICES = """\
# A scene of matrices

Matrices from another program instead of a mesh: a file that has `[[terms]]` in place of `[mesh]`, `[materials]`, `[bodies]`,
`[[supports]]`, `[[springs]]`, `[[contacts]]` and `[effects]`. `[sweep]`, `[study]`, `[solve]`, `[output]` and `[[measured]]` are the same; shapes are
written as arrays.
"""


def reference() -> str:
    """Return the reference as Markdown.

    Raises
    ------
    LookupError
        A key has no description in its section's docstring.
    """
    return "\n".join([_HEAD, *_section(scene_with(known_effects()), ""), _MATRICES, *_section(MatrixScene, "", ("sweep", "study", "solve", "output", "measured"))])


def _section(section: type[BaseModel], where: str, known: tuple[str, ...] = ()) -> list[str]:
    """Return the lines of a section and of those inside it, but for the tables in `known`, which stand elsewhere."""
    prose, described = _docstring(section)
    lines = [f"## `{where}`" if where else "## The whole", "", *prose, ""]
    if not section.model_fields:
        return lines
    lines += ["| key | type | unit | default | meaning |", "|---|---|---|---|---|"]
    inner: list[str] = []
    for name, field in section.model_fields.items():
        key = field.alias or name
        if key not in described:
            raise LookupError(f"{section.__name__}.{key} has no description under Attributes in its docstring")
        kind, unit, meaning = described[key]
        shown = _TYPES.get(kind, re.sub(r"^float\b", "number", kind)) + _bounds(field)
        cells = [cell.replace("|", r"\|") for cell in (f"`{key}`", shown, unit, _default(field), meaning)]
        lines.append(f"| {' | '.join(cells)} |")
        path = f"{where.strip('[]')}.{key}".removeprefix(".")
        for option in options(field.annotation):
            target = get_args(option)[-1] if get_origin(option) in (dict, list) else option
            if isinstance(target, type) and issubclass(target, BaseModel) and key not in known:
                form = {dict: f"[{path}.NAME]", list: f"[[{path}]]"}.get(get_origin(option), f"[{path}]")
                inner += _section(target, form)
    return [*lines, "", *inner]


def _docstring(section: type[BaseModel]) -> tuple[list[str], dict[str, tuple[str, str, str]]]:
    """Return the text of a docstring, and type, unit and meaning of each attribute, inherited ones too."""
    described: dict[str, tuple[str, str, str]] = {}
    prose: list[str] = []
    for owner in reversed(section.__mro__):
        if not issubclass(owner, BaseModel) or owner is BaseModel or not owner.__dict__.get("__doc__"):
            continue
        before, _, rest = inspect.cleandoc(str(owner.__doc__)).partition("Attributes\n----------\n")
        prose = before.strip().splitlines()
        rest = re.split(r"\n\n\w+\n---", rest)[0]
        for entry in re.split(r"\n(?=\S)", rest):
            head, _, meaning = entry.partition("\n")
            names, _, spec = head.partition(" : ")
            kind, _, unit = spec.removesuffix(", optional").rpartition(", ")
            if not _UNITS.fullmatch(unit):
                kind, unit = spec.removesuffix(", optional"), ""
            text = " ".join(meaning.split())
            for name in filter(None, names.split(", ")):
                described[name] = (kind, "length unit" if unit == "length" else unit, text)
    return prose, described


def _bounds(field: FieldInfo) -> str:
    metadata = [*field.metadata]
    for option in get_args(field.annotation):
        for constraint in getattr(option, "__metadata__", ()):
            metadata += getattr(constraint, "metadata", [constraint])
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
    found = [f"{s} {_bound(getattr(m, n))}" for m in metadata for n, s in signs.items() if getattr(m, n, None) is not None]
    return f", {', '.join(dict.fromkeys(found))}" if found else ""


def _bound(value: float) -> str:
    """Return a bound with all its digits, from five on in threes."""
    if value != int(value):
        return f"{value:g}"
    return f"{int(value):,}".replace(",", " ") if abs(value) >= 10_000 else f"{int(value)}"


def _default(field: FieldInfo) -> str:
    value: Any = field.default
    if field.is_required():
        return "required"
    return "none" if value is None or value in ([], {}, "") or isinstance(value, BaseModel) else f"`{toml_text(value)}`"


if __name__ == "__main__":
    sys.stdout.reconfigure(encoding="utf-8")  # type: ignore[union-attr]
    print(reference(), end="")
