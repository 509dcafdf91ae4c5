"""Helpers of the tests of hard cases: SciPy's `eigs` with defaults, correct digits, problems passed through files."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from matrix_scenes import write_scene
from scipy.sparse.linalg import ArpackError, eigs

from fe_squeal import assemble, load_scene
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.problem.forms import collect_powers
from fe_squeal.problem.problem import Problem
from meshes import STEEL, box, join, make_problem

DOUBLE = 15.0  # digits of a double, the most that a result can have


def digits(found: np.ndarray, exact: np.ndarray, size: float | np.ndarray | None = None) -> float:
    """Return the number of correct digits of the worst of the values found; 0 if one is missing.

    Parameters
    ----------
    found, exact : (k,) complex
    size : float, optional
        What errors are relative to (default: the exact value itself).
    """
    found, exact = np.atleast_1d(found), np.atleast_1d(exact)
    if not len(found):
        return 0.0
    away = np.abs(found[:, None] - exact[None, :]).min(axis=0) / (np.abs(exact) if size is None else size)
    return float(np.clip(-np.log10(np.maximum(away.max(), 1e-300)), 0.0, DOUBLE))


def plain_eigs(pencil: Pencil, count: int) -> np.ndarray | str:
    """Return the λ with Im λ ≥ 0 that `scipy.sparse.linalg.eigs` with sigma = 0 gives, or its error message.

    Without damping it solves K φ = θ M φ, otherwise the linearisation [[0, I], [−K, −C]] z = λ [[I, 0], [0, M]] z.
    """
    M, K, n = pencil.M, pencil.K, pencil.n
    try:
        if pencil.C is None:
            theta = eigs(sp.csc_array(K), count, sp.csc_array(M), sigma=0.0, v0=np.ones(n), return_eigenvectors=False)
            lam = 1j * np.sqrt(theta.astype(complex))
            return np.concatenate([lam, -lam.conj()])
        one = sp.eye_array(n)
        A, B = sp.block_array([[None, one], [-K, -pencil.C]]), sp.block_diag([one, M])
        lam = eigs(sp.csc_array(A), 2 * count, sp.csc_array(B), sigma=0.0, v0=np.ones(2 * n), return_eigenvectors=False)
        return lam[lam.imag >= 0]
    except (RuntimeError, ArpackError) as error:
        return f"error: {str(error).splitlines()[0]}"


def judged(found: np.ndarray | str, exact: np.ndarray, size: float | None = None) -> tuple[float, float, str]:
    """Return the digits of the result of `plain_eigs`, its |Re λ|/|λ| if all exact Re λ are zero, and its error."""
    if isinstance(found, str):
        return 0.0, 0.0, found
    drift = np.abs(found.real).max(initial=0.0) / max(np.abs(found).max(initial=0.0), 1e-300)
    return digits(found, exact, size), 0.0 if np.any(exact.real) else drift, ""


def through_files(problem: Problem, folder, parameter: str = "mu", name: str = "mu") -> Problem:
    """Return a problem over one parameter, written as matrices with powers of the parameter `name` and read again."""
    terms = []
    for t in collect_powers(problem, parameter).terms:
        role = {"M": "mass", "C": "damping", "K": "stiffness"}[t.slot]
        lines = [f"powers = {{ {name} = {e} }}" for e in t.powers.values() if e]
        terms.append((role, t.matrix, *lines, *(["imaginary = true"] if t.imaginary else [])))
    path = write_scene(folder, terms, {name: problem.value(parameter)}, suffixes=(".npz",))
    return assemble(load_scene(path))


def matrices(folder, terms: list, **parameters: float) -> Problem:
    """Return the problem of terms (role, matrix, further lines), written as a scene of matrices and read again."""
    return assemble(load_scene(write_scene(folder, terms, parameters, suffixes=(".npz",))))


LINING = {"youngs_modulus": 5e9, "poisson_ratio": 0.25, "density": 2500.0}
SMALL, MIDDLE = ((3, 2, 1), (2, 1, 1)), ((4, 3, 2), (3, 2, 1))  # cells of belt and pad: 345 and 1071 unknowns


def brake(counts=MIDDLE, kind="hex2", springs=("x", "y", "z"), k_n=2e11, mu=0.8, change=None, **more) -> Problem:
    """Return a pad of lining, held by springs, on a steel belt that is held at its bottom.

    Parameters
    ----------
    springs : sequence of "x", "y", "z", or of tables of a scene
    change : callable of a mesh, optional
        Is applied to the mesh of both bodies.
    more
        Further tables of the scene.
    """
    belt = box(kind, counts[0], (0.12, 0.1, 0.03), (-0.06, -0.05, -0.03), name="belt")
    pad = box(kind, counts[1], (0.06, 0.04, 0.02), (-0.02, -0.025, 0.0), name="pad")
    mesh = join(belt, pad)
    on = {"x": ("left_pad", 4e8), "y": ("back_pad", 1e8), "z": ("top_pad", 2e8)}
    contact = {
        "name": "belt", "surface": "bottom_pad", "counterface": "top_belt", "normal_stiffness": k_n,
        "sliding": {"direction": [1.0, 0.2, 0.0], "speed": 2.0},
    }  # fmt: skip
    effects = {"friction": {"mu": mu}, **more.pop("effects", {})}
    tables = {
        "materials": {"steel": STEEL, "lining": LINING},
        "bodies": {"belt": {"material": "steel"}, "pad": {"material": "lining"}},
        "supports": [{"surface": "bottom_belt", "fixed": "xyz"}],
        "springs": [
            axis if isinstance(axis, dict) else
            {"name": axis, "surface": on[axis][0], "direction": list(np.eye(3)["xyz".index(axis)]),
             "stiffness": on[axis][1]}
            for axis in springs
        ],
        "contacts": [{**contact, **more.pop("contact", {})}],
    }  # fmt: skip
    return make_problem(mesh if change is None else change(mesh), effects=effects, **{**tables, **more})
