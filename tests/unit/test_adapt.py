"""Numbers of elements for a target, from errors that are known; marks of tetrahedra."""

from __future__ import annotations

import numpy as np
import pytest

from fe_squeal.accuracy.adapt import LineErrors, counts_for, told
from fe_squeal.accuracy.candidates import marked_elements
from fe_squeal.accuracy.quantities import Split
from fe_squeal.geometry import Block

BLOCK = Block(length=0.08, width=0.04, height=0.02, size=0.01)  # 8, 4, 2 elements


def errors_of(parts, rate=2.0):
    keys = ("elements_x", "elements_y", "layers")
    return LineErrors(BLOCK.lines, dict(zip(keys, map(np.asarray, parts), strict=True)), dict.fromkeys(keys, rate))


def test_the_line_that_errs_is_cut():
    errors = errors_of(([0.08], [0.0], [0.0]))
    counts = counts_for(errors, BLOCK, 0.02)
    assert counts == {"elements_x": 16, "elements_y": 2, "layers": 1}  # half as many where nothing errs
    assert errors.at(counts)[0] == pytest.approx(0.02)
    assert told(counts, BLOCK.lines) == "elements_x 8 to 16, elements_y 4 to 2, layers 2 to 1"


def test_no_number_is_larger_than_needed():
    """Taking one element from any line that is finer than half its number misses the target."""
    rng = np.random.default_rng(3)
    for _ in range(30):
        errors = errors_of(rng.standard_normal((3, 5)) * 10.0 ** rng.uniform(-3, -1, (3, 1)), rng.uniform(1, 4))
        target = 0.3 * errors.at({k: v.elements for k, v in BLOCK.lines.items()}).max()
        counts = counts_for(errors, BLOCK, target)
        if errors.at(counts).max() > target:  # too far to go there at once
            assert BLOCK.with_counts(counts).cells > BLOCK.cells
            continue
        for key, line in BLOCK.lines.items():
            fewer = {**counts, key: counts[key] - 1}
            assert fewer[key] < max(line.least, line.elements / 2) or errors.at(fewer).max() > target


def test_a_far_target_is_approached_in_steps():
    errors = errors_of(([0.5], [0.5], [0.5]))
    counts = counts_for(errors, BLOCK, 1e-4)
    assert BLOCK.cells < BLOCK.with_counts(counts).cells <= 3.5 * BLOCK.cells


def test_parts_of_opposite_sign_do_not_pass_for_accuracy():
    errors = errors_of(([0.1], [-0.1], [0.0]))
    assert errors.at({k: v.elements for k, v in BLOCK.lines.items()})[0] == pytest.approx(0.1)


def split_of(parts):
    parts = np.asarray(parts, float)[:, :, None]
    return Split(tuple(f"q{i}" for i in range(len(parts))), ("onsets",) * len(parts), np.ones(len(parts)), parts)


def test_marks_hold_what_has_to_go():
    """Of one element with nearly all of the error that one alone; of equal ones as many as the target needs."""
    alone = np.full((1, 100), 1e-5)
    alone[0, 42] = 0.1
    assert marked_elements(split_of(alone), 0.05).tolist() == [42]
    even = split_of(np.full((1, 100), 1e-3))
    assert len(marked_elements(even, 0.05)) == pytest.approx(63, abs=2)  # half of it, 0.8 of each
    assert len(marked_elements(even, 0.01)) == 100


def test_the_quantity_that_misses_most_decides():
    parts = np.zeros((2, 10))
    parts[0, 3], parts[1, 7] = 0.2, 0.02
    assert marked_elements(split_of(parts), 0.1).tolist() == [3]
    assert marked_elements(split_of(-parts), 0.1).tolist() == [3]
