"""A digest of a mesh as it was read: of two files with the same digest the results are the same."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

import numpy as np

from .groups import LoadedMesh


def mesh_digest(loaded: LoadedMesh) -> str:
    """Return a digest, in hexadecimal digits, of points, elements, groups and numbers of nodes.

    What a file includes counts, and how it is written does not.
    """
    digest = hashlib.sha256(type(loaded.mesh).__name__.encode())
    for name, part in _parts(loaded):
        digest.update(repr((name, np.shape(part))).encode())
        digest.update(np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()


def _parts(loaded: LoadedMesh) -> Iterator[tuple[str, np.ndarray]]:
    mesh = loaded.mesh
    yield "points", mesh.doflocs
    yield "elements", mesh.t
    for name, elements in sorted((mesh.subdomains or {}).items()):
        yield f"body {name}", np.asarray(elements)
    for name, facets in sorted((mesh.boundaries or {}).items()):
        yield f"surface {name}", np.asarray(facets)
    for name, group in sorted(loaded.node_groups.items()):
        yield f"nodes {name}", group.nodes
        yield f"held {name}", group.held
    # A set of nodes may be given by their numbers in the file: `nodes = "8"`.
    for instance, (numbers, columns) in sorted(loaded.node_numbers.items()):
        yield f"numbers {instance}", np.stack([numbers, columns])
