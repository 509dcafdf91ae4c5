"""Matrix Market files (.mtx)."""

from __future__ import annotations

import gzip
import io
from typing import Any

import numpy as np
from scipy import sparse

from ...errors import SceneError
from .checks import check_square, coordinates, in_a_line, no_complex, refuse_size

_COMMENTS, _LINE = 1_000_000, 128  # bytes: of a header with its comments at most, and of an entry


def read_matrix_market(data: bytes, source: str) -> sparse.coo_array:
    """Return the matrix of a Matrix Market file, which is read strictly.

    scipy.io.mmread is not used, since it takes 1.5D+03 for 1.5, 0x10 for 0 and the integer 9.7 for 9.

    Raises
    ------
    SceneError
        The file is not in this format, or its numbers or their count are wrong.
    """
    stream = io.BytesIO(data)
    layout, symmetry, n, sizes = _header(stream, source)
    body = stream.read().translate(bytes.maketrans(b"Dd", b"Ee"))  # as Fortran writes exponents
    table = np.loadtxt(io.BytesIO(body), comments="%", ndmin=2)
    skew = symmetry == "skew-symmetric"
    stored = n * n if symmetry == "general" else n * (n - 1) // 2 if skew else n * (n + 1) // 2
    expected, found = (sizes[2], len(table)) if layout == "coordinate" else (stored, table.size)
    if found != expected:
        raise SceneError(f"{source}: the header promises {expected} entries, the file holds {found}; is it truncated?")
    if layout == "array":
        value = table.ravel()
        col, row = np.divmod(np.arange(stored), n) if symmetry == "general" else np.triu_indices(n, int(skew))
    elif found == 0:
        return sparse.coo_array((n, n))
    else:
        row, col, value = coordinates(table, n)
    if symmetry == "general":
        return sparse.coo_array((value, (row, col)), shape=(n, n))
    return _both_triangles(row, col, value, skew, n, source)


def unpacked(data: bytes, source: str) -> bytes:
    """Return the text of a packed file, no more of it than its header promises.

    Raises
    ------
    SceneError
        It holds more, or more than the memory does.
    """
    with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
        head = file.read(_COMMENTS)
        _, _, n, sizes = _header(io.BytesIO(head), source)
        entries = min(sizes[-1], 100 * n**2) if len(sizes) == 3 else n**2  # some may be given more than once
        refuse_size(_LINE * entries // 2, source)
        rest = file.read(_LINE * entries + 1)
        if len(rest) > _LINE * entries:
            raise SceneError(f"{source}: holds more than the {entries} entries that its header promises")
    return head + rest


def _header(stream: io.BytesIO, source: str) -> tuple[str, str, int, tuple[int, ...]]:
    """Return layout, symmetry, number of rows and all sizes; the stream is then at the first entry."""
    banner = stream.readline().decode("latin-1")
    words = banner.lower().split()
    if len(words) != 5 or words[:2] != ["%%matrixmarket", "matrix"]:
        given = in_a_line(banner[:80])
        raise SceneError(f'{source}: begins with "{given}"; expected "%%MatrixMarket matrix coordinate real general"')
    layout, field, symmetry = words[2:]
    if field == "complex":
        raise SceneError(no_complex(source))
    for given, known in (
        (layout, ("coordinate", "array")),
        (field, ("real", "integer", "double")),
        (symmetry, ("general", "symmetric", "skew-symmetric")),
    ):
        if given not in known:
            given = in_a_line(given)
            raise SceneError(f'{source}: the Matrix Market header has "{given}"; expected one of {", ".join(known)}')
    line = next((line for line in stream if line.strip() and not line.lstrip().startswith(b"%")), b"")
    sizes = line.split()
    if len(sizes) != (3 if layout == "coordinate" else 2) or not all(size.isdigit() for size in sizes):
        raise SceneError(f'{source}: "{in_a_line(line[:80].decode("latin-1"))}" is not the line of the sizes')
    n, columns, *entries = (int(size) for size in sizes)
    check_square((n, columns), source)
    return layout, symmetry, n, (n, columns, *entries)


def _both_triangles(row: Any, col: Any, value: Any, skew: bool, n: int, source: str) -> sparse.coo_array:
    """Return the matrix of which a symmetric or skew-symmetric file gives one triangle, whichever."""
    cell = np.minimum(row, col) * n + np.maximum(row, col)
    upper, lower = cell[row < col], cell[row > col]
    twice = np.intersect1d(upper, lower) if len(upper) and len(lower) else upper[:0]  # seldom: it costs a sort of all
    if len(twice):  # the sum would be double what is meant
        i, j = divmod(int(twice[0]), n)
        raise SceneError(
            f"{source}: the header says {'skew-' if skew else ''}symmetric, so that one triangle is expected, but both "
            f"({i + 1}, {j + 1}) and ({j + 1}, {i + 1}) are given; write one triangle, or all under the header general"
        )
    off = row != col
    if skew and np.any(value[~off]):
        i = int(row[~off][np.flatnonzero(value[~off])[0]]) + 1
        raise SceneError(f"{source}: the header says skew-symmetric, but the diagonal entry of row {i} is not zero")
    value = np.concatenate([value, -value[off] if skew else value[off]])
    return sparse.coo_array((value, (np.concatenate([row, col[off]]), np.concatenate([col, row[off]]))), shape=(n, n))
