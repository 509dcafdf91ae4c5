"""The numbers of nodes and elements of a mesh, drawn anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import skfem

QUADRATIC = {skfem.MeshHex1: skfem.MeshHex2, skfem.MeshTet1: skfem.MeshTet2}


def renumbered(mesh, seed):
    """Return a mesh with its corners and elements numbered anew at random; groups keep their elements and facets.

    Returns
    -------
    mesh
    cells : (n_elements,)
        The old number of each element.
    """
    rng = np.random.default_rng(seed)
    kind = type(mesh)
    corners = next((linear for linear, quadratic in QUADRATIC.items() if quadratic is kind), kind)
    nodes, cells = rng.permutation(mesh.nvertices), rng.permutation(mesh.nelements)  # new numbers; old numbers
    points = np.empty((3, mesh.nvertices))
    points[:, nodes] = mesh.doflocs[:, : mesh.nvertices]  # corners come first
    new = corners(points, nodes[mesh.t][:, cells].astype(mesh.t.dtype))
    rows = {tuple(f): i for i, f in enumerate(np.sort(new.facets, axis=0).T.tolist())}
    boundaries = {
        name: np.sort([rows[tuple(f)] for f in np.sort(nodes[mesh.facets[:, facets]], axis=0).T.tolist()]).astype(int)
        for name, facets in (mesh.boundaries or {}).items()
    }
    place = np.argsort(cells)
    volumes = {name: np.sort(place[elements]) for name, elements in (mesh.subdomains or {}).items()}
    if kind is not corners:
        new = kind.from_mesh(new)
        x = new.doflocs.copy()
        x[:, new.dofs.element_dofs] = mesh.doflocs[:, mesh.dofs.element_dofs][:, :, cells]
        new = replace(new, doflocs=x)
    return replace(new, _subdomains=volumes, _boundaries=boundaries), cells
