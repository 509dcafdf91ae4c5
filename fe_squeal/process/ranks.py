"""How many processes mpiexec has started, by the variables that it sets; nothing is imported for that."""

from __future__ import annotations

import os

# How many processes there are, and which one this is, by Open MPI, and by MPICH and Intel MPI.
_SIZES, _RANKS = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE"), ("OMPI_COMM_WORLD_RANK", "PMI_RANK")
_LOCAL = ("OMPI_COMM_WORLD_LOCAL_SIZE", "MPI_LOCALNRANKS")


def process_count() -> int:
    """Return how many processes mpiexec has started; 1 without it. Nothing is imported for that."""
    return next((int(os.environ[key]) for key in _SIZES if os.environ.get(key, "").isdigit()), 1)


def local_count() -> int:
    """Return how many of them run on this machine."""
    return next((int(os.environ[key]) for key in _LOCAL if os.environ.get(key, "").isdigit()), 1)


def is_helper() -> bool:
    """Whether this is a process that takes part in factorisations alone."""
    rank = next((os.environ[key] for key in _RANKS if os.environ.get(key, "").isdigit()), "0")
    return process_count() > 1 and rank != "0"
