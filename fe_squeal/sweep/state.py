"""The state that a sweep resumes from, and its conversion to plain arrays and numbers, to be stored."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..eigen.columns import Columns
from ..eigen.pencil import Modes
from ..eigen.request import Completeness
from ..eigen.unsearched import Unsearched
from ..problem.problem import Problem
from .doubts import Doubt
from .onset import Onset, certified
from .point import LiftedShapes, SweepPoint
from .result import Sweep
from .told import Left

_VECTORS = ("right", "left")
_NUMBERS = ("lam", "backward_error", "re_uncertainty", "condition")


class Record(NamedTuple):
    """Arrays by name, and everything else in a form that JSON can hold."""

    arrays: dict[str, np.ndarray]
    data: dict[str, Any]


class Store(Protocol):
    """Keeps what a sweep has finished, so that it can be resumed."""

    def load(self) -> SweepState | None:
        """Return the state that was kept last, or None."""

    def load_model(self) -> Record | None:
        """Return the reduced model that was kept, or None."""

    def save_model(self, model: Record) -> None:
        """Keep the reduced model."""

    def save(self, state: SweepState) -> None:
        """Keep a state, now or a little later."""

    def flush(self) -> None:
        """Write the last state now, if that is still due."""


@dataclass(frozen=True)
class SweepState:
    """The state of a sweep after one of its values.

    Attributes
    ----------
    points, onsets, warnings, completeness, seconds, window, unsettled
        As in `Sweep`. With a reduced model the shapes of the points are given in its coordinates.
    first, previous : Modes
        Modes at the first value and at the last one solved, with shapes.
    first_branches, branches : (k,) int
        The branches of these modes.
    next_branch : int
        Number of the next new branch.
    start, value : float
        The first value, and the last one solved.
    reduced : bool
        Whether the modes are those of a reduced model.
    doubt, beyond, unsearched
        What the next step may widen of what was told, see `Told`.
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
    doubt: Doubt | None = None
    beyond: tuple[float, float, float] | None = None
    unsearched: tuple[Left, ...] = ()

    def sweep(self, problem: Problem, parameter: str) -> Sweep:
        """Return the result so far, from which tables of modes and onsets can be made."""
        values = [point.value for point in self.points if not point.between]
        onsets, _, vague = certified(self.onsets, parameter, values, (-np.inf, np.inf))
        return Sweep(
            problem, parameter, self.points, onsets, self.completeness, dict(self.seconds), (*self.warnings, *vague),
            window=self.window, unsettled=(*self.unsettled, *vague),
        )  # fmt: skip


def record_of_point(point: SweepPoint) -> Record:
    """Return a point as a record; shapes of a reduced model are stored in its coordinates."""
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
            "exhaustive": point.modes.exhaustive, "unsearched": asdict(point.modes.unsearched),
            "description": {name: list(entries) for name, entries in point.description.items()},
        },
    )  # fmt: skip


def point_of_record(record: Record) -> SweepPoint:
    """Return the point that `record_of_point` made a record of."""
    arrays, data = record
    modes = Modes(
        arrays["lam"], np.zeros((0, len(arrays["lam"]))), None, arrays["backward_error"], arrays["re_uncertainty"],
        arrays["condition"], data["method"], data["exhaustive"], unsearched=_unsearched(data["unsearched"]),
    )  # fmt: skip
    shapes = {int(name.removeprefix("shape_")): u for name, u in arrays.items() if name.startswith("shape_")}
    moves = {
        int(i): {path: (at, complex(re, im)) for path, (at, re, im) in found.items()}
        for i, found in data["sensitivities"].items()
    }
    above = tuple(complex(*lam) for lam in data["above"])
    return SweepPoint(
        data["value"], modes, arrays["branches"], shapes, moves, data["pressed"], above=above, between=data["between"],
        description=dict(data["description"]),
    )  # fmt: skip


def record_of_modes(modes: Modes) -> Record:
    """Return modes with their shapes as a record."""
    names = [*_NUMBERS, *(v for v in _VECTORS if getattr(modes, v) is not None)]
    data = {"method": modes.method, "exhaustive": modes.exhaustive, "unsearched": asdict(modes.unsearched)}
    return Record({name: getattr(modes, name) for name in names}, data)


def modes_of_record(record: Record) -> Modes:
    """Return the modes that `record_of_modes` made a record of."""
    a = record.arrays
    return Modes(
        a["lam"], a["right"], a.get("left"), a["backward_error"], a["re_uncertainty"], a["condition"],
        record.data["method"], record.data["exhaustive"], unsearched=_unsearched(record.data["unsearched"]),
    )  # fmt: skip


def record_of_state(state: SweepState) -> Record:
    """Return a state as a record, without its points and first modes, which do not change and are stored once."""
    modes = record_of_modes(state.previous)
    data = {
        "points": len(state.points), "values": sum(not p.between for p in state.points),
        "onsets": [asdict(o) for o in state.onsets], "warnings": list(state.warnings),
        "completeness": asdict(state.completeness), "seconds": dict(state.seconds), "next_branch": state.next_branch,
        "start": state.start, "value": state.value, "reduced": state.reduced,
        "window": state.window, "unsettled": list(state.unsettled),
        "doubt": None if state.doubt is None else asdict(state.doubt), "beyond": state.beyond,
        "told_unsearched": [[first, last, asdict(left)] for first, last, left in state.unsearched],
    }  # fmt: skip
    branches = {"branches": state.branches, "first_branches": state.first_branches}
    return Record(modes.arrays | branches, modes.data | data)


def _onset(data: dict[str, Any]) -> Onset:
    return Onset(**data | {"exact": None if data["exact"] is None else tuple(data["exact"])})


def state_of_record(record: Record, first: Modes, points: tuple[SweepPoint, ...]) -> SweepState:
    """Return the state that `record_of_state` made a record of, with its points and first modes."""
    a, data = record
    return SweepState(
        points, tuple(_onset(o) for o in data["onsets"]), tuple(data["warnings"]),
        Completeness(**data["completeness"]), data["seconds"], first, modes_of_record(record), a["first_branches"],
        a["branches"], data["next_branch"], data["start"], data["value"], data["reduced"], data["window"],
        tuple(data["unsettled"]), None if data["doubt"] is None else Doubt(**data["doubt"]),
        None if data["beyond"] is None else tuple(data["beyond"]),
        tuple((first, last, _unsearched(left)) for first, last, left in data["told_unsearched"]),
    )  # fmt: skip


def _unsearched(data: Mapping[str, Any]) -> Unsearched:
    return Unsearched(tuple(data["kinds"]), data["low"], data["rate"], data["damped"])


def lifted(point: SweepPoint, V: Columns) -> SweepPoint:
    """Return a point of a reduced model with shapes of the problem itself; V (n, r) is the model's basis."""
    return replace(point, shapes=LiftedShapes(point.shapes, V))
