"""Elastic bodies on several processes under mpiexec: each sums the rows of its unknowns, from the elements there."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..eigen.columns import are_spread
from ..eigen.linear.matrix_parts import SpreadRows, keep_rows, own_unknowns
from ..eigen.linear.processes import new_handle, together
from ..eigen.linear.spread_matrix import Part, Partition, SpreadMatrix
from ..process.ranks import process_count
from .element_matrices import assemble_elasticity, sum_elements, sum_mass
from .spaces import DisplacementSpace

_SUMS: dict[str, Callable[..., Any]] = {"sum_elements": sum_elements, "sum_mass": sum_mass}
_space: DisplacementSpace | None = None  # the last one that all processes know, on each of them
_known: weakref.ref[Partition] | None = None  # its partition, on process 0


def elastic_matrices(
    space: DisplacementSpace, elements: np.ndarray, stiffness: np.ndarray, density: float, lame: float = 0.0
) -> tuple[sp.csr_array, sp.csr_array]:
    """Return what `assemble_elasticity` does of elements (e,), with the rows on all processes where there are several.

    Small problems are not spread. Other threads than the main one get matrices of this process, since the processes do
    one thing at a time.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or not are_spread(space.unknowns, process_count()):
        return assemble_elasticity(space, elements, stiffness, density, lame)
    return spread_elasticity(space, elements, stiffness, density, lame)


def spread_elasticity(
    space: DisplacementSpace, elements: np.ndarray, stiffness: np.ndarray, density: float, lame: float = 0.0
) -> tuple[SpreadMatrix, SpreadMatrix]:
    """Return what `assemble_elasticity` does of elements (e,), with the rows on all processes."""
    K, M = _on_all(space, "sum_elements", 2, elements, stiffness, density, lame)
    return K, M


def spread_mass(space: DisplacementSpace, elements: np.ndarray, components: np.ndarray) -> SpreadMatrix:
    """Return what `sum_mass` does of elements (e,) for a symmetric A (3, 3), with the rows on all processes."""
    (M,) = _on_all(space, "sum_mass", 1, elements, components)
    return M


def _on_all(space: DisplacementSpace, summing: str, count: int, *given: object) -> list[SpreadMatrix]:
    """Return what a function of `element_matrices` sums of elements, symmetric matrices with rows on all processes."""
    global _known
    partition = space.partition
    if _known is None or _known() is not partition:
        together("call", space, function=f"{__name__}:know")
        _known = weakref.ref(partition)
    handles = [new_handle() for _ in range(count)]
    told = together(
        "call", None, function=f"{__name__}:assemble_rows", summing=summing, partition=partition.handle,
        handles=handles, given=given,
    )  # fmt: skip
    return [SpreadMatrix([(1.0, Part(partition, h, t))]) for h, t in zip(handles, told, strict=True)]


def know(comm: Any, what: dict[str, Any], space: DisplacementSpace | None) -> None:
    """Let every process know the space that process 0 has."""
    global _space
    sent = None if space is None else replace(space)  # without what it keeps, which each process makes of its own
    _space = space if comm is None else comm.bcast(sent, root=0)
    if space is not None:
        _space = space


def assemble_rows(comm: Any, what: dict[str, Any], data: None) -> list[SpreadRows] | None:
    """Sum this process's rows of the matrices of some elements, and keep them."""
    space, own = _space, own_unknowns(what["partition"])
    assert space is not None
    elements, *given = what["given"]
    found = _SUMS[what["summing"]](space, elements[_touching(space, elements, own)], *given)
    matrices = found if isinstance(found, tuple) else (found,)
    return keep_rows(comm, what["handles"], [_symmetrised_rows(A, own) for A in matrices])


def _touching(space: DisplacementSpace, elements: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Return which of some elements (e,) act on some unknowns, bool."""
    acting = np.diff(space.prolongation[:, own].indptr).reshape(-1, 3).any(axis=1)  # (functions,)
    found: np.ndarray = acting[space.dofs.element_dofs[:, elements]].any(axis=0)
    if space.bubbles is not None:
        found |= acting[space.nodes + space.bubbles.functions_of(space.mesh, elements)].any(axis=0)
    return found


def _symmetrised_rows(A: sp.csr_array, own: np.ndarray) -> sp.csr_array:
    """Return some rows of (A + Aᵀ)/2: rounding leaves an asymmetry that would hide what a matrix is."""
    rows = sp.csr_array(A[own] + sp.csr_array(A[:, own].T))
    rows.data /= 2
    return rows
