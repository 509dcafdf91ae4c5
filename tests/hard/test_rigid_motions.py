"""Free bodies, mechanisms, pads that only friction holds, and shifts that hit an eigenvalue.

See tests/analytic/test_rigid_modes.py for free bodies without contact.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from hard_problems import LINING, MIDDLE, SMALL, brake, digits, judged, plain_eigs, through_files
from selection import crossed, some

import fe_squeal
from fe_squeal.eigen.dense import DENSE_LIMIT
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.shift import BELOW
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.errors import NotConvergedError
from fe_squeal.sweep.roots import Roots
from meshes import BELT, box, join, make_problem, modes_of, rigid_motions

SIDES = (0.08, 0.04, 0.02)
SOFT = 1e7  # N/m per m^2: 1e-4 of the pad's own stiffness, so that it moves as a rigid body


def loose_pad(counts, mu=0.0, **more):
    """Return a pad that lies on a belt and is held by nothing but the contact."""
    contact = {"surface": "bottom", "counterface": "rigid", "normal_stiffness": SOFT, "sliding": BELT}
    return make_problem(
        box("hex2", counts, SIDES, (-SIDES[0] / 2, -SIDES[1] / 2, 0.0)), materials={"lining": LINING},
        contacts=[contact], effects={"friction": {"mu": mu}}, **more,
    )  # fmt: skip


@pytest.mark.parametrize("mu", [0.0, 0.5, 3.0])
@pytest.mark.parametrize("counts", [(2, 1, 1), (6, 4, 2)])
@pytest.mark.parametrize("through", ["mesh", "files"])
def test_pad_held_by_friction_alone(tmp_path, record, through, counts, mu):
    """Sliding friction holds nothing: three motions along the belt stay free at every μ, and K is singular and
    nonsymmetric, so that a shift at 0 fails and the zeros come out as pairs ±1e-3. The other three are those of a
    rigid block: lift k A/m, roll k I_x/J_x, and pitch with the moment of friction, coupled with the lift by μ."""
    problem = loose_pad(counts)
    problem = through_files(problem, tmp_path) if through == "files" else problem
    pencil = problem.pencil(mu=mu)
    modes = solve_modes(pencil, Request(count=8))
    assert (modes.lam[:3] == 0).all() and set(modes.stability[:3]) == {"marginal"}
    # By hand: motions (z, θ_y) of the mass centre at height h/2, gap = z − x θ_y, friction moment about y: −μ N h/2.
    (a, b, h), rho = SIDES, LINING["density"]
    m, area = rho * a * b * h, a * b
    jx, jy = m * (b**2 + h**2) / 12, m * (a**2 + h**2) / 12
    k = SOFT * np.diag([area, area * a**2 / 12])
    k[1, 0] = mu * h / 2 * SOFT * area  # pitch by the force N = −k A z at the foot
    theta = np.append(la.eigvals(k, np.diag([m, jy])), SOFT * area * b**2 / 12 / jx)
    exact = 1j * np.sqrt(theta.astype(complex))
    found = modes.lam[3:6]
    assert (np.abs(found[:, None] - exact).min(axis=1) <= 2e-2 * np.abs(found)).all()  # the pad is not quite rigid
    # Rayleigh's quotients of rigid motions on the assembled matrices are those by hand to rounding.
    problem = loose_pad(counts)
    R = rigid_motions(problem)
    x = R - 0.0
    x[:, 3] -= h / 2 * R[:, 1] * -1  # turn about axes through the mass centre
    x[:, 4] -= h / 2 * R[:, 0]
    K, M = x.T @ (problem.pencil(mu=mu).K @ x), x.T @ (problem.pencil(mu=mu).M @ x)
    np.testing.assert_allclose(np.sort(la.eigvals(K[2:5, 2:5], M[2:5, 2:5]).real), np.sort(theta.real), rtol=1e-9)
    record(digits(found, exact), "three zeros, marginal; 2 % is the pad's own elasticity",
           *judged(plain_eigs(pencil, 6), exact))  # fmt: skip


@pytest.mark.parametrize(
    ("counts", "method"), some([(SMALL, "direct"), (SMALL, "reduced"), (MIDDLE, "reduced")],
                               lambda counts, method: counts == SMALL and method == "reduced"),
    ids=["dense", "dense reduced", "sparse reduced"],
)  # fmt: skip
def test_divergence_beside_a_rigid_motion(record, counts, method):
    """One inclined spring leaves the pad free across it, while friction makes other motions diverge. K is singular at
    every μ, so that det K = 0 tells nothing and Newton's method has no regular border; projected, the zero comes out as
    ±1 rad/s, unstable at half of the values."""
    inclined = {"name": "piston", "surface": "top_pad", "direction": [0.3, 0.1, 1.0], "stiffness": 2e8}
    problem = brake(counts, springs=[inclined])
    result = fe_squeal.sweep(problem, np.linspace(0.0, 0.5, 6), modes=10, method=method)
    assert len(result.warnings) == 1 and "1 of the modes are rigid motions" in result.warnings[0]
    for point in result.points:
        zero = point.modes.lam == 0
        assert zero.sum() == 1 and point.modes.stability[zero][0] == "marginal"
    last = result.points[-1].modes
    pencil = problem.pencil(mu=0.5)
    theta = la.eigvals(la.solve(pencil.M.toarray(), pencil.K.toarray(), assume_a="pos"))
    exact = np.concatenate([s * 1j * np.sqrt(theta.astype(complex)) for s in (1, -1)])
    rest = last.lam[last.lam != 0]
    near = exact[np.abs(rest[:, None] - exact).argmin(axis=1)]
    np.testing.assert_allclose(rest, near, rtol=1e-8)
    # At each divergence one θ passes zero with the slope −c²: LAPACK beside it, where rounding is less than that.
    found = [o for o in result.onsets if o.kind == "divergence"]
    assert len(found) == 2 == (last.stability[last.lam.imag == 0] == "unstable").sum()
    M = pencil.M.toarray()
    for onset in found:
        for step in (-1e-5, 1e-5)[: 1 if counts == MIDDLE else 2]:
            theta = la.eigvals(la.solve(M, problem.pencil(mu=onset.value + step).K.toarray(), assume_a="pos"))
            slope = -(onset.crossing_speed**2)
            assert np.abs(theta - slope * step).min() <= 1e-2 * abs(slope * step)
    record(digits(rest, near), "the zero stays zero, both divergences are found", *judged(plain_eigs(pencil, 10), near))


def test_divergence_beside_a_rigid_motion_is_bisected(monkeypatch):
    """Where Newton's method fails, the rigid motion must neither count as growing in the reduced model, in which λ = 0
    is blurred, nor, as the slowest mode, say how fast the others may grow."""

    def fail(self, change):
        raise NotConvergedError("Newton's method")

    inclined = {"name": "piston", "surface": "top_pad", "direction": [0.3, 0.1, 1.0], "stiffness": 2e8}
    problem, values = brake(SMALL, springs=[inclined]), np.linspace(0.3, 0.35, 2)
    by_newton = fe_squeal.sweep(problem, values, modes=10, method="direct").onsets
    monkeypatch.setattr(Roots, "of", fail)
    result = fe_squeal.sweep(problem, values, modes=10, method="reduced")
    assert len(result.warnings) == 1 and "1 of the modes are rigid motions" in result.warnings[0]
    assert [o.kind for o in result.onsets] == [o.kind for o in by_newton] == ["divergence"] * 2
    for onset, exact in zip(result.onsets, by_newton, strict=True):
        assert abs(onset.value - exact.value) <= onset.uncertainty + exact.uncertainty <= 1e-6


@pytest.mark.parametrize(
    ("method", "effects"),
    crossed(
        ["direct", "reduced"], ["rayleigh", "beta", "loss", "slip"],
        fast=lambda method, effects: (method, effects) == ("reduced", "rayleigh"),
    ),
)  # fmt: skip
def test_damped_pad_held_by_friction_alone(method, effects):
    """Three free motions at every μ, by both ways, whatever damps the pad; −α three times where mass does."""
    rayleigh = {"alpha": 20.0 if effects == "rayleigh" else 0.0, "beta": 1e-7}
    more = {
        "rayleigh": {"rayleigh": rayleigh}, "beta": {"rayleigh": rayleigh},
        "loss": {"structural_damping": {}}, "slip": {"friction_damping": {"contact_pressure": 1e5}},
    }[effects]  # fmt: skip
    lining = {"lining": {**LINING, "loss_factor": 0.02 if effects == "loss" else 0.0}}
    contact = {"surface": "bottom", "counterface": "rigid", "normal_stiffness": SOFT, "sliding": BELT}
    mesh = box("hex2", (4, 2, 2), SIDES, (-SIDES[0] / 2, -SIDES[1] / 2, 0.0))
    problem = make_problem(mesh, materials=lining, contacts=[contact], effects={"friction": {"mu": 0.3}, **more})
    assert problem.unknowns > DENSE_LIMIT
    result = fe_squeal.sweep(problem, [0.2, 0.3], modes=8, method=method)
    assert "3 of the modes are rigid motions" in result.warnings[0]
    for point in result.points:
        lam = point.modes.lam
        assert (lam == 0).sum() == 3 and set(point.modes.stability[lam == 0]) == {"marginal"}
        if effects == "rayleigh":
            assert np.count_nonzero(np.abs(lam + 20.0) < 1e-6) == 3


def test_free_motions_that_friction_begins_to_damp():
    """Without friction a pad slides in three ways and swings in others. Friction damps two of the three motions beside
    those that swing: nothing is missing, and where modes could not be followed is said."""
    contact = {"surface": "bottom", "counterface": "rigid", "normal_stiffness": 3e7, "sliding": BELT}
    problem = make_problem(
        box("hex1", (1, 1, 1), SIDES), order=1, materials={"lining": LINING}, contacts=[contact],
        effects={"friction": {"mu": 0.0}, "friction_damping": {"contact_pressure": 1e6}},
    )  # fmt: skip
    result = fe_squeal.sweep(problem, [0.0, 0.6], modes=5)
    free, damped = (point.modes.lam for point in result.points)
    assert (free == 0).sum() == 3 and not free.real.any()
    assert (damped == 0).sum() == 3 and ((damped.imag == 0) & (damped.real < 0)).sum() == 2
    assert any("modes that do not swing" in w for w in result.warnings)


@pytest.mark.parametrize("rayleigh", [(20.0, 0.0), (20.0, 1e-8), (0.0, 1e-8)])
@pytest.mark.parametrize("cells", some([2, 3], lambda cells: cells == 2))
def test_free_body_with_damping(record, cells, rayleigh):
    """Six zeros, double and defective unless α damps them; then six times −α besides. Rounding makes complex pairs
    −α ± 1e-6 i and ±1e-3 i of equal real eigenvalues, and the upper half plane holds four, eight or eleven."""
    alpha, beta = rayleigh
    problem = make_problem(box("hex2", (cells,) * 3, (0.1,) * 3), effects={"rayleigh": {"alpha": alpha, "beta": beta}})
    modes = modes_of(problem, 12)
    swinging = modes.lam[modes.lam.imag > 0]
    assert (modes.lam == 0).sum() == 6 and set(modes.stability[modes.lam == 0]) == {"marginal"}
    real = modes.lam[(modes.lam.imag == 0) & (modes.lam != 0)]
    assert len(real) == (6 if alpha else 0)
    np.testing.assert_allclose(real, -alpha, rtol=1e-5)
    # The elastic ones are those without damping, λ² + (α + βω²)λ + ω² = 0.
    omega = modes_of(make_problem(box("hex2", (cells,) * 3, (0.1,) * 3)), 12).lam.imag[6:]
    c = (alpha + beta * omega**2) / 2
    exact = -c + 1j * np.sqrt(omega**2 - c**2)
    assert (np.abs(swinging[:6, None] - exact).min(axis=1) <= 1e-8 * np.abs(swinging[:6])).all()
    assert set(modes.stability[modes.lam.imag > 0]) == {"stable"}
    record(digits(swinging[:6], exact[:6]), "six zeros, and six times −α where that is")


def test_mechanism(record):
    """Two blocks joined by one spring: eleven zeros and one stretching mode, √(k (1/m₁ + 1/m₂)). Rounding splits the
    zeros into ± pairs of 1e-3 of the first elastic mode."""
    one = box("hex2", (2, 2, 2), (0.1, 0.1, 0.1), name="one")
    other = box("hex2", (2, 2, 2), (0.1, 0.1, 0.1), (0.1, 0.0, 0.0), name="two")
    spring = {"name": "link", "surface": "right_one", "to": "left_two", "direction": [1, 0, 0], "stiffness": 1e4}
    problem = make_problem(join(one, other), springs=[spring])
    modes = modes_of(problem, 16)
    assert (modes.lam[:11] == 0).all() and (np.abs(modes.lam[11:]) > 1).all()
    assert set(modes.stability) == {"marginal"}
    exact = 1j * np.sqrt(1e4 * 2 / (7800.0 * 1e-3))
    assert abs(modes.lam[11] - exact) < 1e-4 * abs(exact)
    record(digits(modes.lam[11], exact), "eleven zeros, counted", *judged(plain_eigs(problem.pencil(), 16), exact))


@pytest.mark.parametrize(
    ("away", "kind"),
    some([*((a, k) for a in (0.0, 1e-15, 1e-10) for k in ("undamped", "friction")), (0.0, "dashpots"),
          (1e-10, "dashpots")], lambda a, k: k != "dashpots"),
)
def test_shift_on_an_eigenvalue(record, kind, away):
    """The shift inside the band is an eigenvalue, so that the shifted matrix is singular: here a divergence at exactly
    the place where the program itself puts its shift, and nearly there."""
    band, n = 16.0, DENSE_LIMIT + 50
    theta = np.arange(1.0, n + 1)
    sigma = -((BELOW * band) ** 2) if kind != "dashpots" else -((band / 2) ** 2)
    theta[0] = sigma * (1 + away)
    C = None
    if kind == "dashpots":  # λ = band/2 of λ² + cλ + θ₀, and the others swing
        C = sp.csr_array(sp.diags_array(np.full(n, 0.1)))
        theta[0] = -(band / 2) * (band / 2 + 0.1) * (1 + away)
    K = sp.csr_array(sp.diags_array(theta))
    if kind == "friction":
        K = sp.csr_array(K + sp.csr_array(([0.5], ([5], [9])), shape=(n, n)))
    pencil = Pencil(sp.eye_array(n, format="csr"), K, C, symmetric=kind != "friction")
    modes = solve_modes(pencil, Request(count=12), band)
    c = 0.1 if C is not None else 0.0
    exact = -c / 2 + 1j * np.sqrt(theta[:13].astype(complex) - c**2 / 4)
    exact = np.concatenate([exact, -c - exact[:1]])
    exact = exact[exact.imag >= 0]
    assert (np.abs(modes.lam[:, None] - exact).min(axis=1) <= 1e-9 * np.abs(modes.lam)).all()
    assert (modes.stability == "unstable").sum() == 1
    np.testing.assert_allclose(modes.lam[modes.stability == "unstable"], exact[exact.real > 0], rtol=1e-9)
    assert (modes.lam.imag > 0).sum() >= 10
    record(digits(exact, modes.lam), "found, divergence and all")
