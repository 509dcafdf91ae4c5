"""Axes of nodes that a deck turns: what is held along them, as directions of the scene."""

from __future__ import annotations

import numpy as np

_ALIGNED = 1e-9  # largest entry by which the projector onto held directions may differ from that onto x, y or z


def along_axes(held: np.ndarray) -> str | None:
    """Return which of x, y and z span the same directions as those that are held, None where they do not.

    Two directions that are turned about z hold x and y, although neither of them is along an axis.

    Parameters
    ----------
    held : (k, 3) float
        Unit vectors, at right angles to each other; NaN for a direction that is not defined.

    Examples
    --------
    >>> along_axes(np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0]])), along_axes(np.array([[0.6, 0.8, 0.0]]))
    ('xy', None)
    """
    projector = held.T @ held
    inside = np.diag(projector) > 0.5
    if not (np.abs(projector - np.diag(inside)) <= _ALIGNED).all():
        return None
    return "".join(c for c, is_held in zip("xyz", inside, strict=True) if is_held)
