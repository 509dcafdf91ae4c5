"""How wide a window of instability the error of a group matrix may hide, where Re λ is near zero."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fe_squeal.sweep.changes import Asked
from fe_squeal.sweep.crossings import _hidden

T = np.linspace(0.0, 1.0, 101)
ERROR = 1e-3 * 16 * (T * (1 - T)) ** 2


def hidden(growth, error=ERROR, blur=1e-12, settled=1.0):
    return _hidden(SimpleNamespace(t=T, settled=settled), growth, error, blur)


def test_a_steep_zero_is_one():
    """Re λ changes by 1 over the interval, its error by 1e-3."""
    assert hidden(T - 0.5) == 0


def test_along_zero_all_may_be_hidden():
    """Re λ = −1e-4 where the error is 1e-3 in the middle: it exceeds 1e-4 for |t − 1/2| < 0.41."""
    share = np.sqrt(1 - np.sqrt(0.1))  # 16 t²(1 − t)² = (1 − 4s²)² = 0.1 at s = share / 2
    assert hidden(np.full(101, -1e-4)) == pytest.approx(share, abs=0.03)
    with pytest.raises(Asked) as asked:
        hidden(np.full(101, -1e-4), settled=1e-5)
    assert asked.value.t == pytest.approx(0.5, abs=0.02)


def test_what_is_sure_hides_nothing():
    """Farther from zero than the error, or with errors that are rounding."""
    assert hidden(np.full(101, -2e-3)) == 0
    assert hidden(np.full(101, -1e-4), blur=1e-2) == 0
