"""The sweeps of many scenes, such as design variants, one beside the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..assembly.assembly import assemble
from ..assembly.swept import swept
from ..errors import NotConvergedError, SceneError
from ..scene import MatrixScene, Scene
from ..scene.file import load_scene
from ..sweep.result import Sweep
from ..sweep.sweep import sweep
from .engine import Cluster, spread

if TYPE_CHECKING:
    import pandas as pd

Variant = Scene | MatrixScene | str | Path


def run_many(
    scenes: Mapping[str, Variant] | Sequence[Variant], workers: int = 0, scheduler: str = ""
) -> tuple[pd.DataFrame, pd.DataFrame]:  # fmt: skip
    """Run the sweep of each scene, and return all modes and all onsets with the name of the scene in front.

    Parameters
    ----------
    scenes : mapping of name to scene, or sequence of scenes
        Scenes or their files; those of a sequence are called by their files, or by their numbers from 1.
    workers : int
        Processes on this machine, by dask.distributed; 0 for none.
    scheduler : str
        Address of a running scheduler of Dask.

    Returns
    -------
    modes, onsets : pandas.DataFrame
        The columns of modes.csv and onsets.csv behind `scene`.

    Raises
    ------
    SceneError, NotConvergedError
        With the name of the scene.
    """
    import pandas as pd

    if not isinstance(scenes, Mapping):
        scenes = {str(s) if isinstance(s, str | Path) else str(i): s for i, s in enumerate(scenes, 1)}
    if not scenes:
        raise SceneError("run_many: given no scenes; expected at least one")
    loaded = {name: load_scene(s) if isinstance(s, str | Path) else s for name, s in scenes.items()}
    found: dict[int, tuple[pd.DataFrame, pd.DataFrame]] = {}
    with spread(Cluster(workers, scheduler)) as call:
        for i, frames in call(_tables, None, enumerate(loaded.items())):
            found[i] = frames
    modes, onsets = (pd.concat([found[i][k] for i in range(len(loaded))], ignore_index=True) for k in (0, 1))
    return modes, onsets


def _tables(shared: None, named: tuple[str, Any]) -> tuple[pd.DataFrame, pd.DataFrame]:
    name, scene = named
    try:
        result = _sweep_of(scene)
    except SceneError as error:
        raise SceneError(f"{name}: {error}") from error
    except NotConvergedError as error:
        raise NotConvergedError(f"{name}: {error}") from error
    modes, onsets = result.to_dataframe(), result.onsets_dataframe()
    for frame in (modes, onsets):
        frame.insert(0, "scene", name)
    return modes, onsets


def _sweep_of(scene: Scene | MatrixScene) -> Sweep:
    problem = assemble(scene)
    parameter, values = swept(scene, problem)
    solve = scene.solve
    return sweep(
        problem, values, parameter, solve.modes, solve.max_frequency, solve.tolerance, method=solve.method,
        linear_solver=solve.linear_solver,
    )  # fmt: skip
