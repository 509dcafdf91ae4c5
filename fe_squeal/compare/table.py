"""Finite-element models of the lumped systems beside the lumped systems themselves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.optimize import linear_sum_assignment

import lumped

from ..assembly.discretisation import discretisation_of
from ..eigen.linear.factor import LinearSolver
from ..eigen.pencil import Modes
from ..eigen.request import Request
from ..eigen.solve import solve_modes
from ..errors import SceneError, suggest
from ..problem.problem import Problem
from ..sweep.sweep import sweep
from .cases import Case, minimal, nine_dof, two_mass, uncoupled_disc

# Times the highest lumped frequency: modes above it deform the bodies, those below that are no lumped ones rotate them.
_DEFORMING = 10.0
_SOFTER = (1e-2, 1e-1, 1.0)  # times a case's modulus: the three moduli to which the order in 1/E is fitted


@dataclass(frozen=True)
class Setup:
    """What is compared: friction coefficients of the spectra, the interval of the onsets, and Young's modulus (Pa,
    against springs of 1 to 50 N/m on bodies of 1 m)."""

    make: Callable[[], Case]
    values: tuple[float, ...]
    interval: tuple[float, float, int]
    modulus: float = 1e6


SETUPS = {
    "minimal": Setup(minimal, (0.0, 0.5, 1.0), (0.0, 1.0, 6)),
    "minimal-damped": Setup(
        lambda: minimal(lumped.Minimal(k2=20.0, c1=0.3, c2=0.3, c3=0.3)), (0.0, 0.5, 1.0), (0.0, 1.0, 6)
    ),
    "minimal-sprung-at-top": Setup(lambda: minimal(springs_on="top"), (), (0.0, 1.0, 6)),
    "two-mass": Setup(two_mass, (0.0, 0.1, 0.4), (0.0, 0.6, 7)),
    "nine-dof": Setup(nine_dof, (0.0, 0.5, 2.0), (0.0, 4.0, 41), 3e6),
    "uncoupled-disc": Setup(uncoupled_disc, (0.0, 1.0, 5.0), (0.0, 5.0, 6)),
}


def compare(name: str = "all", linear_solver: LinearSolver | str = "auto") -> pd.DataFrame:
    """Return a row per quantity: case, quantity, lumped, finite_elements, difference.

    For a spectrum it is the eigenvalue that differs most, with its relative difference; for the friction matrix,
    projected on the rigid motions, the largest entry, with the largest difference of any entry relative to it.

    Parameters
    ----------
    name : str
        A key of SETUPS, or "all".
    linear_solver : LinearSolver or str
        As of `fe_squeal.sweep`.

    Raises
    ------
    SceneError
        If there is no such case.
    """
    if name != "all" and name not in SETUPS:
        raise SceneError(f'compare: no case "{name}"{suggest(name, [*SETUPS, "all"])}')
    keys = SETUPS if name == "all" else [name]
    rows = [row for key in keys for row in compare_case(key, linear_solver)]
    return pd.DataFrame(rows, columns=["case", "quantity", "lumped", "finite_elements", "difference"])


def compare_case(
    name: str, linear_solver: LinearSolver | str = "auto"
) -> list[tuple[str, str, float, float, float]]:
    """Return the rows of one case."""
    setup = SETUPS[name]
    case = setup.make()
    stiff = case.problem(setup.modulus)
    rows: list[tuple[str, str, float, float, float]] = []
    R = case.rigid_motions(stiff)
    friction = stiff.derivative("mu", "K")
    assert friction is not None
    projected, expected = R.T @ (friction @ R), case.model.friction_matrix
    size = np.abs(expected).max()
    gap = np.abs(projected - expected).max() / size
    rows.append((name, "K_f, largest entry (N/m)", size, float(np.abs(projected).max()), gap))
    for mu in setup.values:
        difference, model, fem = spectrum_difference(case, stiff, mu, linear_solver)
        rows.append((name, f"|λ| at μ = {mu:g} (rad/s)", abs(model), abs(fem), difference))
    if setup.values:
        slope = stiffness_rate(case, setup.modulus, setup.values[-1], linear_solver)
        rows.append((name, "order in 1/E", 1.0, slope, abs(slope - 1.0)))
    for label, omega in rotations(case, stiff, linear_solver):
        rows.append((name, f"rotation of {label} (rad/s)", np.nan, omega, np.nan))
    rows += _onset_rows(name, case, stiff, setup, linear_solver)
    if name == "uncoupled-disc":
        drift = spectrum_drift(case.problem(1e-2 * setup.modulus), setup.values, linear_solver)
        rows.append((name, "change of λ over μ", 0.0, drift, drift))
    return rows


def lumped_modes(
    case: Case, problem: Problem, mu: float, linear_solver: LinearSolver | str = "auto"
) -> Modes:
    """Return the modes that move as the lumped masses do, without the rotations and deformations of the bodies.

    With P the mass projection on the rigid motions R, ψᴴMPφ/ψᴴMφ is the share of the lumped coordinates in a mode,
    right and left together. By φ alone a mode of the lumped masses could pass for a rotation, because friction makes a
    translation drive a rotation.
    """
    pencil = problem.pencil(mu=mu)
    modes = solve_modes(pencil, Request(count=problem.unknowns), linear_solver=linear_solver)
    assert modes.left is not None
    R = case.rigid_motions(problem)
    MR = pencil.M @ R
    through = np.einsum("ij,ij->j", (modes.left.conj().T @ MR).T, np.linalg.solve(R.T @ MR, MR.T @ modes.right))
    whole = np.einsum("ij,ij->j", modes.left.conj(), pencil.M @ modes.right)
    return modes.select(np.flatnonzero(np.abs(through / whole) > 0.5))


def rotations(
    case: Case, problem: Problem, linear_solver: LinearSolver | str = "auto"
) -> list[tuple[str, float]]:
    """Return the body and the frequency at μ = 0 of each mode that is neither the lumped model's nor a deformation."""
    discretisation = discretisation_of(problem)
    assert discretisation is not None
    pencil, space = problem.pencil(mu=0.0), discretisation.space
    modes = solve_modes(pencil, Request(count=problem.unknowns), linear_solver=linear_solver)
    lumped_ones = lumped_modes(case, problem, 0.0, linear_solver).lam.imag
    highest = _DEFORMING * lumped_ones.max()
    found = []
    for i, omega in enumerate(modes.lam.imag):
        if omega > highest or np.abs(lumped_ones - omega).min() <= 1e-9 * highest:
            continue
        motion = np.abs(space.expand(modes.right[:, i]))
        size = {b: motion[space.dofs.element_dofs[:, e]].max() for b, e in discretisation.bodies.items()}
        found.append((max(size, key=lambda b: size[b]), float(omega)))
    return found


def spectrum_difference(
    case: Case, problem: Problem, mu: float, linear_solver: LinearSolver | str = "auto"
) -> tuple[float, complex, complex]:
    """Return the largest relative difference of an eigenvalue, with the lumped and the finite-element one.

    It is infinite, and the finite-element one is NaN, where an eigenvalue of the lumped model is missing.
    """
    reference = case.model.eigenvalues(mu)
    reference = reference[reference.imag > 1e-6 * np.abs(reference).max()]
    found = lumped_modes(case, problem, mu, linear_solver).lam
    partner = partners(reference, found)
    difference = np.nan_to_num(np.abs(partner - reference) / np.abs(reference), nan=np.inf)
    worst = int(np.argmax(difference))
    return float(difference[worst]), complex(reference[worst]), complex(partner[worst])


def partners(expected: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Return for each expected number (k,) the one of those found (m,) that belongs to it, so that they lie near.

    Each of those found belongs to one expected number at most. Where too few were found, some have NaN.

    Examples
    --------
    >>> partners(np.array([1.0, 1.1, 5.0]), np.array([4.0, 1.08])).tolist()
    [nan, 1.08, 4.0]
    """
    result = np.full(len(expected), np.nan, dtype=np.result_type(expected, found, float))
    # Of the roots of distances, so that what agrees is not moved for what is far from everything.
    own, other = linear_sum_assignment(np.sqrt(np.abs(expected[:, None] - found[None, :])))
    result[own] = found[other]
    return result


def stiffness_rate(
    case: Case, modulus: float, mu: float, linear_solver: LinearSolver | str = "auto"
) -> float:
    """Return the fitted order in 1/E of the largest change of an eigenvalue from one modulus to the next."""
    moduli = [modulus * s for s in _SOFTER]
    spectra = [lumped_modes(case, case.problem(E), mu, linear_solver).lam for E in (0.1 * moduli[0], *moduli)]
    changes = [np.abs(partners(a, b) - a).max() for a, b in pairwise(spectra)]
    if not np.isfinite(changes).all():
        return float("nan")  # an eigenvalue is missing
    return float(-np.polyfit(np.log(moduli), np.log(changes), 1)[0])


def spectrum_drift(
    problem: Problem, values: tuple[float, ...], linear_solver: LinearSolver | str = "auto"
) -> float:
    """Return the largest relative change of an eigenvalue between values of μ."""
    found = [solve_modes(problem.pencil(mu=mu), Request(count=9), linear_solver=linear_solver) for mu in values]
    spectra = [modes.lam.imag for modes in found]
    return float(max(np.abs(s / spectra[0] - 1).max() for s in spectra[1:]))


def _onset_rows(
    name: str, case: Case, problem: Problem, setup: Setup, linear_solver: LinearSolver | str
) -> list[tuple[str, str, float, float, float]]:  # fmt: skip
    low, high, points = setup.interval
    rotations = problem.unknowns if problem.unknowns < 12 else 12
    modes = rotations if name == "nine-dof" else 4
    result = sweep(problem, np.linspace(low, high, points), modes=modes, linear_solver=linear_solver)
    found = [o for o in result.onsets if o.direction == "into" and o.law != "parting"]
    highest = _DEFORMING * float(case.model.eigenvalues(low).imag.max())
    alike = np.array([o.value for o in found if 2 * np.pi * o.frequency_hz <= highest], dtype=float)
    expected = np.array([mu for mu in case.model.critical_mu() if low < mu < high], dtype=float)
    rows = onset_rows(name, expected, alike)
    if name == "minimal-sprung-at-top":
        rows = [(*row[:4], np.nan) for row in rows]  # the two models are different ones there, which is no error
    deforming = len(found) - len(alike)
    return [*rows, (name, "onsets of deformations", np.nan, float(deforming), np.nan)] if deforming else rows


def onset_rows(name: str, expected: np.ndarray, found: np.ndarray) -> list[tuple[str, str, float, float, float]]:
    """Return a row for each onset of the lumped model, and one for their numbers.

    An onset that the finite elements lack has the infinite difference; one that they have besides is in their number.
    """
    rows = []
    for mu, partner in zip(expected.tolist(), partners(expected, found).tolist(), strict=True):
        rows.append((name, "critical μ", mu, partner, abs(partner - mu) / mu if partner == partner else np.inf))
    counts = float(len(expected)), float(len(found))
    return [*rows, (name, "number of onsets", *counts, abs(counts[1] - counts[0]))]
