"""A deck, or a bare mesh, as a scene: as text with comments, or at once as what is solved."""

from __future__ import annotations

import tomllib
from pathlib import Path

from ..errors import SceneError
from ..mesh.loading import guarded_reading, load_mesh
from ..mesh.readers.sources import Sources
from ..scene import MatrixScene, Scene
from ..scene.file import load_scene, parse_scene
from ..scene.writing import seen_from
from .abaqus.read import draft_abaqus
from .ansys.read import draft_ansys
from .draft import Draft
from .nastran.read import draft_nastran
from .template import draft_template

_READERS = {
    ".inp": draft_abaqus, ".cdb": draft_ansys, **dict.fromkeys((".bdf", ".nas", ".dat", ".fem", ".blk"), draft_nastran),
}  # fmt: skip
_NAMED = 5  # missing things in one message


def draft_of(path: Path, target: Path | None = None) -> Draft:
    """Return the draft of a scene made from a deck or a mesh.

    Parameters
    ----------
    path : Path
        The deck or mesh.
    target : Path, optional
        The scene file that is going to be written; the mesh is named relative to it (default: beside the deck).

    Raises
    ------
    MeshError
    """
    name = seen_from((target or path).parent, path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        return draft_template(load_mesh(path), name)
    with guarded_reading(path):
        return reader(Sources(path), name)


def scene_of(path: Path) -> tuple[Scene | MatrixScene, Draft | None]:
    """Return the scene of a scene file, or that which a deck describes, and of a deck its draft.

    Raises
    ------
    SceneError, MeshError
        Also where something has to be given that the deck does not have.
    """
    if path.suffix.lower() not in _READERS:
        return load_scene(path), None
    draft = draft_of(path)
    missing = draft.missing
    if missing:
        more = f" | and {len(missing) - _NAMED} more" if len(missing) > _NAMED else ""
        raise SceneError(
            f"{path}: {len(missing)} thing{'s are' if len(missing) > 1 else ' is'} missing for a run:"
            f" {' | '.join(missing[:_NAMED])}{more}; write the scene with fe-squeal new {path}, and give it there"
        )
    scene = parse_scene(tomllib.loads(draft.text()), str(path))
    scene._source = path
    return scene, draft
