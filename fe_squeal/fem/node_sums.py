"""Sums of element matrices over pairs of nodes: which pairs there are is found once for all entries of a pair."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp


class NodeSums:
    """The pairs of functions that have an element in common, and the sums of what such elements add to each pair.

    Entries of a pair and of the reverse pair are added in the same order, that of the elements, so that the sum of
    symmetric element matrices is symmetric to the last bit.

    Parameters
    ----------
    nodes : (e, j) int
        Numbers of the functions of each element.
    functions : int
    kept : (m,) int or None
        The functions that rows and columns are wanted of, in rising order; None for all.

    Examples
    --------
    >>> two = NodeSums(np.array([[0, 1], [1, 2]]), 3)
    >>> two.scalar(np.array([[[1.0, 2.0], [2.0, 3.0]], [[4.0, 5.0], [5.0, 6.0]]])).toarray()
    array([[1., 2., 0.],
           [2., 7., 5.],
           [0., 5., 6.]])
    """

    def __init__(self, nodes: np.ndarray, functions: int, kept: np.ndarray | None = None) -> None:
        j = nodes.shape[1]
        whole = np.int32 if nodes.size * j <= np.iinfo(np.int32).max else np.int64
        order = np.argsort(nodes.ravel(), kind="stable")
        counts = np.bincount(nodes.ravel(), minlength=functions)
        starts = np.concatenate([[0], np.cumsum(counts) * j]).astype(whole)
        places = (order[:, None] * j + np.arange(j)).ravel().astype(whole)  # where the entry of a pair lies
        columns = nodes[order // j].ravel().astype(np.int32)
        # The conversion to columns and back sorts the columns of each row, and leaves equal ones in their order.
        pairs = sp.csr_array((places, columns, starts), shape=(functions, functions)).tocsc().tocsr()
        rows = np.repeat(np.arange(functions, dtype=np.int32), np.diff(pairs.indptr))
        first = np.ones(len(rows), bool)
        first[1:] = (pairs.indices[1:] != pairs.indices[:-1]) | (rows[1:] != rows[:-1])
        start = np.flatnonzero(first)
        pointers, shape = np.append(start, len(rows)).astype(whole), (len(start), nodes.size * j)
        self._sums = sp.csr_array((np.ones(len(rows)), pairs.data, pointers), shape=shape)
        rows, self._columns, self._size = rows[start], pairs.indices[start], functions
        if kept is not None and len(kept) < functions:
            number = np.full(functions, -1, np.int32)
            number[kept] = np.arange(len(kept), dtype=np.int32)
            rows, self._columns, self._size = number[rows], number[self._columns], len(kept)
            own = (rows >= 0) & (self._columns >= 0)
            self._sums, rows, self._columns = self._sums[np.flatnonzero(own)], rows[own], self._columns[own]
        self._pointers = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=self._size))]).astype(np.int32)

    def scalar(self, blocks: np.ndarray) -> sp.csr_array:
        """Return the (m, m) sum of element matrices (e, j, j)."""
        shape = self._size, self._size
        return sp.csr_array((self._sums @ blocks.ravel(), self._columns, self._pointers), shape=shape)

    def vector(self, blocks: np.ndarray) -> sp.csr_array:
        """Return the (3 m, 3 m) sum of element matrices (e, j, j, 3, 3), the last axes for x, y and z."""
        sums, shape = (self._sums @ blocks.reshape(-1, 9)).reshape(-1, 3, 3), (3 * self._size, 3 * self._size)
        return sp.csr_array(sp.bsr_array((sums, self._columns, self._pointers), shape=shape).tocsr())


def scatter(blocks: np.ndarray, nodes: np.ndarray, functions: int) -> sp.csr_array:
    """Return the (functions, functions) sum of element matrices (e, j, j) at the rows and columns of nodes (e, j)."""
    return NodeSums(nodes, functions).scalar(blocks)
