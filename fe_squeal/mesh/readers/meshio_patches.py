"""Make meshio read files at which version 5.3.5 stops."""

from __future__ import annotations

import contextlib
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fe_squeal.errors import MeshError

_INT = re.compile(rb"(?:(SCALARS \S+ )|(\S+ \d+ \d+ ))int((?: \d+)?) *\n")
# Number of nodes of a cell in XDMF's mixed topology, by its code; meshio's list lacks most quadratic cells.
_XDMF_NODES = {0x1: 1, 0x2: 2, 0x4: 3, 0x5: 4, 0x6: 4, 0x7: 5, 0x8: 6, 0x9: 8, 0x22: 3, 0x23: 9, 0x24: 6, 0x25: 8,
               0x26: 10, 0x27: 13, 0x28: 15, 0x29: 18, 0x30: 20, 0x31: 24, 0x32: 27}  # fmt: skip


@contextlib.contextmanager
def patched_meshio(path: Path) -> Iterator[None]:
    """Let meshio, inside the block, read cells at which version 5.3.5 stops with a KeyError.

    These are wedges of 15 nodes, pyramids of 13 nodes, and quadratic cells in XDMF's mixed topology.
    """
    from meshio._mesh import topological_dimension

    topological_dimension.setdefault("wedge15", 3)
    topological_dimension.setdefault("pyramid13", 3)
    if path.suffix.lower() not in (".xdmf", ".xmf"):
        yield
        return
    from meshio.xdmf import main

    original = main.translate_mixed_cells
    main.translate_mixed_cells = lambda data: _mixed_cells(data, path.name)
    try:
        yield
    finally:
        main.translate_mixed_cells = original


def _mixed_cells(data: np.ndarray, source: str) -> list[object]:
    """Return meshio's blocks of cells from XDMF's mixed topology: code, nodes, code, nodes, ... one after the other."""
    import meshio
    from meshio.xdmf.common import xdmf_idx_to_meshio_type

    data = np.asarray(data, dtype=np.int64).ravel()
    codes, starts, at = [], [], 0
    while at < len(data):
        code = int(data[at])
        if code not in _XDMF_NODES:
            raise MeshError(
                f"{source}: the mixed topology has cells of XDMF type {code}; expected linear or quadratic tetrahedra"
                " (6, 38), hexahedra (9, 48, 50), wedges (8, 40) or pyramids (7, 39), with triangles or quadrilaterals"
            )
        at += 1
        if code in (0x1, 0x2):  # points and lines state their number of nodes
            if at >= len(data) or data[at] != _XDMF_NODES[code]:
                raise MeshError(f"{source}: the mixed topology has lines of more than 2 points; leave them out")
            at += 1
        codes.append(code)
        starts.append(at)
        at += _XDMF_NODES[code]
    if at != len(data):
        raise MeshError(f"{source}: the mixed topology ends within a cell; save the mesh again")
    blocks, first = [], 0
    for i in range(1, len(codes) + 1):
        if i == len(codes) or codes[i] != codes[first]:
            nodes = data[np.array(starts[first:i])[:, None] + np.arange(_XDMF_NODES[codes[first]])]
            blocks.append(meshio.CellBlock(xdmf_idx_to_meshio_type[codes[first]], nodes))
            first = i
    return blocks


def with_sized_integers(path: Path) -> object | None:
    """Return meshio's mesh of a binary legacy .vtk file with arrays of type int; None for any other file.

    An int has four bytes there, and meshio takes eight.
    """
    from meshio.vtk._main import read_buffer

    if path.suffix.lower() != ".vtk":
        return None
    data = path.read_bytes()
    if b"Version 5" not in data[:40] or b"\nBINARY" not in data[:400] or not _INT.search(data):
        return None
    with tempfile.TemporaryFile() as copy:  # it has no name, so that nothing is left of it if this process is killed
        copy.write(_INT.sub(rb"\1\2vtktypeint32\3\n", data))
        copy.seek(0)
        return read_buffer(copy)
