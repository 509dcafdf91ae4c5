"""Stiffness matrices from springs, and the ways in which friction follows the normal force."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def direction(theta: ArrayLike) -> tuple[Floats, Floats]:
    """Return the components (sin θ, −cos θ) of the direction along which a spring acts.

    The angle is reduced to 0…45° before sine and cosine are taken. A spring has no sense of direction, so the result
    is that of θ modulo 180°, to the last bit; and mirrored springs (60° and 120°) cancel exactly.

    Parameters
    ----------
    theta : array_like, degrees

    Returns
    -------
    tuple of arrays
        x and y component.

    Examples
    --------
    >>> x, y = direction([90.0, 60.0, 120.0, 240.0])
    >>> bool(x[1] == x[2] == x[3]), bool(y[1] == -y[2] == y[3]), float(y[0])
    (True, True, 0.0)
    """
    angle = np.mod(np.asarray(theta, dtype=float), 180.0)
    obtuse = angle > 90.0
    acute = np.where(obtuse, 180.0 - angle, angle)
    low = acute <= 45.0
    a = np.deg2rad(np.where(low, acute, 90.0 - acute))
    sine = np.where(low, np.sin(a), np.cos(a))
    cosine = np.where(low, np.cos(a), np.sin(a))
    return sine, np.where(obtuse, cosine, -cosine) + 0.0  # + 0.0 turns -0.0 into 0.0


def add_spring(K: Floats, stiffness: float, elongation: dict[int, float]) -> Floats:
    """Return K with a spring added that is elongated by Σ d_i q_i: K + k d dᵀ.

    Parameters
    ----------
    K : (n, n) array, N/m
    stiffness : float, N/m
    elongation : dict
        The nonzero d_i by coordinate.

    Examples
    --------
    >>> add_spring(np.zeros((2, 2)), 3.0, {0: 1.0, 1: -1.0})
    array([[ 3., -3.],
           [-3.,  3.]])
    """
    d = np.zeros(len(K))
    for i, value in elongation.items():
        d[i] = value
    return K + stiffness * np.outer(d, d)


def inclined(theta: float, x: int, y: int | None = None, x_other: int | None = None) -> dict[int, float]:
    """Return the elongation of a spring at angle θ on the mass with coordinates x, y.

    The other end is fixed, or on a mass that moves along `x_other` only.

    Examples
    --------
    >>> {i: round(float(d), 3) for i, d in inclined(60.0, 0, 1).items()}
    {0: 0.866, 1: -0.5}
    """
    dx, dy = direction(theta)
    d = {x: float(dx)}
    if y is not None:
        d[y] = float(dy)
    if x_other is not None:
        d[x_other] = -float(dx)
    return d


def friction_coupling(K0: Floats, tangential: int, normal: int, contact_stiffness: float, friction: str) -> Floats:
    """Return F in K(μ) = K0 + μ F for one mass on a belt.

    x points along the belt's velocity, y out of the belt, so that friction pulls the mass with +μ N along x.

    ========= ============================================================ ==========================
    `printed` the whole stiffness against the normal motion carries load   F[x, y] = K0[y, y]
    `contact` only the contact spring does: N = N0 − k y (virtual work)    F[x, y] = k
    `full`    all that is in the equation of the normal motion             F[x, :] = K0[y, :]
    ========= ============================================================ ==========================

    Parameters
    ----------
    K0 : (n, n) array, N/m
        Without friction.
    tangential, normal : int
        Coordinates x and y.
    contact_stiffness : float, N/m
    friction : {"printed", "contact", "full"}

    References
    ----------
    `contact`: Hoffmann, Fischer, Allgaier, Gaul, Mech. Res. Commun. 29 (2002) 197-205.

    Examples
    --------
    >>> friction_coupling(np.array([[3.0, -1.0], [-1.0, 5.0]]), 0, 1, 4.0, "full")
    array([[-1.,  5.],
           [ 0.,  0.]])
    """
    F = np.zeros_like(K0)
    if friction == "full":
        F[tangential] = K0[normal]
    else:
        F[tangential, normal] = K0[normal, normal] if friction == "printed" else contact_stiffness
    return F
