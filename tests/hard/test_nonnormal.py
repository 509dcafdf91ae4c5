"""Large friction, heavy damping, crowded bands: spectra of matrices that are far from normal.

See tests/hard/test_modes_in_sight.py and test_matrix_scenes_awkward.py for overdamped modes of diagonal and turned
matrices, and for massless unknowns.
"""

from __future__ import annotations

import functools

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from dense import all_eigenvalues
from hard_problems import MIDDLE, SMALL, brake, digits, judged, matrices, plain_eigs, through_files
from selection import crossed

import fe_squeal
from fe_squeal.eigen.dense import DENSE_LIMIT
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import prove_completeness, solve_modes
from meshes import STEEL, box, join, make_problem

plain_brake = functools.cache(brake)


@pytest.mark.parametrize("through", ["mesh", "files"])
@pytest.mark.parametrize(("refined", "mu"), [(False, 1.0), (False, 2.0), (False, 5.0), (True, 5.0)])
def test_large_friction(tmp_path, record, refined, through, mu):
    """Friction as strong as the contact stiffness and more: right and left modes have nothing in common, a projection
    on modes of μ = 0 is off by tens of percents, and Re λ has a condition number of 10 and more."""
    problem = plain_brake(MIDDLE if refined else SMALL)
    problem = through_files(problem, tmp_path) if through == "files" else problem
    pencil = problem.pencil(mu=mu)
    modes = solve_modes(pencil, Request(count=16))
    theta = la.eigvals(la.solve(pencil.M.toarray(), pencil.K.toarray(), assume_a="pos")).astype(complex)
    exact = np.concatenate([1j * np.sqrt(theta), -1j * np.sqrt(theta)])
    near = exact[np.abs(modes.lam[:, None] - exact).argmin(axis=1)]
    np.testing.assert_allclose(modes.lam, near, rtol=1e-8)
    below = exact[(exact.imag > 1e-6 * np.abs(exact)) & (np.abs(exact) < 0.999 * np.abs(modes.lam).max())]
    assert (np.abs(below[:, None] - modes.lam).min(axis=1) <= 1e-8 * np.abs(below)).all()
    growing = near.real > 1e-6 * np.abs(near)
    assert (modes.stability == np.where(growing, "unstable", np.where(near.real < -1e-6 * np.abs(near), "stable",
                                                                      "marginal"))).all()  # fmt: skip
    # Left modes: ψᴴQ(λ) = 0, and biorthogonal to the right ones.
    residual = pencil.transposed().apply(modes.lam.conj(), modes.left)
    size = pencil.transposed().magnitude(modes.lam.conj(), modes.left)
    assert (la.norm(residual, axis=0) <= 1e-10 * la.norm(size, axis=0)).all()
    gram = modes.left.conj().T @ (pencil.M @ modes.right)
    mirror = np.abs(modes.lam[:, None] ** 2 - modes.lam[None, :] ** 2) <= 1e-9 * np.abs(modes.lam[:, None]) ** 2
    lengths = np.sqrt(np.einsum("ij,ij->j", modes.left.conj(), pencil.M @ modes.left).real)
    assert (np.abs(gram[~mirror]) / np.broadcast_to(lengths[:, None], gram.shape)[~mirror]).max() < 1e-7
    record(digits(modes.lam, near), "right, left and verdicts", *judged(plain_eigs(pencil, 16), near))


@pytest.mark.slow
@pytest.mark.parametrize("mu", [0.5, 2.0])
def test_modal_projection_is_off_at_large_friction(record, mu):
    """The usual projection on 16 modes without friction says something else than the full model, in growth rates and
    in what is unstable. It is offered as `modal`, with its error told."""
    problem = plain_brake(SMALL)
    result = fe_squeal.sweep(problem, [0.0, mu], modes=16, method="modal")
    full = solve_modes(problem.pencil(mu=mu), Request(count=16)).lam
    reduced = fe_squeal.sweep(problem, [0.0, mu], modes=16, method="reduced", tolerance=1e-11).points[-1].modes.lam
    modal = result.points[-1].modes.lam
    off = np.abs(full[:12, None] - modal).min(axis=1) / np.abs(full[:12])
    assert off.max() > 1e-3 and any("modal projection" in d for d in result.warnings)
    assert (np.abs(full[:12, None] - reduced).min(axis=1) <= 1e-7 * np.abs(full[:12])).all()
    record(digits(reduced, full[:12]), "the reduced model keeps the tolerance; `modal` tells its error",
           digits(modal, full[:12]), 0.0, "(here: the projection on modes of μ = 0)")  # fmt: skip


@pytest.mark.parametrize(("copies", "ratio"), crossed(
    [1, 300], [0.5, 0.99, 1 - 1e-8, 1.0, 1 + 1e-8, 1.01, 5.0, 1e3],
    fast=lambda copies, ratio: copies == 1 or ratio in (0.5, 1.0),
))  # fmt: skip
def test_critical_damping(tmp_path, record, copies, ratio):
    """λ² + 2Dλ + 1 around D = 1: at critical damping λ = −1 is double and defective, rounding makes it swing at 1e-8 or
    puts it apart; with large D one of the two creeps. Every one decays; none may be marginal, rigid or growing."""
    omega = np.linspace(1.0, 2.0, copies)
    M, K, C = sp.eye_array(copies), sp.diags_array(omega**2), sp.diags_array(2 * ratio * omega)
    terms = [("mass", M), ("stiffness", K), ("damping", C)]
    if copies == 1:  # a second mode that swings, for there to be something to ask for
        swings = (1.0, 9.0, 0.06)
        terms = [(r, sp.block_diag([A, sp.csr_array([[x]])])) for (r, A), x in zip(terms, swings, strict=True)]
    problem = matrices(tmp_path, terms)
    modes = solve_modes(problem.pencil(), Request(count=600))
    assert (modes.stability == "stable").all()
    root = np.sqrt(complex(ratio**2 - 1))
    exact = np.concatenate([omega * (-ratio + root), omega * (-ratio - root)])
    # Near D = 1 by the square root of rounding, the creeping one to cancellation in D − √(D² − 1).
    blur = min(1e-15 / max(abs(ratio - 1), 1e-30) ** 0.5, 1e-7) + 1e-12
    if ratio > 1:
        exact[:copies] = -omega / (ratio + root)
    exact = exact[exact.imag >= 0]
    found = modes.lam[np.abs(modes.lam.imag - 3) > 0.1] if copies == 1 else modes.lam
    assert (np.abs(found[:, None] - exact).min(axis=1) <= 10 * blur * np.abs(found) + 1e-13).all()
    kept = digits(found, exact)
    assert kept > 6  # and none is missing
    asked = judged(plain_eigs(problem.pencil(), 8), exact[:1]) if copies > 1 and ratio < 1 else ()
    record(kept, "stable, all of them", *asked)


def test_brake_with_heavy_rayleigh_damping(record):
    """α and β so large that slow and fast modes are both overdamped, by closed form from the undamped ones: λ² + (α +
    βω²)λ + ω² = 0, one band that swings between real λ on both sides."""
    alpha, beta = 5e5, 3e-5
    problem = brake(SMALL, mu=0.0, effects={"rayleigh": {"alpha": alpha, "beta": beta}})
    pencil = problem.pencil(mu=0.0)
    modes = solve_modes(pencil, Request(count=2 * pencil.n))
    # β acts on the elastic stiffness alone, so the references are linearisations by LAPACK: of λ for the fast ones,
    # and of 1/λ for the slow ones, since its errors are those of the largest eigenvalue.
    unit = 1e6
    fast = all_eigenvalues(pencil.M, pencil.C, pencil.K, unit)
    slow = 1 / all_eigenvalues(pencil.K, pencil.C, pencil.M, 1 / unit)
    real = modes.lam[modes.lam.imag == 0]
    assert len(real) > pencil.n and (modes.stability == "stable").all()
    away = np.minimum(*(np.abs(modes.lam[:, None] - exact).min(axis=1) for exact in (fast, slow)))
    assert (away <= 1e-7 * np.abs(modes.lam)).all() and modes.backward_error.max() < 1e-10
    record(-np.log10((away / np.abs(modes.lam)).max()), "all real and swinging modes, stable")


@pytest.mark.slow
@pytest.mark.parametrize("spread", [0.0, 1e-9, 1e-4])
def test_hundreds_of_modes_in_a_band(record, spread):
    """Sixty equal blocks on a foundation: every frequency comes sixty times, or within 1e-4. Krylov spaces see one of
    equal eigenvalues, counts cut through clusters, and `eigs` wants a number that nobody knows."""
    blocks = [box("hex1", (1, 1, 1), (0.02, 0.02, 0.02), (0.03 * i, 0.0, 0.0), name=f"b{i}") for i in range(60)]
    materials = {f"m{i}": {**STEEL, "youngs_modulus": 2e11 * (1 + spread * i / 60)} for i in range(60)}
    problem = make_problem(
        join(*blocks), order=1, materials=materials, bodies={f"b{i}": {"material": f"m{i}"} for i in range(60)},
        supports=[{"surface": f"bottom_b{i}", "fixed": "xyz"} for i in range(60)],
    )  # fmt: skip
    pencil = problem.pencil()
    modes = solve_modes(pencil, Request(count=190))
    theta = la.eigh(pencil.K.toarray(), pencil.M.toarray(), eigvals_only=True)[: len(modes)]
    exact = 1j * np.sqrt(theta)
    np.testing.assert_allclose(modes.lam, exact, rtol=1e-9)
    assert len(modes) == 190 and set(modes.stability) == {"marginal"}
    proof = prove_completeness(pencil, modes)
    assert proof.found == (proof.expected or proof.found)
    record(digits(modes.lam, exact), "every one of them", *judged(plain_eigs(pencil, 190), exact))


@pytest.mark.parametrize("power", [0, 6, 12])
def test_skew_coefficient_much_larger_than_the_rest(record, power):
    """Gyroscopic terms 10⁶ and 10¹² times √(KM): pairs at ±ig and slow ones at ±ik/g, 24 powers of ten apart, with
    no growth at all. A linearisation in one unit makes the slow ones grow. λ² m + λ g J + k: g/2 ± √(g²/4 + k)."""
    n, g = 30, 10.0**power
    rng = np.random.default_rng(6)
    k = np.repeat(rng.uniform(1.0, 2.0, n), 2)
    G = sp.kron(sp.eye_array(n), np.array([[0.0, g], [-g, 0.0]]))
    Q = la.block_diag(*[la.qr(rng.standard_normal((2, 2)))[0] for _ in range(n)])
    pencil = Pencil(sp.eye_array(2 * n, format="csr"), sp.csr_array(Q @ np.diag(k) @ Q.T), sp.csr_array(Q @ G @ Q.T))
    modes = solve_modes(pencil, Request(count=4 * n))
    fast = g / 2 + np.sqrt(g**2 / 4 + k[::2])
    exact = 1j * np.concatenate([fast, k[::2] / fast])
    assert len(modes) == 2 * n and set(modes.stability) == {"marginal"}
    away = np.abs(modes.lam[:, None] - exact).min(axis=1)
    assert (away <= 1e-9 * np.abs(modes.lam)).all()
    record(digits(modes.lam, exact), "no growth, slow and fast", *judged(plain_eigs(pencil, 10), 1j * k[::2] / fast))


def test_pencil_beyond_the_dense_limit_with_singular_mass_and_friction(record):
    """Half of the unknowns without mass, friction between these and the others, M singular: K⁻¹M has a null space of
    half its size. Exact: the massless ones eliminated by hand."""
    n, rng = DENSE_LIMIT + 80, np.random.default_rng(12)
    k = rng.uniform(1.0, 3.0, n + 1)
    K = sp.diags_array([k[:-1] + k[1:], -k[1:-1], -k[1:-1]], offsets=[0, 1, -1]).tocsr()
    places = np.arange(21, n - 20, 40)
    K = K + sp.csr_array((np.full(len(places), 1.2), (places, places + 1)), shape=(n, n))
    mass = np.where(np.arange(n) % 2 == 0, rng.uniform(0.5, 2.0, n), 0.0)
    pencil = Pencil(sp.csr_array(sp.diags_array(mass)), sp.csr_array(K))
    modes = solve_modes(pencil, Request(count=12))
    A, heavy, light = K.toarray(), mass > 0, mass == 0
    S = A[np.ix_(heavy, heavy)] - A[np.ix_(heavy, light)] @ la.solve(A[np.ix_(light, light)], A[np.ix_(light, heavy)])
    theta = la.eigvals(S / mass[heavy][:, None]).astype(complex)
    exact = np.concatenate([1j * np.sqrt(theta), -1j * np.sqrt(theta)])
    near = exact[np.abs(modes.lam[:, None] - exact).argmin(axis=1)]
    assert (np.abs(modes.lam - near) <= 1e-9 * np.abs(near) + modes.re_uncertainty).all()
    assert len(modes) >= 12
    record(digits(modes.lam, near), "none of the infinite ones", *judged(plain_eigs(pencil, 12), near))
