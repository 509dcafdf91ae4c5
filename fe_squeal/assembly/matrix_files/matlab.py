"""MATLAB files (.mat) as -v4, -v6 and -v7 write them."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from ...errors import SceneError, suggest
from .checks import check_square, coordinates, in_a_line, no_complex, refuse_size, sizes_of

_CLASSES = (
    "unknown", "cell", "struct", "object", "char", "sparse", "double", "single", "int8", "uint8", "int16", "uint16",
    "int32", "uint32", "int64", "uint64", "function", "opaque",
)  # fmt: skip
_NUMERIC = _CLASSES[5:16]
_LEVEL5_TYPES = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
}  # fmt: skip
_TAGS = 8192  # bytes around the numbers: tags, sizes, the name
_LEVEL4_TYPES = ("f8", "f4", "i4", "i2", "u2", "u1")


class _Variable(NamedTuple):
    """One variable of a MATLAB file, not yet read."""

    shape: tuple[int, ...]
    kind: str  # of _CLASSES, or "logical"
    is_complex: bool
    load: Callable[[], Any]

    def __str__(self) -> str:
        return f"{sizes_of(self.shape)} {self.kind}".strip()


def read_matlab(data: bytes, variable: str | None, source: str) -> Any:
    """Return the matrix of a .mat file.

    scipy.io.loadmat is not used, since unknown type codes in damaged files crash Python there.

    Raises
    ------
    SceneError
        It is a file of MATLAB 7.3, the matrix is complex, there is no such variable, or several and none is named.
    ValueError
        The file is damaged.
    """
    if b"\x89HDF\r\n" in (data[:6], data[512:518]):  # at 0 as Octave writes it
        raise SceneError(f"{source}: a MATLAB 7.3 file (HDF5) is not read; save it with -v7")
    contents = _level4(data) if 0 in data[:4] else _level5(data, source)
    matrices = [name for name, found in contents.items() if found.kind in _NUMERIC and len(found.shape) == 2]
    if variable is None:
        if len(matrices) != 1:
            what = "several matrices; name one by variable" if matrices else "no numeric matrix"
            names = ", ".join(f"{name} ({contents[name]})" for name in matrices or contents)
            raise SceneError(f"{source}: holds {what}: {in_a_line(names) or 'it is empty'}")
        variable = matrices[0]
    if variable not in contents:
        raise SceneError(f'{source}: no variable "{variable}"' + in_a_line(suggest(variable, contents)))
    chosen = contents[variable]
    if chosen.kind not in _NUMERIC:
        what = f"{variable} ({chosen}) is not a numeric matrix" + suggest("", matrices)
        raise SceneError(f"{source}: {in_a_line(what)}")
    check_square(chosen.shape, source)
    if chosen.is_complex:
        raise SceneError(no_complex(source))
    return chosen.load()


def _level5(data: bytes, source: str) -> dict[str, _Variable]:
    """List the variables of a file saved with -v6 or -v7 by their headers."""
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None or struct.unpack_from(f"{order}H", data, 124)[0] >> 8 != 1:
        raise ValueError("not the header of a MATLAB file")
    contents: dict[str, _Variable] = {}
    view, at = memoryview(data), 128
    while at < len(data):
        code, block, at = _element(view, at, order)
        packed = code == 15
        if packed:  # the first 4096 bytes hold the header; a variable that is not wanted is not unpacked
            start = memoryview(zlib.decompressobj().decompress(block, 4096))
            code, start = struct.unpack_from(f"{order}I", start)[0], start[8:]
        else:
            start = block
        if code != 14:
            raise ValueError("a variable that is no array")
        _, flags, next_part = _element(start, 0, order)
        bits, room = struct.unpack_from(f"{order}2I", flags)
        kind = "logical" if bits & 0x200 else _CLASSES[bits & 0xFF] if bits & 0xFF < len(_CLASSES) else "unknown"
        shape: tuple[int, ...] = ()
        if kind != "opaque":
            code, sizes, next_part = _element(start, next_part, order)
            shape = tuple(int(n) for n in _numbers(code, sizes, order, "iu"))
        _, name, next_part = _element(start, next_part, order)
        if name:  # MATLAB keeps what objects and function handles need in a nameless array
            load = partial(_level5_matrix, source, block, packed, next_part, order, shape, kind, room)
            contents[bytes(name).decode("latin-1")] = _Variable(shape, kind, bool(bits & 0x800), load)
    return contents


def _element(data: memoryview, at: int, order: str) -> tuple[int, memoryview, int]:
    """Return type code and content of the element that begins at a byte, and where the next one begins."""
    code, size = struct.unpack_from(f"{order}2I", data, at)
    if code >> 16:  # up to four bytes share the tag's eight
        code, size, first, end = code & 0xFFFF, code >> 16, at + 4, at + 8
    else:
        first, end = at + 8, at + 8 + size + (0 if code == 15 else -size % 8)
    if first + size > min(end, len(data)):
        raise ValueError(f"{size} bytes are promised where {max(min(end, len(data)) - first, 0)} are left")
    return code, data[first : first + size], end


def _numbers(code: int, content: memoryview, order: str, kinds: str = "iuf") -> np.ndarray:
    kind = _LEVEL5_TYPES.get(code, "?")
    if kind[0] not in kinds:
        raise ValueError(f"numbers of the type {code}")
    return np.frombuffer(content, np.dtype(order + kind))


def _level5_matrix(
    source: str, block: memoryview, packed: bool, at: int, order: str, shape: tuple[int, ...], kind: str, room: int
) -> np.ndarray | sparse.csc_array:
    if packed:
        # Indices take 4 bytes, numbers 8; there may be room for more of them than there are.
        size = 12 * room + 4 * (shape[1] + 1) if kind == "sparse" else 8 * math.prod(shape)
        refuse_size(3 * size, source)
        unpacked = zlib.decompressobj()
        content = memoryview(unpacked.decompress(block, size + _TAGS))[8:]
        if unpacked.unconsumed_tail:
            raise ValueError(f"more than the {size} bytes that its header promises")
    else:
        content = block
    parts = []
    for kinds in ("iu", "iu", "iuf") if kind == "sparse" else ("iuf",):
        code, part, at = _element(content, at, order)
        parts.append(_numbers(code, part, order, kinds))
    values = parts[-1].astype(np.float64)
    if kind != "sparse":
        return values.reshape(shape, order="F")
    rows, starts = (part.astype(np.int64) for part in parts[:2])
    stored = int(starts[-1])  # there may be room for more
    return sparse.csc_array((values[:stored], rows[:stored], starts), shape=shape)


def _level4(data: bytes) -> dict[str, _Variable]:
    """List the variables of a file saved with -v4, as simple programs write it."""
    order = "<" if 0 <= struct.unpack_from("<i", data)[0] <= 5000 else ">"
    contents: dict[str, _Variable] = {}
    at = 0
    while at < len(data):
        code, rows, columns, imaginary, length = struct.unpack_from(f"{order}5i", data, at)
        machine, number, what = code // 1000, code // 10 % 10, code % 10
        if machine not in (0, 1) or number >= len(_LEVEL4_TYPES) or what > 2 or min(rows, columns, length) < 0:
            raise ValueError("not the header of a MATLAB 4 variable")
        name = data[at + 20 : at + 20 + length].rstrip(b"\0").decode("latin-1")
        at += 20 + length
        kind, shape, is_complex = ("double", "char", "sparse")[what], (rows, columns), bool(imaginary)
        dtype = np.dtype(order + _LEVEL4_TYPES[number])
        count = rows * columns
        if at + count * dtype.itemsize > len(data):
            raise ValueError(f"{rows}x{columns} numbers are promised where {max(len(data) - at, 0)} bytes are left")
        table = np.frombuffer(data, dtype, count, at).reshape(shape, order="F")
        at += count * dtype.itemsize * (2 if is_complex and what != 2 else 1)
        load: Callable[[], Any] = partial(np.asarray, table)
        if what == 2:  # a table of row, column and value, the last row has the sizes
            is_complex = columns == 4
            shape = (int(table[-1, 0]), int(table[-1, 1]))
            load = partial(_level4_sparse, table[:-1], shape)
        contents[name] = _Variable(shape, kind, is_complex, load)
    return contents


def _level4_sparse(table: np.ndarray, shape: tuple[int, int]) -> sparse.coo_array:
    row, col, value = coordinates(table.astype(np.float64), shape[0])
    return sparse.coo_array((value, (row, col)), shape=shape)
