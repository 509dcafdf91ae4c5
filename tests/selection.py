"""Choose which parameters of a test `make test` runs; the others are marked slow and run in `make test-all`.

How many random examples a test has is chosen here as well: `make test-again` has more of them than `make test-all`.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterable
from typing import Any

import pytest
from varied_imports import SEED


def amount(usual: int, again: int) -> int:
    """Return how many random examples a test has: `again` where each repetition has others, as in `make test-again`."""
    return again if os.environ.get(SEED) else usual


def some(values: Iterable[Any], fast: Callable[..., bool]) -> list[Any]:
    """Return parameters for pytest, each a value or a tuple of values; those for which `fast` is false are slow."""
    rows = [v if isinstance(v, tuple) else (v,) for v in values]
    return [pytest.param(*row, marks=() if fast(*row) else pytest.mark.slow) for row in rows]


def crossed(*axes: Iterable[Any], fast: Callable[..., bool]) -> list[Any]:
    """Return all combinations of the values of several parameters; those for which `fast` is false are slow."""
    return some(itertools.product(*axes), fast)
