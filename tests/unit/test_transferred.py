"""An interpolated problem on the basis of a reduced model of the problem itself, against LAPACK and its own bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from chains import CLASSES, MODES, Opening, dense
from selection import some

from fe_squeal import NotConvergedError
from fe_squeal.eigen.request import Request, is_needed
from fe_squeal.problem.interpolation import interpolate
from fe_squeal.problem.terms import Term
from fe_squeal.reduced import ReducedModel, TransferredModel

VALUES = np.linspace(0.0, 0.9, 7)


@pytest.fixture(scope="module", params=some(CLASSES, lambda kind: kind in ("nonsymmetric", "complex")))
def both(request):
    """The problem interpolated over all values, and its modes on the basis of the problem itself."""
    problem = Opening(*CLASSES[request.param]).problem({"mu": 0.3})
    model = ReducedModel(problem, "mu", VALUES, Request(count=MODES))
    affine = interpolate(problem, "mu", float(VALUES[0]), float(VALUES[-1]))
    return affine, TransferredModel(model, affine, 0.0), model


def test_modes_are_those_of_the_other_problem_within_the_errors_told(both):
    """Of the other problem: the two differ by far more than the errors, between the values that are interpolated."""
    affine, transferred, model = both
    apart = 0.0
    for value in VALUES:
        exact, modes = dense(affine, value), transferred.modes(value)
        swings = is_needed(modes) & (modes.lam.imag > 0)
        off = np.abs(modes.lam[swings, None] - exact).min(axis=1) / np.abs(modes.lam[swings])
        assert off.max() <= 3 * transferred.error(value) + 1e-11
        own = model.modes(value)
        apart = max(apart, float(np.abs(own.lam - modes.lam[: len(own)]).max(initial=0.0) / np.abs(own.lam).max()))
    assert apart > 1e-5


def test_the_basis_gets_no_vector_more(both):
    _, transferred, model = both
    assert len(transferred.basis) <= len(model.basis)


def test_a_problem_far_away_is_told():
    """With springs to the ground here and there modes are others, and the basis does not hold them."""
    problem = Opening().problem({"mu": 0.3})
    model = ReducedModel(problem, "mu", VALUES, Request(count=MODES))
    affine = interpolate(problem, "mu", 0.0, 0.9)
    size = max(abs(t.matrix).max() for t in affine.terms if t.slot == "K")
    ground = sp.csr_array(sp.diags_array(size * np.random.default_rng(3).uniform(0.0, 1e-3, affine.unknowns)))
    far = replace(affine, terms=(*affine.terms, Term("ground", "K", ground, True)))
    assert TransferredModel(model, affine, 0.0).error(0.0) < 1e-6
    transferred = TransferredModel(model, far, 0.0)
    modes = transferred.modes(0.0)
    off = np.abs(modes.lam[:, None] - dense(far, 0.0)).min(axis=1) / np.abs(modes.lam)
    assert 1e-4 < off.max() <= 3 * transferred.error(0.0)
    away = replace(far, terms=(*affine.terms, Term("ground", "K", 1000 * ground, True)))
    with pytest.raises(NotConvergedError, match="no modes in the range"):
        TransferredModel(model, away, 0.0)
