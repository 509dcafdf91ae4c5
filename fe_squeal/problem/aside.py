"""Matrices of terms in a file instead of memory, while their sums are worked with."""

from __future__ import annotations

import mmap
import shutil
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import psutil
import scipy.sparse as sp

from ..eigen.linear.spread_matrix import SpreadMatrix
from ..eigen.pages import pages_of
from .terms import Term

_LEAST = 1e6  # entries: smaller matrices stay
_LEFT = 2**30  # bytes of the disk that are left to others
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
    moved = 0
    for same in _movable(terms, used):
        A = same[0]
        arrays, size = (A.data, A.indices), _size(A)
        try:
            with tempfile.TemporaryFile() as file:
                for array in arrays:
                    array.tofile(file)
                file.flush()
                mapped = mmap.mmap(file.fileno(), size, access=mmap.ACCESS_READ)
        except (OSError, ValueError):  # the disk is full, or the file is shorter than what was written
            return moved
        starts = 0, A.data.nbytes
        data, indices = (
            np.frombuffer(mapped, array.dtype, array.size, start) for array, start in zip(arrays, starts, strict=True)
        )
        for B in same:
            B.data, B.indices = data, indices
        moved += size
    return moved


def forget_pages(terms: Iterable[Term]) -> None:
    """Give back the memory that matrices take since they were read from their files; they can be read again."""
    for term in terms:
        if isinstance(term.matrix, SpreadMatrix):
            continue
        pages = pages_of(term.matrix.data)
        if pages is not None and hasattr(mmap, "MADV_DONTNEED"):
            pages.madvise(mmap.MADV_DONTNEED)


def movable_bytes(terms: Iterable[Term], used: Iterable[sp.csr_array]) -> int:
    """Return the bytes of what `put_aside` would move."""
    return sum(_size(same[0]) for same in _movable(terms, used))


def _movable(terms: Iterable[Term], used: Iterable[sp.csr_array]) -> list[list[sp.csr_array]]:
    """Return the matrices that are moved, those that share their arrays together; as many as there is room for."""
    room, kept = _room(), [A.data for A in used if not isinstance(A, SpreadMatrix)]
    own: dict[tuple[int, int], list[sp.csr_array]] = {}
    for A in {id(t.matrix): t.matrix for t in terms if not isinstance(t.matrix, SpreadMatrix)}.values():
        own.setdefault((A.data.ctypes.data, A.indices.ctypes.data), []).append(A)
    found = []
    for same in own.values():
        A = same[0]
        # Those that were moved before are not to be written to.
        if A.nnz < _LEAST or not A.data.flags.writeable or any(np.may_share_memory(A.data, data) for data in kept):
            continue
        if _size(A) > room:
            break
        room -= _size(A)
        found.append(same)
    return found


def _size(A: sp.csr_array) -> int:
    return int(A.data.nbytes + A.indices.nbytes)


def _room() -> int:
    """Return the bytes that temporary files may take."""
    try:
        folder = Path(tempfile.gettempdir())
        return 0 if _is_in_memory(folder) else shutil.disk_usage(folder).free - _LEFT
    except OSError:  # there is no such folder
        return 0


def _is_in_memory(folder: Path) -> bool:
    """Return whether files in a folder are in memory."""
    kinds = {Path(part.mountpoint): part.fstype for part in psutil.disk_partitions(all=True)}
    at = folder.resolve()
    return next((kinds[place] for place in (at, *at.parents) if place in kinds), "") in _OF_MEMORY
