"""The projector beside known states of a problem with dampers, against all of its eigenpairs."""

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from fe_squeal.eigen.deflation import Deflation

_N = 6


def _matrices() -> list[np.ndarray]:
    rng = np.random.default_rng(20261201)
    rough = rng.standard_normal((2, _N, _N))
    K = np.diag(np.linspace(1.0, 9.0, _N)) + 0.4 * rough[0]  # friction makes it unsymmetric
    return [np.diag(rng.uniform(0.5, 2.0, _N)), 0.05 * rough[1], K]


def _states(M: np.ndarray, C: np.ndarray, K: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return λ (2n,) by falling |λ| of pairs, and the displacements (n, 2n) of their states."""
    A = np.block([[np.zeros_like(M), np.eye(_N)], [-la.solve(M, K), -la.solve(M, C)]])
    lam, z = la.eig(A)
    order = np.lexsort((lam.imag, -np.abs(lam).round(9)))
    return lam[order], z[:_N, order]


@pytest.mark.parametrize("sigma", [0.7, 0.3 + 2.0j])
@pytest.mark.parametrize("adjoint", [False, True])
def test_known_states_are_taken_out_and_no_others(sigma: complex, adjoint: bool) -> None:
    M, C, K = _matrices()
    own, other = _states(M, C, K), _states(M, C.T, K.T)
    np.testing.assert_allclose(np.sort_complex(own[0]), np.sort_complex(other[0]), rtol=1e-9)
    known = 4  # two pairs of complex ones, whose real and imaginary parts are the states
    assert (own[0].imag != 0).all() and own[0][known - 1] == own[0][known - 2].conj()

    def real(lam: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        u, v = u[:, :known:2], u[:, :known:2] * lam[:known:2]
        return np.hstack([u.real, u.imag]), np.hstack([v.real, v.imag])

    pair = real(*own), real(*other)
    if adjoint:
        C, pair, own = C.T, pair[::-1], other
    shift = np.conj(sigma) if adjoint else sigma
    every = np.arange(_N)
    known_states = Deflation(sp.csr_array(M), sp.csr_array(C.T), shift, every, every, *pair)
    assert all(np.isrealobj(x) for part in known_states._parts for x in part[2:])
    lam, u = own
    z = np.vstack([u, u * lam / shift])  # as the operator has them: λu/σ
    rest = known_states.beside(z)
    np.testing.assert_allclose(rest[:, :known], 0.0, atol=1e-11)
    np.testing.assert_allclose(rest[:, known:], z[:, known:], atol=1e-11)
    mixed = z @ np.random.default_rng(1).standard_normal(2 * _N)
    once = known_states.beside(mixed)
    assert once.shape == mixed.shape
    np.testing.assert_allclose(known_states.beside(once), once, atol=1e-11)
