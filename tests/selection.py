"""Choose which tests, and which parameters of a test, `make test` runs; the others are slow and run in `make test-all`.

How many random examples a test has is chosen here as well: `make test-again` has more of them than `make test-all`.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Hashable, Iterable, Sequence
from pathlib import Path
from typing import Any

import pytest
from varied_imports import SEED

# Names of files without "test_": what becomes of numbers in pages, pictures, decks and folders.
_NOT_MATHEMATICS = ("report_", "decks_", "folders", "surroundings", "safety", "damaged_results", "files_within_limits",
                    "exchanged_folders", "isolation", "run_files", "study_command", "cli_commands", "lumped_studies",
                    "measured", "mesh_writing", "difference")  # fmt: skip


def is_mathematics(path: Path) -> bool:
    """Return whether a file of tests is one of those whose fast tests are in `make test`."""
    return not path.name.removeprefix("test_").startswith(_NOT_MATHEMATICS)


def amount(usual: int, again: int) -> int:
    """Return how many random examples a test has: `again` where each repetition has others, as in `make test-again`."""
    return again if os.environ.get(SEED) else usual


def some(values: Iterable[Any], fast: Callable[..., bool]) -> list[Any]:
    """Return parameters for pytest, each a value or a tuple of values; those for which `fast` is false are slow."""
    rows = [v if isinstance(v, tuple) else (v,) for v in values]
    return [pytest.param(*row, marks=() if fast(*row) else pytest.mark.slow) for row in rows]


def in_part(files: Sequence[Path], part: str) -> set[Path]:
    """Return the files of a part: "K/N" stands for every N-th one from the K-th on, counted round.

    Examples
    --------
    >>> files = [Path("a"), Path("b"), Path("c")]
    >>> [sorted(str(f) for f in in_part(files, part)) for part in ("1/2", "2/2", "41/2", "1/1")]
    [['a', 'c'], ['b'], ['a', 'c'], ['a', 'b', 'c']]
    """
    k, n = (int(number) for number in part.split("/"))
    return set(files[(k - 1) % n :: n])


def crossed(*axes: Iterable[Any], fast: Callable[..., bool]) -> list[Any]:
    """Return all combinations of the values of several parameters; those for which `fast` is false are slow."""
    return some(itertools.product(*axes), fast)


def parameters(item: pytest.Item) -> set[Hashable]:
    """Return the names of each `parametrize` and fixture of a test, with what tells which of its values these are."""
    values: dict[str, object] = dict(item.callspec.params)  # type: ignore[attr-defined]
    names = [tuple(n.strip() for n in mark.args[0].split(",")) if isinstance(mark.args[0], str) else tuple(mark.args[0])
             for mark in item.iter_markers("parametrize")]  # fmt: skip
    joined = set(itertools.chain(*names))
    # All combinations share the objects that are their values, which need not be hashable, nor equal to themselves.
    return {(n, *(id(values[k]) for k in n)) for n in [*names, *((k,) for k in values if k not in joined)]}


def covering(combinations: Sequence[set[Hashable]]) -> list[int]:
    """Return the numbers of a few of the sets whose union is that of all: again and again the one that adds the most.

    `make test` runs these combinations of several parameters: each value of each parameter is in one.

    Examples
    --------
    >>> covering([{"a0", "b0"}, {"a0", "b1"}, {"a1", "b0"}, {"a1", "b1"}])
    [0, 3]
    """
    missing: set[Hashable] = set().union(*combinations)
    chosen = []
    while missing:
        chosen.append(max(range(len(combinations)), key=lambda k: len(combinations[k] & missing)))
        missing -= combinations[chosen[-1]]
    return chosen
