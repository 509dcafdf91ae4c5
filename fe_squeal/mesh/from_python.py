"""Check a scikit-fem mesh that was made in Python, to be used instead of a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import skfem

from fe_squeal.errors import MeshError

from .checking import check_cells, check_points, jacobian_range, orient_cells
from .elements import MESH_CLASS, REFERENCE, matching
from .groups import LoadedMesh
from .raw import CellBlock, Ints, RawMesh


def from_skfem(mesh: skfem.Mesh, source: str = "<python>") -> LoadedMesh:
    """Check a mesh built in Python, to be used instead of a scene's own: `assemble(scene, from_skfem(mesh))`.

    Parameters
    ----------
    mesh : skfem.Mesh
        MeshTet1, MeshTet2, MeshHex1 or MeshHex2, coordinates in metres. Its `subdomains` are the volume groups and its
        `boundaries` the surface groups.
    source : str
        What messages call the mesh.

    Returns
    -------
    LoadedMesh

    Raises
    ------
    MeshError
        The mesh is of another class, nodes belong to no element, groups hold indices that do not exist, coordinates are
        not finite, or elements are flat, broken or listed twice. Left-handed elements are accepted, as in scikit-fem.

    Examples
    --------
    >>> block = skfem.MeshHex().with_subdomains({"pad": [0]}).with_boundaries({"face": lambda x: x[2] == 0.0})
    >>> from_skfem(block).mesh.boundaries["face"].shape
    (1,)
    """
    kind = next((kind for kind, cls in MESH_CLASS.items() if isinstance(mesh, cls) and mesh.elem is cls.elem), None)
    if kind is None:
        raise MeshError(
            f"{source}: {type(mesh).__name__} is not supported; expected one of "
            + ", ".join(cls.__name__ for cls in MESH_CLASS.values())
        )
    local = mesh.dofs.element_dofs if len(REFERENCE[kind]) > mesh.t.shape[0] else mesh.t
    nodes = local.T[:, matching(REFERENCE[kind], np.asarray(mesh.elem.doflocs))].astype(np.int64)
    block = CellBlock(kind, nodes, np.arange(len(nodes)))
    groups = _checked_groups(mesh.subdomains, mesh.nelements, "subdomain", source)
    surfaces = _checked_groups(mesh.boundaries, mesh.nfacets, "boundary", source)
    raw = RawMesh(mesh.doflocs.T, np.arange(mesh.doflocs.shape[1]), (block,), groups, {})
    loose = np.setdiff1d(raw.node_labels, nodes)
    if len(loose):
        raise MeshError(f"{source}: {len(loose)} nodes belong to no element, the first is {loose[0]}; expected none")
    check_points(raw, source)
    check_cells(raw, source)
    left = jacobian_range(kind, raw.points, nodes)[1] < 0
    warnings: list[str] = []
    for which in (left, ~left):
        # scikit-fem allows left-handed cells, and `orient_cells` expects one handedness: both are checked in turn.
        if which.any():
            cells = replace(block, nodes=nodes[which], labels=block.labels[which])
            warnings += orient_cells(replace(raw, blocks=(cells,), volume_groups={}), source)[1]
    mesh = replace(mesh, _subdomains=groups, _boundaries=surfaces)
    return LoadedMesh(mesh, source, (), tuple(warnings), block.labels.astype(str))


def _checked_groups(groups: Mapping[str, Ints] | None, count: int, what: str, source: str) -> dict[str, Ints]:
    """Return groups with sorted indices below `count`, or raise MeshError; `what` names their kind in the message."""
    checked = {}
    for name, members in (groups or {}).items():
        index = np.unique(np.asarray(members))
        if index.dtype.kind not in "iu" or (len(index) and (index[0] < 0 or index[-1] >= count)):
            raise MeshError(f'{source}: {what} "{name}" must hold indices from 0 to {count - 1}')
        checked[str(name)] = index.astype(np.int64)
    return checked
