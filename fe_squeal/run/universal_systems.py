"""Coordinate systems of universal files (data set 2420): where nodes are, and along what their displacements are.

Format: Universal Dataset Number 2420 of the Structural Dynamics Research Laboratory, University of Cincinnati,
https://www.ceas3.uc.edu/sdrluff, as it stands in `pyuff.datasets.dataset_2420`. It does not say how the matrix of four
rows is meant, and in what units angles are; taken as in SDynPy (Sandia National Laboratories, sdynpy_geometry.py,
`global_coord` and `global_deflection`): global = local @ rows 1 to 3 + row 4, angles in degrees, and of a spherical
system radius, polar angle and angle about the axis. Points of data set 2411 are in the system that stands beside them,
as in SDynPy, like those of 15; by the words of 2411 it is one of export, so a note says where this moves points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..mesh.readers.nastran.coordinates import System, axes_at, to_global

_KINDS = {0: "R", 1: "C", 2: "S"}
_NAMES = {"R": "Cartesian", "C": "cylindrical", "S": "spherical"}
_ROUNDING = 1e-4  # of direction cosines that were written with few digits


@dataclass(frozen=True)
class Node:
    """A node as it is written: its coordinates (3,), and the numbers of the systems that belong to it.

    Attributes
    ----------
    written : (3,) float
    definition, displacement : int
        The system of its coordinates, and that of its displacements.
    """

    written: np.ndarray
    definition: int
    displacement: int


def read_nodes(sets: Sequence[dict[str, Any]]) -> dict[int, Node]:
    """Return the nodes of the data sets 2411 and 15 by their numbers."""
    names = ("node_nums", "x", "y", "z", "def_cs", "disp_cs")
    return {
        int(node): Node(np.array([x, y, z], dtype=float), int(definition), int(displacement))
        for s in sets
        if s.get("type") in (15, 2411)
        for node, x, y, z, definition, displacement in zip(*(s[name] for name in names), strict=True)
    }


def place_nodes(nodes: Sequence[Node], sets: Sequence[dict[str, Any]]) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return points (p, 3), the directions (p, 3, 3) of their displacements as rows, both global, and notes.

    System 0 is the global one, and so is 1 where the file defines none of that number, as programs write it.

    Raises
    ------
    ValueError
        A node names a system that the file does not define, or the matrix of a system is no rotation.
    """
    systems = {n: system for s in sets if s.get("type") == 2420 for n, system in _systems(s)}
    older = {int(n) for s in sets if s.get("type") == 18 for n in s["cs_num"]}
    is_global = {0} | ({1} - systems.keys() - older)
    named = sorted({n for node in nodes for n in (node.definition, node.displacement)})
    for number in named:
        if number not in is_global | systems.keys():
            raise ValueError(f"nodes in coordinate system {number}, which no data set 2420 defines")
    notes = ["coordinate system 1, which the file does not define, is taken as the file's axes"] * (
        1 in named and 1 in is_global
    )
    defined = np.array([0 if node.definition in is_global else node.definition for node in nodes])
    points = np.array([node.written for node in nodes])
    for number in np.unique(defined[defined != 0]):
        own = defined == number
        points[own] = to_global(points[own], int(number), systems)
        kind = _NAMES[systems[number].kind]
        notes.append(f"{np.count_nonzero(own)} points are given in the {kind} coordinate system {number} of the file")
    along = [0 if node.displacement in is_global else node.displacement for node in nodes]
    axes = np.array([axes_at(point, number, systems) for point, number in zip(points, along, strict=True)])
    return points, axes, notes


def _systems(s: dict[str, Any]) -> list[tuple[int, System]]:
    found, columns = [], [s[name] for name in ("CS_sys_labels", "CS_types", "CS_matrices")]
    if len({len(column) for column in columns}) > 1:
        raise ValueError("a data set 2420 that is not whole; save it again")
    for number, kind, rows in zip(*columns, strict=True):
        rows = np.asarray(rows, dtype=float)
        if kind not in _KINDS:
            raise ValueError(f"coordinate system {number} of type {kind}; expected 0, 1 or 2")
        turned = rows.shape == (4, 3) and np.allclose(rows[:3] @ rows[:3].T, np.eye(3), rtol=0, atol=_ROUNDING)
        if not turned or np.linalg.det(rows[:3]) < 0:
            raise ValueError(f"coordinate system {number}, whose matrix is no rotation")
        x, _, z, origin = rows
        found.append((int(number), System(_KINDS[kind], 0, np.array([origin, origin + z, origin + x]))))
    return found
