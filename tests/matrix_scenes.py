"""Scenes of matrices in files, and their exact eigenvalues.

The model `sites` has closed forms. It consists of n sites of unit mass, each with the stiffness SITE + μ PULL in (x,
y), joined to each other, and at both ends to the ground, by links of stiffness GLUE. With κ_j = 4 GLUE sin²(jπ/2(n+1))
its θ = −λ² are κ_j + 20 ± √(25 − 10Bμ), so that every pair meets at μ = 1/√3. For sparse solvers, CROWD independent
oscillators with θ = 100, 101, ... are added.
"""

from __future__ import annotations

import gzip
import io
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

from fe_squeal import assemble, load_scene
from fe_squeal import sweep as solve_sweep
from fe_squeal.eigen.dense import DENSE_LIMIT

B = 5 * np.sqrt(3) / 2
SITE, PULL = np.array([[22.5, -B], [-B, 17.5]]), np.array([[0.0, 10.0], [0.0, 0.0]])
GLUE, ALPHA, ETA = 0.5, 0.02, 0.01
CROWD = 420
KINDS = ["undamped", "dashpots", "structural"]
SUFFIXES = (".mtx", ".npz", ".npy", ".mat", ".mtx.gz")


def write_matrix(path: Path, A: np.ndarray | sp.sparray) -> None:
    dense = A.toarray() if sp.issparse(A) else np.asarray(A, float)
    if ".mtx" in path.name:
        stream = io.BytesIO()
        scipy.io.mmwrite(stream, sp.coo_array(A), precision=17)
        path.write_bytes(gzip.compress(stream.getvalue()) if path.name.endswith(".gz") else stream.getvalue())
    elif path.suffix == ".npz":
        sp.save_npz(path, sp.csc_array(A))
    elif path.suffix == ".npy":
        np.save(path, dense)
    else:
        scipy.io.savemat(path, {"A": sp.csc_array(A), "other": dense[:1, :1], "note": "exported"})


def write_scene(folder: Path, terms: list, parameters: dict[str, float], tail: str = "", suffixes=SUFFIXES) -> Path:
    """Write terms (role, matrix, further lines) into files of mixed formats, and the scene of them."""
    text = "".join(["[parameters]\n", *(f"{name} = {float(value)!r}\n" for name, value in parameters.items())])
    for i, (role, matrix, *lines) in enumerate(terms):
        name = f"{role}_{i}{suffixes[i % len(suffixes)]}"
        write_matrix(folder / name, matrix)
        lines += ['variable = "A"'] if name.endswith(".mat") else []
        text += "\n".join(["[[terms]]", f'role = "{role}"', f'file = "{name}"', *lines, ""])
    (folder / "scene.toml").write_text(text + tail)
    return folder / "scene.toml"


def sweep_text(parameter: str, start: float, stop: float, points: int, modes: int = 20) -> str:
    text = f'[sweep]\nparameter = "{parameter}"\nfrom = {float(start)!r}\nto = {float(stop)!r}\npoints = {points}\n'
    return f"{text}[solve]\nmodes = {modes}\n"


def run(folder, terms, parameters, *sweep, suffixes=SUFFIXES):
    scene = load_scene(write_scene(folder, terms, parameters, sweep_text(*sweep), suffixes))
    return solve_sweep(assemble(scene), scene.sweep.grid, scene.sweep.parameter, modes=scene.solve.modes)


def upper(lam: np.ndarray) -> np.ndarray:
    """Return those of all eigenvalues that the program reports, in its order."""
    lam = np.where(np.abs(lam) * 1e-13 < np.abs(lam.imag), lam, lam.real)
    lam = lam[lam.imag >= 0]
    return lam[np.lexsort((-lam.real.round(9), lam.imag.round(9)))]


def assert_near(point, exact: np.ndarray, rel: float) -> None:
    """Assert that every eigenvalue found is an exact one, and that none below the highest found is missing."""
    exact, found = upper(exact), point.modes.lam
    size = np.maximum(np.abs(found), 1e-3 * np.abs(found).max())
    assert (np.abs(found[:, None] - exact[None, :]).min(axis=1) <= rel * size).all()
    below = exact[exact.imag <= found.imag.max() * (1 - 1e-6)]
    assert (np.abs(below[:, None] - found[None, :]).min(axis=1) <= rel * np.maximum(np.abs(below), size.min())).all()


def sites(n: int, springs: int = 1, crowd: int = 0) -> tuple[sp.csr_array, ...]:
    """Return M, K and the friction matrix; a link consists of `springs` in series, with massless nodes between them."""
    count = (n + 1) * springs - 1
    on = sp.diags_array((np.arange(1, count + 1) % springs == 0).astype(float))
    k = springs * GLUE * np.ones(count)
    K = sp.kron(sp.diags_array([2 * k, -k[1:], -k[1:]], offsets=[0, 1, -1]), np.eye(2)) + sp.kron(on, SITE)
    M, F = sp.kron(on, np.eye(2)), sp.kron(on, PULL)
    if crowd:
        beside = sp.eye_array(crowd), sp.diags_array(100.0 + np.arange(crowd)), sp.csr_array((crowd, crowd))
        M, K, F = (sp.block_diag(blocks) for blocks in zip((M, K, F), beside, strict=True))
    return sp.csr_array(M), sp.csr_array(K), sp.csr_array(F)


def theta(n: int, mu: float, crowd: int = 0) -> np.ndarray:
    root = np.sqrt(complex(25 - 10 * B * mu))
    kappa = 4 * GLUE * np.sin(np.arange(1, n + 1) * np.pi / (2 * n + 2)) ** 2
    return np.concatenate([kappa + 20 + root, kappa + 20 - root, 100.0 + np.arange(crowd)])


def exact(n: int, mu: float, kind: str, crowd: int = 0) -> np.ndarray:
    """Return all λ; with structural damping those with Im λ > 0."""
    if kind == "dashpots":
        root = np.sqrt(ALPHA**2 / 4 - theta(n, mu, crowd))
        return np.concatenate([-ALPHA / 2 + root, -ALPHA / 2 - root])
    lam = 1j * np.sqrt(theta(n, mu, crowd) * (1 + (1j * ETA if kind == "structural" else 0)))
    return lam if kind == "structural" else np.concatenate([lam, -lam])


def critical(n: int, kind: str) -> np.ndarray:
    """Return μ of all onsets: where Re λ of κ_j + 20 + i√(10Bμ − 25) is zero."""
    a = theta(n, 1 / np.sqrt(3)).real[:n]
    extra = {"undamped": 0 * a, "dashpots": ALPHA**2 * a, "structural": (ETA * a) ** 2}[kind]
    return (25 + extra) / (10 * B)


def terms_of(M, K, F, kind: str) -> list:
    found = [("mass", M), ("stiffness", K), ("stiffness", F, "powers = { mu = 1 }")]
    if kind == "dashpots":
        found.append(("damping", M, f"scale = {ALPHA}"))
    if kind == "structural":
        found += [("stiffness", K, "imaginary = true", f"scale = {ETA}"),
                  ("stiffness", F, "imaginary = true", f"scale = {ETA}", "powers = { mu = 1 }")]  # fmt: skip
    return found


def check(result, n: int, kind: str, rate: float = 1.0) -> None:
    """Check spectrum, errors and onsets of a sweep of μ from 0 to 0.9 against the closed forms."""
    dense = result.problem.unknowns <= DENSE_LIMIT
    for point in result.points:
        modes = point.modes
        assert modes.method.startswith("dense") is dense
        assert_near(point, rate * exact(n, point.value, kind, 0 if dense else CROWD), 1e-12)
        assert modes.backward_error.max() <= 1e-12
        assert len(modes) == 2 * n  # no eigenvalue is lost, and no infinite one is taken for a finite one
    assert not result.warnings
    omega = rate * np.sqrt(theta(n, 1 / np.sqrt(3)).real[:n] * (1 + ETA**2 * (kind == "structural")))
    assert len(result.onsets) == n
    assert all(o.kind == "flutter" and o.direction == "into" for o in result.onsets)
    for o, exact_value, frequency in zip(
        sorted(result.onsets, key=lambda o: o.frequency_hz), critical(n, kind), omega, strict=True
    ):
        assert abs(o.value - exact_value) <= 1e-12 and o.uncertainty <= 1e-11
        assert 2 * np.pi * o.frequency_hz == pytest.approx(frequency, rel=1e-11)


def tied(n: int, copies: np.ndarray, crowd=0, unit=1.0, sign=1.0) -> tuple[sp.csr_array, ...]:
    """Return the model with some unknowns doubled, and both copies tied by Lagrange multipliers, [[K, ±Bᵀ], [B, 0]]."""
    M, K, F = sites(n, 1, crowd)
    size, m = 2 * n + crowd, len(copies)
    E = sp.csr_array((np.ones(m), (np.arange(m), copies)), shape=(m, size))  # selects the unknowns that are doubled
    half = sp.diags_array(1 - 0.5 * np.asarray(E.sum(axis=0)))
    # The copy of an unknown gets half of its mass, and half of its stiffness to the ground, 2 GLUE.
    rest = K - GLUE * (E.T @ E)
    A = [sp.block_diag([half @ M, 0.5 * sp.eye_array(m)]), sp.block_diag([rest, GLUE * sp.eye_array(m)]),
         sp.block_diag([F, sp.csr_array((m, m))])]  # fmt: skip
    tie = unit * sp.hstack([E, -sp.eye_array(m)])
    zero = sp.csr_array((m, m))
    M, K, F = A
    return (sp.csr_array(sp.block_diag([M, zero])), sp.csr_array(sp.block_array([[K, sign * tie.T], [tie, None]])),
            sp.csr_array(sp.block_diag([F, zero])))  # fmt: skip
