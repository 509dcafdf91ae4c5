"""Read an Ansys archive with mapdl-archive: python -m fe_squeal.mesh.readers.ansys_archive FILE > OUT.npz

This runs as a process of its own, because the compiled reader of mapdl-archive may crash on a damaged file.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fe_squeal.errors import MeshError
from fe_squeal.process.isolation import isolated_environment

from ..raw import Floats, Ints

_SECONDS = 600  # the reading process is ended after so long


@dataclass(frozen=True)
class Archive:
    """The arrays of an archive; the names are mapdl-archive's.

    Attributes
    ----------
    nnum : (n,) int
        Numbers of the nodes.
    nodes : (n, 3) float
        Coordinates of the nodes, in the file's unit of length.
    angles : (n, 3) float
        Angles in degrees that turn the axes of the nodes: THXY about z, then THYZ about x, then THZX about y.
    ekey : (t, 2) int
        Number and kind (185, ...) of each element type.
    elem : (e, w) int
        Rows of EBLOCK, filled up with zeros: material, type, real constant, ..., number and nodes of each element.
    node_components, element_components : mapping of str to (m,) int
        Numbers of the nodes and of the elements of each component.
    reals : mapping of int to (k,) float
        Sets of real constants by their numbers.
    """

    nnum: Ints
    nodes: Floats
    angles: Floats
    ekey: Ints
    elem: Ints
    node_components: dict[str, Ints]
    element_components: dict[str, Ints]
    reals: dict[int, Floats]


def read_apart(path: Path) -> Archive:
    """Return the arrays of a file, read by another process.

    Raises
    ------
    MeshError
        The file is damaged, reading takes too long, or mapdl-archive is not installed.
    """
    if importlib.util.find_spec("mapdl_archive") is None:
        what = 'Ansys archives need the package mapdl-archive: pip install "fe-squeal[ansys]"'
        raise MeshError(f"{path.name}: {what}")
    command = [sys.executable, "-m", "fe_squeal.mesh.readers.ansys_archive", str(path.resolve())]
    with tempfile.TemporaryFile() as out:  # it has no name, so that nothing is left of it if this process is killed
        try:
            done = subprocess.run(
                command, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.DEVNULL, timeout=_SECONDS,
                env=isolated_environment(), check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired as error:
            raise MeshError(f"{path.name}: reading this Ansys archive took more than {_SECONDS} s") from error
        if done.returncode or not out.seek(0, os.SEEK_END):
            raise MeshError(f"{path.name}: not a readable Ansys archive; it is damaged: write it again by CDWRITE,DB")
        out.seek(0)
        with np.load(out) as data:
            parts: dict[str, dict[str, np.ndarray]] = {"node": {}, "element": {}, "real": {}}
            for key in data.files:
                kind, dot, name = key.partition(".")
                if dot:
                    parts[kind][name] = data[key]
            return Archive(
                data["nnum"], data["nodes"], data["angles"], data["ekey"], data["elem"], parts["node"],
                parts["element"],
                {int(name): values for name, values in parts["real"].items()},
            )  # fmt: skip


def main() -> int:
    """Read the file that the argument names, and write its arrays to the standard output; return 0."""
    out = os.dup(1)
    os.dup2(2, 1)  # what the compiled reader prints does not belong to them
    from mapdl_archive import Archive as Reader

    archive = Reader(sys.argv[1], parse_vtk=False, verbose=False)
    rows = [np.asarray(row, dtype=np.int64) for row in archive.elem]
    elem = np.zeros((len(rows), max(map(len, rows), default=0)), np.int64)
    for i, row in enumerate(rows):
        elem[i, : len(row)] = row
    arrays = {
        "nnum": np.asarray(archive.nnum, dtype=np.int64), "nodes": np.asarray(archive.nodes, dtype=float)[:, :3],
        "angles": np.asarray(archive.node_angles, dtype=float).reshape(-1, 3),
        "ekey": np.asarray(archive.ekey, dtype=np.int64).reshape(-1, 2), "elem": elem,
    }  # fmt: skip
    for kind, components in (("node", archive.node_components), ("element", archive.element_components)):
        for name, members in components.items():
            arrays[f"{kind}.{str(name).strip().replace('/', '_')}"] = np.asarray(members, dtype=np.int64)
    for number, values in zip(archive.rlblock_num, archive.rlblock, strict=True):
        arrays[f"real.{int(number)}"] = np.asarray(values, dtype=float)
    with os.fdopen(out, "wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]
    return 0


if __name__ == "__main__":
    sys.exit(main())
