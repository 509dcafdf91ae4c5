"""What is kept of the search for a mesh, so that it can go on after any interruption: its trials, and the next mesh.

Every mesh has a file of its own, which `search.json` names. So both belong together at any moment, whatever was written
last.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from ..accuracy.candidates import Candidate, restored
from ..accuracy.choose import Trial
from ..accuracy.line_errors import LineErrors
from ..errors import OutputError
from ..mesh import LoadedMesh
from ..mesh.keeping import keep_mesh, kept_mesh
from ..report.files import replace_atomically, write_json
from ..scene import Scene
from .checkpoint import read_json
from .folder import CHECKPOINT, NEXT_MESH, RECORD, SEARCH
from .inputs import differences, run_inputs
from .manifest import Manifest
from .resume import another_run

_Number = float | None  # None: not finite, which JSON has no number for


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid")


class _Trial(_Table):
    mesh: str
    unknowns: int
    error: _Number
    seconds: float
    by_bars: bool = True


class _Before(_Table):
    """The `LineErrors` of the mesh before; `elements` and `places` are those of its lines."""

    elements: dict[str, int]
    places: dict[str, list[float]]
    order: Annotated[int, Field(ge=1, le=3)] = 2
    rates: dict[str, float]
    along: list[str]
    layers: list[Annotated[int, Field(ge=0)]]
    groups: list[Annotated[int, Field(ge=0)]]
    singular: list[bool]
    parts: list[list[_Number]]


class _Kept(_Table):
    inputs: dict[str, Any]
    trials: list[_Trial]
    file: Annotated[str, Field(pattern=rf"^{NEXT_MESH.format('[0-9]+')}$")]
    digest: str
    mesh: str
    geometry: dict[str, Any] | None
    before: _Before | None


def search_inputs(scene: Scene, mesh: LoadedMesh, target: float, what: str) -> dict[str, Any]:
    """Return what a search depends on: what a run does, see `run_inputs`, and the target under the option's name.

    Parameters
    ----------
    scene : Scene
    mesh : LoadedMesh
        The mesh from which others are made; that of a geometry follows from the scene.
    target : float
    what : "onsets", "growth", "frequencies" or "all"
    """
    inputs = run_inputs(scene, mesh if scene.mesh.geometry is None else None)
    return {**inputs, "scene": {**inputs["scene"], "--accuracy": target, "--accuracy-of": what}}


class KeptSearch:
    """The search that is kept in a folder of results.

    Parameters
    ----------
    results : Manifest
        The manifest of the folder.
    inputs : mapping
        What the search depends on, see `search_inputs`.
    """

    def __init__(self, results: Manifest, inputs: Mapping[str, Any]) -> None:
        self._results, self._out, self._inputs = results, results.folder, inputs

    def save(self, trials: list[Trial], candidate: Candidate) -> None:
        """Keep the trials so far, and the mesh that is tried next."""
        name = NEXT_MESH.format(len(trials))
        with replace_atomically(self._out / CHECKPOINT / name) as temporary:
            keep_mesh(candidate.loaded, temporary)
            digest = _digest(temporary)
        geometry = candidate.scene.mesh.geometry
        kept = {
            "inputs": dict(self._inputs), "trials": [asdict(t) for t in trials], "file": name, "digest": digest,
            "mesh": candidate.told, "geometry": None if geometry is None else geometry.model_dump(mode="json"),
            "before": _before(candidate.errors),
        }  # fmt: skip
        write_json(kept, self._out / SEARCH)
        others = {f"{CHECKPOINT}/{NEXT_MESH.format(n)}" for n in range(len(trials))}
        self._results.remove(others.__contains__)

    def is_finished(self) -> bool:
        """Return whether the folder has all results of this search, by run.json.

        False means that it has a search to go on with, results of this search that miss the target, or nothing.

        Raises
        ------
        SceneError
            It has results of another search, or of a run that is none, and no search to go on with.
        """
        record = read_json(self._out / RECORD)
        if not isinstance(record, dict):
            return False
        searched, finished = record.get("search"), record.get("status") == "complete"
        known = searched.get("inputs") if isinstance(searched, dict) else record.get("inputs")
        found = differences(known, self._inputs)
        if found and not (self._out / SEARCH).exists():
            raise another_run(self._out, "the finished results are of" if finished else "the results are of", found)
        return finished and not found

    def load(self, scene: Scene) -> tuple[list[Trial], Candidate] | None:
        """Return the trials so far and the mesh that is tried next, or None if nothing was kept.

        Raises
        ------
        SceneError
            It belongs to another scene.
        OutputError
            It is damaged, or its mesh.
        """
        path = self._out / SEARCH
        if not path.exists():
            return None
        found = read_json(path)
        another = differences(found.get("inputs") if isinstance(found, dict) else None, self._inputs)
        if another:
            raise another_run(self._out, "the interrupted run was", another)
        try:
            kept = _Kept.model_validate(found)
            trials = [
                Trial(t.mesh, t.unknowns, np.nan if t.error is None else t.error, t.seconds, t.by_bars)
                for t in kept.trials
            ]
            errors = _line_errors(scene, kept.before)
            mesh = self._out / CHECKPOINT / kept.file
            if _digest(mesh) != kept.digest:
                raise ValueError("the mesh is another one")
            return trials, restored(scene, kept_mesh(mesh), kept.geometry, kept.mesh, errors)
        except (OSError, ValueError) as error:  # pydantic's among them
            raise OutputError(f"{path}: is damaged; run without --resume to start the search anew") from error


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _before(errors: LineErrors | None) -> dict[str, Any] | None:
    if errors is None:
        return None
    return {
        "elements": {key: line.elements for key, line in errors.lines.items()},
        "places": {key: line.places for key, line in errors.lines.items()}, "rates": dict(errors.rates),
        "along": errors.along.tolist(), "layers": errors.layers.tolist(), "groups": errors.groups.tolist(),
        "singular": errors.singular.tolist(), "parts": errors.parts.tolist(), "order": errors.order,
    }  # fmt: skip


def _line_errors(scene: Scene, before: _Before | None) -> LineErrors | None:
    if before is None:
        return None
    if scene.mesh.geometry is None:
        raise ValueError("a mesh from a file has no lines")
    own = scene.mesh.geometry.with_counts(before.elements).lines
    if not own.keys() == before.places.keys() == before.rates.keys() == before.elements.keys() >= set(before.along):
        raise ValueError("the lines are others")
    lines = {key: replace(line, places=tuple(before.places[key])) for key, line in own.items()}
    along, layers, groups = np.array(before.along, str), np.array(before.layers, int), np.array(before.groups, int)
    parts, singular = np.array(before.parts, float), np.array(before.singular, bool)
    if not len(parts) == len(along) == len(layers) == len(groups) == len(singular) or parts.ndim != 2:
        raise ValueError("the parts are not those of the lines")
    if any(n >= max(len(before.places[key]) - 1, 1) for key, n in zip(before.along, before.layers, strict=True)):
        raise ValueError("a layer is not one of its line")
    return LineErrors(lines, before.rates, parts, along, layers, groups, singular, before.order)
