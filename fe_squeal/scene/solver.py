"""The linear solver of a scene, with the options that the scene gives it."""

from __future__ import annotations

from ..eigen.linear.choice import choose
from ..eigen.linear.factor import LinearSolver
from ..eigen.linear.mumps import Mumps
from ..eigen.linear.petsc import MumpsOptions
from ..errors import SceneError
from .matrices import MatrixScene
from .scene import Scene


def solver_of(scene: Scene | MatrixScene) -> LinearSolver:
    """Return the solver that `[solve] linear_solver` names.

    Raises
    ------
    SceneError
        It is not installed, or the folder for its files is not there; the message has the name of the scene file.
    """
    try:
        return choose(scene.solve.linear_solver, _options(scene))
    except SceneError as error:
        where = f"{scene.source}: " if scene.source is not None else ""
        raise SceneError(f"{where}{error}") from error


def note_on_options(scene: Scene | MatrixScene, solver: LinearSolver) -> str | None:
    """Return a sentence where the scene has options of MUMPS, and "auto" is another solver here."""
    if scene.solve.mumps is None or isinstance(solver, Mumps):
        return None
    return f"solve.mumps has no effect: {solver.name} factorises here"


def _options(scene: Scene | MatrixScene) -> MumpsOptions:
    table = scene.solve.mumps
    if table is None:
        return MumpsOptions()
    folder = "" if table.folder is None else str((scene.folder / table.folder).absolute())
    return MumpsOptions(table.out_of_core, folder, table.low_rank or 0.0, table.memory_relaxation)
