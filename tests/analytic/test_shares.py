"""Where a growth rate comes from: shares by term, by closed forms and invariants, and next to onsets."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal import sweep
from fe_squeal.compare.cases import minimal
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.problem.energy import energy_balance
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from lumped import Minimal

N = 7


def random_terms(seed=3):
    """Terms of every kind: mass, springs, damper, gyroscope, follower force, loss factor."""
    rng = np.random.default_rng(seed)

    def matrix(kind):
        a = rng.standard_normal((N, N))
        return sp.csr_array({"definite": a @ a.T + N * np.eye(N), "skew": a - a.T, "any": 4 * a}[kind])

    return {
        "mass": Term("mass", "M", matrix("definite"), True),
        "elastic": Term("elastic", "K", matrix("definite"), True),
        "spring": Term("spring", "K", matrix("definite"), True),
        "follower": Term("follower", "K", matrix("any"), False, {"mu": 1}),
        "circulatory": Term("circulatory", "K", matrix("skew"), False, skew=True),
        "loss": Term("loss", "K", 0.02 * matrix("definite"), True, imaginary=True),
        "loss_of_friction": Term("loss_of_friction", "K", 0.02 * matrix("any"), False, {"mu": 1}, imaginary=True),
        "loss_of_skew": Term("loss_of_skew", "K", 0.1 * matrix("skew"), False, skew=True, imaginary=True),
        "damper": Term("damper", "C", 0.01 * matrix("definite"), True),
        "slip": Term("slip", "C", 0.1 * matrix("any"), False, {"mu": 1}),
        "gyroscope": Term("gyroscope", "C", 0.3 * matrix("skew"), False, skew=True),
    }


CONSERVATIVE = {"mass", "elastic", "spring", "gyroscope"}


@pytest.mark.parametrize(
    ("names", "problem_class"),
    [
        ("follower", "nonsymmetric"), ("circulatory", "nonsymmetric"), ("follower gyroscope", "quadratic"),
        ("follower damper slip gyroscope", "quadratic"), ("follower loss", "complex"),
        ("follower circulatory loss damper slip gyroscope", "complex"), ("loss_of_friction", "complex"),
        ("follower loss_of_skew damper", "complex"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("mu", [0.1, 1.0])
def test_shares_add_up_in_every_class(names, problem_class, mu):
    """Σ shares = Re λ; what is conservative has exactly zero; the energies of each kind add up to one."""
    every = random_terms()
    kept = ["mass", "elastic", "spring", *names.split()]
    problem = Problem(tuple(every[n] for n in kept), {"mu": mu})
    assert problem.problem_class == problem_class
    modes = solve_modes(problem.pencil(), Request(count=N))
    assert len(modes) >= N
    for i, lam in enumerate(modes.lam):
        found = energy_balance(problem, complex(lam), modes.right[:, i])
        assert set(found) == set(kept)
        assert sum(s.growth for s in found.values()) == pytest.approx(lam.real, abs=1e-11 * abs(lam))
        assert all(found[n].growth == 0.0 for n in CONSERVATIVE & set(kept)) or lam.imag == 0
        assert found["mass"].energy == pytest.approx(1.0)
        assert found["elastic"].energy + found["spring"].energy == pytest.approx(1.0)
        assert all(np.isnan(s.energy) for n, s in found.items() if n not in ("mass", "elastic", "spring"))


def test_shares_of_dampers_in_one_oscillator():
    """m ẍ + (c₁ + c₂)ẋ + kx = 0: −c₁/2m and −c₂/2m; of a loss factor beside them its part of the work."""
    m, k, dampers = 2.0, 50.0, {"c1": 0.3, "c2": -0.7}
    terms = [Term("m", "M", sp.csr_array([[m]]), True), Term("k", "K", sp.csr_array([[k]]), True)]
    terms += [Term(n, "C", sp.csr_array([[c]]), True) for n, c in dampers.items()]
    lam = 0.1 + 1j * np.sqrt(k / m - 0.01)
    found = energy_balance(Problem(tuple(terms), {}), lam, np.ones(1))
    assert {n: s.growth for n, s in found.items()} == pytest.approx({"m": 0, "k": 0, "c1": -0.075, "c2": 0.175})
    eta = 0.04
    lossy = Problem((*terms[:2], Term("eta", "K", sp.csr_array([[k * eta]]), True, imaginary=True)), {})
    lam = complex(1j * np.sqrt(k / m * (1 + 1j * eta)))
    found = energy_balance(lossy, lam, np.ones(1))
    assert found["eta"].growth == pytest.approx(lam.real, rel=1e-13) and found["k"].growth == 0.0


def test_shares_do_not_depend_on_the_size_or_phase_of_the_shape():
    problem = Problem(tuple(random_terms().values()), {"mu": 1.0})
    modes = solve_modes(problem.pencil(), Request(count=1))
    one, other = (energy_balance(problem, complex(modes.lam[0]), f * modes.right[:, 0]) for f in (1.0, 3e7 - 4e7j))
    assert {n: s.growth for n, s in one.items()} == pytest.approx({n: s.growth for n, s in other.items()}, rel=1e-12)


@pytest.mark.parametrize("distance", [1e-2, 1e-5, 1e-8, 1e-10])
def test_next_to_an_onset(distance):
    """Where Re λ is the small difference of large shares they still add up, and friction's is bounded by its work."""
    model = Minimal(k2=20.0, friction="contact")
    terms = (
        Term("mass", "M", sp.csr_array(model.M), True), Term("elastic", "K", sp.csr_array(model.K0), True),
        Term("friction", "K", sp.csr_array(model.friction_matrix), False, {"mu": 1}),
        Term("damper", "C", sp.csr_array(0.05 * np.eye(2)), True),
    )  # fmt: skip
    [onset] = sweep(Problem(terms, {"mu": 0.0}), np.linspace(0, 1, 6), modes=2).onsets
    problem = Problem(terms, {"mu": onset.value * (1 + distance)})
    modes = solve_modes(problem.pencil(), Request(count=2))
    i = int(np.argmax(modes.lam.real))
    lam = complex(modes.lam[i])
    assert 0 < lam.real < 20 * distance
    found = energy_balance(problem, lam, modes.right[:, i])
    assert sum(s.growth for s in found.values()) == pytest.approx(lam.real, abs=1e-13)
    # λ(λ + c) = θ of the undamped pair: c alone takes c|λ|²/(|λ|² + uᴴK_s u/uᴴMu), which tends to c/2 at the onset.
    assert found["damper"].growth == pytest.approx(-0.025, rel=20 * distance + 1e-12)
    assert found["friction"].growth == pytest.approx(0.025 + lam.real, rel=20 * distance + 1e-12)


def test_damping_that_destabilises_a_finite_element_block():
    """c₁ = c₂ = 0.3 without c₃ lets the block flutter at μ = 0.325996…, equal dampers at 0.38336…; undamped 4/7√3.

    The lumped model's friction takes k₃ + Σ k cos²θ = 17.5 N/m, the block's only its contact spring of 10 N/m: hence
    the ratio. What is left of the block's softness falls with 1/E and is taken out by extrapolation.
    """
    for (c1, c2, c3), exact in (
        ((0.3, 0.3, 0.0), 0.325996705567428), ((0.3, 0.3, 0.3), 0.38336057874191151), ((0.0, 0.0, 0.0), 4 / 7 / 3**0.5)
    ):  # fmt: skip
        found = []
        for modulus in (1e5, 2e5):
            case = minimal(Minimal(k2=20.0, c1=c1, c2=c2, c3=c3, friction="contact"))
            for contact in case.scene["contacts"]:
                contact["friction_ratio"] = 1.75
            problem = case.problem(modulus)
            result = sweep(problem, np.linspace(0.1, 0.5, 9), modes=3)
            assert problem.problem_class == ("quadratic" if c1 else "nonsymmetric")
            [onset] = result.onsets
            assert (onset.kind, onset.direction) == ("flutter", "into")
            found.append(onset.value)
        assert found[0] == pytest.approx(exact, rel=2e-3)
        assert 2 * found[1] - found[0] == pytest.approx(exact, rel=1e-7)
