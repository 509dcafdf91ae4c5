"""A growing pair that becomes two real eigenvalues, told from a count that differs for another reason."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fe_squeal.sweep.crossings import _partings


def _samples(v: np.ndarray) -> Any:
    """Return what is asked of samples: eigenvalues v (s, m), no rounding, and changes given as (kind, gains, place)."""
    return SimpleNamespace(
        t=np.linspace(0.0, 1.0, len(v)), v=v, rounding=np.zeros(len(v)),
        made=lambda kind, gains, k, there, i, limits, alike: (kind, gains, k),
    )  # fmt: skip


@pytest.mark.parametrize("forwards", [True, False])
def test_a_pair_that_parts(forwards):
    """λ = 1 ± √(t − t₀): a pair counts once, two real eigenvalues count twice."""
    square = np.array([-0.3, -0.1, 0.1, 0.3]) + 0j
    v = 1 + np.stack([np.sqrt(square), -np.sqrt(square)], axis=1)
    v = v if forwards else v[::-1]
    found = _partings(_samples(v), v.real > 0, 1e-12, np.zeros(3, int))
    assert found == [("parting", 1 if forwards else -1, 1)]


def test_a_growing_mode_of_which_rounding_hides_one_sample_is_no_pair_that_parts():
    """Where the modes of an end say that a mode grows, and the group matrix beside it cannot, no onset is made up."""
    blur = 1e-14
    growth = np.array([0.9, 1.3, 1.9, 2.6])[:, None] * blur  # of a mode that grows at every sample, barely
    v = np.hstack([growth + 1j, growth - 1j])
    unstable = v.real > blur
    unstable[0] = True
    assert not _partings(_samples(v), unstable, blur, np.zeros(3, int))
    assert not _partings(_samples(v), v.real > blur, blur, np.zeros(3, int))
