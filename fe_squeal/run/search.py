"""What is kept of the search for a mesh, so that it can go on after any interruption: its trials, and the next mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from ..accuracy.candidates import Candidate, restored
from ..accuracy.choose import Trial
from ..errors import SceneError
from ..mesh import load_mesh
from ..mesh.writing import write_loaded
from ..report.files import replace_atomically, write_json
from ..scene import Scene
from .checkpoint import read_json
from .folder import NEXT_MESH, SEARCH
from .inputs import differences, listed
from .manifest import Manifest


class KeptSearch:
    """The search of a folder of results.

    Parameters
    ----------
    results : Manifest
    inputs : mapping
        What the search depends on, see `run_inputs`.
    """

    def __init__(self, results: Manifest, inputs: Mapping[str, Any]) -> None:
        self._out, self._inputs = results.folder, inputs

    def save(self, trials: list[Trial], candidate: Candidate) -> None:
        """Keep the trials so far, and the mesh that is tried next."""
        with replace_atomically(self._out / NEXT_MESH) as temporary:
            write_loaded(candidate.loaded, temporary)
        geometry = candidate.scene.mesh.geometry
        numbers = None if geometry is None else geometry.model_dump(mode="json")
        kept = {
            "inputs": dict(self._inputs), "trials": [asdict(t) for t in trials], "mesh": candidate.told,
            "geometry": numbers,
        }  # fmt: skip
        write_json(kept, self._out / SEARCH)

    def load(self, scene: Scene) -> tuple[list[Trial], Candidate] | None:
        """Return what was kept, or None where nothing is.

        Raises
        ------
        SceneError
            It belongs to another scene.
        """
        kept = read_json(self._out / SEARCH)
        if not isinstance(kept, dict):
            return None
        found = differences(kept.get("inputs"), self._inputs)
        if found:
            raise SceneError(
                f"{self._out}: the interrupted run was another one: {listed(found)}; run without --resume to start"
                " anew, or give another folder by -o"
            )
        trials = [Trial(**t) for t in kept["trials"]]
        return trials, restored(scene, load_mesh(self._out / NEXT_MESH), kept["geometry"], kept["mesh"])
