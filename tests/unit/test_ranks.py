"""Which of the processes of mpiexec or srun this is, by the variables that they set."""

from __future__ import annotations

import pytest

from fe_squeal.process import ranks

# Variables, how many processes they stand for, and whether the first one serves another.
TOLD = {
    "alone": ({}, 1, False),
    "Open MPI": ({"OMPI_COMM_WORLD_SIZE": "3", "OMPI_COMM_WORLD_RANK": "2", "PMIX_RANK": "2"}, 3, True),
    "Open MPI in a step of one task": (
        {"OMPI_COMM_WORLD_SIZE": "3", "OMPI_COMM_WORLD_RANK": "2", "PMIX_RANK": "2", "SLURM_NTASKS": "1"}, 3, True),
    "MPICH": ({"PMI_SIZE": "2", "PMI_RANK": "1"}, 2, True),
    "srun, pmix": ({"PMIX_RANK": "5", "SLURM_PROCID": "5", "SLURM_NTASKS": "8"}, 8, True),
    "srun, pmix, first": ({"PMIX_RANK": "0", "SLURM_PROCID": "0", "SLURM_NTASKS": "8"}, 8, False),
    "srun, pmix, part of the job": (
        {"PMIX_RANK": "1", "SLURM_PROCID": "1", "SLURM_NTASKS": "8", "SLURM_STEP_NUM_TASKS": "4"}, 4, True),
    "script of sbatch": ({"SLURM_PROCID": "0", "SLURM_NTASKS": "8"}, 1, False),
    "worker of dask-jobqueue": ({"SLURM_PROCID": "3", "SLURM_NTASKS": "8", "SLURM_STEP_NUM_TASKS": "8"}, 1, False),
    "no number": ({"PMI_SIZE": "many", "PMI_RANK": "1"}, 1, False),
}  # fmt: skip


@pytest.mark.parametrize("name", TOLD)
def test_processes_by_what_started_them(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    told, count, helper = TOLD[name]
    monkeypatch.setattr(ranks, "_TOLD", told)
    assert (ranks.process_count(), ranks.is_helper()) == (count, helper)
