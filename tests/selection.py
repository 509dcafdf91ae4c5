"""Choose which parameters of a test `make test` runs; the others are marked slow and run in `make test-all`."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from typing import Any

import pytest


def some(values: Iterable[Any], fast: Callable[..., bool]) -> list[Any]:
    """Return parameters for pytest, each a value or a tuple of values; those for which `fast` is false are slow."""
    rows = [v if isinstance(v, tuple) else (v,) for v in values]
    return [pytest.param(*row, marks=() if fast(*row) else pytest.mark.slow) for row in rows]


def crossed(*axes: Iterable[Any], fast: Callable[..., bool]) -> list[Any]:
    """Return all combinations of the values of several parameters; those for which `fast` is false are slow."""
    return some(itertools.product(*axes), fast)
