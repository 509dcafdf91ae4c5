"""Points of a scatter: scrambled Sobol points, as numbers with given distributions and correlations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, qmc

from ..errors import SceneError
from ..scene.study import Distribution, parameter_name

_EDGE = 1e-12  # of 1: how near to 0 and 1 probabilities come, where quantiles of unbounded distributions are infinite


@dataclass(frozen=True)
class Scatter:
    """Several numbers with their distributions.

    Attributes
    ----------
    names : tuple of str
    distributions : tuple of Distribution
    correlation : (d, d) float
        Of the normal variables behind normal and lognormal numbers (Gaussian copula); the unit matrix for others.
    """

    names: tuple[str, ...]
    distributions: tuple[Distribution, ...]
    correlation: np.ndarray

    @classmethod
    def of(
        cls, parameters: Mapping[str, Distribution], pairs: Sequence[tuple[str, str, float]] = ()
    ) -> Scatter:  # fmt: skip
        """Return the scatter of some parameters with correlations of pairs of them.

        Raises
        ------
        SceneError
            The correlations contradict each other.
        """
        names = tuple(parameter_name(name) for name in parameters)
        R = np.eye(len(names))
        for a, b, coefficient in pairs:
            i, j = names.index(parameter_name(a)), names.index(parameter_name(b))
            R[i, j] = R[j, i] = coefficient
        if np.linalg.eigvalsh(R)[0] <= 1e-10:
            raise SceneError(
                "study.correlation: given coefficients that contradict each other; expected a positive definite matrix"
            )
        return cls(names, tuple(parameters.values()), R)

    def normals(self, u: np.ndarray) -> np.ndarray:
        """Return correlated standard normal numbers (m, d) for independent probabilities (m, d)."""
        z = norm.ppf(np.clip(u, _EDGE, 1 - _EDGE))
        return np.asarray(z @ np.linalg.cholesky(self.correlation).T)

    def values(self, z: np.ndarray) -> np.ndarray:
        """Return the values (m, d) of the parameters for correlated standard normal numbers (m, d)."""
        return np.stack([quantiles(d, norm.cdf(z[:, i])) for i, d in enumerate(self.distributions)], axis=1)

    def redrawn(self, z: np.ndarray, i: int, u: np.ndarray) -> np.ndarray:
        """Return the normal numbers (m, d) with number i drawn anew at probabilities u (m,), given the others."""
        precision = np.linalg.inv(self.correlation)[i]
        others = np.delete(np.arange(z.shape[1]), i)
        mean = -z[:, others] @ precision[others] / precision[i]
        changed = z.copy()
        changed[:, i] = mean + norm.ppf(np.clip(u, _EDGE, 1 - _EDGE)) / np.sqrt(precision[i])
        return changed


def sobol_points(count: int, dimension: int, seed: int) -> np.ndarray:
    """Return scrambled Sobol points (count, dimension) in the unit cube; the first ones are the same for any count."""
    sampler = qmc.Sobol(dimension, scramble=True, seed=seed)
    return np.asarray(sampler.random_base2(int(np.ceil(np.log2(max(count, 2)))))[:count])


def quantiles(distribution: Distribution, u: np.ndarray) -> np.ndarray:
    """Return the values that a distribution stays below with probabilities u.

    Examples
    --------
    >>> quantiles(Distribution(values=[1.0, 2.0, 4.0]), np.array([0.1, 0.5, 0.9])).tolist()
    [1.0, 2.0, 4.0]
    >>> quantiles(Distribution.model_validate({"uniform": {"low": 2.0, "high": 4.0}}), np.array([0.25])).tolist()
    [2.5]
    """
    u = np.clip(u, _EDGE, 1 - _EDGE)
    if distribution.values is not None:
        values = np.array(distribution.values)
        return values[np.minimum((u * len(values)).astype(int), len(values) - 1)]
    if (uniform := distribution.uniform) is not None:
        return np.asarray(uniform.low + (uniform.high - uniform.low) * u)
    if (triangle := distribution.triangular) is not None:
        width, left = triangle.high - triangle.low, triangle.mode - triangle.low
        rising = triangle.low + np.sqrt(u * width * left)
        falling = triangle.high - np.sqrt((1 - u) * width * (width - left))
        return np.where(u * width < left, rising, falling)
    if (normal := distribution.normal) is not None:
        cut = _cut(u, normal.low, normal.high, normal.mean, normal.deviation)
        return np.asarray(_inside(normal.mean + normal.deviation * cut, normal.low, normal.high))
    table = distribution.lognormal
    assert table is not None
    low, high = (None if x is None else -np.inf if x <= 0 else np.log(x) for x in (table.low, table.high))
    mean, deviation = np.log(table.median), np.log(table.factor)
    return np.asarray(_inside(np.exp(mean + deviation * _cut(u, low, high, mean, deviation)), table.low, table.high))


def _cut(u: np.ndarray, low: float | None, high: float | None, mean: float, deviation: float) -> np.ndarray:
    """Return quantiles of the standard normal distribution cut off at (low − mean) / deviation and the same of high."""
    below = 0.0 if low is None else norm.cdf((low - mean) / deviation)
    above = 0.0 if high is None else norm.sf((high - mean) / deviation)
    inside = 1 - below - above
    # From the nearer end, so that digits are kept in both tails.
    lower, upper = norm.ppf(below + u * inside), norm.isf(above + (1 - u) * inside)
    return np.where(u < 0.5, lower, upper)


def _inside(values: np.ndarray, low: float | None, high: float | None) -> np.ndarray:
    return np.clip(values, low, high) if low is not None or high is not None else values
