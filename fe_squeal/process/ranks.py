"""How many processes mpiexec or srun has started, by the variables that they set; nothing is imported for that."""

from __future__ import annotations

import os

# As they are at the beginning: while this process starts children they have none of these, see `isolated_children`.
_TOLD = dict(os.environ)
# How many processes there are, and which one this is, by Open MPI, and by MPICH and Intel MPI.
_SIZES, _RANKS = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE"], ["OMPI_COMM_WORLD_RANK", "PMI_RANK"]
# `srun --mpi=pmix` tells a process of MPI by the first one alone, and the rest by SLURM's own. These are also there
# where a script of sbatch runs one process.
_PMIX, _OF_STEP, _RANK_IN_STEP = "PMIX_RANK", ["SLURM_STEP_NUM_TASKS", "SLURM_NTASKS"], ["SLURM_PROCID"]


def process_count() -> int:
    """Return how many processes mpiexec or srun has started; 1 without it. Nothing is imported for that."""
    return _number([*_SIZES, *(_OF_STEP if _PMIX in _TOLD else [])], 1)


def is_helper() -> bool:
    """Whether this is a process that takes part in factorisations alone."""
    return process_count() > 1 and _number([*_RANKS, *(_RANK_IN_STEP if _PMIX in _TOLD else [])], 0) != 0


def _number(keys: list[str], otherwise: int) -> int:
    return next((int(_TOLD[key]) for key in keys if _TOLD.get(key, "").isdigit()), otherwise)
