"""The motions that no stiffness holds, at any values of the parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..eigen.kernel import kernel_within, unforced
from ..eigen.pencil import FreeMotions, Pencil
from .terms import Term

# Of the forces that cancel when a body moves as a whole: what rounding of its coordinates leaves, also far from the
# origin. Each term is judged by its own forces, so that a soft spring is not taken for the rounding of a stiff body.
ROUNDING_OF_FORCES = 1e-9


def find_free_motions(
    terms: Sequence[Term], coefficients: Sequence[float], motions: np.ndarray | None,
    pencil: Callable[[], Pencil], kernel: Callable[[Pencil], np.ndarray], kept: dict[object, Any],
) -> FreeMotions:  # fmt: skip
    """Return the motions that nothing holds, and the forces of dampers along them.

    They depend on which stiffnesses act, not on how large they are, and so are found once for each set of these.

    Parameters
    ----------
    terms, coefficients : those of a problem at its present values; a term of coefficient zero does not act
    motions : (n, r) float or None
        The motions among which they are; None where nothing is known of them.
    pencil : function
        Returns the matrices at these values, where they are needed.
    kernel : function of a Pencil
        Looks for the kernel of K where `motions` is None.
    kept : dict
        What was found before; filled here.
    """
    acting = [i for i, c in enumerate(coefficients) if c]
    stiff = tuple(i for i in acting if terms[i].slot == "K")
    if stiff not in kept:
        kept[stiff] = kernel(pencil()) if motions is None else _left_free([terms[i] for i in stiff], motions)
    Z = kept[stiff]
    if motions is None and Z.shape[1]:  # an eigenvalue may have been zero by chance at the values where Z was found
        Z = kernel_within(pencil(), Z)
    dampers = [i for i in acting if terms[i].slot == "C"]
    if not dampers or not Z.shape[1]:
        return FreeMotions(Z, np.zeros_like(Z) if dampers else None)
    forces = [coefficients[i] * _damping(terms[i], ("damping", i), Z, kept) for i in dampers]
    return FreeMotions(Z, np.asarray(sum(forces)))


def holds_everything(
    terms: Sequence[Term], coefficients: Sequence[float], motions: np.ndarray | None, kept: dict[object, Any]
) -> bool:
    """Return whether the stiffnesses that act leave no motion free, so that none is free if others act, too.

    The arguments are those of `find_free_motions`, with motions (n, r). False where nothing is known of these.
    """
    stiff = tuple(i for i, c in enumerate(coefficients) if c and terms[i].slot == "K")
    if motions is not None and stiff not in kept:
        kept[stiff] = _left_free([terms[i] for i in stiff], motions)
    return motions is not None and not kept[stiff].shape[1]


def _left_free(stiff: Sequence[Term], motions: np.ndarray) -> np.ndarray:
    """Return the motions that some stiffnesses leave free."""
    Z = motions
    for term in sorted(stiff, key=lambda t: t.matrix.nnz):  # small springs and contacts hold most of them
        Z = Z @ unforced(term.matrix, Z, ROUNDING_OF_FORCES)
    return Z


def _damping(term: Term, key: object, Z: np.ndarray, kept: dict[object, Any]) -> np.ndarray:
    """Return the forces (n, k) of a damper along the motions Z, exactly zero where they are rounding."""
    known = kept.get(key)
    if known is None or known[0] is not Z:
        A = term.matrix
        N = unforced(A, Z, ROUNDING_OF_FORCES)
        kept[key] = known = Z, A @ (Z - Z @ N @ N.T)
    return known[1]
