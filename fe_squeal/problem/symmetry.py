"""Whether a matrix is symmetric or skew-symmetric."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from scipy import sparse

_ROUNDING = 8 * np.finfo(float).eps  # of the largest entries of row and column: what files and sums leave


def measure_symmetry(A: sparse.csr_array, rounding: float = _ROUNDING) -> Literal["symmetric", "skew", "general"]:
    """Say whether a square matrix is symmetric or skew-symmetric, but for rounding; the zero matrix is symmetric.

    a_ij and ±a_ji count as equal where they differ by no more than `rounding` sqrt(r_i r_j), with r_i the largest
    magnitude in row and column i. As no entry exceeds its r_i and r_j, this allows entries that differ in their last
    digits as well as what is left of sums that cancel. It is local: a penalty of 1e20 elsewhere hides no asymmetry, and
    units that differ between the degrees of freedom do not matter.

    Examples
    --------
    >>> [measure_symmetry(sparse.csr_array([[0.0, 2.0], [a, 0.0]])) for a in (2.0, -2.0, 1.0)]
    ['symmetric', 'skew', 'general']
    """
    entries = A.tocoo()
    largest = np.zeros(A.shape[0])
    for index in (entries.row, entries.col):
        np.maximum.at(largest, index, np.abs(entries.data))
    root = np.sqrt(largest)  # before the product, which could overflow

    def vanishes(difference: Any) -> bool:
        d = difference.tocoo()
        return bool(np.all(np.abs(d.data) <= rounding * root[d.row] * root[d.col]))

    with np.errstate(over="ignore"):  # the difference of opposite huge numbers: infinite, hence not small
        return "symmetric" if vanishes(A - A.T) else "skew" if vanishes(A + A.T) else "general"
