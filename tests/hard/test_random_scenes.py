"""Random small scenes and pencils: no crash, no wrong verdict, invariants of the spectrum, backward errors met."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from dense import all_eigenvalues
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import fe_squeal
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.errors import NotConvergedError, SquealError
from meshes import box, join, make_problem

SETTINGS = settings(max_examples=200, suppress_health_check=[HealthCheck.too_slow])
FEW = settings(SETTINGS, max_examples=10)


def exponents(low, high):
    return st.floats(low, high).map(lambda x: 10.0**x)


@st.composite
def pencils(draw):
    """Draw M, C, K of any class: rigid, massless, damped, with friction, in any units, doublets among them."""
    n = draw(st.integers(2, 14))
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    Q = la.qr(rng.standard_normal((n, n)))[0]
    theta = rng.uniform(0.1, 2.0, n) * draw(exponents(-3, 3))
    theta[: draw(st.integers(0, n // 2))] = 0.0  # rigid
    if draw(st.booleans()):
        theta[-1] = theta[n // 2]  # a doublet
    root = rng.uniform(0.5, 2.0, n)
    M, K = np.diag(root**2), (root[:, None] * (Q * theta) @ Q.T) * root
    friction = draw(st.sampled_from([0.0, 0.1, 1.0, 3.0]))
    if friction:
        gap, slip = rng.standard_normal((2, n)) * root
        K = K + theta.max() * (np.outer(gap, gap) + friction * np.outer(slip, gap)) / n
    C = None
    if kind := draw(st.sampled_from(["", "light", "heavy", "gyroscopic"])):
        A = rng.standard_normal((n, n)) * root
        C = (A - A.T if kind == "gyroscopic" else A.T @ A) * np.sqrt(theta.max()) / n
        C = C * {"light": 1e-3, "heavy": 30.0, "gyroscopic": 1.0}[kind]
    m, k = draw(exponents(-9, 9)), draw(exponents(-9, 9))
    c = np.sqrt(m * k)
    K = (K + K.T) / 2 if not friction else K
    return sp.csr_array(m * M), None if C is None else sp.csr_array(c * C), sp.csr_array(k * K), not friction


def all_of(M, C, K):
    """Return the unit √(k/m) and all λ."""
    unit = np.sqrt(abs(K).max() / abs(M).max())
    return unit, all_eigenvalues(M, C, K, unit)


@SETTINGS
@given(pencils())
def test_random_pencils(matrices):
    """Whatever the class: backward errors at rounding, verdicts that an independent solver does not contradict, and the
    invariants of the spectrum (conjugates, mirror images, the trace)."""
    M, C, K, symmetric = matrices
    pencil, n = Pencil(M, K, C, symmetric), M.shape[0]
    modes = solve_modes(pencil, Request(count=4 * n))
    assert modes.backward_error.max() <= 1e-10
    assert (modes.lam.imag >= 0).all() and np.isfinite(modes.re_uncertainty).all()
    unit, exact = all_of(M, C, K)
    # A simple eigenvalue of the doubled matrix is good to ε‖A‖κ, a defective one to its root: 1e-6 of the unit here.
    for lam, u, verdict in zip(modes.lam, modes.re_uncertainty, modes.stability, strict=True):
        near = exact[np.argmin(np.abs(exact - lam))]
        slack = u + 1e-6 * unit
        assert abs(near - lam) <= 2 * slack + 1e-6 * abs(lam)
        if near.real > 10 * slack:
            assert verdict == "unstable"
        if near.real < -10 * slack:
            assert verdict == "stable"
    # Friction and symmetric stiffness alone: mirror images, and nothing decays or grows without a partner.
    if C is None:
        assert (modes.stability == "unstable").sum() == (modes.stability == "stable").sum()
        if symmetric:
            assert set(modes.stability) <= {"marginal"}
            theta = np.where(modes.lam == 0, 0.0, modes.lam.imag**2)
            total = np.sum(K.diagonal() / M.diagonal())
            assert abs(theta.sum() - total) <= 1e-9 * total
    elif C is not None and symmetric and la.norm((C - C.T).toarray()) < 1e-12 * la.norm(C.toarray()):
        assert "unstable" not in modes.stability  # C, K positive semidefinite


@pytest.mark.slow
@SETTINGS
@given(pencils(), exponents(-6, 6), st.integers(0, 1000))
def test_units_and_turns_of_random_pencils(matrices, unit, seed):
    """λ of PᵀQ(λ)P for a permutation and other units of single unknowns, in another unit of time: the same, scaled."""
    M, C, K, symmetric = matrices
    n = M.shape[0]
    rng = np.random.default_rng(seed)
    P = sp.csr_array(sp.eye_array(n).tocsr()[rng.permutation(n)] * 10.0 ** rng.uniform(-3, 3))
    here = solve_modes(Pencil(M, K, C, symmetric), Request(count=4 * n))
    turned = [None if A is None else sp.csr_array(P.T @ A @ P) for A in (M, C, K)]
    there = solve_modes(
        Pencil(turned[0], turned[2] * unit**2, None if C is None else turned[1] * unit, symmetric), Request(count=4 * n)
    )
    assert len(here) == len(there)
    size = np.abs(here.lam).max()
    for lam, u in zip(here.lam, here.re_uncertainty, strict=True):
        j = np.argmin(np.abs(there.lam / unit - lam))
        assert abs(there.lam[j] / unit - lam) <= 4 * (u + there.re_uncertainty[j] / unit) + 1e-7 * size


@st.composite
def scenes(draw):
    """Draw a pad on a belt or a rigid counterface, with random effects, springs, materials and stiffnesses."""
    kind = draw(st.sampled_from(["hex1", "hex2", "tet1"]))
    pad = box(kind, (draw(st.integers(1, 2)), 1, 1), (0.06, 0.04, draw(st.sampled_from([0.002, 0.02]))), name="pad")
    rigid = draw(st.booleans())
    meshes = [pad] if rigid else [pad, box(kind, (2, draw(st.integers(1, 2)), 1), (0.1, 0.06, 0.02),
                                           (-0.02, -0.01, -0.02), name="belt")]  # fmt: skip
    axes = draw(st.sets(st.sampled_from("xyz")))
    on = {"x": "left_pad", "y": "back_pad", "z": "top_pad"}
    springs = [{"name": a, "surface": on[a], "direction": list(np.eye(3)["xyz".index(a)]),
                "stiffness": draw(exponents(3, 10))} for a in sorted(axes)]  # fmt: skip
    effects = {"friction": {"mu": draw(st.sampled_from([0.0, 0.3]))}}
    if draw(st.booleans()):
        effects["rayleigh"] = {"alpha": draw(exponents(-1, 4)), "beta": draw(exponents(-10, -5))}
    if draw(st.booleans()):
        effects["friction_damping"] = {"contact_pressure": 1e6}
    if len(axes) == 3 and draw(st.booleans()):
        effects["preload"] = {"pressures": {"top_pad": draw(exponents(3, 7))}}
        effects.get("friction_damping", {}).pop("contact_pressure", None)
    E = {name: draw(exponents(8, 11.5)) for name in ("a", "b")}
    return {
        "mesh": join(*meshes) if not rigid else box(kind, (1, 1, 1), (0.06, 0.04, 0.02), name="pad"),
        "order": draw(st.sampled_from([1, 2])),
        "materials": {
            n: {"youngs_modulus": e, "poisson_ratio": draw(st.sampled_from([0.0, 0.3, 0.45])), "density": 3000.0}
            for n, e in E.items()
        },
        "bodies": {"pad": {"material": "a"}} | ({} if rigid else {"belt": {"material": "b"}}),
        "supports": [] if rigid else [{"surface": "bottom_belt", "fixed": "xyz"}],
        "springs": springs, "effects": effects,
        "contacts": [{"name": "face", "surface": "bottom_pad", "counterface": "rigid" if rigid else "top_belt",
                      "normal_stiffness": draw(exponents(7, 14)),
                      "sliding": {"direction": [1, 0, 0], "speed": draw(st.sampled_from([-1.0, 0.1, 10.0]))}}],
    }  # fmt: skip


def solved(tables):
    """Solve a scene over two values of μ: either an answer whose errors and shares are right, or one of the program's
    own errors, never another; return whether there is an answer."""
    tables = dict(tables)
    try:
        problem = make_problem(tables.pop("mesh"), **tables)
        result = fe_squeal.sweep(problem, [0.0, 0.6], modes=5)
    except NotConvergedError as error:
        assert str(error)
        return False
    except SquealError as error:
        assert "preload" in str(error)  # nothing else of these scenes is bad input
        return False
    damped = problem.is_damped
    for point in result.points:
        modes = point.modes
        assert modes.backward_error.max(initial=0.0) <= 1e-8
        omega = modes.lam.imag  # where frequencies are equal up to 1e-9, growth rates decide
        assert (omega >= 0).all() and (np.diff(omega) >= -1e-9 * omega[1:]).all()
        if point.value == 0.0:
            assert "unstable" not in modes.stability  # friction alone feeds energy in
            assert damped or not modes.lam.real.any()
        for i in point.shapes:
            shares = [s.growth for s in result.balance(point, i).values()]
            assert abs(sum(shares) - modes.lam[i].real) <= 1e-6 * np.abs(modes.lam[i]) + modes.re_uncertainty[i]
    frame = result.to_dataframe()
    assert len(frame) == sum(len(p.modes) for p in result.points) and not frame["re"].isna().any()
    return True


def test_random_scenes():
    """From the scene to the table of modes. Of 150 drawn by chance all were solved: more than one in ten without an
    answer is a mistake."""
    answers = []

    @FEW
    @given(scenes())
    def each(tables):
        answers.append(solved(tables))

    each()
    assert len(answers) >= 10 and np.mean(answers) >= 0.9


def test_growth_that_crosses_zero_where_modes_are_one():
    """A pad of one element on its contact alone: modes that meet exactly, without any error of the step model."""
    steel = {"youngs_modulus": 1e8, "poisson_ratio": 0.0, "density": 3000.0}
    assert solved({
        "mesh": box("hex1", (1, 1, 1), (0.06, 0.04, 0.02), name="pad"), "order": 1,
        "materials": {"a": steel}, "bodies": {"pad": {"material": "a"}},
        "contacts": [{"name": "face", "surface": "bottom_pad", "counterface": "rigid", "normal_stiffness": 1e7,
                      "sliding": {"direction": [1, 0, 0], "speed": -1.0}}],
        "effects": {"friction": {"mu": 0.0}, "rayleigh": {"alpha": 1.0, "beta": 1e-5},
                    "friction_damping": {"contact_pressure": 1e6}},
    })  # fmt: skip


def test_friction_damping_under_preload_from_no_friction_on():
    """Without friction there is no C at all, and matrices are made anew at each value."""
    pad = box("hex1", (1, 1, 1), (0.06, 0.04, 0.002), name="pad")
    belt = box("hex1", (2, 1, 1), (0.1, 0.06, 0.02), (-0.02, -0.01, -0.02), name="belt")
    soft = {"youngs_modulus": 1e8, "poisson_ratio": 0.0, "density": 3000.0}
    sides = {"left_pad": [1, 0, 0], "back_pad": [0, 1, 0], "top_pad": [0, 0, 1]}
    assert solved({
        "mesh": join(pad, belt), "order": 1, "materials": {"soft": soft},
        "bodies": {"pad": {"material": "soft"}, "belt": {"material": "soft"}},
        "supports": [{"surface": "bottom_belt", "fixed": "xyz"}],
        "springs": [{"name": f"on {s}", "surface": s, "direction": d, "stiffness": 1e3} for s, d in sides.items()],
        "effects": {"friction": {"mu": 0.0}, "friction_damping": {}, "preload": {"pressures": {"top_pad": 1e3}}},
        "contacts": [{"name": "face", "surface": "bottom_pad", "counterface": "top_belt", "normal_stiffness": 1e7,
                      "sliding": {"direction": [1, 0, 0], "speed": -1.0}}],
    })  # fmt: skip
