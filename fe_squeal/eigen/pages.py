"""Arrays whose memory is given back in parts: NumPy keeps that of an array as a whole."""

from __future__ import annotations

import mmap
from typing import Any

import numpy as np

_CAN = hasattr(mmap, "MAP_PRIVATE") and hasattr(mmap, "MADV_DONTNEED")  # not on Windows


def empty_pages(rows: int, columns: int) -> np.ndarray:
    """Return an array (rows, columns) float without values; pages that are not written to take no memory."""
    if not _CAN or rows * columns == 0:
        return np.empty((rows, columns))
    pages = mmap.mmap(-1, 8 * rows * columns, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    if hasattr(mmap, "MADV_HUGEPAGE"):  # as NumPy does for its own
        pages.madvise(mmap.MADV_HUGEPAGE)
    return np.frombuffer(pages, float).reshape(rows, columns)


def give_back(array: np.ndarray, first: int) -> None:
    """Give back the memory of an array (r, n) of `empty_pages` from row `first` on; what stood there is lost.

    Other arrays keep theirs.
    """
    pages = pages_of(array)
    if pages is None or not _CAN or array.nbytes != len(pages):
        return
    start = -(-first * array.strides[0] // mmap.PAGESIZE) * mmap.PAGESIZE
    if start < len(pages):
        pages.madvise(mmap.MADV_DONTNEED, start, len(pages) - start)


def pages_of(array: Any) -> mmap.mmap | None:
    """Return the mapped memory that an array is in, None for others."""
    while isinstance(array, np.ndarray):
        array = array.base
    array = array.obj if isinstance(array, memoryview) else array
    return array if isinstance(array, mmap.mmap) else None
