"""Gmsh .msh files, versions 2.2 and 4.1, text and binary.

They are not read by meshio, because it stops at files whose entities have no physical group or several without names,
at node numbers with gaps in binary 2.2, and at parametric nodes. Version 4.0 is left to meshio. The formats are
described at https://gmsh.info/doc/texinfo/gmsh.html (MSH file format).
"""

from __future__ import annotations

import codecs
from pathlib import Path

import numpy as np

from fe_squeal.errors import MeshError

from ..gmsh_cells import NODES, GmshCells, raw_mesh
from ..raw import Ints, RawMesh
from .others import read_with_meshio
from .sources import Sources, text_lines


class _Cursor:
    """Reads numbers one after the other from a section, text or binary alike."""

    def __init__(self, body: bytes, text: bool, size_bytes: int, order: str) -> None:
        self.text, self.at = text, 0
        self.kinds = {"i": np.dtype(order + "i4"), "u": np.dtype(order + f"u{size_bytes}"), "d": np.dtype(order + "f8")}
        self.numbers = np.array(body.split() if text else [], dtype=np.float64)
        self.body = body
        self.length = len(self.numbers) if text else len(body)

    def take(self, kind: str, count: int) -> np.ndarray:
        count = int(count)
        step = 1 if self.text else self.kinds[kind].itemsize
        if count < 0 or self.at + count * step > self.length:
            raise ValueError("the section ends too early")
        first, self.at = self.at, self.at + count * step
        if self.text:
            part = self.numbers[first : self.at]
        else:
            part = np.frombuffer(self.body[first : self.at], dtype=self.kinds[kind])
        if kind == "d":
            return part.astype(np.float64)
        with np.errstate(invalid="ignore"):
            whole = part.astype(np.int64)
        if self.text and not np.array_equal(whole, part):
            raise ValueError("a number that should be whole is not")
        return whole

    def one(self, kind: str) -> int:
        return int(self.take(kind, 1)[0])


def read_gmsh(path: Path) -> RawMesh:
    """Read a Gmsh file; physical groups of dimension 3 are volume groups, of dimension 2 surface groups.

    Raises
    ------
    MeshError
        The file is damaged, or not from Gmsh.
    """
    data = path.read_bytes().removeprefix(codecs.BOM_UTF8)
    if not data.lstrip().startswith(b"$"):
        return read_with_meshio(Sources(path))  # Ansys writes .msh files too
    try:
        sections = _sections(data)
        version, size, text, order = _header(sections)
        if version.startswith("4.0"):
            return read_with_meshio(Sources(path))
        if not version.startswith(("2", "4")):
            raise MeshError(f"{path.name}: Gmsh format version {version} is not read; save it as 4.1 or 2.2 in Gmsh")
        if "PartitionedEntities" in sections:
            raise MeshError(f"{path.name}: the mesh is partitioned; save it unpartitioned in Gmsh")
        names = _physical_names(sections.get("PhysicalNames", b""))
        if version.startswith("4"):
            labels, points = _nodes4(_Cursor(sections["Nodes"], text, size, order))
            physical = _entities4(_Cursor(sections["Entities"], text, size, order)) if "Entities" in sections else {}
            cells = _cells4(_Cursor(sections["Elements"], text, size, order), physical)
        else:
            labels, points = _nodes2(sections["Nodes"], text, order)
            cells = _cells2(sections["Elements"], text, order)
    except KeyError as error:
        raise MeshError(
            f"{path.name}: the section ${error.args[0]} is missing or incomplete; save the mesh again"
        ) from error
    except (ValueError, IndexError, OverflowError) as error:
        raise MeshError(f"{path.name}: not a readable Gmsh file ({error}); save the mesh again") from error
    return raw_mesh(path.name, labels, points, cells, names, repeats=version.startswith("2"))


def _sections(data: bytes) -> dict[str, bytes]:
    """Return the bodies of the sections $Name ... $EndName by their names.

    The end of a section is found by its name, since a binary body may contain any byte.
    """
    found: dict[str, bytes] = {}
    at = data.find(b"$")
    while at >= 0:
        end_line = data.find(b"\n", at)
        if end_line < 0:
            break
        name = data[at + 1 : end_line].strip().decode("latin-1")
        stop = data.find(b"\n$End" + name.encode("latin-1"), end_line)
        if stop < 0:
            stop = data.find(b"$End" + name.encode("latin-1"), end_line)
        if stop < 0:
            break
        found.setdefault(name, data[end_line + 1 : stop])
        at = data.find(b"$", stop + 5 + len(name))
    return found


def _header(sections: dict[str, bytes]) -> tuple[str, int, bool, str]:
    first, _, rest = sections["MeshFormat"].partition(b"\n")
    version, mode, size = first.decode("latin-1").split()[:3]
    if mode not in ("0", "1") or size not in ("4", "8"):
        raise ValueError("its header is wrong")
    order = "<" if mode == "0" or rest[:4] == b"\x01\0\0\0" else ">"
    return version, int(size), mode == "0", order


def _physical_names(body: bytes) -> dict[tuple[int, int], str]:
    names = {}
    for line in text_lines(body)[1:]:
        dimension, tag, name = line.split(maxsplit=2)
        names[int(dimension), int(tag)] = name.strip().strip('"')
    return names


def _entities4(read: _Cursor) -> dict[tuple[int, int], tuple[int, ...]]:
    """Return the tags of the physical groups of each entity, by its dimension and tag."""
    physical = {}
    for dimension, count in enumerate(read.take("u", 4)):
        for _ in range(count):
            tag = read.one("i")
            read.take("d", 3 if dimension == 0 else 6)
            physical[dimension, tag] = tuple(int(p) for p in read.take("i", read.one("u")))
            if dimension:
                read.take("i", read.one("u"))
    return physical


def _nodes4(read: _Cursor) -> tuple[Ints, np.ndarray]:
    blocks, total = read.take("u", 4)[:2]
    labels, points = [np.empty(0, np.int64)], [np.empty((0, 3))]
    for _ in range(blocks):
        dimension, _, parametric = read.take("i", 3)
        count = read.one("u")
        labels.append(read.take("u", count))
        width = 3 + (int(dimension) if parametric else 0)
        points.append(read.take("d", count * width).reshape(count, width)[:, :3])
    if sum(map(len, labels)) != total:
        raise ValueError(f"{total} nodes announced, {sum(map(len, labels))} found")
    return np.concatenate(labels), np.concatenate(points)


def _cells4(read: _Cursor, physical: dict[tuple[int, int], tuple[int, ...]]) -> list[GmshCells]:
    cells = []
    for _ in range(read.take("u", 4)[0]):
        dimension, tag, kind = (int(v) for v in read.take("i", 3))
        count = read.one("u")
        if kind not in NODES:
            raise ValueError(f"element type {kind} is not supported; use order 1 or 2")
        rows = read.take("u", count * (1 + NODES[kind])).reshape(count, -1)
        cells.append(GmshCells(kind, rows[:, 0], rows[:, 1:], physical.get((dimension, tag), ())))
    return cells


def _nodes2(body: bytes, text: bool, order: str) -> tuple[Ints, np.ndarray]:
    first, _, rest = body.lstrip().partition(b"\n")
    count = int(first)
    if text:
        rows = np.array(rest.split(), dtype=np.float64).reshape(-1, 4)
        labels, points = rows[:, 0].astype(np.int64), rows[:, 1:]
    else:
        table = np.frombuffer(rest, dtype=[("n", order + "i4"), ("x", order + "f8", 3)], count=count)
        labels, points = table["n"].astype(np.int64), table["x"].astype(np.float64)
    if len(labels) != count:
        raise ValueError(f"{count} nodes announced, {len(labels)} found")
    return labels, points


def _cells2(body: bytes, text: bool, order: str) -> list[GmshCells]:
    first, _, rest = body.lstrip().partition(b"\n")
    count, at, done = int(first), 0, 0
    numbers = np.array(
        rest.split() if text else np.frombuffer(rest[: len(rest) // 4 * 4], dtype=order + "i4"), dtype=np.int64
    )
    flat = numbers.tolist()
    gathered: dict[tuple[int, int], list[list[int]]] = {}
    while done < count:
        if text:
            kind, tags = flat[at + 1], flat[at + 2]
            head, many = [flat[at]], 1
            at += 3
        else:
            kind, many, tags = flat[at : at + 3]
            head, at = [], at + 3
        if kind not in NODES or tags < 0 or many < 1:
            raise ValueError(f"element type {kind} is not supported; use order 1 or 2")
        width = tags + NODES[kind] + (not text)
        if at + many * width > len(flat):
            raise ValueError(f"{count} elements announced, {done} found")
        for _ in range(many):
            row = head + flat[at : at + width]
            gathered.setdefault((kind, row[1] if tags else 0), []).append([row[0], *row[1 + tags :]])
            at += width
        done += many
    cells = []
    for (kind, tag), rows in gathered.items():
        table = np.array(rows, dtype=np.int64)
        cells.append(GmshCells(kind, table[:, 0], table[:, 1:], (tag,) if tag else ()))
    return cells


