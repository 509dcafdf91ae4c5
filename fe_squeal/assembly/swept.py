"""What a scene asks to be swept."""

from __future__ import annotations

from ..problem.parameters import MU
from ..problem.problem import Problem
from ..scene import MatrixScene, Scene


def swept(scene: Scene | MatrixScene, problem: Problem) -> tuple[str, list[float]]:
    """Return the parameter of a scene's sweep and its values; without a sweep μ and its one value."""
    if scene.sweep is None:
        return MU, [problem.parameters.get(MU, 0.0)]
    return scene.sweep.parameter, [float(v) for v in scene.sweep.grid]
