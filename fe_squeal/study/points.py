"""Points of a scatter: scrambled Sobol points, turned into numbers with given distributions and correlations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, qmc

from ..errors import SceneError
from ..problem.parameters import parameter_name
from ..scene.study import Distribution

_EDGE = 1e-12  # least distance of a probability from 0 and 1, where quantiles of unbounded distributions are infinite


@dataclass(frozen=True)
class Scatter:
    """Several numbers with their distributions.

    Attributes
    ----------
    names : tuple of str
        The d parameters.
    distributions : tuple of Distribution
        Distribution of each parameter.
    correlation : (d, d) float
        Correlations of the standard normal variables z that normal and lognormal numbers are functions of (a Gaussian
        copula). Numbers with other distributions are independent: their rows are those of the unit matrix.
    """

    names: tuple[str, ...]
    distributions: tuple[Distribution, ...]
    correlation: np.ndarray

    @classmethod
    def of(
        cls, parameters: Mapping[str, Distribution], pairs: Sequence[tuple[str, str, float]] = ()
    ) -> Scatter:  # fmt: skip
        """Return the scatter of some parameters, given their distributions and the correlations of pairs of them.

        Raises
        ------
        SceneError
            The correlations contradict each other: their matrix is not positive definite.
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
        """Return correlated standard normal numbers z (m, d) for independent probabilities u (m, d) between 0 and 1."""
        z = norm.ppf(np.clip(u, _EDGE, 1 - _EDGE))
        return np.asarray(z @ np.linalg.cholesky(self.correlation).T)

    def values(self, z: np.ndarray) -> np.ndarray:
        """Return the values (m, d) of the parameters for correlated standard normal numbers z (m, d)."""
        return np.stack([quantiles(d, norm.cdf(z[:, i])) for i, d in enumerate(self.distributions)], axis=1)

    def redrawn(self, z: np.ndarray, i: int, u: np.ndarray) -> np.ndarray:
        """Return z (m, d) with column i drawn anew, given the other columns, at probabilities u (m,)."""
        precision = np.linalg.inv(self.correlation)[i]
        others = np.delete(np.arange(z.shape[1]), i)
        mean = -z[:, others] @ precision[others] / precision[i]
        changed = z.copy()
        changed[:, i] = mean + norm.ppf(np.clip(u, _EDGE, 1 - _EDGE)) / np.sqrt(precision[i])
        return changed


def sobol_points(count: int, dimension: int, seed: int) -> np.ndarray:
    """Return scrambled Sobol points (count, dimension) in the unit cube; with a larger count more points follow."""
    sampler = qmc.Sobol(dimension, scramble=True, seed=seed)
    return np.asarray(sampler.random_base2(int(np.ceil(np.log2(max(count, 2)))))[:count])


def quantiles(distribution: Distribution, u: np.ndarray) -> np.ndarray:
    """Return the quantiles (m,) of a distribution: it stays below them with the probabilities u (m,).

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
    """Return quantiles (m,) of the standard normal distribution between (low − mean)/deviation and that of high."""
    below = 0.0 if low is None else norm.cdf((low - mean) / deviation)
    above = 0.0 if high is None else norm.sf((high - mean) / deviation)
    inside = 1 - below - above
    # Each quantile is computed from the nearer end, so that no digits are lost in either tail.
    lower, upper = norm.ppf(below + u * inside), norm.isf(above + (1 - u) * inside)
    return np.where(u < 0.5, lower, upper)


def _inside(values: np.ndarray, low: float | None, high: float | None) -> np.ndarray:
    return np.clip(values, low, high) if low is not None or high is not None else values
