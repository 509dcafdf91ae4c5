"""Problems of matrices from files."""

from __future__ import annotations

from pathlib import Path

import scipy.sparse as sp

from .errors import SceneError
from .matrix_files import measure_symmetry, read_matrix
from .problem import Problem
from .scene import MatrixScene
from .terms import Slot, Term

_SLOTS: dict[str, Slot] = {"mass": "M", "damping": "C", "stiffness": "K"}


def matrix_problem(scene: MatrixScene) -> Problem:
    """Return the sum of a scene's matrices; whether they are symmetric is measured.

    Raises
    ------
    SceneError
        If a file is bad, sizes differ, or a mass matrix is not symmetric.
    """
    terms: list[Term] = []
    for i, section in enumerate(scene.terms):
        try:
            matrix = read_matrix(scene.folder / section.file, section.variable)
        except SceneError as error:
            raise SceneError(f"terms[{i}].file: {error}") from error
        if terms and matrix.shape != terms[0].matrix.shape:
            first, n, m = scene.terms[0].file, terms[0].matrix.shape[0], matrix.shape[0]
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
    return Problem(tuple(terms), dict(scene.parameters))


