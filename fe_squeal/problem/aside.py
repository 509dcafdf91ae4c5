"""Matrices of terms in a file instead of memory, for as long as their sums are worked with."""

from __future__ import annotations

import mmap
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import scipy.sparse as sp

from .terms import Term

_LEAST = 1e6  # entries: smaller matrices stay
_OF_MEMORY = frozenset({"tmpfs", "ramfs"})  # file systems whose files are in memory themselves


def put_aside(terms: Iterable[Term], used: Iterable[sp.csr_array]) -> int:
    """Move the large matrices of terms to temporary files, and return how many bytes of memory that sets free.

    They stay what they are, to be read only: what is asked for comes from the file. The system removes the files with
    the last of their matrices, or with the process. Without room on the disk, or where temporary files are in memory
    themselves, nothing more is moved.

    Parameters
    ----------
    terms : iterable of Term
    used : iterable of (n, n) sparse
        Matrices that are worked with: what is one of these is not moved.
    """
    if _is_in_memory(Path(tempfile.gettempdir())):
        return 0
    moved = 0
    for A in _movable(terms, used):
        arrays = A.data, A.indices
        try:
            with tempfile.TemporaryFile() as file:
                for array in arrays:
                    array.tofile(file)
                file.flush()
                mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except OSError:
            return moved
        starts = 0, A.data.nbytes
        A.data, A.indices = (
            np.frombuffer(mapped, array.dtype, array.size, start) for array, start in zip(arrays, starts, strict=True)
        )
        moved += len(mapped)
    return moved


def forget_pages(terms: Iterable[Term]) -> None:
    """Give back the memory that matrices take since they were read from their files; they can be read again."""
    for term in terms:
        mapped: Any = term.matrix.data
        while isinstance(mapped, np.ndarray):
            mapped = mapped.base
        mapped = mapped.obj if isinstance(mapped, memoryview) else mapped
        if isinstance(mapped, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
            mapped.madvise(mmap.MADV_DONTNEED)


def movable_bytes(terms: Iterable[Term], used: Iterable[sp.csr_array]) -> int:
    """Return the bytes of what `put_aside` would move."""
    if _is_in_memory(Path(tempfile.gettempdir())):
        return 0
    return sum(A.data.nbytes + A.indices.nbytes for A in _movable(terms, used))


def _movable(terms: Iterable[Term], used: Iterable[sp.csr_array]) -> list[sp.csr_array]:
    own = {id(t.matrix): t.matrix for t in terms}
    kept = [A.data for A in used]
    return [
        A for A in own.values()  # those that were moved before are not to be written to
        if A.nnz >= _LEAST and A.data.flags.writeable and not any(np.may_share_memory(A.data, data) for data in kept)
    ]  # fmt: skip


def _is_in_memory(folder: Path) -> bool:
    """Return whether files in a folder are in memory."""
    kinds = {Path(part.mountpoint): part.fstype for part in psutil.disk_partitions(all=True)}
    at = folder.resolve()
    return next((kinds[place] for place in (at, *at.parents) if place in kinds), "") in _OF_MEMORY
