"""Choose and read the frequency responses of a universal file (data set 58) that make up one shape."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import SceneError

Freedom = tuple[int, int]  # a node, and a direction: 0, 1, 2 along x, y, z, then rotations; -1 where none is written
_AXES = ("x", "y", "z", "rx", "ry", "rz")
# Types of functions that have a phase, the best first: frequency response, transmissibility, cross spectrum, spectrum,
# and functions of a type that was not said. Files have coherences and power spectra beside them.
_KINDS = (4, 5, 3, 12, 0)
_RESPONSE, _CROSS, _UNKNOWN = 4, 3, 0
_QUANTITIES = {8: "displacement", 11: "velocity", 12: "acceleration", 13: "force"}  # by the number in the file
_DERIVATIVES = {8: 0, 11: 1, 12: 2}  # each is one more factor iω, as motion is Re u e^(iωt)
_MOST = 8  # references that are named in a sentence


@dataclass(frozen=True)
class Lines:
    """Responses at one frequency.

    Attributes
    ----------
    rows : dict of int to (3,) complex
        By node; NaN where a direction was not measured.
    hz : float, Hz
        The frequency of the line that was read.
    limits : pair of float, Hz
        The range that all responses have.
    notes : list of str
        What was chosen.
    """

    rows: dict[int, np.ndarray]
    hz: float
    limits: tuple[float, float]
    notes: list[str]


@dataclass(frozen=True)
class _Function:
    """A data set 58; `quantities` are the numbers of what the response and the reference are, see `_QUANTITIES`."""

    reference: Freedom
    response: Freedom
    sign: float
    x: np.ndarray
    data: np.ndarray
    kind: int
    quantities: tuple[int, int]


def read_lines(
    responses: Sequence[dict[str, Any]], frequency_hz: float | None, reference: str | None, where: str
) -> Lines:
    """Return the responses to one reference at the line nearest to a frequency.

    Where one response stands still while the references move, as under a roving hammer, the references are the points:
    a linear structure at rest answers at j to a force at k as at k to the same force at j. Of cross spectra the
    conjugate is that of both exchanged; transmissibilities have no such law. Where displacements, velocities and
    accelerations stand beside each other all are made displacements.

    Parameters
    ----------
    responses : sequence of dict
        The data sets 58 as pyuff reads them.
    frequency_hz : float, Hz, optional
    reference : str, optional
        Node and direction, such as "5z". Without it the reference is taken that has all points that any has.
    where : str
        Key of the scene and file, for messages.

    Raises
    ------
    SceneError
        No frequency is given, there is no response along x, y or z, no reference has all points, or the responses are
        of several quantities that are not all motions.
    """
    if frequency_hz is None:
        raise SceneError(f"{where} has frequency responses; expected frequency_hz beside the file, to read at")
    functions = _functions(responses, where)
    moving, notes = _chosen(functions, reference, where)
    mixed = _mixed(list(moving.values()), where)
    if mixed:
        notes.append(f"{mixed} stand beside each other, and all are made displacements")
    rows: dict[int, np.ndarray] = {}
    hz = frequency_hz
    for (node, axis), f in moving.items():
        line = int(np.argmin(np.abs(f.x - frequency_hz)))
        factor = _factor(f, float(f.x[line])) if mixed else 1.0
        rows.setdefault(node, np.full(3, np.nan + 0j))[axis] = f.sign * complex(f.data[line]) / factor
        hz = max(hz, float(f.x[line]), key=lambda found: abs(found - frequency_hz))
    limits = max(float(f.x.min()) for f in moving.values()), min(float(f.x.max()) for f in moving.values())
    return Lines(rows, hz, limits, notes)


def _functions(responses: Sequence[dict[str, Any]], where: str) -> list[_Function]:
    kinds = {int(s["func_type"]) for s in responses}
    kind = next((k for k in _KINDS if k in kinds), None)
    if kind is None:
        given = ", ".join(map(str, sorted(kinds)))
        raise SceneError(f"{where} has functions of type {given}; expected frequency responses, of type 4")
    found = []
    for s in responses:
        along, by = int(s["rsp_dir"]), int(s["ref_dir"])
        if int(s["func_type"]) != kind or not 1 <= abs(along) <= 3:  # rotations and scalars are not used
            continue
        sign = float(np.sign(along) * (np.sign(by) or 1))
        reference, response = (int(s["ref_node"]), abs(by) - 1), (int(s["rsp_node"]), abs(along) - 1)
        quantities = int(s.get("ordinate_spec_data_type") or 0), int(s.get("orddenom_spec_data_type") or 0)
        found.append(_Function(reference, response, sign, np.asarray(s["x"], dtype=float), np.asarray(s["data"]),
                               kind, quantities))
    if not found:
        raise SceneError(f"{where} has no response along x, y or z")
    return found


def _chosen(
    functions: Sequence[_Function], reference: str | None, where: str
) -> tuple[dict[Freedom, _Function], list[str]]:
    """Return the functions that have one freedom in common, by the other one, which moves, and notes."""
    responses: dict[Freedom, dict[Freedom, _Function]] = {}
    references: dict[Freedom, dict[Freedom, _Function]] = {}
    for f in functions:
        responses.setdefault(f.reference, {}).setdefault(f.response, f)
        if 0 <= f.reference[1] <= 2 and f.kind in (_RESPONSE, _CROSS, _UNKNOWN):
            exchanged = replace(f, data=f.data.conj(), quantities=f.quantities[::-1]) if f.kind == _CROSS else f
            references.setdefault(f.response, {}).setdefault(f.reference, exchanged)
    roving = max(map(len, references.values()), default=0) > max(map(len, responses.values()))
    groups = references if roving else responses
    everywhere = set().union(*groups.values())
    known = _known(groups, "fixed response" if roving else "reference")
    complete = [still for still, own in groups.items() if everywhere <= own.keys()]
    if reference is not None:
        taken = next((still for still in groups if _name(still) == reference), None)
        if taken is None:
            raise SceneError(f'{where}: given reference = "{reference}"; expected one of {known}')
    elif len(groups) == 1 or complete:
        taken = complete[0]
    else:
        raise SceneError(
            f"{where} has {known}, and none has all {len(everywhere)} that were measured; expected reference beside"
            " the file, to choose by"
        )
    notes = []
    if len(groups) > 1 and reference is None:
        notes.append(f"{_name(taken)} is taken of {known}; reference in the scene chooses another")
    if roving:
        notes.append(
            f"the response {_name(taken)} stands still and the references move, so by reciprocity these are the points"
        )
    again = sum(f.reference == taken if not roving else f.response == taken for f in functions) - len(groups[taken])
    if again > 0:
        notes.append(f"functions that are there again: {again}; the first of each is taken")
    return groups[taken], notes


def _mixed(functions: Sequence[_Function], where: str) -> str:
    """Return the names of the quantities that differ among functions; "" if all are alike.

    Raises
    ------
    SceneError
        Responses, or references, are of several quantities, and not all of these are motions.
    """
    several = [found for found in (sorted(set(q)) for q in zip(*(f.quantities for f in functions), strict=True))
               if len(found) > 1]  # fmt: skip
    names = ", ".join(dict.fromkeys(_QUANTITIES.get(q, f"type {q}") for found in several for q in found))
    if any(q not in _DERIVATIVES for found in several for q in found):
        raise SceneError(
            f"{where} has functions of several quantities in one shape: {names}; expected one quantity, or"
            " displacements (8), velocities (11) and accelerations (12)"
        )
    return names


def _factor(f: _Function, hz: float) -> complex:
    """Return the factor of a function over that between displacements: u_j / u_k, or u_j u_k* of a cross spectrum."""
    response, reference = ((2j * np.pi * hz) ** _DERIVATIVES.get(q, 0) for q in f.quantities)
    return response * reference.conjugate() if f.kind == _CROSS else response / reference


def _known(groups: Mapping[Freedom, Mapping[Freedom, _Function]], what: str) -> str:
    counts = [f"{_name(g)} with {len(groups[g])}" for g in sorted(groups, key=lambda g: -len(groups[g]))]
    shown = ", ".join(counts[:_MOST]) + (f" and {len(counts) - _MOST} more" if len(counts) > _MOST else "")
    return f"{what}{'s' * (len(counts) > 1)} {shown} directions"


def _name(freedom: Freedom) -> str:
    return f"{freedom[0]}{_AXES[freedom[1]] if freedom[1] >= 0 else ''}"
