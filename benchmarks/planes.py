"""Faces of boxes, as functions that find the facets on a plane."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

_TINY = 1e-9  # m: points this near to a plane are on it


def on_plane(axis: int, at: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function of points x (3, k), m, that says which have the coordinate `at` along an axis.

    Examples
    --------
    >>> on_plane(2, 0.5)(np.array([[0.0, 0.5], [0.0, 0.5], [0.5, 0.0]]))
    array([ True, False])
    """

    def is_on(x: np.ndarray) -> np.ndarray:
        return np.asarray(np.abs(x[axis] - at) < _TINY)

    return is_on
