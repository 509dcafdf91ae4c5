"""Stiffnesses of unlike size side by side: penalties, shims, springs, units.

See tests/hard/test_matrix_scenes_awkward.py for penalties and units of plain matrices, and tests/convergence/
test_interfaces.py for the rate at which a tie converges.
"""

from __future__ import annotations

import functools
from fractions import Fraction

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from hard_problems import LINING, brake, digits, judged, matrices, plain_eigs
from selection import some

import fe_squeal
from fe_squeal.eigen.dense import DENSE_LIMIT
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from meshes import STEEL, box, join, make_problem, modes_of

N, M_ = (3, 3, 1), (3, 3, 2)
MATERIALS = {"materials": {"steel": STEEL, "lining": LINING}}


def tied(k_n):
    """A lining glued on a steel plate that is held below."""
    mesh = join(box("hex2", N, (0.06, 0.06, 0.02), name="pad"),
                box("hex2", M_, (0.06, 0.06, 0.03), (0, 0, -0.03), name="plate"))  # fmt: skip
    contact = {"name": "glue", "surface": "bottom_pad", "counterface": "top_plate", "kind": "tied",
               "normal_stiffness": k_n}  # fmt: skip
    return make_problem(
        mesh, **MATERIALS, bodies={"pad": {"material": "lining"}, "plate": {"material": "steel"}},
        supports=[{"surface": "bottom_plate", "fixed": "xyz"}], contacts=[contact],
    )  # fmt: skip


def merged():
    """The same as one mesh with two volumes."""
    z = np.concatenate([np.linspace(-0.03, 0.0, M_[2] + 1), [0.02]])
    mesh = box("hex1", (3, 3, 3), (0.06, 0.06, 0.05), (0, 0, -0.03))
    layer = np.searchsorted(np.unique(mesh.p[2].round(12)), mesh.p[2].round(12))
    points = mesh.p.copy()
    points[2] = z[layer]
    mesh = type(mesh)(points, mesh.t)
    middle = points[2][mesh.t].mean(axis=0)
    mesh = mesh.with_subdomains({"pad": np.flatnonzero(middle > 0), "plate": np.flatnonzero(middle < 0)})
    mesh = mesh.with_boundaries({"bottom_plate": lambda x: np.abs(x[2] + 0.03) < 1e-9})
    return make_problem(
        mesh, **MATERIALS, bodies={"pad": {"material": "lining"}, "plate": {"material": "steel"}},
        supports=[{"surface": "bottom_plate", "fixed": "xyz"}],
    )  # fmt: skip


@functools.cache
def merged_modes(count):
    return modes_of(merged(), count)


@pytest.mark.parametrize("power", some([11, 12, 13, 14, 15, 17, 19], lambda power: power in (11, 15, 19)))
def test_penalty_of_a_tie_over_eight_decades(record, power):
    """Too soft a penalty lowers every frequency, too stiff a one costs digits, and nobody says which of them rules. The
    drop is the tie's share of the energy, so it can be told; against one mesh of both bodies it is right to 10 %."""
    problem, count = tied(10.0**power), 6
    result = fe_squeal.sweep(problem, [0.0], modes=count)
    found, exact = result.points[0].modes, merged_modes(count)
    drop = 1 - found.lam.imag / exact.lam.imag
    modes = solve_modes(problem.pencil(), Request(count=count))
    (glue,) = (t for t in problem.terms if t.name == "contact.glue")
    share = 10.0**power * np.einsum("ij,ij->j", modes.right, glue.matrix @ modes.right) / modes.lam.imag**2
    if power >= 14:
        np.testing.assert_allclose(drop, share / 2, rtol=0.1, atol=1e-9)
    assert (np.abs(drop) <= 1e-3 * 10.0 ** (15 - power) + 1e-9).all() or power < 13
    said = [d for d in result.warnings if "glue" in d]
    assert bool(said) == (share.max() / 2 > 5e-3) == (power < 14)
    kept = digits(found.lam, 1j * modes.lam.imag)
    record(kept, "a warning says by how much the penalty lowers frequencies",
           *judged(plain_eigs(problem.pencil(), count), modes.lam))  # fmt: skip


@pytest.mark.parametrize("ratio", [1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9, 1e12])
@pytest.mark.parametrize("crowd", [0, DENSE_LIMIT + 50])
def test_two_springs_in_a_row(tmp_path, record, ratio, crowd):
    """Ground, spring 1, mass, spring of `ratio`, mass: the entry 1 + ratio rounds the soft spring away, digit by digit.
    What is known is the spectrum of the rounded matrix (by fractions); its slow mode has ratio · ε, and is told so."""
    K = np.array([[1.0 + ratio, -ratio], [-ratio, ratio]])
    big = sp.block_diag([K, sp.diags_array(1e3 + np.arange(crowd))]) if crowd else sp.csr_array(K)
    problem = matrices(tmp_path, [("mass", sp.eye_array(2 + crowd)), ("stiffness", big)])
    a, b, d = (Fraction(float(x)) for x in (K[0, 0], K[0, 1], K[1, 1]))
    det, trace = a * d - b * b, a + d
    large = (float(trace) + np.sqrt(float(trace * trace - 4 * det))) / 2
    theta = np.array([float(det) / large, large])
    modes = solve_modes(problem.pencil(), Request(count=2))
    slow = modes.lam[0].imag ** 2
    blur = 100 * np.finfo(float).eps * max(ratio, 1.0)
    assert abs(slow - theta[0]) <= blur + 1e-12 * theta[0]
    assert abs(slow - theta[0]) <= 2 * theta[0] * 8 * np.finfo(float).eps * modes.condition[0] + 1e-14
    assert set(modes.stability) == {"marginal"}
    exact = 1j * np.sqrt(theta[:1])
    asked = judged(plain_eigs(problem.pencil(), 2), exact) if crowd else ()
    record(digits(modes.lam[:1], exact), "error within the condition number that is told", *asked)


@pytest.mark.parametrize("power", some([6, 9, 12, 15, 18], lambda power: power % 6 == 0))
def test_spring_stiffer_than_anything_else(record, power):
    """Springs up to 10⁹ times as stiff as the body, as users write supports: frequencies tend to those of the support,
    the shift and the scaling are not led astray by the penalties, and none of its modes takes part."""
    block = box("hex2", (3, 2, 2), (0.1, 0.05, 0.05))
    springs = [{"name": n, "surface": "left", "direction": list(e), "stiffness": 10.0**power}
               for n, e in zip("xyz", np.eye(3), strict=True)]  # fmt: skip
    problem = make_problem(block, springs=springs)
    modes = modes_of(problem, 8)
    held = modes_of(make_problem(block, supports=[{"surface": "left", "fixed": "xyz"}]), 8)
    assert set(modes.stability) == {"marginal"} and modes.backward_error.max() < 1e-12
    drop = 1 - modes.lam.imag / held.lam.imag
    stiffness = STEEL["youngs_modulus"] * 0.05**2 / 0.1
    if power >= 12:
        assert (np.abs(drop) <= 10 * stiffness / 10.0**power + 1e-8).all()
    theta = la.eigh(problem.pencil().K.toarray(), problem.pencil().M.toarray(), eigvals_only=True)[:8]
    exact = 1j * np.sqrt(theta)
    if power <= 12:  # beyond, LAPACK has the penalties' rounding
        np.testing.assert_allclose(modes.lam, exact, rtol=1e-6)
    best = held.lam if power >= 15 else exact
    record(digits(modes.lam, best), "tends to the support, to 1e-8", *judged(plain_eigs(problem.pencil(), 8), best))


@pytest.mark.parametrize("ratio", some([1e-6, 1e-4, 1e-2, 1.0, 1e2], lambda ratio: ratio in (1e-6, 1.0, 1e2)))
def test_soft_shim_beside_steel(record, ratio):
    """A shim of 10⁻⁶ of the steel's modulus between two steel blocks, its own modes apart: the upper block is a mass on
    springs, ω² = k/m with k = E_s A/h + ..., and the conditioning is that of the ratio."""
    z = np.array([0.0, 0.02, 0.021, 0.041])
    mesh = box("hex1", (2, 2, 3), (0.04, 0.04, 0.041))
    points = mesh.p.copy()
    points[2] = z[np.searchsorted(np.unique(mesh.p[2].round(12)), mesh.p[2].round(12))]
    mesh = type(mesh)(points, mesh.t)
    middle = points[2][mesh.t].mean(axis=0)
    mesh = mesh.with_subdomains({
        "below": np.flatnonzero(middle < 0.02), "shim": np.flatnonzero(np.abs(middle - 0.0205) < 1e-3),
        "above": np.flatnonzero(middle > 0.021),
    }).with_boundaries({"foot": lambda x: x[2] < 1e-9, "left": lambda x: x[0] < 1e-9, "front": lambda x: x[1] < 1e-9,
                        "right": lambda x: x[0] > 0.04 - 1e-9, "back": lambda x: x[1] > 0.04 - 1e-9})  # fmt: skip
    plain = {**STEEL, "poisson_ratio": 0.0}
    shim = {"youngs_modulus": ratio * 2e11, "poisson_ratio": 0.0, "density": 1000.0}
    slide = [{"surface": s, "fixed": "x"} for s in ("left", "right")]
    slide += [{"surface": s, "fixed": "y"} for s in ("front", "back")]
    problem = make_problem(
        mesh, materials={"steel": plain, "shim": shim}, supports=[{"surface": "foot", "fixed": "xyz"}, *slide],
        bodies={"below": {"material": "steel"}, "above": {"material": "steel"}, "shim": {"material": "shim"}},
    )  # fmt: skip
    modes = modes_of(problem, 1)
    # Rods in a row without Poisson's effect: springs E/h, tan-free for a shim so soft; else the rods' own determinant.
    heights, moduli, densities = np.diff(z), np.array([1, ratio, 1]) * 2e11, np.array([7800.0, 1000.0, 7800.0])

    def end_force(omega):
        u, n = 0.0, 1.0  # displacement and stress at the foot
        for h, E, rho in zip(heights, moduli, densities, strict=True):
            k = omega * np.sqrt(rho / E)
            c, s = np.cos(k * h), np.sin(k * h)
            u, n = u * c + n * s / (E * k), n * c - u * s * E * k
        return n

    from scipy.optimize import brentq

    grid = np.geomspace(1e2, 4e5, 4000)
    forces = np.array([end_force(w) for w in grid])
    first = np.flatnonzero(forces[1:] * forces[:-1] < 0)[0]
    exact = 1j * brentq(end_force, grid[first], grid[first + 1], xtol=1e-9)
    axial = modes.lam[np.argmin(np.abs(modes.lam - exact))]
    assert abs(axial - exact) < 2e-3 * abs(exact)
    record(digits(axial, exact), "the rods' own frequency, to the mesh", *judged(plain_eigs(problem.pencil(), 4),
                                                                                 np.array([exact])))  # fmt: skip


UNITS = {"mm, t, s": (1e-3, 1e3, 1.0), "µm, g, ms": (1e-6, 1e-3, 1e-3), "km, Gt, h": (1e3, 1e12, 3600.0)}


@pytest.mark.parametrize("units", some(UNITS, lambda units: units == "mm, t, s"))
def test_whole_scene_in_other_units(record, units):
    """Pad, belt, preload, lift-off, friction, slip damping and Rayleigh damping in other consistent units: absolute
    thresholds anywhere (gaps, zero pivots, rigid modes, convergence) would show."""

    def spectrum(length, mass, time):
        stress, stiffness = length * time**2 / mass, time**2 / mass
        steel, lining = ({"youngs_modulus": m["youngs_modulus"] * stress, "poisson_ratio": m["poisson_ratio"],
                          "density": m["density"] * length**3 / mass} for m in (STEEL, LINING))  # fmt: skip

        def scaled(mesh):
            return type(mesh)(mesh.doflocs / length, mesh.t, _subdomains=mesh.subdomains, _boundaries=mesh.boundaries)

        springs = [{"name": n, "surface": s, "direction": d, "stiffness": k * stiffness} for n, s, d, k in (
            ("x", "left_pad", [1, 0, 0], 4e8), ("y", "back_pad", [0, 1, 0], 1e8), ("z", "top_pad", [0, 0, 1], 2e8))]
        problem = brake(
            change=scaled, springs=springs, k_n=2e11 * stiffness * length**2, mu=0.4,
            materials={"steel": steel, "lining": lining},
            contact={"sliding": {"direction": [1.0, 0.2, 0.0], "speed": 2.0 / length * time}},
            effects={"preload": {"pressures": {"top_pad": 2e6 * stress}}, "friction_damping": {},
                     "rayleigh": {"alpha": 20.0 * time, "beta": 1e-8 / time}},
        )  # fmt: skip
        modes = modes_of(problem, 8)
        return modes.lam / time, problem.discretisation.static_state, modes.stability.tolist()

    (lam, base, verdicts), (plain, reference, expected) = spectrum(*UNITS[units]), spectrum(1.0, 1.0, 1.0)
    assert verdicts == expected
    assert (base.contacts["belt"].closed == reference.contacts["belt"].closed).all()
    np.testing.assert_allclose(lam, plain, rtol=1e-8)
    record(digits(lam, plain), "the same λ and the same verdicts")


def test_columns_of_unlike_units_with_friction(record):
    """Unknowns in units 10¹² apart and a nonsymmetric K: eigenvalues stay, a norm over all rows sees one half alone."""
    rng, n = np.random.default_rng(4), DENSE_LIMIT + 60
    k = rng.uniform(1.0, 3.0, n + 1)
    push = np.where(np.arange(n - 1) % 60 == 30, 1.7, 1.0)  # everywhere, modes would grow along the chain like 1.3ⁿ
    K = sp.diags_array([k[:-1] + k[1:], -k[1:-1], -k[1:-1] * push], offsets=[0, 1, -1]).tocsr()
    D = sp.diags_array(10.0 ** rng.uniform(-6, 6, n))
    pencil = Pencil(sp.csr_array(D @ D), sp.csr_array(D @ K @ D))
    modes = solve_modes(pencil, Request(count=10))
    # A tridiagonal matrix with products of one sign is similar to the symmetric one of their roots.
    theta = la.eigh_tridiagonal(k[:-1] + k[1:], k[1:-1] * np.sqrt(push))[0]
    exact = np.sqrt(theta.astype(complex)) * 1j
    exact = np.concatenate([exact, -exact])[np.argsort(np.abs(np.r_[theta, theta]))]
    assert modes.backward_error.max() < 1e-12
    assert (np.abs(modes.lam[:, None] - exact).min(axis=1) <= np.maximum(modes.re_uncertainty, 1e-9)).all()
    wanted = modes.lam
    record(digits(wanted, exact[np.abs(wanted[:, None] - exact).argmin(axis=1)]), "scaled before it is solved",
           *judged(plain_eigs(pencil, 10), wanted))  # fmt: skip


@pytest.mark.parametrize("ratio", [1e4, 1e7])
@pytest.mark.parametrize("kind", ["symmetric", "nonsymmetric", "damped", "loss"])
def test_a_soft_part_beside_a_stiff_one(kind, ratio):
    """Five modes of 1 to 5 rad/s, which nothing couples to the others: rounding of these has forces far larger.

    Friction of the first two gives θ = 1 and 4; damping ratios are 0.005, and the loss factor 0.01.
    """
    n, soft = DENSE_LIMIT + 50, 5
    omega = np.r_[np.arange(1.0, soft + 1), ratio * np.linspace(1, 3, n - soft)]
    L = sp.csr_array(sp.eye_array(n) + sp.diags_array(np.where(np.arange(1, n) == soft, 0.0, 0.2), offsets=1))
    D = sp.csr_array(sp.diags_array(omega**2 * (1 + 0.01j if kind == "loss" else 1.0)))
    if kind == "nonsymmetric":
        D = sp.csr_array(D + sp.csr_array(([0.3], ([0], [1])), shape=(n, n)))
    C = sp.csr_array(L.T @ sp.diags_array(0.01 * omega) @ L) if kind == "damped" else None
    pencil = Pencil(sp.csr_array(L.T @ L), sp.csr_array(L.T @ D @ L), C, symmetric=kind != "nonsymmetric")
    low = omega[:4]
    exact = {"damped": low * (-0.005 + 1j * np.sqrt(1 - 0.005**2)), "loss": 1j * low * np.sqrt(1 + 0.01j)}
    modes = solve_modes(pencil, Request(count=4))
    np.testing.assert_allclose(modes.lam, exact.get(kind, 1j * low), rtol=1e-8)
    assert modes.backward_error.max() <= 1e-8
