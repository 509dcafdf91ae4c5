"""The time that SciPy takes for the right modes at one value, with its own factors."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, eigs, splu

_BELOW = 2 * np.pi * 100.0  # ω, rad/s: problems without dampers get the real shift −ω²
_SHIFTS = 1 / 6, 1 / 2, 5 / 6  # of the band: shifts on the imaginary axis, for dampers or complex stiffness
_MORE = 10  # modes asked for at each of these shifts, in addition to half of all modes


def scipy_modes(pencil: Any, modes: int, band: float) -> tuple[float, np.ndarray]:
    """Return the CPU seconds that SciPy takes, and the λ it finds, rad/s.

    Parameters
    ----------
    pencil : fe_squeal.eigen.pencil.Pencil
    modes : int
        Wanted.
    band : float, rad/s
        Highest frequency wanted; with dampers the three shifts are inside this band.
    """
    start = time.process_time()
    if pencil.C is None and not pencil.is_complex:
        theta = eigs(
            sp.csc_array(pencil.K),
            modes,
            sp.csc_array(pencil.M),
            sigma=-(_BELOW**2),
            return_eigenvectors=True,
            tol=1e-8,
        )[0]
        return time.process_time() - start, 1j * np.sqrt(theta.astype(complex))
    found = [_around(pencil, 1j * s * band, modes // 2 + _MORE) for s in _SHIFTS]
    return time.process_time() - start, np.concatenate(found)


def _around(pencil: Any, shift: complex, count: int) -> np.ndarray:
    """Return the λ nearest to a shift, by Arnoldi iteration on the companion form with the factors of Q(shift)."""
    n, M = pencil.n, pencil.M
    C = sp.csr_array((n, n)) if pencil.C is None else pencil.C
    factor = splu(sp.csc_array(shift**2 * M + shift * C + pencil.K))

    def inverse(z: np.ndarray) -> np.ndarray:
        """(A − shift·B)⁻¹ B z of A = [[0, 1], [−K, −C]], B = diag(1, M)."""
        u, w = z[:n], z[n:]
        x = -factor.solve(M @ w + (C @ u) + shift * (M @ u))
        return np.concatenate([x, u + shift * x])

    operator = LinearOperator((2 * n, 2 * n), matvec=inverse, dtype=complex)
    nu = eigs(operator, count, tol=1e-10)[0]
    return np.asarray(shift + 1 / nu)
