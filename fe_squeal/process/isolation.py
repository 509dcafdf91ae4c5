"""Processes of Python that run nothing of the folder in which they are started."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

# A child is none of the processes that mpiexec or srun has started. By the last ones Open MPI would take it for one.
_OF_MPIEXEC = ("OMPI_", "PMIX_", "PMI_", "MPI_LOCAL", "SLURM_STEP_ID", "SLURM_STEPID")


def isolated_environment() -> dict[str, str]:
    """Return the environment for a child of this process whose modules come from no working folder.

    `python -m` and `python -c` look for modules in the working folder first, where a file `json.py` of a stranger may
    lie; PYTHONSAFEPATH forbids that (Python 3.11). What PYTHONPATH names stays, behind the folder of this package, but
    for empty and relative entries, which mean the working folder again.
    What mpiexec tells the processes that it starts stays here.
    """
    named = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    home = str(Path(__file__).resolve().parents[2])
    return {
        **{key: value for key, value in os.environ.items() if not key.startswith(_OF_MPIEXEC)},
        "PYTHONSAFEPATH": "1",
        "PYTHONPATH": os.pathsep.join([home, *(entry for entry in named if os.path.isabs(entry))]),
    }


def import_matplotlib() -> None:
    """Import Matplotlib without the settings of the working folder.

    A file `matplotlibrc` there comes before all others; it could have LaTeX run, or pictures fail. The settings of the
    user's home, or where MATPLOTLIBRC says, count.
    """
    if not os.path.lexists("matplotlibrc"):
        return
    before = os.getcwd()
    os.chdir(Path(__file__).parent)
    try:
        import matplotlib  # noqa: F401
    finally:
        os.chdir(before)


@contextmanager
def isolated_children() -> Iterator[None]:
    """Start the processes of multiprocessing inside the block in the environment of `isolated_environment`."""
    before, inside = dict(os.environ), isolated_environment()
    changed = {key for key in before.keys() | inside.keys() if before.get(key) != inside.get(key)}
    _put(inside, changed)
    try:
        yield
    finally:
        _put(before, changed)


def _put(values: dict[str, str], keys: set[str]) -> None:
    """Set the variables of these names, and remove those that have no value."""
    for key in keys:
        if key in values:
            os.environ[key] = values[key]
        else:
            os.environ.pop(key, None)
