"""What a sweep has to know to go on after a value, as plain arrays and numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..eigen.pencil import Modes
from ..eigen.request import Completeness
from ..problem.problem import Problem
from .onset import Onset
from .result import LiftedShapes, Sweep, SweepPoint

_VECTORS = ("right", "left")
_NUMBERS = ("lam", "backward_error", "re_uncertainty", "condition")


class Record(NamedTuple):
    """Arrays by name, and beside them what JSON can hold."""

    arrays: dict[str, np.ndarray]
    data: dict[str, Any]


class Store(Protocol):
    """Where a sweep keeps what is finished."""

    def load(self) -> SweepState | None:
        """Return the state that was kept last; None if no value was finished."""

    def load_model(self) -> Record | None:
        """Return the reduced model that was kept, if there is one."""

    def save_model(self, model: Record) -> None:
        """Keep the reduced model."""

    def save(self, state: SweepState) -> None:
        """Keep a state, soon if not at once."""

    def flush(self) -> None:
        """Keep the last state now."""


@dataclass(frozen=True)
class SweepState:
    """The state of a sweep after one of its values.

    Attributes
    ----------
    points : tuple of SweepPoint
        Of a sweep on a reduced model, with shapes in its coordinates.
    onsets : tuple of Onset
    warnings : tuple of str
    completeness : Completeness
    seconds : mapping of stage to float, s
    first, previous : Modes
        At the first and at the last value, with shapes.
    first_branches, branches : (k,) int
        Names of the branches of these modes.
    next_branch : int
    start, value : float
        The first and the last value.
    reduced : bool
        Whether the modes are those of a reduced model.
    window : float
        Every window of instability wider than this was found so far, in the parameter.
    unsettled : tuple of str
        Those of the warnings that are about onsets.
    """

    points: tuple[SweepPoint, ...]
    onsets: tuple[Onset, ...]
    warnings: tuple[str, ...]
    completeness: Completeness
    seconds: Mapping[str, float]
    first: Modes
    previous: Modes
    first_branches: np.ndarray
    branches: np.ndarray
    next_branch: int
    start: float
    value: float
    reduced: bool
    window: float
    unsettled: tuple[str, ...]

    def sweep(self, problem: Problem, parameter: str) -> Sweep:
        """Return the result so far, for its tables of modes and onsets."""
        onsets = tuple(sorted(self.onsets, key=lambda o: o.value))
        return Sweep(problem, parameter, self.points, onsets, self.completeness, dict(self.seconds), self.warnings)


def record_of_point(point: SweepPoint) -> Record:
    """Return a point as arrays, with shapes of a reduced model in its coordinates."""
    shapes = point.shapes.coordinates if isinstance(point.shapes, LiftedShapes) else point.shapes
    arrays = {name: getattr(point.modes, name) for name in _NUMBERS}
    arrays |= {"branches": point.branches} | {f"shape_{i}": u for i, u in shapes.items()}
    moves = {
        str(i): {path: [at, d.real, d.imag] for path, (at, d) in found.items()}
        for i, found in point.sensitivities.items()
    }
    pressed = {name: dict(numbers) for name, numbers in point.pressed.items()}
    return Record(
        arrays,
        {
            "value": point.value, "method": point.modes.method, "sensitivities": moves, "pressed": pressed,
            "above": [[lam.real, lam.imag] for lam in point.above], "between": point.between,
            "exhaustive": point.modes.exhaustive,
        },
    )  # fmt: skip


def point_of_record(record: Record) -> SweepPoint:
    """Return the point of `record_of_point`."""
    arrays, data = record
    modes = Modes(
        arrays["lam"], np.zeros((0, len(arrays["lam"]))), None, arrays["backward_error"], arrays["re_uncertainty"],
        arrays["condition"], data["method"], data["exhaustive"],
    )  # fmt: skip
    shapes = {int(name.removeprefix("shape_")): u for name, u in arrays.items() if name.startswith("shape_")}
    moves = {
        int(i): {path: (at, complex(re, im)) for path, (at, re, im) in found.items()}
        for i, found in data["sensitivities"].items()
    }
    above = tuple(complex(*lam) for lam in data["above"])
    return SweepPoint(
        data["value"], modes, arrays["branches"], shapes, moves, data["pressed"], above=above, between=data["between"]
    )


def record_of_modes(modes: Modes) -> Record:
    """Return modes with their shapes as arrays."""
    names = [*_NUMBERS, *(v for v in _VECTORS if getattr(modes, v) is not None)]
    return Record({name: getattr(modes, name) for name in names}, {"method": modes.method})


def modes_of_record(record: Record) -> Modes:
    """Return the modes of `record_of_modes`."""
    a = record.arrays
    return Modes(
        a["lam"], a["right"], a.get("left"), a["backward_error"], a["re_uncertainty"], a["condition"],
        record.data["method"],
    )  # fmt: skip


def record_of_state(state: SweepState) -> Record:
    """Return a state without its points and first modes, which do not change."""
    modes = record_of_modes(state.previous)
    data = {
        "points": len(state.points), "onsets": [asdict(o) for o in state.onsets], "warnings": list(state.warnings),
        "completeness": asdict(state.completeness), "seconds": dict(state.seconds), "next_branch": state.next_branch,
        "start": state.start, "value": state.value, "reduced": state.reduced,
        "window": state.window, "unsettled": list(state.unsettled),
    }  # fmt: skip
    branches = {"branches": state.branches, "first_branches": state.first_branches}
    return Record(modes.arrays | branches, modes.data | data)


def state_of_record(record: Record, first: Modes, points: tuple[SweepPoint, ...]) -> SweepState:
    """Return the state of `record_of_state`."""
    a, data = record
    return SweepState(
        points, tuple(Onset(**o) for o in data["onsets"]), tuple(data["warnings"]),
        Completeness(**data["completeness"]), data["seconds"], first, modes_of_record(record), a["first_branches"],
        a["branches"], data["next_branch"], data["start"], data["value"], data["reduced"], data["window"],
        tuple(data["unsettled"]),
    )  # fmt: skip


def lifted(point: SweepPoint, V: np.ndarray) -> SweepPoint:
    """Return a point of a reduced model with shapes of the problem, V its basis."""
    return replace(point, shapes=LiftedShapes(point.shapes, V))
