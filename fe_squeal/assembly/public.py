"""`assemble` for scripts, which see no console: what looks doubtful is a Python warning."""

from __future__ import annotations

import warnings

from ..eigen.linear.factor import LinearSolver
from ..errors import SceneWarning
from ..mesh import LoadedMesh
from ..problem.problem import Problem
from ..scene import MatrixScene, Scene
from . import assembly


def assemble(
    scene: Scene | MatrixScene, mesh: LoadedMesh | None = None, linear_solver: LinearSolver | str | None = None
) -> Problem:
    """Assemble the equation of motion of a scene, (λ²M + λC + K)u = 0, as a sum of terms."""
    problem = assembly.assemble(scene, mesh, linear_solver)
    for sentence in problem.warnings:
        warnings.warn(sentence, SceneWarning, stacklevel=2)
    return problem


assemble.__doc__ = f"""{assembly.assemble.__doc__}
    Warns
    -----
    SceneWarning
        For each sentence of `Problem.warnings`.
    """
