"""The linear solver that a scene asks for."""

from __future__ import annotations

from ..eigen.linear.choice import choose
from ..eigen.linear.factor import LinearSolver
from ..errors import SceneError
from ..scene import MatrixScene, Scene


def solver_of(scene: Scene | MatrixScene) -> LinearSolver:
    """Return the solver that `[solve] linear_solver` names.

    Raises
    ------
    SceneError
        It is not installed; the message has the name of the scene file.
    """
    try:
        return choose(scene.solve.linear_solver)
    except SceneError as error:
        where = f"{scene.source}: " if scene.source is not None else ""
        raise SceneError(f"{where}{error}") from error
