"""Modes that friction or gyroscopic forces bring into the range from far beyond it, in reduced models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from selection import crossed, some

from fe_squeal import sweep
from fe_squeal.eigen.request import Request
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.reduced import BoxModel
from fe_squeal.reduced.missing import whirl_rate
from fe_squeal.study.points import sobol_points
from meshes import annulus, make_problem

N = 240
TURN = la.expm(sp.diags_array([np.full(N - 1, 0.01), np.full(N - 1, -0.01)], offsets=[1, -1]).toarray())


def problem(stiffness: np.ndarray, friction: np.ndarray, gyroscopic: np.ndarray | None, alpha: float) -> Problem:
    """Return oscillators in coordinates of many neighbours, with friction and gyroscopic forces between the last two.

    Parameters
    ----------
    stiffness : (N,) float
    friction, gyroscopic : (2, 2) float
        Both grow with p.
    alpha : float
        Damping of all oscillators; 0 for none.
    """
    F, G = np.zeros((N, N)), np.zeros((N, N))
    F[0, 1], F[-2:, -2:] = 0.1, friction
    slots = [("M", np.eye(N), 0), ("K", np.diag(stiffness), 0), ("K", F, 1)]
    if gyroscopic is not None:
        G[-2:, -2:] = gyroscopic
        slots.append(("C", G, 1))
    if alpha:
        slots.append(("C", alpha * np.eye(N), 0))
    terms = []
    for i, (slot, A, power) in enumerate(slots):
        B = sp.csr_array(TURN.T @ A @ TURN) if power or slot == "K" else sp.csr_array(A)
        symmetric = bool(np.abs(A - A.T).max() == 0)
        terms.append(Term(f"{slot}{i}", slot, B, symmetric, {"p": 1} if power else {}, A is G))
    return Problem(tuple(terms), {"p": 1.0})


def eigenvalues(stiffness: np.ndarray, friction: np.ndarray, gyroscopic: np.ndarray | None, alpha: float) -> np.ndarray:
    """Return the λ of the last two oscillators at p = 1."""
    C = alpha * np.eye(2) + (0 if gyroscopic is None else gyroscopic)
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-(np.diag(stiffness[-2:]) + friction), -C]])
    return la.eigvals(A)


GROWTH = {
    "divergence": [[0.0, 130.0], [130.001, 1.0]],
    "flutter that grows faster than it swings": [[-130.0, 20.0], [-20.0, -130.0]],
    "flutter of soft modes": [[-96.0, 3.0], [-3.0, -96.0]],
}


@pytest.mark.parametrize(
    ("alpha", "values"), some([(0.0, (1.0,)), (0.01, (1.0,)), (0.0, (0.0, 1.0))], lambda _, values: len(values) == 1)
)
@pytest.mark.parametrize("kind", GROWTH)
def test_friction_that_softens_modes_far_beyond_the_range(kind, alpha, values):
    stiffness, friction = np.append(np.linspace(1, 10, N - 2), [10.0, 10.0]) ** 2, np.array(GROWTH[kind])
    lam = eigenvalues(stiffness, friction, None, alpha)
    case = problem(stiffness, friction, None, alpha)
    result = sweep(case, values, "p", max_frequency=2.2 / (2 * np.pi), method="reduced")
    modes = result.points[-1].modes
    expected = lam[(lam.real > 1e-6) & (lam.imag >= 0)]
    np.testing.assert_allclose(modes.lam[modes.stability == "unstable"], expected, rtol=1e-6)


def test_soft_directions_are_searched_for_until_there_are_as_many_as_counted(monkeypatch):
    """One step of the search is hardly ever enough, and as many as there are as a rule were not from every start."""
    monkeypatch.setattr("fe_squeal.reduced.soft._STEPS", 1)
    test_friction_that_softens_modes_far_beyond_the_range("divergence", 0.0, (1.0,))


@pytest.mark.parametrize("values", some([((1.0,),), ((0.0, 1.0),)], lambda values: len(values) == 1))
@pytest.mark.parametrize(("omega", "gyro"), [(8.0, 20.0), (20.0, 130.0)])
def test_gyroscopic_forces_that_slow_a_whirl_down_into_the_range(omega, gyro, values):
    stiffness = np.append(np.linspace(1, 20, N - 2), [omega, omega]) ** 2
    turning, driving = np.array([[0, gyro], [-gyro, 0]]), np.array([[0, -0.1 * gyro], [0.1 * gyro, 0]])
    lam = eigenvalues(stiffness, driving, turning, 0.01)
    case = problem(stiffness, driving, turning, 0.01)
    result = sweep(case, values, "p", max_frequency=3.5 / (2 * np.pi), method="reduced")
    modes = result.points[-1].modes
    expected = lam[(lam.real > 1e-6) & (lam.imag > 0) & (lam.imag < 3.5)]
    np.testing.assert_allclose(modes.lam[modes.stability == "unstable"], expected, rtol=1e-6)
    swinging = np.sqrt(stiffness[:-2] - 0.005**2)
    assert len(modes) == np.count_nonzero(swinging < 3.5) + 1


@pytest.mark.parametrize(
    ("kind", "alpha"), crossed([*GROWTH, "whirl"], [0.0, 0.01], fast=lambda kind, a: a == 0 and kind == "divergence")
)
def test_a_box_of_parameters_has_modes_that_come_from_afar(kind, alpha):
    """Swept are the forces and the stiffness of one of the other oscillators; far from p = 1 the modes are away."""
    stiffness = np.append(np.linspace(1, 10, N - 2), [10.0, 10.0]) ** 2
    turning = np.array([[0, 20.0], [-20.0, 0]]) if kind == "whirl" else None
    friction = np.array([[0, -2.0], [2.0, 0]]) if kind == "whirl" else np.array(GROWTH[kind])
    lam, case = eigenvalues(stiffness, friction, turning, alpha), problem(stiffness, friction, turning, alpha)
    own = sp.csr_array(np.outer(TURN[3], TURN[3]))
    case = replace(case, terms=(*case.terms, Term("own", "K", own, True, {"s": 1})), parameters={"p": 1.0, "s": 0.1})
    limit = 4.4 if kind == "whirl" else 2.2
    request, names, low, high = Request(None, limit / (2 * np.pi), 1e-7), ("p", "s"), np.zeros(2), np.array([1.0, 0.5])

    def draw(i: int) -> list[tuple[float, ...]]:
        return [tuple(map(float, high * u)) for u in sobol_points(12, 2, i)]

    model = BoxModel(case, names, low, high, draw, request).online()
    modes = model.modes((1.0, 0.2))[0]
    grows = modes.lam[(modes.stability == "unstable") & (modes.lam.imag < limit)]
    expected = lam[(lam.real > 1e-6) & (lam.imag >= 0) & (lam.imag < limit)]
    assert len(expected)
    np.testing.assert_allclose(grows, expected, rtol=1e-5)


def test_the_rate_of_gyroscopic_terms_is_a_bound():
    """Of a rotating ring, against the eigenvalues of M⁻¹G; and it bounds how far modes come down."""
    rotation = {"bodies": ["disc"], "axis": [0, 0, 1], "centre": [0, 0, 0], "speed": 900.0}
    mesh = annulus("hex2", (1, 12, 1), 0.06, 0.10, 0.01)
    problem = make_problem(mesh, supports=[{"surface": "hub", "fixed": "xyz"}], effects={"rotation": rotation})
    G = sum(t.matrix * t.coefficient(problem.parameters) for t in problem.terms if t.slot == "C").toarray()
    M, K = problem.mass.toarray(), problem.pencil().K.toarray()
    true = la.eigvalsh(1j * G, M).max()
    rate = whirl_rate(problem)
    assert true <= rate <= 100 * true
    theta = la.eigvalsh(K, M)
    A = np.block([[np.zeros_like(M), np.eye(len(M))], [-la.solve(M, K), -la.solve(M, G)]])
    swinging = np.sort(la.eigvals(A).imag)
    for omega in swinging[swinging > 0][:40] * (1 + 1e-6):
        own = np.count_nonzero((swinging > 0) & (swinging <= omega))
        assert own <= np.count_nonzero(theta <= omega**2 + true * omega)


@pytest.mark.parametrize("C", [np.eye(60, k=1), np.eye(60, k=1) - np.eye(60, k=-1)])
def test_the_rate_is_not_known_of_other_terms_or_without_mass(C):
    massless = np.arange(60) == 0 if abs(C + C.T).max() == 0 else np.zeros(60, bool)
    parts = ("m", "M", np.diag(1.0 - massless)), ("k", "K", np.eye(60)), ("g", "C", C)
    terms = tuple(Term(n, slot, sp.csr_array(A), slot != "C", skew=n == "g" and massless.any()) for n, slot, A in parts)
    assert whirl_rate(Problem(terms, {})) == np.inf
