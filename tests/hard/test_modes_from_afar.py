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
from fe_squeal.reduced.whirling import _counted, whirl_rate
from fe_squeal.study.points import sobol_points
from meshes import annulus, make_problem

N = 160
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


FAR = {
    "whirl": ([[0.0, -2.0], [2.0, 0.0]], [[0.0, 20.0], [-20.0, 0.0]]), "flutter": ([[-56.0, 1.0], [-1.0, -56.0]], None),
}  # fmt: skip


@pytest.mark.parametrize("values", some([((1.0,),), ((0.0, 0.5, 1.0),)], lambda values: len(values) == 1))
@pytest.mark.parametrize("kind", FAR)
def test_the_mode_from_afar_may_be_the_highest_one_of_the_range(kind, values):
    """All others end at 2 rad/s, and the range at 3.5: a search up to the highest known mode would not see it."""
    stiffness = np.concatenate([np.linspace(1, 2, 20), np.linspace(6, 20, N - 22), [8.0, 8.0]]) ** 2
    friction, gyroscopic = (None if x is None else np.array(x) for x in FAR[kind])
    lam = eigenvalues(stiffness, friction, gyroscopic, 0.01)
    result = sweep(problem(stiffness, friction, gyroscopic, 0.01), values, "p", max_frequency=3.5 / (2 * np.pi),
                   method="reduced")  # fmt: skip
    modes = result.points[-1].modes
    expected = lam[(lam.real > 1e-6) & (lam.imag > 0) & (lam.imag < 3.5)]
    assert len(expected)
    np.testing.assert_allclose(modes.lam[modes.stability == "unstable"], expected, rtol=1e-6)


@pytest.mark.parametrize("seed", [1000, 1003])
def test_a_rough_image_just_beyond_the_range_is_searched_for_again(seed, monkeypatch):
    """From these starts the first search has the whirl of 2.81 rad/s at 3.51: the range ends at 3.5."""
    for module in "missing", "whirling", "soft", "basis":
        monkeypatch.setattr(f"fe_squeal.reduced.{module}._SEED", seed)
    test_the_mode_from_afar_may_be_the_highest_one_of_the_range("whirl", (1.0,))


def stiffened(case: Problem, *parts: tuple[float, int]) -> Problem:
    """Return the problem with (factor, power) · 1 as further stiffness of the last two oscillators."""
    last = np.zeros((N, N))
    last[-2:, -2:] = np.eye(2)
    own = sp.csr_array(TURN.T @ last @ TURN)
    more = (Term(f"own{i}", "K", own * factor, True, {"p": power}) for i, (factor, power) in enumerate(parts))
    return replace(case, terms=(*case.terms, *more))


def test_a_whirl_in_the_middle_of_a_sweep_of_speeds():
    """Gyroscopic forces bring it down, and stiffening by p² takes it away again: it is in range at p = 3.5 alone."""
    stiffness, rates = np.append(np.linspace(1, 20, N - 2), [8.0, 8.0]) ** 2, np.array([[0, 20.0], [-20.0, 0]])
    driving = np.array([[0, -2.0], [2.0, 0]])
    case = stiffened(problem(stiffness, driving, rates, 0.01), (5.0, 2))
    result = sweep(case, (0.0, 3.5, 20.0), "p", max_frequency=2.1 / (2 * np.pi), method="reduced")
    lam = eigenvalues(stiffness + 5 * 3.5**2, 3.5 * driving, 3.5 * rates, 0.01)
    expected = lam[(lam.real > 1e-6) & (lam.imag > 0) & (lam.imag < 2.1)]
    modes = result.points[1].modes
    assert len(expected)
    np.testing.assert_allclose(modes.lam[modes.stability == "unstable"], expected, rtol=1e-6)


@pytest.mark.slow
def test_a_part_that_is_soft_at_one_value_between_others():
    """Its stiffness is 324 − 2584p + 5168p², 1 at p = 0.25, where friction makes the two oscillators flutter."""
    stiffness, friction = np.append(np.linspace(1, 20, N - 2), [18.0, 18.0]) ** 2, np.array([[0, -1.0], [1.0, 0]])
    case = stiffened(problem(stiffness, friction, None, 0.0), (-2584.0, 1), (5168.0, 2))
    values = (0.0, 0.125, 0.25, 0.375, 0.5, 0.75, 1.0)
    result = sweep(case, values, "p", max_frequency=2.5 / (2 * np.pi), method="reduced")
    lam = eigenvalues(np.full(N, 1.0), 0.25 * friction, None, 0.0)
    modes, expected = result.points[2].modes, lam[(lam.real > 0) & (lam.imag > 0)]
    np.testing.assert_allclose(modes.lam[modes.stability == "unstable"], expected, rtol=1e-6)


def test_soft_directions_are_searched_for_until_there_are_as_many_as_counted(monkeypatch):
    """One step of the search is hardly ever enough, and as many as there are as a rule were not from every start."""
    monkeypatch.setattr("fe_squeal.reduced.soft._STEPS", 1)
    test_friction_that_softens_modes_far_beyond_the_range("divergence", 0.0, (1.0,))


def test_whirls_are_searched_for_until_there_are_as_many_as_counted(monkeypatch):
    """A step of the search from one vector never has the four whirls; as many searches as it takes have."""
    monkeypatch.setattr("fe_squeal.reduced.whirling._STEPS", 1)
    monkeypatch.setattr("fe_squeal.reduced.whirling._BLOCK", 1)
    test_the_mode_from_afar_may_be_the_highest_one_of_the_range("whirl", (1.0,))


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


def rotating_ring(speed: float) -> Problem:
    rotation = {"bodies": ["disc"], "axis": [0, 0, 1], "centre": [0, 0, 0], "speed": speed}
    mesh = annulus("hex2", (1, 12, 1), 0.06, 0.10, 0.01)
    return make_problem(mesh, supports=[{"surface": "hub", "fixed": "xyz"}], effects={"rotation": rotation})


def test_the_rate_of_gyroscopic_terms_is_a_bound():
    """Of a rotating ring, against the eigenvalues of M⁻¹G; and it bounds how far modes come down."""
    problem = rotating_ring(900.0)
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


@pytest.mark.usefixtures("needs_pardiso")
def test_the_hermitian_matrix_counts_the_modes_of_a_rotating_ring():
    """As long as K is positive, each frequency at which an eigenvalue of H(ω) = K − ω²M + iωG turns negative is one."""
    pencil = rotating_ring(900.0).pencil()
    M, C, K = (A.toarray() for A in (pencil.M, pencil.C, pencil.K))
    A = np.block([[np.zeros_like(M), np.eye(len(M))], [-la.solve(M, K), -la.solve(M, C)]])
    swinging = np.sort(la.eigvals(A).imag)
    swinging = swinging[swinging > 0]
    assert la.eigvalsh(K)[0] > 0
    still = np.sqrt(la.eigvalsh(K, M))
    for k in (1, 2, 5, 30, 31, 100):
        omega = (swinging[k - 1] + swinging[k]) / 2
        assert _counted(pencil, omega, "pardiso") == k
    assert np.abs(still[:31] - swinging[:31]).max() > 0.01 * still[0]  # another count than that without rotation


@pytest.mark.slow
def test_motions_without_mass_do_not_count_as_soft_by_rounding():
    """A mass on a massless unknown, whose spring to the ground depends on p: 1e-18 of a mass in the basis is none."""
    stiffness, friction = np.append(np.linspace(1, 10, N - 2), [10.0, 10.0]) ** 2, np.array(GROWTH["divergence"])
    case, none = problem(stiffness, friction, None, 0.0), np.zeros((2, 2))
    beside = {"M0": np.diag([1.0, 0.0]), "K1": np.array([[10.0, -10.0], [-10.0, 12.55]])}
    terms = [replace(t, matrix=sp.csr_array(sp.block_diag([t.matrix, beside.get(t.name, none)]))) for t in case.terms]
    spring = sp.csr_array(sp.block_diag([sp.csr_array((N, N)), np.diag([0.0, -2.45])]))
    wide = replace(case, terms=(*terms, Term("spring", "K", spring, True, {"p": 1})))
    result = sweep(wide, (-1.0, -0.5, 0.0, 0.5, 1.0), "p", max_frequency=2.2 / (2 * np.pi), method="reduced")
    for point, p in zip(result.points, (-1.0, -0.5, 0.0, 0.5, 1.0), strict=True):
        lam = eigenvalues(stiffness, p * friction, None, 0.0)
        expected = lam[(lam.real > 1e-6) & (lam.imag >= 0) & (lam.imag < 2.2)]
        found = point.modes.lam[point.modes.stability == "unstable"]
        np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("C", [np.eye(60, k=1), np.eye(60, k=1) - np.eye(60, k=-1)])
def test_the_rate_is_not_known_of_other_terms_or_without_mass(C):
    massless = np.arange(60) == 0 if abs(C + C.T).max() == 0 else np.zeros(60, bool)
    parts = ("m", "M", np.diag(1.0 - massless)), ("k", "K", np.eye(60)), ("g", "C", C)
    terms = tuple(Term(n, slot, sp.csr_array(A), slot != "C", skew=n == "g" and massless.any()) for n, slot, A in parts)
    assert whirl_rate(Problem(terms, {})) == np.inf
