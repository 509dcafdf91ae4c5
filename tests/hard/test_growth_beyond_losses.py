"""Divergence and strong flutter beside loss factors, whose law is one of oscillations: told, never silent."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

import fe_squeal
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.quality import modes_from_lambda, modes_from_theta
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.sweep.losses import growth_beyond


def term(name, slot, matrix, powers=None, **more):
    return Term(name, slot, sp.csr_array(np.array(matrix, float)), more.pop("symmetric", True), powers or {}, **more)


def softening(loss, damping):
    """Two oscillators of stiffness 1 − p and 9: without losses the first one diverges beyond p = 1."""
    parts = [term("mass", "M", np.eye(2)), term("elastic", "K", np.diag([1.0, 9.0])),
             term("load", "K", np.diag([-1.0, 0.0]), {"p": 1})]  # fmt: skip
    parts += [term("loss", "K", loss * np.diag([1.0, 9.0]), imaginary=True)] if loss else []
    parts += [term("damper", "C", damping * np.eye(2))] if damping else []
    return Problem(tuple(parts), {"p": 0.0})


@pytest.mark.parametrize("method", ["direct", "reduced"])
@pytest.mark.parametrize("damping", [0.0, 0.1, 3.0])
def test_divergence_beside_losses(damping, method):
    """No onset can be given, since the law says nothing at λ = 0; where something diverges is told, and only there."""
    values = np.linspace(0.0, 2.0, 6)
    told = fe_squeal.sweep(softening(0.05, damping), values, "p", modes=2, method=method)
    (sentence,) = [w for w in told.unsettled if "loss factors say nothing" in w]
    assert "p = 1.2 to 2 " in sentence and not told.onsets_complete["sure"]
    below = fe_squeal.sweep(softening(0.05, damping), 0.4 * values, "p", modes=2, method=method)
    assert not any("loss factors" in w for w in below.warnings)
    (onset,) = fe_squeal.sweep(softening(0.0, damping), values, "p", modes=2, method=method).onsets
    assert onset.value == pytest.approx(1.0, abs=1e-6) and onset.kind == "divergence"


def strong(loss):
    """λ = ±0.70 ± 0.21j of friction, which grows faster than it swings, at p = 1.5."""
    parts = (term("mass", "M", np.eye(2)), term("elastic", "K", -0.45 * np.eye(2)),
             term("push", "K", [[0.0, 0.2], [-0.2, 0.0]], {"p": 1}, symmetric=False),
             term("loss", "K", loss * np.eye(2), imaginary=True))  # fmt: skip
    return Problem(parts, {"p": 1.5})


@pytest.mark.parametrize("loss", [1e-9, 1e-3, 0.05])
def test_strong_flutter_that_losses_hardly_change_is_unstable(loss):
    """By what they change of it, δλ = loss/(2|λ|), and no more."""
    result = fe_squeal.sweep(strong(loss), [1.5], "p", modes=2)
    modes = result.points[0].modes
    assert modes.stability[modes.lam.real > 0].tolist() == ["unstable"]
    exact = np.sqrt(0.45 - 0.3j)
    growing = modes.lam.real > 0
    assert np.abs(modes.lam[growing] - exact.conjugate()) <= modes.re_uncertainty[growing] * 1.01
    np.testing.assert_allclose(modes.re_uncertainty[growing], loss / (2 * abs(exact)), rtol=0.1, atol=1e-8)
    assert not any("loss factors say nothing" in w for w in result.warnings)


def test_strong_flutter_that_losses_change_much_is_told():
    """0.2 of 0.3 in Im θ: a study says what that means."""
    result = fe_squeal.sweep(strong(0.2), [1.5], "p", modes=2)
    assert any("loss factors say nothing" in w for w in result.unsettled)
    box = {"p": {"uniform": {"low": 1.0, "high": 2.0}}}
    study = fe_squeal.scatter(strong(0.2), box, samples=16, indices=False)
    assert "loss factors say nothing" in study.solver.why


def chain(extra, damping, n=850, loss=0.05):
    """A chain of 30 masses beside stiffer single ones, with losses, and a stiffness of its last masses without."""
    single, links = np.linspace(50.0, 100.0, n - 30), sp.diags_array(np.ones(29), offsets=1, shape=(30, 30))
    elastic = sp.csr_array(sp.block_diag([sp.diags_array(single), 2 * sp.eye_array(30) - links - links.T]))
    last = np.arange(n - len(extra), n)
    push = sp.coo_array((np.ravel(extra), (np.repeat(last, len(last)), np.tile(last, len(last)))), shape=(n, n))
    parts = [Term("mass", "M", sp.eye_array(n, format="csr"), True), Term("elastic", "K", elastic, True),
             Term("loss", "K", loss * elastic, True, imaginary=True),
             Term("push", "K", sp.csr_array(push), False, {"p": 1})]  # fmt: skip
    parts += [Term("damper", "C", damping * sp.eye_array(n, format="csr"), True)] if damping else []
    return Problem(tuple(parts), {"p": 1.0})


def swings_below_1(problem):
    return fe_squeal.sweep(problem, [1.0], "p", max_frequency=1.0 / (2 * np.pi))


@pytest.mark.parametrize("stiffness", [-1.5, -9.0])
@pytest.mark.parametrize("damping", [0.0, 0.01])
def test_divergence_of_large_matrices_is_told(stiffness, damping):
    """With a stiffness −s at its end the chain has θ = 2 − s − 1/s, of 0.4 or 2.7 1/s but for the losses."""
    told = swings_below_1(chain([[stiffness]], damping)).unsettled
    (sentence,) = [w for w in told if "loss factors" in w]
    rate = np.sqrt(damping**2 / 4 - 2 - stiffness - 1 / stiffness) - damping / 2
    assert float(re.search(r"by up to (\S+) 1/s", sentence).group(1)) == pytest.approx(rate, rel=0.02)


@pytest.mark.parametrize("damping", [0.0, 0.01])
def test_what_the_law_makes_of_strong_flutter_below_the_axis_is_not_told(damping):
    """λ = a ± ib with b < a, but for losses that change little of it."""
    result = swings_below_1(chain([[-3.0, 2.0], [-2.0, -3.0]], damping, loss=0.01))
    modes = result.points[0].modes
    fast = modes.lam.real > modes.lam.imag
    assert (modes.lam.real > 1.2).any() and fast[modes.stability == "unstable"].all()
    assert not any("loss factors" in w for w in result.warnings)


def test_slow_growth_that_losses_do_not_touch_is_listed_and_told():
    """Ten free pairs, each of the two masses with a negative damper, λ ≈ g: rounding puts some below the axis."""
    n, rates = 850, np.linspace(1e-4, 1e-3, 10)
    links = sp.diags_array(np.ones(29), offsets=1, shape=(30, 30))
    elastic = sp.block_diag([sp.diags_array(np.linspace(50.0, 100.0, n - 50)), 2 * sp.eye_array(30) - links - links.T])
    pair, lossless = np.array([[1.0, -1.0], [-1.0, 1.0]]), sp.csr_array((20, 20))
    damper = sp.block_diag([0.01 * sp.eye_array(n - 20), *[np.diag([-2 * g, 0.0]) for g in rates]])
    problem = Problem((
        Term("mass", "M", sp.eye_array(n, format="csr"), True),
        Term("elastic", "K", sp.csr_array(sp.block_diag([elastic, *[pair] * 10])), True),
        Term("loss", "K", sp.csr_array(sp.block_diag([0.05 * elastic, lossless])), True, imaginary=True),
        Term("damper", "C", sp.csr_array(damper), True, {"p": 1}),
    ), {"p": 1.0})  # fmt: skip
    result = swings_below_1(problem)
    modes = result.points[0].modes
    found = modes.lam.real > 1e-5
    np.testing.assert_allclose(np.sort(modes.lam[found]), rates, rtol=1e-5)
    assert (modes.stability[found] == "marginal").all() and any("loss factors" in w for w in result.unsettled)


def test_fast_flutter_below_the_axis_is_told_unless_its_partner_is_found():
    """λ = ±0.70 ± 0.21j but for losses and dampers that change little of it."""
    K, C, one, none = strong(0.01).pencil().K.toarray(), 0.01 * np.eye(2), np.eye(2), np.zeros((2, 2))
    pencil = Pencil(*(sp.csr_array(A) for A in (one, K, C)))
    values, states = np.linalg.eig(np.block([[none, one], [-K, -C]]))
    adjoint, left = np.linalg.eig(np.block([[none, one], [-K.conj().T, -C]]))
    left = left[:, [np.abs(adjoint - v.conj()).argmin() for v in values]]
    grows = values.real > 0
    for chosen, rate in ((grows, 0.0), (grows & (values.imag < 0), values.real[grows & (values.imag < 0)][0])):
        modes = modes_from_lambda(pencil, values[chosen], states[:2, chosen], left[:2, chosen], "")
        assert modes.beyond == pytest.approx(rate) and len(modes) == (rate == 0)


@pytest.mark.parametrize("damping", [None, 0.0, 0.05, -0.2])
@pytest.mark.parametrize("softest", [-1e-6, -0.04, -3.0, -500.0, -1e7])
def test_slow_and_fast_divergence_beside_flutter(softest, damping):
    """λ² + cλ + k = 0 of each motion in other coordinates, among them a pair with Im k that flutters faster."""
    rng, n = np.random.default_rng(17), 24
    V = rng.standard_normal((n, n))
    k = np.diag(np.append(rng.uniform(0.1, 1.0, n - 1), softest))
    k[:2, :2] = [[0.2, 3.0], [-3.0, 0.2]]
    C = None if damping is None else sp.csr_array(damping * V @ V.T)
    pencil = Pencil(sp.csr_array(V @ V.T), sp.csr_array(V @ (k + 0j) @ V.T), C)
    one = np.ones((n, 1))
    swings = (modes_from_theta(pencil, np.ones(1), one, one, "known") if C is None
              else modes_from_lambda(pencil, np.array([1.0j]), one, one, "known"))  # fmt: skip
    c = damping or 0.0
    rate = -c / 2 + np.sqrt(c**2 / 4 - softest)
    assert growth_beyond(pencil, swings) == pytest.approx(rate, rel=1e-3 if softest == -1e-6 else 1e-6)
    stiff = V @ (k + np.diag([*np.zeros(n - 1), 0.1 - softest])) @ V.T
    assert damping == -0.2 or growth_beyond(replace(pencil, K=sp.csr_array(stiff + 0j)), swings) == 0
