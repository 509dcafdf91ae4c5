"""What every matrix has to be, whatever file it comes from, and the words of the refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from ...eigen.memory import available_memory, memory_text
from ...errors import SceneError

_LARGEST = 1e100  # the solvers square what they multiply, and a double ends at 1.8e308
_MOST_ROWS = 20_000_000  # the row pointers alone are 160 MB; a damaged header can claim any number


def checked(matrix: Any, source: str) -> sparse.csr_array:
    """Return a matrix as (n, n) sparse float with sorted indices, without duplicates and zeros.

    Raises
    ------
    SceneError
        The matrix is complex, not square, or has entries that are not finite or absurdly large.
    ValueError
        Its index pointers or indices are wrong.
    """
    check_square(matrix.shape, source)
    if matrix.dtype.kind == "c":
        raise SceneError(no_complex(source))
    if sparse.issparse(matrix):
        if matrix.format in ("csr", "csc", "bsr"):
            # Compiled code, which trusts the indices, converts them below: wrong ones crash Python. SciPy's own check
            # looks at nothing where the last pointer is not positive; and a difference of pointers could overflow.
            if np.any(matrix.indptr[1:] < matrix.indptr[:-1]):
                raise ValueError("index pointers that decrease")
            matrix.check_format(full_check=True)
        result = sparse.csr_array(matrix, dtype=np.float64, copy=True)
    else:
        result = sparse.csr_array(np.asarray(matrix, dtype=np.float64))
    result.sum_duplicates()
    result.eliminate_zeros()
    bad = np.flatnonzero(~np.isfinite(result.data))
    if len(bad):
        row = int(np.searchsorted(result.indptr, bad[0], side="right"))  # counted from 1
        raise SceneError(
            f"{source}: {len(bad)} of {result.nnz} entries are not finite, the first, {result.data[bad[0]]}, "
            f"in row {row}, column {result.indices[bad[0]] + 1}; expected finite numbers"
        )
    large = np.flatnonzero(np.abs(result.data) > _LARGEST)
    if len(large):
        raise SceneError(
            f"{source}: holds {result.data[large[0]]:g}; expected numbers up to {_LARGEST:g}, whatever the units;"
            " is the file damaged?"
        )
    return result


def check_square(shape: tuple[int, ...], source: str) -> None:
    """Raise SceneError for a shape that is not square, is empty or is absurdly large."""
    sizes = sizes_of(shape)
    if len(shape) != 2 or shape[0] != shape[1]:
        what = f"of {sizes}" if len(shape) > 1 else f"one row of {sizes} numbers" if shape else "a single number"
        raise SceneError(f"{source}: the matrix is {what}; expected a square one")
    if not 0 < shape[0] <= _MOST_ROWS:
        what = f"more than {_MOST_ROWS}; is the file damaged?" if shape[0] > 0 else "empty; expected at least one row"
        raise SceneError(f"{source}: the matrix is of {sizes}, {what}")


def coordinates(table: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows and columns (m,) int, counted from 0, and values (m,) of a table (m, 3) that counts from 1.

    Raises
    ------
    ValueError
        The table does not have three columns, or a row or column is not a whole number from 1 to n.
    """
    if table.shape[1] != 3:
        raise ValueError(f"{table.shape[1]} numbers per entry; expected row, column and value")
    if not np.all((table[:, :2] == np.floor(table[:, :2])) & (table[:, :2] >= 1) & (table[:, :2] <= n)):
        raise ValueError(f"row or column numbers that are not whole numbers from 1 to {n}")
    return table[:, 0].astype(np.int64) - 1, table[:, 1].astype(np.int64) - 1, table[:, 2]


def refuse_size(size: int, source: str) -> None:
    """Refuse to unpack more bytes than there is memory for.

    Raises
    ------
    SceneError
    """
    free = available_memory()
    if size > free:
        raise SceneError(
            f"{source}: the matrix takes {memory_text(size)}, and {memory_text(free)} are free; is the file damaged?"
        )


def sizes_of(shape: tuple[int, ...]) -> str:
    """Return a shape as in 3x8."""
    return in_a_line("x".join(str(int(n)) for n in shape))


def no_complex(source: str) -> str:
    """Return the message for a complex matrix."""
    return (
        f"{source}: the matrix is complex; expected a real one: give its real and its imaginary part as two terms, "
        "the latter with imaginary = true"
    )


def in_a_line(text: str) -> str:
    """Return a text without line breaks and control characters, cut where it gets long."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())[:160].rstrip(" .")
