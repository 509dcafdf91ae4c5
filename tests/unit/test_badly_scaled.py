"""Pencils with unknowns of unlike units or without mass, with and without structural damping, against NumPy."""

import numpy as np
import pytest
import scipy.linalg as la
from pencils import chain, definite, distance, reference, sparse

from fe_squeal.eigen.dense import solve_dense
from fe_squeal.eigen.pencil import Pencil


def scaled(case, damping, eta):
    """A chain of 40 with one thing that makes the plain linearisation inaccurate; dashpots of its own pattern."""
    rng = np.random.default_rng(7)
    n = 40
    base = chain(0.3, n=n, eta=0.0)
    M, K = base.M.toarray(), base.K.toarray().real
    K = K * (1 + 1j * eta) if eta else K
    C = damping * (definite(rng, n) + np.diag(rng.uniform(0, 1, n)))
    if case == "light":
        M = M * np.where(np.arange(n) % 3, 1.0, 1e-10)
    if case in ("massless", "massless, mixed units"):
        M = M * np.where(np.arange(n) % 3, 1.0, 0.0)
    if case in ("mixed units", "massless, mixed units"):
        d = 10.0 ** rng.uniform(-6, 6, n)
        M, C, K = (d[:, None] * A * d for A in (M, C, K))
    if case == "heavy":
        M, C = 1e12 * M, 1e6 * C
    if case == "light and stiff":
        M, K = 1e-12 * M, 1e12 * K
    if case == "two dashpots":
        C = damping * np.diag(np.where(np.isin(np.arange(n), [3, 20]), 1e7, 0.0))
    return Pencil(sparse(M), sparse(K), sparse(C) if damping else None)


@pytest.mark.parametrize("eta", [0.0, 0.05])
@pytest.mark.parametrize(
    ("case", "damping"),
    [(c, d) for c in ("light", "massless", "mixed units", "massless, mixed units", "heavy", "light and stiff")
     for d in (0.0, 0.1)] + [("two dashpots", 0.1), ("as it is", 1e12), ("as it is", 1e-12)],
)  # fmt: skip
def test_badly_scaled_pencils_keep_their_accuracy(case, damping, eta):
    pencil = scaled(case, damping, eta)
    modes = solve_dense(pencil)
    assert modes.backward_error.max() < 2e-11
    expected = 26 if case.startswith("massless") else 40
    # Dashpots overdamp some: with loss one of the two real λ goes to the lower half plane.
    assert len(modes) == expected if not damping else len(modes) >= 26


@pytest.mark.parametrize("eta", [0.0, 0.05])
@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_units_do_not_change_the_modes(eta, damping):
    """Mixed units are a change of variables u = Dv: λ is that of the plain matrices, by NumPy."""
    plain, mixed = scaled("as it is", damping, eta), scaled("mixed units", damping, eta)
    expected = reference(plain)
    expected, found = (x[np.abs(x.real) < x.imag] for x in (expected, solve_dense(mixed).lam))
    assert len(found) == len(expected) and distance(expected, found) < 1e-10


def test_equal_eigenvalues_of_a_symmetric_massless_pencil_stay_real():
    """Six equal chains in turned coordinates: QZ would split their equal eigenvalues into complex pairs."""
    n = 24
    turn = la.qr(np.random.default_rng(3).standard_normal((6 * n, 6 * n)))[0]
    one = np.diag(np.arange(n) % 3 > 0), chain(n=n, eta=0.0).K.real.toarray()
    M, K = (turn.T @ np.kron(np.eye(6), A) @ turn for A in one)
    M, K = M + M.T, K + K.T
    modes = solve_dense(Pencil(sparse(M), sparse(K), symmetric=True))
    assert len(modes) == 96 and (modes.lam.real == 0).all()
    np.testing.assert_allclose(modes.lam.imag[::6], modes.lam.imag[5::6], rtol=1e-12)
    mass = modes.left.conj().T @ M @ modes.right
    np.testing.assert_allclose(mass, np.eye(96), atol=1e-11)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_massless_unknowns_are_condensed(friction):
    """Undamped unknowns without mass carry no mode: the others have those of the statically condensed stiffness."""
    pencil = chain(friction, n=45, eta=0.05)
    K, rest = pencil.K.toarray(), np.arange(45) % 3 > 0
    M = pencil.M.toarray() * rest
    for stiffness, symmetric in ((K, not friction), (K.real, not friction)):
        modes = solve_dense(Pencil(sparse(M), sparse(stiffness), symmetric=symmetric))
        S = stiffness[np.ix_(rest, rest)] - stiffness[np.ix_(rest, ~rest)] @ la.solve(
            stiffness[np.ix_(~rest, ~rest)], stiffness[np.ix_(~rest, rest)]
        )
        expected = 1j * np.sqrt(la.eigvals(S, M[np.ix_(rest, rest)]).astype(complex))
        assert len(modes) == 30
        assert distance(modes.lam, expected) < 1e-10 and distance(expected, modes.lam) < 1e-10
