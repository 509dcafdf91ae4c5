"""What takes known states out of a shift-inverted operator: the spectral projector beside them."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from .blocks import cross, lift
from .free_modes import States


class Deflation:
    """z ↦ z − S (LᴴS)⁻¹ Lᴴz for invariant states S = (u, v/σ) of λ²M + λC + K, with left vectors L.

    A state (a, b) of the adjoint problem belongs to the left vectors L = (Cᵀa + Mb, σ*Ma). The shift σ cancels in LᴴS,
    and all arrays of real states stay real where σ is complex. Without C, S = u and L = Ma.

    Parameters
    ----------
    M : (n, n) sparse
    transposed : (n, n) sparse or None
        Cᵀ.
    sigma : float or complex
        The shift.
    active, mass : (a,), (m,) int
        The unknowns whose displacements, and whose velocities, the operator has.
    own, other : States
        Invariant states of the problem and of the adjoint one.
    """

    def __init__(
        self, M: sp.csr_array, transposed: sp.csr_array | None, sigma: complex, active: np.ndarray, mass: np.ndarray,
        own: States, other: States,
    ) -> None:  # fmt: skip
        (u, v), (a, b) = own, other
        self._parts: list[tuple[slice, complex, np.ndarray, np.ndarray]]
        if transposed is None:
            self._parts = [(slice(None), 1.0, u[active], lift(M, a)[active])]
        else:
            above, below = slice(len(active)), slice(len(active), None)
            momentum = (lift(transposed, a) + lift(M, b))[active]
            self._parts = [(above, 1.0, u[active], momentum), (below, sigma, v[mass], lift(M, a)[mass])]
        # States and left vectors get unit length, since the pseudoinverse takes what is short beside others for zero.
        size = np.sqrt(sum((np.linalg.norm(S, axis=0) / abs(f)) ** 2 for _, f, S, _ in self._parts))
        size_left = np.sqrt(sum((np.linalg.norm(L, axis=0) * abs(f)) ** 2 for _, f, _, L in self._parts))
        gram = sum(cross(L.conj(), S) for _, _, S, L in self._parts)
        self._inverse = np.linalg.pinv(gram / np.outer(size_left, size)) / np.outer(size, size_left)

    def beside(self, z: np.ndarray) -> np.ndarray:
        """Return columns z (s,) or (s, b) of the operator without their parts in the known states."""
        columns = z.reshape(len(z), -1)
        inside = sum(factor * cross(L.conj(), columns[rows]) for rows, factor, _, L in self._parts)
        share = lift(self._inverse, np.asarray(inside))
        rest = [columns[rows] - lift(S, share) / factor for rows, factor, S, _ in self._parts]
        return np.concatenate(rest).reshape(z.shape)
