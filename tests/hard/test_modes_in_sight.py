"""Modes that a shift inside the band, a count, or a stopping rule would lose; each docstring names what breaks."""

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

import fe_squeal
from fe_squeal.eigen.dense import DENSE_LIMIT
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.fem.contact import contact_operators
from fe_squeal.fem.spaces import make_space
from fe_squeal.problem.energy import energy_balance
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.sweep.sweep import sweep
from meshes import box, join

N = DENSE_LIMIT + 60


def diagonal(theta, slope=None, damping=None):
    """Uncoupled oscillators of unit mass; θ_i(μ) = θ_i + μ slope_i."""
    terms = [Term("m", "M", sp.eye_array(len(theta), format="csr"), True)]
    terms.append(Term("k", "K", sp.csr_array(sp.diags_array(np.asarray(theta, float))), True))
    if slope is not None:
        # Declared nonsymmetric, so that the sweep takes the path of a frictional problem.
        terms.append(Term("f", "K", sp.csr_array(sp.diags_array(np.asarray(slope, float))), False, {"mu": 1}))
    if damping is not None:
        terms.append(Term("c", "C", sp.csr_array(sp.diags_array(np.asarray(damping, float))), True))
    return Problem(tuple(terms), {"mu": 0.0})


def test_divergence_far_below_zero_is_kept():
    """θ from 1 through 0 at μ = 0.5 to −199: a shift inside the band 1…400 looks at the other side only."""
    theta = np.arange(1.0, N + 1)
    slope = np.zeros(N)
    slope[0] = -2.0
    result = sweep(diagonal(theta, slope), [0.0, 0.4, 1.0, 5.0, 10.0], modes=20)
    [onset] = result.onsets
    assert onset.kind == "divergence" and onset.value == pytest.approx(0.5, abs=1e-10)
    for point in result.points[2:]:
        growing = point.modes.lam[point.modes.stability == "unstable"]
        np.testing.assert_allclose(growing, [np.sqrt(2 * point.value - 1)], rtol=1e-10)


def test_overdamped_modes_do_not_crowd_out_oscillating_ones():
    """60 oscillators with real λ near zero beside lightly damped ones: the 10 lowest asked for are those that swing."""
    theta, damping = np.arange(1.0, N + 1), np.full(N, 0.02)
    theta[-60:], damping[-60:] = np.linspace(1.0, 4.0, 60), 200.0
    modes = solve_modes(diagonal(theta, damping=damping).pencil(), Request(count=10))
    oscillating = modes.lam[modes.lam.imag > 0]
    exact = -0.01 + 1j * np.sqrt(np.arange(1.0, 11) - 1e-4)
    np.testing.assert_allclose(oscillating, exact, rtol=1e-9)
    real = modes.lam[modes.lam.imag == 0].real
    slow = -100 + np.sqrt(1e4 - theta[-60:])
    assert all(np.abs(slow - x).min() < 1e-9 for x in real)


@pytest.mark.parametrize("damping", [1e-9, 1e-5, 1e-2])
def test_onset_of_almost_no_damping_stays_where_it_is(damping):
    """On the stable side Re λ = −c/2 may lie below rounding: a Newton step on Re λ = 0 alone then goes anywhere."""
    base = diagonal([22.5, 17.5], damping=[damping] * 2)
    b, k3 = -5 * np.sqrt(3) / 2, 10.0
    coupling = Term("b", "K", sp.csr_array(np.array([[0.0, b], [b, 0.0]])), True)
    friction = Term("f", "K", sp.csr_array(np.array([[0.0, k3], [0.0, 0.0]])), False, {"mu": 1})
    result = sweep(Problem((*base.terms, coupling, friction), {"mu": 0.0}), np.linspace(0, 1, 8), modes=2)
    [onset] = result.onsets
    # The two modes share the damping: λ² + cλ + θ = 0 with complex θ crosses where |Im θ| = c √(Re θ), μ_c + O(c²).
    expected = 1 / np.sqrt(3) + damping**2 * 20 / (abs(b) * k3)
    assert onset.value == pytest.approx(expected, abs=1e-6)
    assert abs(onset.value - expected) <= onset.uncertainty + 1e-12


def test_rigid_modes_of_a_damped_free_chain_are_zero():
    """A double zero eigenvalue of a damped pencil splits by the root of rounding; it is still zero and marginal."""
    n = 30
    K = np.diag(np.r_[1.0, 2 * np.ones(n - 2), 1.0]) - np.eye(n, k=1) - np.eye(n, k=-1)
    terms = [Term(*t, True) for t in (("m", "M", sp.eye_array(n, format="csr")), ("k", "K", sp.csr_array(K)))]
    problem = Problem((*terms, Term("c", "C", sp.csr_array(0.1 * K), True)), {})
    modes = solve_modes(problem.pencil(), Request(count=5))
    zero = modes.lam == 0
    assert zero.any() and (modes.stability[zero] == "marginal").all()
    theta = la.eigvalsh(K)[1:4]
    exact = -0.05 * theta + 1j * np.sqrt(theta - (0.05 * theta) ** 2)
    assert all(np.abs(modes.lam - x).min() < 1e-9 for x in exact)


def test_shares_of_a_real_growth_rate_add_up():
    """For an undamped divergence the oscillating mode's energy balance is 0/0."""
    problem = diagonal([1.0, 9.0], [-2.0, 0.0])
    found = energy_balance(problem.at(mu=5.0), 3.0 + 0j, np.array([1.0, 0.0]))
    shares = {name: share.growth for name, share in found.items() if share.growth}
    assert shares == pytest.approx({"k": -1 / 3, "f": 10 / 3})
    assert sum(shares.values()) == pytest.approx(3.0)


@pytest.mark.parametrize("ratio", [3, 5])
def test_nested_meshes_are_not_taken_for_matching(ratio):
    """Facets cut into 3 or 5 keep one centre where it was: centres alone would skip most of the finer ones."""
    pad = box("hex2", (2, 2, 1), (0.06, 0.06, 0.02), name="pad")
    belt = box("hex2", (2 * ratio, 2 * ratio, 1), (0.06, 0.06, 0.02), (0, 0, -0.02), name="belt")
    mesh = fe_squeal.from_skfem(join(pad, belt)).mesh
    space = make_space(mesh, 2, [])
    operators = contact_operators(space, mesh.boundaries["bottom_pad"], mesh.boundaries["top_belt"], None)
    forces = space.expand(operators.gap.T @ operators.weights)
    face = space.nodes_of(mesh.boundaries["top_belt"])
    exact = space.surface(mesh.boundaries["top_belt"])
    tributary = exact.values.T @ exact.weights
    error = np.abs(forces[face, 2] + tributary[face])
    assert error.max() < 0.3 * tributary.max()
    assert np.count_nonzero(forces[face, 2]) == np.count_nonzero(tributary[face])


def test_a_pair_that_couples_and_parts_inside_one_step_is_found():
    """θ = 100 ± √((μ−1)(μ−1.4)) beside 480 other modes, values 0, 2, 4: nothing is unstable at any of them."""
    base = diagonal(np.r_[100.0, 100.0, 200.0 + np.arange(N - 2)])
    terms = [Term("low", "K", sp.csr_array(([1.0], ([1], [0])), shape=(N, N)), False)]
    for power, value in ((0, 1.4), (1, -2.4), (2, 1.0)):
        upper = sp.csr_array(([value], ([0], [1])), shape=(N, N))
        terms.append(Term(f"up{power}", "K", upper, False, {"mu": power}))
    result = sweep(Problem((*base.terms, *terms), {"mu": 0.0}), [0.0, 2.0, 4.0], modes=10)
    assert [o.direction for o in result.onsets] == ["into", "out of"]
    np.testing.assert_allclose([o.value for o in result.onsets], [1.0, 1.4], atol=1e-9)
    assert result.warnings == ()
