"""Complex eigenvalue analysis of brake squeal on finite-element meshes.

>>> import fe_squeal
>>> callable(fe_squeal.load_scene) and callable(fe_squeal.sweep)
True
"""

from __future__ import annotations

from .assembly.assembly import assemble
from .errors import InputError, MeshError, NotConvergedError, OutputError, SceneError, SquealError
from .mesh import LoadedMesh, from_skfem, load_mesh
from .problem.problem import Problem
from .run.outputs import export_shapes
from .scene import Scene
from .scene.file import load_scene, parse_scene
from .sweep.result import Sweep
from .sweep.sweep import find_onsets, sweep
from .version import __version__

__all__ = [
    "InputError",
    "LoadedMesh",
    "MeshError",
    "NotConvergedError",
    "OutputError",
    "Problem",
    "Scene",
    "SceneError",
    "SquealError",
    "Sweep",
    "__version__",
    "assemble",
    "export_shapes",
    "find_onsets",
    "from_skfem",
    "load_mesh",
    "load_scene",
    "parse_scene",
    "sweep",
]
