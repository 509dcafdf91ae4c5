"""Divergence and strong flutter beside loss factors, whose law is one of oscillations: told, never silent."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

import fe_squeal
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term


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
