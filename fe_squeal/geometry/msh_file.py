"""Write a structured mesh as a gmsh MSH 4.1 text file, without gmsh."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

from fe_squeal.geometry.grouped import GMSH_TYPE, GroupedMesh, owned_nodes

_END = b"$EndMeshFormat\n"


def write_msh(mesh: GroupedMesh, path: Path) -> None:
    """Write a mesh: every group is an entity with one physical group of the same tag, volumes first.

    Coordinates are written with the fewest digits that give the same double when read.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    path.write_text("".join(f"{line}\n" for line in _lines(mesh)), encoding="ascii", newline="\n")
    mark_as_ours(path)


def _lines(mesh: GroupedMesh) -> Iterator[str]:
    tags = {name: tag for tag, name in enumerate([*mesh.volumes, *mesh.surfaces], start=1)}
    yield from ("$MeshFormat", "4.1 0 8", "$EndMeshFormat")

    yield from ("$PhysicalNames", str(len(tags)))
    yield from (f'2 {tags[name]} "{name}"' for name in mesh.surfaces)
    yield from (f'3 {tags[name]} "{name}"' for name in mesh.volumes)
    yield "$EndPhysicalNames"

    # The line of an entity: tag, bounding box, number and tag of its physical groups, number of its bounding entities
    # (0).
    yield from ("$Entities", f"0 0 {len(mesh.surfaces)} {len(mesh.volumes)}")
    for name, cells in [*mesh.surfaces.items(), *mesh.volumes.items()]:
        corners = mesh.points[cells.ravel()]
        box = " ".join(repr(float(x)) for x in [*corners.min(axis=0), *corners.max(axis=0)])
        yield f"{tags[name]} {box} 1 {tags[name]} 0"
    yield "$EndEntities"

    yield "$Nodes"
    n = len(mesh.points)
    yield f"{len(mesh.volumes)} {n} 1 {n}"
    for name, nodes in owned_nodes(mesh).items():
        yield f"3 {tags[name]} 0 {len(nodes)}"
        yield from (str(node + 1) for node in nodes)
        yield from (" ".join(repr(float(x)) for x in point) for point in mesh.points[nodes])
    yield "$EndNodes"

    groups = [(2, name, cells) for name, cells in mesh.surfaces.items()]
    groups += [(3, name, cells) for name, cells in mesh.volumes.items()]
    n = sum(len(cells) for _, _, cells in groups)
    yield from ("$Elements", f"{len(groups)} {n} 1 {n}")
    element = 0
    for dimension, name, cells in groups:
        yield f"{dimension} {tags[name]} {GMSH_TYPE[dimension, cells.shape[1]]} {len(cells)}"
        for nodes in cells:
            element += 1
            yield f"{element} " + " ".join(str(node + 1) for node in nodes)
    yield "$EndElements"


def mark_as_ours(path: Path) -> None:
    """Put a comment with a check sum behind the header, by which `is_ours` knows files that this package wrote.

    The check sum shows whether the file was edited since: gmsh keeps the comment when it saves a mesh that somebody
    changed. Readers ignore the comment.
    """
    data = path.read_bytes().replace(b"\r\n", b"\n")
    header, end, rest = data.partition(_END)
    path.write_bytes(header + end + _comment(data) + rest)


def is_ours(path: Path) -> bool:
    """Return whether a file is a mesh that this package wrote and that nobody has changed since."""
    data = path.read_bytes().replace(b"\r\n", b"\n")
    header, end, rest = data.partition(_END)
    comment, closing, rest = rest.partition(b"$EndComments\n")
    return comment + closing == _comment(header + end + rest)


def _comment(data: bytes) -> bytes:
    return f"$Comments\nmade by fe-squeal, {hashlib.sha256(data).hexdigest()}\n$EndComments\n".encode()
