"""Multiple and defective zeros of motions that nothing holds, in every class: their number must not depend on rounding.

Chains of equal masses and springs, free at both ends, so that each moves as a whole. What breaks: with damping a zero
is a Jordan block, which rounding splits by its root, and a Krylov space has one vector of a multiple eigenvalue.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from dense import all_eigenvalues, companion
from selection import crossed

from fe_squeal.eigen import kernel, shift_invert
from fe_squeal.eigen.dense import DENSE_LIMIT
from fe_squeal.eigen.free_modes import split_off
from fe_squeal.eigen.pencil import FreeMotions, Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes

ALPHA, BETA, ETA = 0.02, 0.01, 0.05
CHAINS = 3


def chain(n):
    k = np.ones(n - 1)
    return sp.diags_array([np.r_[1.0, 2 * np.ones(n - 2), 1.0], -k, -k], offsets=[0, 1, -1])


def single(n, i, j, value):
    return sp.csr_array(([value], ([i], [j])), shape=(n, n))


def dampers(kind, M, K, n):
    """Return C (None without), and how many eigenvalues ν ≠ 0 the free motions have by themselves."""
    N = CHAINS * n
    grounded = single(N, 3, 3, 0.3)
    between = sum(single(N, i, j, 0.2 * s) for i, j, s in ((2, 2, 1), (n, n, 1), (2, n, -1), (n, 2, -1)))
    # Gyroscopic: inside the first chain it drives no free motion, between the chains it couples two of them.
    inside = single(N, 1, 6, 0.1) - single(N, 6, 1, 0.1)
    across = single(N, 1, n + 4, 0.1) - single(N, n + 4, 1, 0.1)
    return {
        "none": None,
        "alpha": ALPHA * M,
        "beta": BETA * K,
        "rayleigh": ALPHA * M + BETA * K,
        "grounded": grounded,
        "between": between + BETA * K,
        "gyroscopic inside": inside,
        "gyroscopic across": across + BETA * K,
    }[kind]


KINDS = ["none", "alpha", "beta", "rayleigh", "grounded", "between", "gyroscopic inside", "gyroscopic across"]


def pencil_of(kind, stiffness, n):
    M = sp.csr_array(sp.diags_array(1.0 + 0.1 * np.sin(np.arange(CHAINS * n))))
    K = sp.csr_array(sp.block_diag([chain(n) * s for s in (1.0, 1.3, 1.7)]))
    C = dampers(kind, M, K, n)
    if stiffness == "friction":  # a force on the second chain and the third by the gap inside the first
        N = CHAINS * n
        for i in (n + 2, 2 * n + 5, 4):
            K = sp.csr_array(K + single(N, i, 7, 0.4) - single(N, i, 8, 0.4))
    if stiffness == "loss":
        K = sp.csr_array(K * (1 + 1j * ETA))
    return Pencil(M, K, None if C is None else sp.csr_array(C), symmetric=stiffness != "friction")


def all_of(pencil):
    """Return all eigenvalues of the linearisation; those that are zero are lost in the root of rounding."""
    L = sp.diags_array(1 / np.sqrt(pencil.M.diagonal()))
    K, C = (None if A is None else L @ A @ L for A in (pencil.K, pencil.C))
    return all_eigenvalues(np.eye(pencil.n), C, K)


@pytest.mark.parametrize(
    ("n", "kind", "stiffness"),
    crossed(
        [12, 134], KINDS, ["symmetric", "friction", "loss"],
        fast=lambda n, kind, stiffness: n == 12 or (kind, stiffness) == ("rayleigh", "friction"),
    ),
)  # fmt: skip
def test_zeros_are_as_many_as_free_motions(monkeypatch, n, kind, stiffness):
    """Three zeros, whatever holds them or not, from any start vector; all other modes are those of LAPACK."""
    pencil = pencil_of(kind, stiffness, n)
    assert (pencil.n > DENSE_LIMIT) == (n == 134)
    every = all_of(pencil)
    # A zero of multiplicity two, the residual of which is rounding, lies within its root.
    other = every[np.abs(every) > 1e-5]
    for seed in (1, 2) if n == 134 else (1,):
        monkeypatch.setattr(shift_invert, "_SEED", seed)
        monkeypatch.setattr(kernel, "_SEED", seed)
        modes = solve_modes(pencil, Request(count=12))
        zero = modes.lam == 0
        assert zero.sum() == CHAINS and set(modes.stability[zero]) == {"marginal"}
        Z = np.kron(np.eye(CHAINS), np.ones((n, 1)))
        inside = Z @ np.linalg.lstsq(Z, modes.right[:, zero], rcond=None)[0]
        np.testing.assert_allclose(inside, modes.right[:, zero], atol=1e-12 * np.abs(inside).max())
        rest = modes.lam[~zero & (modes.lam.imag > 0)]
        assert np.abs(rest[:, None] - other).min(axis=1).max() <= 1e-8
        # The lowest ones are all there: as many up to a clear gap.
        swinging = np.sort(other.imag[other.imag > 1e-9])
        edge = (swinging[3] + swinging[4]) / 2
        if np.diff(swinging[3:5])[0] > 1e-6:
            assert (rest.imag < edge).sum() == 4


@pytest.mark.parametrize("kind", KINDS[1:])
@pytest.mark.parametrize("stiffness", ["symmetric", "friction", "loss"])
def test_split_off_states_are_invariant_and_complete(kind, stiffness):
    """A maps the states that are split off into themselves, from either side; what is left is regular at zero."""
    pencil = pencil_of(kind, stiffness, 12)
    K, C, M = (A.toarray() for A in (pencil.K, pencil.C, pencil.M))
    free = split_off(pencil)
    size = la.norm(K, 2)
    for (u, v), (k, c) in ((free.states, (K, C)), (free.adjoint_states, (K.conj().T, C.T))):
        A = companion(M, c, k)
        S = la.qr(np.vstack([u, v]), mode="economic")[0]
        AS = A @ S
        assert la.norm(AS - S @ (S.conj().T @ AS)) <= 1e-12 * size
        own = la.eigvals(S.conj().T @ AS)
        # All zeros of LAPACK's own spectrum are among them, with their multiplicity.
        assert np.count_nonzero(np.abs(own) < 1e-5) == np.count_nonzero(np.abs(all_of(pencil)) < 1e-5)
    if kind in ("alpha", "rayleigh"):
        np.testing.assert_allclose(np.sort_complex(free.lam), [-ALPHA] * CHAINS + [0] * CHAINS, atol=1e-15)


def test_what_is_given_is_taken(monkeypatch):
    """Motions that are handed over are not looked for; a problem that holds all of them pays for nothing."""
    pencil = pencil_of("rayleigh", "symmetric", 134)
    held = Pencil(pencil.M, sp.csr_array(pencil.K + 1e-3 * pencil.M), pencil.C, True, free=FreeMotions.none(pencil.n))
    monkeypatch.setattr(kernel, "factorize", None)
    modes = solve_modes(held, Request(count=6))
    assert (modes.lam != 0).all() and split_off(held) is None


@pytest.mark.parametrize("soft", [1e-3, 1e-6, 1e-9])
def test_a_soft_hold_is_no_free_motion(soft):
    """A spring far softer than the chain holds it: the mode is slow, not zero, as long as rounding does not hide it."""
    pencil = pencil_of("none", "symmetric", 134)
    K = sp.csr_array(pencil.K + sum(single(pencil.n, 134 * i + 3, 134 * i + 3, soft) for i in range(CHAINS)))
    modes = solve_modes(Pencil(pencil.M, K, symmetric=True), Request(count=6))
    assert (modes.lam != 0).all()
    mass = pencil.M.diagonal().reshape(CHAINS, -1).sum(axis=1)
    np.testing.assert_allclose(np.sort(modes.lam.imag[:3]), np.sort(np.sqrt(soft / mass)), rtol=max(100 * soft, 1e-5))


@pytest.mark.parametrize("C", [None, [0.0, 0.1, 0.2], [0.3, 0.1, 0.2]])
def test_an_unknown_without_any_stiffness(C):
    """Its row of K is empty: nothing cancels in it, and 0/0 is no backward error."""
    M, K = sp.eye_array(3, format="csr"), sp.csr_array(np.diag([0.0, 4.0, 9.0]))
    modes = solve_modes(Pencil(M, K, None if C is None else sp.csr_array(np.diag(C)), True), Request(count=3))
    assert (modes.lam == 0).sum() == 1 and (modes.backward_error <= 1e-15).all()
    c = np.array([0.1, 0.2]) if C else np.zeros(2)
    exact = -c / 2 + 1j * np.sqrt([4.0, 9.0] - c**2 / 4)
    np.testing.assert_allclose(modes.lam[modes.lam.imag > 0], exact, rtol=1e-13)


@pytest.mark.parametrize("alpha", [None, 0.01])
def test_several_unknowns_without_any_stiffness(alpha):
    """Their rows of K are empty, while the inertia couples them to others.

    θ = 0 thrice, then 1, 2, ...: forces in empty rows are zero, and rounding of others must not count as theirs.
    """
    n = DENSE_LIMIT + 50
    D = sp.diags_array(np.r_[np.zeros(3), np.arange(1.0, n - 2)])
    L = sp.csr_array(sp.eye_array(n) + sp.diags_array(0.2 * np.ones(n - 1), offsets=1))
    L = L[:, np.random.default_rng(0).permutation(n)]
    M, K = sp.csr_array(L.T @ L), sp.csr_array(L.T @ D @ L)
    pencil = Pencil(M, K, None if alpha is None else sp.csr_array(alpha * M), symmetric=True)
    assert kernel.find_kernel(pencil).shape[1] == 3
    modes = solve_modes(pencil, Request(count=6))
    assert (modes.lam == 0).sum() == 3 and modes.backward_error.max() <= 1e-12
    exact = np.sqrt(np.arange(1.0, 4.0) - (alpha or 0.0) ** 2 / 4)
    np.testing.assert_allclose(modes.lam.imag[modes.lam.imag > 0][:3], exact, rtol=1e-10)


@pytest.mark.parametrize("size", [20, 300])
@pytest.mark.parametrize("seed", range(2))
def test_two_free_motions_that_gyroscopic_forces_might_couple(size, seed):
    """C has entries between the parts that two free motions move, C z = 0 for each: two defective λ = 0.

    What rounding leaves of z₁ᵀCz₂ is no weight of a left mode, whose uncertainty all other modes would have as well.
    """
    rng = np.random.default_rng(seed)

    def held(z):
        return np.eye(size) - np.outer(z, z) / (z @ z)

    free = rng.standard_normal((2, size))
    B = held(free[0]) @ rng.standard_normal((size, size)) @ held(free[1])
    C = np.block([[np.zeros((size, size)), B], [-B.T, np.zeros((size, size))]])
    parts = []
    for z in free:
        Q = held(z) @ la.qr(rng.standard_normal((size, size)))[0]
        parts.append(Q @ np.diag(np.linspace(1.0, 50.0, size) ** 2) @ Q.T)
    K = la.block_diag(*((A + A.T) / 2 for A in parts))
    modes = solve_modes(Pencil(*map(sp.csr_array, (np.eye(2 * size), K, C))), Request(count=10))
    A = np.block([[np.zeros((2 * size, 2 * size)), np.eye(2 * size)], [-K, -C]])
    exact = np.sort(la.eigvals(A).imag)
    swing = modes.lam != 0
    assert np.count_nonzero(~swing) == 2 and swing.sum() >= 8
    assert (modes.re_uncertainty[swing] <= 1e-9 * np.abs(modes.lam[swing])).all()
    assert np.abs(modes.left[:, ~swing]).max() == 0
    apart = np.abs(modes.lam.imag[swing, None] - exact[None, :]).min(axis=1)
    assert (apart <= 1e-9 * np.abs(modes.lam[swing])).all() and not (modes.stability == "unstable").any()
