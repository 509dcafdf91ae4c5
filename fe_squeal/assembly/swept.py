"""What a scene asks to be swept, and to be kept of it."""

from __future__ import annotations

from ..problem.parameters import MU
from ..problem.problem import Problem
from ..scene import MatrixScene, Scene


def swept(scene: Scene | MatrixScene, problem: Problem) -> tuple[str, list[float]]:
    """Return the parameter of a scene's sweep and its values.

    Without a sweep it is μ, or of a scene of matrices without μ its first parameter, at the one value that it has.
    Where there is no friction, and no other parameter, μ is 0.
    """
    if scene.sweep is None:
        own = scene.parameters if isinstance(scene, MatrixScene) else {}
        parameter = MU if MU in own else next(iter(own), MU)
        return parameter, [problem.parameters.get(parameter, 0.0)]
    return scene.sweep.parameter, [float(v) for v in scene.sweep.grid]


def keeps_shapes(scene: Scene | MatrixScene) -> bool:
    """Return whether a sweep keeps the shapes of all modes, to be written or compared with measured ones."""
    return scene.output.shapes == "all" or any(entry.file is not None for entry in scene.measured)
