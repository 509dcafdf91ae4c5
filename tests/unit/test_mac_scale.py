"""The modal assurance criterion does not depend on the units of a shape, however large or small its numbers are."""

from __future__ import annotations

import numpy as np
import pytest

from fe_squeal.report.mac import mac


@pytest.mark.parametrize("scale", [1e-320, 1e-200, 1e-160, 1.0, 1e160, 1e200, 1e307])
def test_units_do_not_matter(scale: float) -> None:
    """(1, 2j)ᴴ (3, 1) = 3 − 2j: 13/(5 ⋅ 10). The smallest of these numbers have four digits."""
    a, b = np.array([1.0, 2j]), np.array([3.0, 1.0])
    expected = pytest.approx(0.26, rel=1e-3 if scale < 1e-300 else 1e-12)
    assert mac(a * scale, b) == expected
    assert mac(a, b * scale) == expected
    assert mac(a * scale, b * scale) == expected
    assert mac(a * scale, b / scale if scale > 1e-300 else b) == expected


def test_nothing_moves() -> None:
    assert np.isnan(mac(np.zeros(3), np.ones(3))) and np.isnan(mac(np.zeros(0), np.zeros(0)))
