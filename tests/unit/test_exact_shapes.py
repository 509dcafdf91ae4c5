"""Shapes of a reduced model that are made exact: by which factors, and only where that is needed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from chains import CLASSES, MODES, chain
from selection import some

from fe_squeal.eigen.quality import backward_errors
from fe_squeal.eigen.request import Request
from fe_squeal.reduced import ReducedModel, mode_corrections

STRONG, WEAK = 0.9, 0.05


def model_to(stop, kind):
    return ReducedModel(chain(*CLASSES[kind]), "mu", np.linspace(0.0, stop, 7), Request(count=MODES))


def exact(model, value, tolerance):
    """Return the shapes of all modes at a value to a tolerance, and how many matrices were factorised for them."""
    model.request = replace(model.request, tolerance=tolerance)
    before = model.factorizations
    modes = model.modes(value)
    shapes, errors = model.shapes(value, range(len(modes)))
    pencil = model.problem.pencil({"mu": value})
    np.testing.assert_allclose(backward_errors(pencil, modes.lam, shapes), errors, rtol=0.1, atol=1e-15)
    return errors, model.factorizations - before


@pytest.mark.parametrize("kind", some(list(CLASSES), lambda kind: kind == "complex with C"))
def test_undamped_factors_make_shapes_exact_where_those_of_p_sufficed(kind):
    """One matrix is factorised for all shapes of a value, and none where they are exact enough as they are."""
    model = model_to(WEAK, kind)
    errors, made = exact(model, WEAK, 1e-5)
    assert errors.max() <= 1e-5 and made == 0
    errors, made = exact(model, WEAK, 1e-11)
    assert errors.max() <= 1e-11 and made == 1


@pytest.mark.parametrize("kind", some(list(CLASSES), lambda kind: kind == "quadratic"))
def test_other_factors_follow_where_they_do_not(kind, monkeypatch):
    """Where P was of no use, a matrix with friction and damping is factorised at once; else after the undamped one."""
    for limit in ("_FAST", "_FASTER", "_FEW"):  # factors of P serve for one correction
        monkeypatch.setattr(mode_corrections, limit, 0)
    model = model_to(STRONG, kind)
    assert model.factorizations > 1
    errors, made = exact(model, STRONG, 1e-11)
    assert errors.max() <= 1e-11 and made == 1
    model._corrections.definite_suffices = True
    monkeypatch.setattr("fe_squeal.reduced.shapes._ROUNDS", 1)
    assert exact(model, STRONG, 1e-13)[1] == 2


def test_what_served_is_stored():
    """A resumed run makes shapes by the same factors."""
    model = model_to(WEAK, "nonsymmetric")
    model._corrections.definite_suffices = False
    again = ReducedModel.restored(model.problem, "mu", model._values, model.request, *model.stored())
    assert not again._corrections.definite_suffices
