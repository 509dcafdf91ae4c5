"""Onsets that a rough reduced model gives: corrections of their modes make them as certain as those of the problem."""

from __future__ import annotations

import importlib

import numpy as np
import pytest
from chains import CLASSES, MODES, N, chain
from selection import some

from fe_squeal import sweep
from fe_squeal.eigen.request import Request
from fe_squeal.reduced import ReducedModel, SharperModel

VALUES = np.linspace(0.0, 0.9, 7)
KINDS = ("nonsymmetric", "quadratic", "complex", "complex with C")
roots = importlib.import_module("fe_squeal.sweep.roots")


@pytest.mark.parametrize("kind", some(KINDS, lambda kind: kind == "nonsymmetric"))
def test_rough_models_give_sharp_onsets(kind, monkeypatch):
    """Without Newton's method on the problem itself, although the model's eigenvalues are right to 1e-3 alone."""
    problem = chain(*CLASSES[kind])
    exact = sweep(problem, VALUES, modes=MODES, method="direct").onsets
    rough, sizes = [], []
    measure = ReducedModel.root_error

    def root_error(self, *arguments):
        rough.append(measure(self, *arguments)[0])
        return measure(self, *arguments)

    for name in ("find_coalescence", "find_crossing", "find_zero"):
        find = getattr(roots, name)
        counted = lambda p, *a, find=find, **o: (sizes.append(p.unknowns), find(p, *a, **o))[1]  # noqa: E731
        monkeypatch.setattr(roots, name, counted)
    monkeypatch.setattr(ReducedModel, "root_error", root_error)
    found = sweep(problem, VALUES, modes=MODES, method="reduced", tolerance=1e-3).onsets
    assert len(found) == len(exact) > 0 and sizes
    for a, b in zip(found, exact, strict=True):
        assert abs(a.value - b.value) <= a.uncertainty + b.uncertainty
        assert a.uncertainty <= 2e-7 * a.value
    assert max(rough) > 1e-6  # else there was nothing to sharpen
    assert max(sizes) < N


def test_corrections_leave_the_model_as_it_is():
    problem = chain()
    model = ReducedModel(problem, "mu", VALUES, Request(count=MODES, tolerance=1e-3))
    modes, size = model.modes(0.45), len(model.basis)
    sharper = SharperModel(model)
    lam = 1j * modes.lam[0].imag
    right, left = modes.right[:, 0].real, modes.left[:, 0].real
    before = sharper.root_error(0.45, lam, right, left)
    assert before == model.root_error(0.45, lam, right, left)
    sharper.correct(0.45, lam, right, left, model.middle)
    assert len(model.basis) == size < sharper.problem.unknowns
    # The same numbers of the same vector in the larger basis: what was added is orthogonal to it, in the P-norm.
    padded = sharper.padded(right), sharper.padded(left)
    np.testing.assert_allclose(sharper.root_error(0.45, lam, *padded)[0], before[0], rtol=1e-6)
    np.testing.assert_array_equal(model.modes(0.45).lam, modes.lam)


def test_a_model_that_was_stored_is_sharpened_alike():
    problem, request = chain(), Request(count=MODES, tolerance=1e-3)
    model = ReducedModel(problem, "mu", VALUES, request)
    again = ReducedModel.restored(problem, "mu", VALUES, request, *model.stored())
    modes = model.modes(0.45)
    right, left = modes.right[:, 0].real, modes.left[:, 0].real
    errors = []
    for each in (model, again):
        sharper = SharperModel(each)
        sharper.correct(0.45, 1j * modes.lam[0].imag, right, left, each.middle)
        errors.append(sharper.root_error(0.45, 1j, sharper.padded(right), sharper.padded(left)))
    assert errors[0] == pytest.approx(errors[1], rel=1e-9)


def test_the_error_of_a_root_at_rest():
    """Divergence begins at λ = 0, which rounding puts on either side: both give the error of zero, and no NaN."""
    model = ReducedModel(chain(*CLASSES["quadratic"]), "mu", VALUES, Request(count=MODES, tolerance=1e-3))
    modes = model.modes(0.45)
    right, left = modes.right[:, 0].real, modes.left[:, 0].real
    for each in (model, SharperModel(model)):
        at_rest, *beside = (each.root_error(0.45, lam, right, left) for lam in (0j, 1e-10j, 1e-10))
        assert min(at_rest) > 0
        for found in beside:
            assert found == pytest.approx(at_rest, rel=1e-6)
