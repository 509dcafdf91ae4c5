"""Arrays of NumPy (.npy) and sparse matrices of SciPy (.npz)."""

from __future__ import annotations

import io
import math
import zipfile
from typing import Any

import numpy as np
from numpy.lib import format as npy
from scipy import sparse

from ...errors import SceneError
from .checks import check_square, in_a_line, refuse_size

_HEADER, _LARGEST = 65_536, 64  # bytes that hold every header, and every number or the name of a format
_INDICES = {
    "csr": ("indices", "indptr"), "csc": ("indices", "indptr"), "bsr": ("indices", "indptr"),
    "coo": ("row", "col"), "dia": ("offsets",),
}  # fmt: skip


def read_array(data: bytes, source: str, kinds: str) -> np.ndarray:
    """Return the array of an .npy file, read without any unpickling.

    Raises
    ------
    SceneError
        The array has another kind of numbers than those in `kinds` (NumPy's letters).
    ValueError
        The data do not fill exactly the shape of the header, or it is no such file.
    """
    stream = io.BytesIO(data)
    version = npy.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"version {version} of the format")
    read_header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, fortran, dtype = read_header(stream)
    if dtype.kind not in kinds:
        what = "Python objects (pickled), which are never read" if dtype.hasobject else f'data of type "{dtype}"'
        raise SceneError(f"{source}: holds {in_a_line(what)}; expected numbers")
    count, at = math.prod(shape), stream.tell()
    if min(shape, default=0) < 0 or count * dtype.itemsize != len(data) - at:
        raise ValueError(f"shape {shape} of {dtype} does not fit the {len(data) - at} bytes of data")
    return np.frombuffer(data, dtype, count, at).reshape(shape, order="F" if fortran else "C")


def _promised(head: bytes) -> tuple[int, int]:
    """Return how many numbers the header of an .npy file promises, and their size in bytes."""
    stream = io.BytesIO(head)
    version = npy.read_magic(stream)
    read_header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read_header(stream)
    return math.prod(shape), dtype.itemsize


def read_scipy_sparse(data: bytes, source: str) -> Any:
    """Return the matrix that scipy.sparse.save_npz wrote; its arrays are checked before SciPy gets them.

    Raises
    ------
    SceneError
        An array is missing or has another kind of numbers, or the matrix is not square or too large for the memory.
    ValueError
        The arrays do not make a sparse matrix of a known format.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        names = [name.removesuffix(".npy") for name in archive.namelist()]
        if missing := {"format", "shape", "data"} - set(names):
            raise SceneError(
                f"{source}: there is no {', '.join(sorted(missing))} among its arrays ({in_a_line(', '.join(names))}); "
                "expected a sparse matrix saved with scipy.sparse.save_npz"
            )

        def member(name: str, kinds: str = "iu", most: int = 64) -> np.ndarray:
            """Return an array of at most so many numbers, looked for in its header before the rest is unpacked."""
            entry = archive.getinfo(f"{name}.npy")
            with archive.open(entry) as file:
                head = file.read(_HEADER)
                count, size = _promised(head)
                if count > most or size > _LARGEST:
                    raise ValueError(f"{name} promises {count} numbers of {size} bytes, where the shape allows {most}")
                refuse_size(2 * count * size, source)
                rest = file.read(count * size + 1)
            return read_array(head + rest, source, kinds)

        layout = member("format", "SU").astype(str).item()
        shape = tuple(int(n) for n in member("shape").ravel())
        check_square(shape, source)
        n = shape[0]
        values = member("data", "iufc", 4 * n**2 + 64)  # diagonals and blocks are filled up, entries may be double
        values = values.astype(np.complex128 if values.dtype.kind == "c" else np.float64)
        known = [name for name in names if name in _INDICES.get(layout, ())]
        index = {name: member(name, "iu", max(n + 1, len(values))).astype(np.int64) for name in known}
    if layout not in _INDICES or len(index) != len(_INDICES[layout]):
        raise ValueError(f'format "{layout}" with the arrays {", ".join(names)}')
    if layout == "coo":
        return sparse.coo_array((values, (index["row"], index["col"])), shape=shape)
    if layout == "dia":
        return sparse.dia_array((values, index["offsets"]), shape=shape)
    make = {"csr": sparse.csr_array, "csc": sparse.csc_array, "bsr": sparse.bsr_array}[layout]
    return make((values, index["indices"], index["indptr"]), shape=shape)
