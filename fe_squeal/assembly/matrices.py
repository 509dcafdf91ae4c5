"""Problems of matrices from files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..eigen.shift_invert import occupied
from ..errors import SceneError
from ..problem.problem import Problem
from ..problem.terms import Slot, Term
from ..scene import MatrixScene
from .matrix_files import measure_symmetry, read_matrix

_SLOTS: dict[str, Slot] = {"mass": "M", "damping": "C", "stiffness": "K"}
_MOST_CONSTRAINTS = 2000  # up to so many are checked for independence, which takes a full matrix of as many rows


def matrix_problem(scene: MatrixScene) -> Problem:
    """Return the sum of a scene's matrices; whether they are symmetric is measured.

    Raises
    ------
    SceneError
        If a file is bad, sizes differ, or a mass matrix is not symmetric.
    """
    terms: list[Term] = []
    n = 0
    for i, section in enumerate(scene.terms):
        try:
            matrix = read_matrix(scene.folder / section.file, section.variable)
        except SceneError as error:
            raise SceneError(f"terms[{i}].file: {error}") from error
        n = n or matrix.shape[0]
        if matrix.shape[0] != n:
            first, m = scene.terms[0].file, matrix.shape[0]
            raise SceneError(
                f"terms[{i}].file: {section.file} has {m} rows, and {first} of terms[0] has {n}; expected one size"
            )
        symmetry = measure_symmetry(matrix)
        if section.role == "mass" and symmetry != "symmetric":
            raise SceneError(f"terms[{i}].file: the mass matrix {section.file} is not symmetric; expected that it is")
        if not section.scale or not matrix.nnz:
            continue
        sign = {"symmetric": 1.0, "skew": -1.0}.get(symmetry)
        if sign is not None:  # rounding in the file would hide the class of the problem
            matrix = sp.csr_array((matrix + sign * matrix.T) / 2)
        name = f"{section.role}.{section.variable or Path(section.file).stem}"
        if any(t.name == name for t in terms):
            name = f"{name}.{i + 1}"
        terms.append(
            Term(
                name, _SLOTS[section.role], matrix * section.scale, symmetry == "symmetric", dict(section.powers),
                skew=symmetry == "skew", imaginary=section.imaginary,
            )
        )  # fmt: skip
    for slot, role in (("M", "mass"), ("K", "stiffness")):
        if not any(t.slot == slot and not t.imaginary for t in terms):
            raise SceneError(f"terms: every {role} matrix is zero; expected one that is not")
    _check_rows(terms)
    _check_mass(terms, scene.parameters)
    return Problem(tuple(terms), dict(scene.parameters))


def _check_mass(terms: list[Term], parameters: Mapping[str, float]) -> None:
    """Refuse negative entries on the diagonal of mass: a motion of that unknown alone would have negative energy."""
    mass = np.sum([t.coefficient(parameters) * t.matrix.diagonal() for t in terms if t.slot == "M"], axis=0)
    negative = np.flatnonzero(mass < 0)
    if len(negative):
        raise SceneError(
            f"terms: the mass matrix has {mass[negative[0]]:.6g} on its diagonal in row {negative[0] + 1}, and negative"
            f" entries there in {len(negative)} rows; expected none, since kinetic energy is not negative"
        )


def _check_rows(terms: list[Term]) -> None:
    """Refuse rows that leave the problem singular for all λ: every number would be an eigenvalue."""
    n = terms[0].matrix.shape[0]
    moving = np.zeros(n, dtype=bool)
    for t in terms:
        if t.slot != "K":
            moving |= occupied(t.matrix)
    stiffness = [t.matrix for t in terms if t.slot == "K"]
    held = np.any([A.diagonal() != 0 for A in stiffness], axis=0)
    rows = np.flatnonzero(~moving & ~held)  # Lagrange multipliers
    if not len(rows):
        return
    B = sp.csr_array(sp.hstack([A[rows] for A in stiffness]))
    size = np.sqrt(np.asarray(B.multiply(B).sum(axis=1)))
    if not size.all():
        row = rows[size == 0][0] + 1
        raise SceneError(f"terms: row {row} is empty in all matrices; expected an entry in every row")
    if len(rows) > _MOST_CONSTRAINTS:
        return
    B = sp.csr_array(sp.diags_array(1 / size) @ B)
    r, order = la.qr((B @ B.T).toarray(), mode="r", pivoting=True)
    dependent = np.abs(r.diagonal()) <= 8 * len(rows) * np.finfo(float).eps
    if dependent.any():
        raise SceneError(
            f"terms: row {rows[order[dependent]].min() + 1} is a constraint that follows from others"
            f" ({np.count_nonzero(dependent)} such); expected constraints that do not depend on each other"
        )


