"""Sweeps where strong dampers at the contacts overdamp most modes."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal import sweep
from fe_squeal.eigen.pencil import Modes
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.sweep import forecast
from fe_squeal.sweep.tracking import match_modes

N, EVERY, DAMPER = 500, 5, 60.0


def oscillators(damper: float) -> tuple[Problem, np.ndarray, np.ndarray]:
    """Return oscillators of which one in five is not overdamped, coupled in pairs by friction, with their k and c."""
    k, c = np.linspace(1.0, 400.0, N) ** 1.1, np.full(N, damper)
    c[::EVERY] = 0.02
    T = sp.csr_array(sp.diags_array([np.ones(N), np.full(N - 1, 0.4)], offsets=[0, 1]))
    first, second = EVERY * np.arange(2, 20, 2), EVERY * np.arange(3, 20, 2)
    count = min(len(first), len(second))
    friction = sp.lil_array((N, N))
    for i, j in zip(first[:count], second[:count], strict=True):
        friction[i, j], friction[j, i] = 30.0, -30.0
    diagonals = {"M": np.ones(N), "K": k, "C": c}
    terms = [Term(s.lower(), s, sp.csr_array(T.T @ sp.diags_array(d) @ T), True) for s, d in diagonals.items()]
    terms.append(Term("friction", "K", sp.csr_array(T.T @ friction.tocsr() @ T), False, {"mu": 1}))
    return Problem(tuple(terms), {"mu": 0.0}), k, c


def exact(k: np.ndarray, c: np.ndarray, mu: float) -> np.ndarray:
    """Return λ of the oscillators that swing: pairs of equal dampers have θ of [[k₁, 30 μ], [−30 μ, k₂]]."""
    light = np.arange(0, N, EVERY)
    first, second = EVERY * np.arange(2, 20, 2), EVERY * np.arange(3, 20, 2)
    theta = k[light].astype(complex)
    for i, j in zip(first, second, strict=True):
        mean, half = (k[i] + k[j]) / 2, (k[i] - k[j]) / 2
        root = np.sqrt(complex(half**2 - (30.0 * mu) ** 2))
        theta[i // EVERY], theta[j // EVERY] = mean - root, mean + root
    lam = -c[light] / 2 + 1j * np.sqrt(theta - c[light] ** 2 / 4)
    return lam[np.argsort(lam.imag)]


@pytest.mark.parametrize(("swings", "halved"), [(False, False), (True, True)])
def test_only_modes_that_swing_are_followed_closely(swings, halved):
    """Three modes that mix from value to value: no shape is like one before, with MAC of 1/9 and 4/9."""
    turned = np.eye(3) - 2 / 3
    lam = np.array([-2.0, -3.0, -4.0]) + 1j * swings * np.array([100.0, 101.0, 102.0])
    none = np.zeros(3)
    before, now = (Modes(lam, x + 0j, x + 0j, none, none, none) for x in (np.eye(3), turned))
    match = match_modes(before, now, sp.csr_array(np.eye(3)))
    assert match.doubtful.any() == halved and (match.origin >= 0).any()


@pytest.mark.slow
def test_swinging_modes_among_a_crowd_in_a_sweep(monkeypatch):
    """A reduced model cannot part the crowd, so that "auto" solves directly, and says so; all that swings is found."""
    monkeypatch.setattr(forecast, "UNKNOWNS", 100)
    problem, k, c = oscillators(DAMPER)
    result = sweep(problem, [0.0, 0.25, 0.5], modes=24)
    for point in result.points:
        lam = exact(k, c, point.value)
        found = point.modes.lam[point.modes.lam.imag > 0]
        assert len(found) >= 24
        assert np.abs(found[:, None] - lam[None, :]).min(axis=1).max() < 1e-9 * np.abs(found).max()
        inside = lam[lam.imag < 0.98 * found.imag.max()]
        assert np.abs(inside[:, None] - found[None, :]).min(axis=1).max() < 1e-9 * np.abs(found).max()
        unstable = int((point.modes.stability == "unstable").sum())
        assert unstable == int((lam[: len(found)].real > 0).sum())
    assert any("decay without swinging" in text for text in result.warnings)
    # Friction beats the dampers where |(k₁ − k₂)/2| is below 30 μ by so much: Re √… of the pair exceeds c/2.
    assert len(result.onsets) >= 2
    for onset in result.onsets:
        lam = exact(k, c, onset.value)
        assert np.abs(lam.real).min() < 1e-3 and onset.direction == "into" and onset.kind == "flutter"
        at = np.abs(lam.imag - 2 * np.pi * onset.frequency_hz)
        assert np.abs(lam.real[at < 1e-5 * np.abs(lam)]).min() < 1e-5
