"""Small models whose dampers make most modes fast or creeping: the others are exact without QZ."""

from __future__ import annotations

import numpy as np
import pytest

from fe_squeal.eigen.lapack import damped_methods
from fe_squeal.eigen.polish import ACCURATE, pair_errors

_COUNT = 12


def _oscillators(other_seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return M, C, K of oscillators seen in other coordinates, and all λ: some weakly damped, others overdamped."""
    rng = np.random.default_rng(other_seed + 7)
    k = 1 + rng.random(_COUNT)
    c = np.where(np.arange(_COUNT) % 3 == 0, 0.02 * rng.random(_COUNT), 1e7 * (1 + rng.random(_COUNT)))
    T = np.linalg.qr(rng.standard_normal((_COUNT, _COUNT)))[0] @ np.diag(1 + rng.random(_COUNT))
    root = np.sqrt((c / 2) ** 2 - k + 0j)
    fast = -c / 2 - root
    return T.T @ T, T.T @ np.diag(c) @ T, T.T @ np.diag(k) @ T, np.concatenate([fast, k / fast])


@pytest.mark.parametrize("highest", [1.5, 3.0])
def test_shifted_gives_what_oscillates(highest: float, other_seed: int) -> None:
    """Overdamped pairs are near −1e7 and −1e-7; those that oscillate have |λ| = √k."""
    M, C, K, lam = _oscillators(other_seed)
    standard, shifted = damped_methods(M, C, K, highest, upper=True)[:2]
    with pytest.raises(np.linalg.LinAlgError, match="rounding of the fastest"):
        standard()
    found, right, left = shifted()
    wanted = lam[(lam.imag > 0) & (np.abs(lam) <= highest)]
    oscillating = np.flatnonzero(found.imag > 1e-3)
    assert len(wanted) >= 2
    np.testing.assert_allclose(np.sort(found[oscillating].imag), np.sort(wanted.imag), rtol=1e-7)
    errors = pair_errors([K, C, M], found[oscillating], right[:, oscillating], left[:, oscillating])
    assert errors.max() <= ACCURATE


def test_shifted_needs_a_limit(other_seed: int) -> None:
    M, C, K, _ = _oscillators(other_seed)
    with pytest.raises(np.linalg.LinAlgError, match="all eigenvalues"):
        damped_methods(M, C, K, np.inf, upper=True)[1]()
