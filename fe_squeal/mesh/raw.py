"""The mesh as a file gives it: points, cells in VTK order, named groups; before any check or conversion."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fe_squeal.errors import MeshError

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CellBlock:
    """Volume cells of one kind.

    Attributes
    ----------
    kind : str
        meshio's name of the cell type, a key of `elements.REFERENCE`.
    nodes : (n, k) int
        Rows of `RawMesh.points`, in VTK's order; -1 for a midside node that the file leaves out.
    labels : (n,) int
        The file's own element numbers.
    prefix : str
        What stands before the number in messages, such as "PAD-1." for an Abaqus instance.
    """

    kind: str
    nodes: Ints
    labels: Ints
    prefix: str = ""

    def __len__(self) -> int:
        return len(self.nodes)


@dataclass(frozen=True)
class RawMesh:
    """What a reader returns: the mesh as its file has it, before any check.

    Attributes
    ----------
    points : (n, 3) float
        Coordinates of the nodes, in the file's unit of length.
    node_labels : (n,) int
        The file's own node numbers.
    blocks : tuple of CellBlock
        The volume cells. Groups number them through all blocks, in this order.
    volume_groups : mapping of str to (m,) int
        Cell indices by group name.
    surfaces : mapping of str to list of (m, 3) or (m, 4) int
        By group name, the corner nodes (rows of `points`) of its triangles and quadrilaterals, in any number of arrays.
    node_groups : mapping of str to (m,) int
        Rows of `points` by group name. They are node sets, and surface groups too where they cover whole faces of the
        boundary.
    unusable : mapping of str to str
        Names in the file that give no group, with the reason.
    length_unit : str
        What the file says of the unit of its coordinates, such as "mm"; "" where it says nothing.
    held_nodes : mapping of str to (m,) int
        By name of a node set, `NodeSet.held` where the file gives it.
    """

    points: Floats
    node_labels: Ints
    blocks: tuple[CellBlock, ...]
    volume_groups: dict[str, Ints]
    surfaces: dict[str, list[Ints]]
    node_groups: dict[str, Ints] = field(default_factory=dict)
    unusable: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    node_prefixes: tuple[tuple[int, str], ...] = ((0, ""),)
    ignore_case: bool = False
    length_unit: str = ""
    held_nodes: dict[str, Ints] = field(default_factory=dict)

    def node_name(self, row: int) -> str:
        """Return the number of a node, by its row in `points`, as the file has it, with its instance in front."""
        prefix = [text for first, text in self.node_prefixes if first <= row][-1]
        return f"{prefix}{self.node_labels[row]}"


def element_names(blocks: tuple[CellBlock, ...]) -> NDArray[np.str_]:
    """Return the names (n,) str of all cells, "12" or "PAD-1.12", for all blocks one after the other."""
    if not blocks:
        return np.empty(0, dtype=str)
    return np.concatenate([np.char.add(block.prefix, block.labels.astype(str)) for block in blocks])


def listed(names: list[str] | NDArray[np.str_], limit: int = 5) -> str:
    """Return the first few different names, and how many more there are, for a message.

    Examples
    --------
    >>> listed([str(i) for i in range(1, 9)])
    '1, 2, 3, 4, 5 and 3 more'
    """
    once = list(dict.fromkeys(str(name) for name in names))
    return ", ".join(once[:limit]) + (f" and {len(once) - limit} more" if len(once) > limit else "")


def rows_of(wanted: Ints, labels: Ints) -> Ints:
    """Return the position (n,) of each of `wanted` (n,) in `labels` (m,), -1 where it is not there.

    Examples
    --------
    >>> rows_of(np.array([7, 5, 9]), np.array([5, 6, 7]))
    array([ 2,  0, -1])
    """
    return Rows(labels)(wanted)


class Rows:
    """Finds the positions of numbers in `labels` (m,), which are sorted once for any number of calls.

    Examples
    --------
    >>> find = Rows(np.array([5, 6, 7]))
    >>> find(np.array([7, 5, 9])), find(np.array([[6]]))
    (array([ 2,  0, -1]), array([[1]]))
    """

    def __init__(self, labels: Ints) -> None:
        self._order = np.argsort(labels, kind="stable")
        self._sorted = np.asarray(labels, dtype=np.int64)[self._order]

    def __call__(self, wanted: Ints) -> Ints:
        """Return the position of each of `wanted`, an array of its shape, -1 where it is not there."""
        wanted = np.asarray(wanted, dtype=np.int64)
        if len(self._sorted) == 0:
            return np.full(wanted.shape, -1)
        place = np.minimum(np.searchsorted(self._sorted, wanted), len(self._sorted) - 1)
        return np.where(self._sorted[place] == wanted, self._order[place], -1)


def check_unique_nodes(labels: Ints, points: Floats, source: str) -> tuple[Ints, Floats]:
    """Return the numbers (n,) and coordinates (n, 3) of nodes, those written twice at the same place only once.

    Raises
    ------
    MeshError
        A node number is written twice with different coordinates.
    """
    unique, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    if len(unique) == len(labels):
        return labels, points
    apart = np.any(points != points[first][inverse], axis=1)
    if apart.any():
        names = np.unique(labels[apart]).astype(str)
        raise MeshError(
            f"{source}: node number {listed(names)} is defined more than once at different places; "
            "give every node its own number"
        )
    keep = np.sort(first)
    return labels[keep], points[keep]
