"""The mixed displacement–pressure formulation: pressures that are eliminated in each element.

With a pressure p of its own, σ = 2με(u) + p 1 and p/λ = div u weakly. For pressures that are discontinuous from element
to element the second equation is solved in each by itself, p = λ Π div u, Π the L² projection on the pressures, and
what remains is the positive semidefinite stiffness in displacements alone

    K = ∫ 2μ ε(δu):ε(u) + λ ∫ Π(div δu) Π(div u).

Pressures have the order of the displacements less one: constant, linear or quadratic in x, y, z themselves (not in
reference coordinates, or they would lose an order on distorted hexahedra). As ν → ½ and λ → ∞ only Π div u is forced to
zero; the error stays bounded in that limit because displacements and pressures satisfy an inf-sup condition, for which
`fe_squeal.fem.bubbles` cares. (Boffi, Brezzi and Fortin, Mixed Finite Element Methods and Applications, 2013,
chapter 8.)
"""

from __future__ import annotations

import numpy as np


def pressure_functions(points: np.ndarray, dx: np.ndarray, order: int) -> np.ndarray:
    """Return the pressures of displacements of an order, orthonormal in L² on each element.

    Parameters
    ----------
    points : (e, 3, q) float, m
        Quadrature points.
    dx : (e, q) float, m^3
    order : int
        Order of the displacements.

    Returns
    -------
    (e, i, q) float, m^-3/2
        One function for order 1, four for order 2, ten for order 3.

    Examples
    --------
    >>> x = np.random.default_rng(1).uniform(size=(1, 3, 10))
    >>> P = pressure_functions(x, np.full((1, 10), 0.1), 2)
    >>> np.round(P[0] * 0.1 @ P[0].T, 12).tolist() == np.eye(4).tolist()
    True
    """
    volume = dx.sum(axis=1)
    P = np.ones((len(dx), 1, dx.shape[1]))
    if order > 1:
        centre = np.einsum("ecq,eq->ec", points, dx) / volume[:, None]
        x = (points - centre[:, :, None]) / np.cbrt(volume)[:, None, None]
        i, j = np.triu_indices(3)
        P = np.concatenate([P, x, *([x[:, i] * x[:, j]] if order > 2 else [])], axis=1)
    gram = (P * dx[:, None]) @ np.swapaxes(P, 1, 2)
    return np.asarray(np.linalg.solve(np.linalg.cholesky(gram), P))


def projected(f: np.ndarray, points: np.ndarray, dx: np.ndarray, order: int) -> np.ndarray:
    """Return Π f, the projection of a function (e, q) on the pressures; the others as of `pressure_functions`."""
    P = pressure_functions(points, dx, order)
    return np.einsum("eiq,ei->eq", P, np.einsum("eiq,eq->ei", P, f * dx))
