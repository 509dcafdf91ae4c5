"""Run the sweeps of many scenes, such as variants of a design, in several processes."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..assembly.assembly import assemble
from ..assembly.swept import swept
from ..errors import MeshError, NotConvergedError, SceneError, SceneWarning, TooLargeError
from ..scene import MatrixScene, Scene
from ..scene.file import load_scene
from ..scene.solver import solver_of
from ..sweep.sweep import sweep
from .pools import Processes, pool_of

if TYPE_CHECKING:
    import pandas as pd

Variant = Scene | MatrixScene | str | Path


def run_many(
    scenes: Mapping[str, Variant] | Sequence[Variant], workers: int = 0, scheduler: str = ""
) -> tuple[pd.DataFrame, pd.DataFrame]:  # fmt: skip
    """Run the sweep of each scene, and return tables of all modes and of all onsets.

    Parameters
    ----------
    scenes : mapping of str to scene, or sequence of scenes
        Scenes, or paths of their files. Scenes of a sequence are named after their files, or numbered from 1.
    workers : int
        Processes on this machine, by dask.distributed; 0 to use this process.
    scheduler : str
        Address of a running scheduler of Dask, instead of `workers`.

    Returns
    -------
    modes, onsets : pandas.DataFrame
        The columns of modes.csv and of onsets.csv, behind the column `scene` with the name of the scene.

    Raises
    ------
    SceneError
        There are no scenes, one of them is wrong (the message has its name), or dask.distributed is not installed.
    MeshError, TooLargeError
        Of one scene, whose name the message has.
    NotConvergedError
        A sweep failed (the message has the name of the scene), or the scheduler does not answer.

    Warns
    -----
    SceneWarning
        For each sentence of `Problem.warnings` and `Sweep.warnings`, behind the name of the scene.
    """
    if not isinstance(scenes, Mapping):
        scenes = _named(scenes)
    if not scenes:
        raise SceneError("run_many: given no scenes; expected at least one")
    loaded = {name: load_scene(s) if isinstance(s, str | Path) else s for name, s in scenes.items()}
    with pool_of(Processes(workers, scheduler)) as pool:
        pool.add(_tables, None, enumerate(loaded.items()))
        found = dict(pool)
    for i, name in enumerate(loaded):  # not where they arise, since nobody sees those of other processes
        for sentence in found[i][2]:
            warnings.warn(f"{name}: {sentence}", SceneWarning, stacklevel=2)
    modes, onsets = (_joined([found[i][k] for i in range(len(loaded))]) for k in (0, 1))
    return modes, onsets


def _joined(tables: list[pd.DataFrame]) -> pd.DataFrame:
    """Return the rows of all tables; empty ones have no types of columns, which pandas would take for others."""
    import pandas as pd

    return pd.concat([t for t in tables if len(t)] or tables[:1], ignore_index=True)


def _named(scenes: Sequence[Variant]) -> dict[str, Variant]:
    """Return scenes by name: by that of their file, or by number; the same file again has a number behind its name."""
    named: dict[str, Variant] = {}
    for i, scene in enumerate(scenes, 1):
        name = str(scene) if isinstance(scene, str | Path) else str(i)
        named[f"{name} ({i})" if name in named else name] = scene
    return named


def _tables(shared: None, named: tuple[str, Any]) -> tuple[pd.DataFrame, pd.DataFrame, tuple[str, ...]]:
    """Return the modes, the onsets and the warnings of the scene with a name."""
    name, scene = named
    try:
        problem = assemble(scene)
        parameter, values = swept(scene, problem)
        solve = scene.solve
        result = sweep(
            problem, values, parameter, solve.modes, solve.max_frequency, solve.tolerance, method=solve.method,
            linear_solver=solver_of(scene),
        )  # fmt: skip
    except (SceneError, MeshError, NotConvergedError, TooLargeError) as error:
        raise type(error)(f"{name}: {error}") from error
    modes, onsets = result.to_dataframe(), result.onsets_dataframe()
    for frame in (modes, onsets):
        frame.insert(0, "scene", name)
    return modes, onsets, (*problem.warnings, *result.warnings)
