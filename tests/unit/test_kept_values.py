"""Modes of a reduced model that met the tolerance before its basis grew for other values."""

from __future__ import annotations

import numpy as np
import pytest
from chains import CLASSES, MODES, chain
from selection import some

from fe_squeal.eigen.request import Request
from fe_squeal.reduced import ReducedModel

N, VALUES = 240, np.linspace(0.0, 0.8, 17)


def model_of(kind: str) -> ReducedModel:
    return ReducedModel(chain(*CLASSES[kind], n=N), "mu", VALUES, Request(count=MODES))


@pytest.mark.parametrize("kind", some(CLASSES, lambda kind: kind == "quadratic"))
def test_kept_modes_are_those_of_the_grown_basis(kind):
    """Grown by vectors that have nothing to do with the modes: kept ones stay, and are right to the tolerance."""
    model = model_of(kind)
    kept = {p: model.modes(p) for p in VALUES.tolist()}
    assert set(model._met) >= set(kept)
    shapes, count = {p: model.lift(m.right) for p, m in kept.items()}, len(model.basis)
    model.basis.append(np.random.default_rng(3).standard_normal((N, 5)))
    assert len(model.basis) > count
    for p, before in kept.items():
        after = model.modes(p)
        np.testing.assert_array_equal(after.lam, before.lam)
        assert after.right.shape == (len(model.basis), len(before)) and not after.right[count:].any()
        np.testing.assert_allclose(model.lift(after.right), shapes[p], atol=1e-12 * np.abs(shapes[p]).max())
        exact = model.basis.modes(p, 1.2 * model.highest).lam
        away = np.abs(after.lam[:, None] - exact[None, :]).min(axis=1)
        assert (away <= 1e-8 * np.abs(after.lam)).all()


@pytest.mark.slow
def test_a_stored_model_gives_the_kept_modes_again():
    """A resumed sweep has to give the numbers of an unbroken one, whatever the basis became after a value was met."""
    model = model_of("quadratic")
    kept = {p: model.modes(p) for p in VALUES.tolist()}
    model.basis.append(np.random.default_rng(3).standard_normal((N, 5)))
    again = ReducedModel.restored(model.problem, "mu", VALUES, model.request, *model.stored())
    for p, before in kept.items():
        np.testing.assert_allclose(again.modes(p).lam, before.lam, rtol=1e-12)
        assert again.modes(p).right.shape[0] == len(model.basis)


@pytest.mark.parametrize("kind", some(CLASSES, lambda kind: kind == "quadratic"))
def test_no_modes_are_kept_before_missing_ones_were_looked_for(kind, monkeypatch):
    """The basis may get a mode that they lack from other values; then the search finds that nothing is missing."""
    kept = []
    search = ReducedModel._add_missing

    def noted(self, values):
        kept.append(len(self._met))
        return search(self, values)

    monkeypatch.setattr(ReducedModel, "_add_missing", noted)
    model = model_of(kind)
    assert kept[0] == 0 and set(model._met) == set(VALUES.tolist())
