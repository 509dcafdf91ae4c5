"""Axes of nodes that a deck turns: what is held along them, as directions of the scene."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_ALIGNED = 1e-9  # largest entry by which the projector onto held directions may differ from that onto x, y or z


def held_projector(axes: np.ndarray, held: Sequence[bool]) -> np.ndarray:
    """Return the projector (3, 3) onto the directions along which a node is held.

    Parameters
    ----------
    axes : (3, 3) float
        Unit vectors at right angles to each other, a row each; NaN for one that is not defined, such as the radial one
        of a node on the axis of a cylinder.
    held : sequence of 3 bool
        Which of these the node is held along.

    Returns
    -------
    projector : (3, 3) float
        NaN where the axes do not say it.
    """
    vectors, others = axes[np.array(held)], axes[~np.array(held)]
    if np.isnan(vectors).any():  # what the others leave is held, whichever axes it has
        return np.eye(3) - others.T @ others
    return vectors.T @ vectors


def along_axes(projector: np.ndarray) -> str | None:
    """Return which of x, y and z span the same directions as a projector (3, 3), None where they do not.

    Two directions that are turned about z hold x and y, although neither of them is along an axis.

    Examples
    --------
    >>> axes = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    >>> along_axes(held_projector(axes, [True, True, False])), along_axes(held_projector(axes, [True, False, False]))
    ('xy', None)
    """
    inside = np.diag(projector) > 0.5
    if not (np.abs(projector - np.diag(inside)) <= _ALIGNED).all():
        return None
    return "".join(c for c, is_held in zip("xyz", inside, strict=True) if is_held)
