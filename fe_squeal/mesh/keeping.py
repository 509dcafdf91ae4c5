"""Keep a checked mesh whole in a NumPy archive: read back it is the same, to the bit and in the order of its nodes.

A Gmsh file (`writing.py`) is for other programs, and has neither the numbers of elements in the file that a mesh came
from nor `LoadedMesh.bisection`, without which a refined mesh is refined in another way.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from .elements import MESH_CLASS
from .groups import LoadedMesh, NodeSet

_TEXTS = ("source", "notes", "warnings", "unusable", "ignore_case", "length_unit")
_ARRAYS = ("element_labels", "added", "bisection")


def keep_mesh(loaded: LoadedMesh, path: Path) -> None:
    """Write a mesh with all that is known of it to a file with the suffix .npz.

    Raises
    ------
    OSError
        The file cannot be written.

    Examples
    --------
    >>> import tempfile, skfem
    >>> from .from_python import from_skfem
    >>> block = from_skfem(skfem.MeshTet().with_subdomains({"pad": [0, 1]}), "block")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     keep_mesh(block, Path(folder, "block.npz"))
    ...     again = kept_mesh(Path(folder, "block.npz"))
    >>> again.source, again.mesh.subdomains["pad"].tolist(), bool((again.mesh.p == block.mesh.p).all())
    ('block', [0, 1], True)
    """
    mesh = loaded.mesh
    kind = next(kind for kind, cls in MESH_CLASS.items() if mesh.elem is cls.elem)
    groups: dict[str, dict[str, np.ndarray]] = {
        "volume": {name: np.asarray(elements) for name, elements in (mesh.subdomains or {}).items()},
        "surface": {name: np.asarray(facets) for name, facets in (mesh.boundaries or {}).items()},
        "nodes": {name: group.nodes for name, group in loaded.node_groups.items()},
        "held": {name: group.held for name, group in loaded.node_groups.items()},
        "numbers": {name: np.stack(columns) for name, columns in loaded.node_numbers.items()},
    }
    told = {name: getattr(loaded, name) for name in _TEXTS}
    names = {what: list(found) for what, found in groups.items()}
    arrays = {f"{what}_{i}": part for what, found in groups.items() for i, part in enumerate(found.values())}
    arrays |= {name: np.asarray(getattr(loaded, name)) for name in _ARRAYS}
    text = json.dumps({"kind": kind, "told": told, "names": names})
    with path.open("wb") as file:
        np.savez(file, text=np.array(text), points=mesh.doflocs, elements=mesh.t, **arrays)  # type: ignore[arg-type]


def kept_mesh(path: Path) -> LoadedMesh:
    """Return a mesh that `keep_mesh` has written.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is no such file.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            found: dict[str, Any] = dict(file)
        text = json.loads(str(found["text"]))
        groups = {
            what: {name: found[f"{what}_{i}"] for i, name in enumerate(names)} for what, names in text["names"].items()
        }
        mesh = MESH_CLASS[text["kind"]](
            found["points"], found["elements"], _subdomains=groups["volume"], _boundaries=groups["surface"]
        )
        told: dict[str, Any] = {
            key: tuple(part) if isinstance(part, list) else part for key, part in text["told"].items()
        }
        return LoadedMesh(
            mesh, **told, **{name: found[name] for name in _ARRAYS},
            node_groups={name: NodeSet(nodes, groups["held"][name]) for name, nodes in groups["nodes"].items()},
            node_numbers={name: (rows[0], rows[1]) for name, rows in groups["numbers"].items()},
        )  # fmt: skip
    except (KeyError, TypeError, AttributeError, IndexError) as error:
        raise ValueError(f"{path}: holds no mesh") from error
