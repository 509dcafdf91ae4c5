"""Which of a test's parameters `make test` runs; the others are marked slow and run in `make test-all`."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from typing import Any

import pytest


def some(values: Iterable[Any], fast: Callable[..., bool]) -> list[Any]:
    """Return parameters, one value or a tuple of values each; slow where `fast` of them is false."""
    rows = [v if isinstance(v, tuple) else (v,) for v in values]
    return [pytest.param(*row, marks=() if fast(*row) else pytest.mark.slow) for row in rows]


def crossed(*axes: Iterable[Any], fast: Callable[..., bool]) -> list[Any]:
    """Return all combinations of the values of some parameters, as `some` does."""
    return some(itertools.product(*axes), fast)
