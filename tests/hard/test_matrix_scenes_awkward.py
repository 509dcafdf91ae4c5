"""Scenes of matrices with massless nodes, multipliers, penalties and unlike units; each docstring says what breaks."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from matrix_scenes import CROWD, KINDS, assert_near, check, run, sites, terms_of, theta, tied
from selection import crossed, some

from fe_squeal.eigen.dense import DENSE_LIMIT
from fe_squeal.eigen.inertia import count_below
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import prove_completeness, solve_modes


@pytest.mark.parametrize(
    ("springs", "crowd", "kind"),
    some([(s, c, k) for s, c in ((2, 0), (2, CROWD), (60, 0)) for k in KINDS],
         lambda s, c, k: (s, c) == (2, 0) or k == "undamped"),
)  # fmt: skip
def test_massless_nodes(tmp_path, springs, crowd, kind):
    """Nodes without mass make M singular: infinite eigenvalues, as finite ones of huge size in usual codes, and a
    Krylov space that ends after as many steps as there are masses: with 60 springs per link 59 of 60 nodes have none.
    Condensed statically, the links have the stiffness GLUE."""
    n = 4
    result = run(tmp_path, terms_of(*sites(n, springs, crowd), kind), {"mu": 0.0}, "mu", 0, 0.9, 3, 2 * n)
    if springs == 60:
        assert result.problem.unknowns > DENSE_LIMIT and (result.problem.pencil().M.diagonal() > 0).sum() == 2 * n
    check(result, n, kind)


@pytest.mark.parametrize(
    ("copies", "damping"), crossed([1, 140], [3.0, 3e3, 3e5], fast=lambda n, d: n == 1 or d > 3)
)
def test_damper_on_a_massless_node(tmp_path, damping, copies):
    """Mass, spring, massless node, dashpot to ground: C turns one infinite eigenvalue into the real −a, far out where
    the dashpot is weak. c, k and k₂ at m = 1 are such that det = c(λ + a)(λ² + bλ + d) with chosen a, b and d."""
    a, b, d = damping * np.linspace(1, 2, copies), 0.2, np.arange(16.0, 16.0 + copies)
    c = b * (a + d / (a + b)) / (a + b)
    k, k2 = c * (a + b), a * d / (a + b)
    # The third unknown is a second massless node that hangs on the first and carries nothing.
    springs = [np.array([[p + q, -p, 0], [-p, p + 1, -1], [0, -1, 1]]) for p, q in zip(k, k2, strict=True)]
    K = sp.block_diag(springs)
    C = sp.block_diag([np.diag([0.0, c_, 0.0]) for c_ in c])
    terms = [("mass", sp.kron(sp.eye_array(copies), np.diag([1.0, 0, 0]))), ("stiffness", K),
             ("damping", C, "powers = { share = 1 }")]  # fmt: skip
    modes = copies if copies == 1 else 8
    start, end = run(tmp_path, terms, {"share": 1.0}, "share", 0, 1, 2, modes).points
    rounding = 1e-12 + 1e-15 * k.max()  # k beside k₂ of order d
    np.testing.assert_allclose(start.modes.lam, 1j * np.sqrt(k2)[:modes], rtol=rounding)  # the node hangs on the mass
    swinging = end.modes.lam[end.modes.lam.imag > 0]
    np.testing.assert_allclose(swinging, (-b / 2 + 1j * np.sqrt(d - b * b / 4))[:modes], rtol=1e-10)
    real = end.modes.lam[end.modes.lam.imag == 0]
    assert all(np.abs(a + x.real).min() <= 1e-9 * a[0] for x in real)
    assert len(real) == 1 or copies > 1
    assert (end.modes.stability == "stable").all()
    assert end.modes.backward_error.max() <= (1e-12 if copies == 1 else 1e-10)


@pytest.mark.parametrize(
    ("crowd", "count", "unit", "sign", "kind"),
    some([(*c, k) for c in ((0, 1, 1.0, 1), (0, 9, 1e6, -1), (CROWD, 12, 1.0, -1), (CROWD, 4, 1e6, 1)) for k in KINDS],
         lambda crowd, n, unit, sign, k: n == 1 or k == "undamped"),
)  # fmt: skip
def test_lagrange_multipliers(tmp_path, crowd, count, unit, sign, kind):
    """Multi-point constraints make K indefinite, with zeros on its diagonal, rows of other units, and infinite
    eigenvalues in Jordan blocks, which rounding splits into finite ones. Exact: here they tie unknowns together again
    that were cut in two."""
    n = 6
    terms = terms_of(*tied(n, np.arange(0, 2 * n, 2 * n / count).astype(int), crowd, unit, sign), kind)
    result = run(tmp_path, terms, {"mu": 0.0}, "mu", 0, 0.9, 3, 2 * n)
    check(result, n, kind)


def test_friction_by_multipliers(tmp_path):
    """Contact by multipliers: columns Bᵀ + μTᵀ of forces, rows B of gaps. Neither is the other's transpose, so that the
    null spaces of both sides differ; exact: Wᵀ(K − θM)N y = 0 with NumPy's orthonormal bases, small and large."""
    rng = np.random.default_rng(8)
    for n, m in ((30, 4), (400, 4)):
        M, K = sp.diags_array(rng.uniform(0.5, 2, n)), sp.diags_array(np.linspace(1.0, 60.0, n))
        K = K + sp.diags_array([-0.3 * np.ones(n - 1)] * 2, offsets=[1, -1])
        B, T = (sp.random_array((m, n), density=4 / n, random_state=rng).tocsr() for _ in range(2))
        B = sp.csr_array(B + sp.csr_array((np.ones(m), (np.arange(m), 5 * np.arange(m) + 1)), shape=(m, n)))
        zero = sp.csr_array((m, m))
        terms = [("mass", sp.block_diag([M, zero])), ("stiffness", sp.block_array([[K, B.T], [B, None]])),
                 ("stiffness", sp.block_array([[sp.csr_array((n, n)), T.T], [None, zero]]),
                  "powers = { mu = 1 }")]  # fmt: skip
        for point in run(tmp_path, terms, {"mu": 0.0}, "mu", 0, 0.6, 2, 12).points:
            N, W = la.null_space(B.toarray()), la.null_space((B + point.value * T).toarray())
            theta = la.eigvals(la.solve(W.T @ (M @ N), W.T @ (K @ N))).astype(complex)
            assert_near(point, np.concatenate([1j * np.sqrt(theta), -1j * np.sqrt(theta)]), 1e-9)
            assert point.modes.backward_error.max() <= 1e-12


@pytest.mark.parametrize(
    ("constraints", "divergent", "massless"),
    some([(0, 5, 0), (0, 5, 25), (1, 0, 0), (7, 5, 0), (7, 0, 25), (40, 0, 0), (40, 5, 25)],
         lambda n, divergent, massless: n > 0 and massless + divergent != 5),
)  # fmt: skip
def test_modes_are_counted_in_spite_of_multipliers(constraints, divergent, massless):
    """The inertia of K − sM counts a negative pivot for each multiplier at every s, and one for each massless node on a
    negative spring; neither is a mode. Divergence far below zero is one, and no search near zero meets it."""
    n, rng = 405, np.random.default_rng(constraints + divergent)
    mass, k = rng.uniform(0.5, 2.0, n), rng.uniform(1.0, 3.0, n + 1)
    mass[3 : 3 + massless] = 0.0
    K = sp.diags_array([k[:-1] + k[1:], -k[1:-1], -k[1:-1]], offsets=[0, 1, -1])
    soft = np.zeros(n)
    soft[5 : 5 + massless // 5] = 20.0
    soft[100 : 100 + 20 * divergent : 20] = 10.0 ** np.arange(1, divergent + 1)
    K = sp.csr_array(K - sp.diags_array(soft))
    at = rng.choice(n, (constraints, 3), replace=False)
    B = sp.csr_array((rng.uniform(0.5, 2, 3 * constraints), (np.repeat(np.arange(constraints), 3), at.ravel())),
                     shape=(constraints, n))  # fmt: skip
    zero = sp.csr_array((constraints, constraints))
    big = sp.csr_array(sp.block_array([[K, B.T], [B, zero]]) if constraints else K)
    pencil = Pencil(sp.csr_array(sp.block_diag([sp.diags_array(mass), zero])), big, symmetric=True)
    N = la.null_space(B.toarray()) if constraints else np.eye(n)
    nu = la.eigvals(la.solve(N.T @ K @ N, N.T @ (mass[:, None] * N)))  # 1/θ, zero for what is no mode
    theta = np.sort(1 / nu.real[np.abs(nu) > 1e-10])
    divergent = int((theta < 0).sum())  # massless nodes on negative springs may bring some of their own
    for omega in (0.0, 0.05, 0.3, 1.0, 2.0):
        assert count_below(pencil, omega) == (theta < omega**2).sum()
    modes = solve_modes(pencil, Request(count=10))
    expected = np.sqrt(-theta[: 10 + divergent].astype(complex))
    expected = np.concatenate([expected[:divergent], -expected[:divergent], 1j * np.abs(expected[divergent:])])
    assert len(modes) == 10 + 2 * divergent and modes.backward_error.max() < 1e-10
    apart = np.abs(modes.lam[:, None] - expected).min(axis=0)
    assert (apart <= 1e-9 * np.maximum(1, np.abs(expected))).all()
    assert (modes.stability == "unstable").sum() == divergent
    proof = prove_completeness(pencil, modes)
    assert proof.proven and proof.found == proof.expected == len(modes)
    slow = [0] if not divergent else np.flatnonzero(np.isin(modes.lam, [modes.lam[0], -modes.lam[0]]))
    for lost in (slow, [len(modes) - 3]):  # the slowest or a divergence of two λ; a fast one
        less = prove_completeness(pencil, modes.select(np.delete(np.arange(len(modes)), lost)))
        assert not less.proven and less.expected == less.found + 1


@pytest.mark.parametrize("crowd", [0, CROWD])
def test_divergence_of_a_constrained_model(tmp_path, crowd):
    """A symmetric sweep K − pM with multipliers: the two lowest θ pass zero at p of their values; the count of modes at
    the start is proven although every multiplier gives a negative pivot."""
    n = 6
    M, K, _ = tied(n, np.arange(0, n, 3), crowd)
    lowest = np.sort(theta(n, 0.0).real)
    far = (lowest[1] + lowest[2]) / 2
    terms = [("mass", M), ("stiffness", K), ("stiffness", M, "powers = { p = 1 }", "scale = -1")]
    result = run(tmp_path, terms, {"p": 0.0}, "p", 0, far, 4, 6)
    assert [o.kind for o in result.onsets] == ["divergence"] * 2 and not result.warnings
    assert [o.value for o in result.onsets] == pytest.approx(lowest[:2], rel=1e-12)
    assert result.completeness.proven and result.completeness.expected == result.completeness.found
    growing = result.points[-1].modes.lam[result.points[-1].modes.stability == "unstable"]
    np.testing.assert_allclose(np.sort(growing), np.sqrt(far - lowest[1::-1]), rtol=1e-10)


# Factors of M, C and K.
UNITS = {
    "SI": (1, 1, 1), "mm, t, s": (1e-3, 1e-3, 1e-3), "light and stiff": (1e-12, 0.1, 1e10), "heavy": (1e9, 1e3, 1e-3),
}  # fmt: skip


@pytest.mark.parametrize(
    ("units", "crowd", "kind"),
    # Modes of a crowd with dampers, which take seconds, in those units that are farthest apart.
    some([(units, crowd, kind) for units in UNITS for crowd in (0, CROWD) for kind in KINDS
          if not crowd or kind != "dashpots" or units in ("light and stiff", "heavy")],
         lambda units, crowd, kind: kind == "undamped" and not crowd),
)  # fmt: skip
def test_units(tmp_path, units, crowd, kind):
    """The same model in other units, and half of the unknowns besides by 10⁵, as rotations beside translations: λ
    changes by √(k/m), onsets do not. Absolute thresholds anywhere would show."""
    m, c, k = UNITS[units]
    n, size = 6, 12 + crowd
    D = sp.diags_array(np.where(np.arange(size) % 4 < 2, 1.0, 1e5))
    M, K, F = (D @ A @ D for A in sites(n, 1, crowd))
    factor = {"mass": m, "damping": c, "stiffness": k}
    terms = [(role, matrix * factor[role], *more) for role, matrix, *more in terms_of(M, K, F, kind)]
    result = run(tmp_path, terms, {"mu": 0.0}, "mu", 0, 0.9, 3, 2 * n)
    check(result, n, kind, rate=np.sqrt(k / m))


@pytest.mark.parametrize(
    ("crowd", "kind", "penalty"),
    some([(crowd, kind, p) for crowd in (0, CROWD) for kind in KINDS for p in (1e14, 1e20, 1e36)
          if not crowd or kind != "dashpots" or p != 1e20],
         lambda crowd, k, p: p == 1e36 and (not crowd or k == "undamped")),
)  # fmt: skip
def test_penalties(tmp_path, crowd, kind, penalty):
    """Unknowns fixed by penalties, 10³⁶ in one common code: shifts and pivots relative to the largest entry are blind
    to all others then. Two more sites stand between the model and the ground, held so; exact up to GLUE²/penalty."""
    n = 6
    M, K, F = sites(n + 2, 1, crowd)
    ends = np.r_[0, 1, 2 * n + 2, 2 * n + 3]
    K = sp.csr_array(K + sp.csr_array((np.full(4, penalty), (ends, ends)), shape=K.shape))
    result = run(tmp_path, terms_of(M, K, F, kind), {"mu": 0.0}, "mu", 0, 0.9, 3, 2 * n)
    check(result, n, kind)


def roots(m: np.ndarray, c: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Return all λ of Im λ ≥ 0 of mλ² + cλ + k; the small real one as k/(m λ_large), without cancellation."""
    found: list[complex] = []
    for m_, c_, k_ in zip(m, c, k, strict=True):
        d = c_ * c_ - 4 * m_ * k_
        large = -(c_ + np.sqrt(max(d, 0.0))) / 2
        found += [large / m_, k_ / large] if d >= 0 else [complex(-c_, np.sqrt(-d)) / (2 * m_)]
    return np.array(found, complex)


@pytest.mark.parametrize(
    ("m", "c", "k"),
    [(1, (1e3, 1e3), 1), (1, (1e9, 1e9), 1), (1e-6, (1e-3, 1e-3), 1e12), (1e-6, (1e6, 1e6), 1e12), (1, (1e-2, 1e6), 1),
     (1e-6, (1e-3, 1e9), 1e12)],
)  # fmt: skip
def test_overdamped(m, c, k):
    """|C|² ≫ |M||K|: creeping λ ≈ −k/c and fast ones −c/m in one spectrum, up to 10¹⁸ apart, of which a linearisation
    in one unit keeps one kind; a creeping mode is not a rigid one. M, C, K share a random orthogonal basis."""
    n, rng = 40, np.random.default_rng(3)
    Q = la.qr(rng.standard_normal((n, n)))[0]
    values = m * rng.uniform(0.5, 2, n), np.geomspace(*c, n) * rng.uniform(0.9, 1.1, n), k * rng.uniform(0.5, 2, n)
    M, C, K = (sp.csr_array((A + A.T) / 2) for A in ((Q * x) @ Q.T for x in values))
    modes, expected = solve_modes(Pencil(M, K, C, symmetric=True), Request(count=2 * n)), roots(*values)
    assert len(modes) == len(expected) and modes.backward_error.max() <= 1e-12
    error = np.abs(modes.lam[:, None] - expected)
    near = error.argmin(axis=0)
    assert len(set(near)) == len(near)
    # What rounding of M, C, K themselves moves: some ε times the condition number of each.
    error = error[near, np.arange(len(near))] / np.abs(expected)
    assert (error <= 1e-14 + 1e3 * np.finfo(float).eps * modes.condition[near]).all()
    assert error.max() < 1e-9 and (modes.stability == "stable").all()
