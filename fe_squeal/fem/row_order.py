"""The order in which unknowns are dealt out to processes under mpiexec."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
import skfem
from scipy.sparse.csgraph import reverse_cuthill_mckee


def unknowns_along_bodies(mesh: skfem.Mesh, functions: Sequence[np.ndarray], prolongation: sp.csr_array) -> np.ndarray:
    """Return all unknowns (n,) in an order in which those that act on each other are near to each other.

    The elements are in reverse Cuthill-McKee order, in which neighbours are near; each unknown comes with the first of
    its elements.

    Parameters
    ----------
    functions : sequence of (j, elements) int
        Shape functions of each element: of its nodes, and of bubbles where there are any.
    prolongation : (3 functions, n) sparse
        Amplitudes of the shape functions from the unknowns.
    """
    count, scalars = mesh.nelements, prolongation.shape[0] // 3
    one, other = mesh.f2t[:, mesh.f2t[1] >= 0]
    graph = sp.csr_array((np.ones(len(one)), (one, other)), shape=(count, count))
    rank, first = np.empty(count, int), np.full(scalars, count)
    rank[reverse_cuthill_mckee(sp.csr_array(graph + graph.T), symmetric_mode=True)] = np.arange(count)
    for some in functions:
        np.minimum.at(first, some, np.broadcast_to(rank, some.shape))
    P = sp.csc_array(prolongation)
    filled, of_unknown = np.flatnonzero(np.diff(P.indptr)), np.full(P.shape[1], count)
    of_unknown[filled] = np.minimum.reduceat(first[P.indices // 3], P.indptr[filled])
    return np.argsort(of_unknown, kind="stable")
