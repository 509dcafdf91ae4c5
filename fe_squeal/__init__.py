"""Complex eigenvalue analysis of brake squeal on finite-element meshes.

    load_scene(path)                a scene from its TOML file
    parse_scene(tables)             the same from nested dictionaries
    load_mesh(path), from_skfem(m)  a mesh, for assemble(scene, mesh), instead of the scene's own
    assemble(scene)                 the Problem: mass, damping and stiffness as a sum of terms
    problem.at({"mu": 0.4})         the same Problem with other numbers of the scene, by their paths
    sweep(problem, values)          a Sweep: complex modes over a parameter (friction, unless another is named),
                                    followed by their shapes, and the onsets of instability between the values
    result.to_dataframe()           its modes as a table; onsets_dataframe(), contributions_dataframe() and
                                    sensitivities_dataframe() are the others
    find_onsets(problem, values)    the critical values alone, to full precision
    result.plot_stability()         figures, also in notebooks: plot_damping(value), and show(branch), a shape in 3-D
    scatter(problem, parameters)    how probable instability is if several numbers are known by their distributions only
    stability_map(problem, x, y)    the boundaries of stability over two numbers, followed exactly
    run_many(scenes)                modes and onsets of many scenes, such as design variants, in several processes
    export_shapes(result, folder)   shapes of the unstable modes for ParaView
    SquealError                     what all of these raise: SceneError, MeshError and OutputError for what you can
                                    mend, NotConvergedError, which carries what did converge

A block on a rigid belt, held by springs of which two are inclined: where does it turn unstable as friction grows, and
what do stiffer springs along the belt change?

>>> import fe_squeal
>>> springs = [
...     ("inclined_1", "front", [-1.0, 0.0, 1.0], 4e5), ("inclined_2", "back", [-1.0, 0.0, 1.0], 4e5),
...     ("up_1", "left", [0.0, 0.0, 1.0], 4.3e6), ("up_2", "right", [0.0, 0.0, 1.0], 4.3e6),
...     ("along_1", "left", [1.0, 0.0, 0.0], 4.8e6), ("along_2", "right", [1.0, 0.0, 0.0], 4.8e6),
...     ("across", "front", [0.0, 1.0, 0.0], 2e7),
... ]
>>> scene = fe_squeal.parse_scene({
...     "mesh": {"order": 1, "block": {"length": 0.08, "width": 0.04, "height": 0.02, "size": 0.02}},
...     "materials": {"steel": {"youngs_modulus": 2e11, "poisson_ratio": 0.3, "density": 7800.0}},
...     "bodies": {"block": {"material": "steel"}},
...     "springs": [dict(zip(("name", "surface", "direction", "stiffness"), spring)) for spring in springs],
...     "contacts": [{"surface": "bottom", "counterface": "rigid", "normal_stiffness": 3.125e8,
...                   "sliding": {"direction": [1.0, 0.0, 0.0], "speed": 1.0}}],
...     "effects": {"friction": {"mu": 0.3}},
... })
>>> problem = fe_squeal.assemble(scene)
>>> result = fe_squeal.sweep(problem, [0.0, 0.3, 0.6, 0.9], modes=6)
>>> [f"{o.kind} at mu = {o.value:.2f}, {o.frequency_hz:.0f} Hz" for o in result.onsets]
['flutter at mu = 0.40, 712 Hz']
>>> stiffer = problem.at({"springs.along_1.stiffness, springs.along_2.stiffness": 5.0e6})
>>> [f"mu = {o.value:.2f}" for o in fe_squeal.find_onsets(stiffer, [0.0, 0.3, 0.6, 0.9], modes=6)]
['mu = 0.52']
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING, Any

# Read by NumPy when it is imported: its arrays shall not ask for pages of 2 MB. On a virtual machine that gives freed
# memory back to its host, each of these takes some ms when it is first written to (benchmarks/pages.py).
os.environ.setdefault("NUMPY_MADVISE_HUGEPAGE", "0")

from .errors import InputError as InputError
from .errors import MeshError as MeshError
from .errors import NotConvergedError as NotConvergedError
from .errors import OutputError as OutputError
from .errors import SceneError as SceneError
from .errors import SquealError
from .sweep.sweep import find_onsets, sweep

if TYPE_CHECKING:
    from .assembly.public import assemble
    from .mesh import LoadedMesh as LoadedMesh
    from .mesh import from_skfem, load_mesh
    from .problem.problem import Problem
    from .run.outputs import export_shapes
    from .scene import Scene as Scene
    from .scene.file import load_scene, parse_scene
    from .study.many import run_many
    from .study.map import stability_map
    from .study.scatter import scatter
    from .sweep.result import Sweep
    from .version import __version__ as __version__

# What help(fe_squeal) shows and a star imports; the other names that stand here are public too.
__all__ = [
    "Problem",
    "SquealError",
    "Sweep",
    "assemble",
    "export_shapes",
    "find_onsets",
    "from_skfem",
    "load_mesh",
    "load_scene",
    "parse_scene",
    "run_many",
    "scatter",
    "stability_map",
    "sweep",
]

# Where the names stand that are imported when they are first asked for: finite elements, tables and plots take time.
_PLACES = {
    "LoadedMesh": "mesh",
    "Problem": "problem.problem",
    "Scene": "scene",
    "Sweep": "sweep.result",
    "__version__": "version",
    "assemble": "assembly.public",
    "export_shapes": "run.outputs",
    "from_skfem": "mesh",
    "load_mesh": "mesh",
    "load_scene": "scene.file",
    "parse_scene": "scene.file",
    "run_many": "study.many",
    "scatter": "study.scatter",
    "stability_map": "study.map",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_PLACES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_PLACES})
