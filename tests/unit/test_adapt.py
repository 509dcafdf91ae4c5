"""Numbers of elements for a target, from errors that are known; marks of tetrahedra."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fe_squeal.accuracy.adapt import finer_geometry, told
from fe_squeal.accuracy.bars import Parts, bar_of_parts
from fe_squeal.accuracy.candidates import marked_elements
from fe_squeal.accuracy.line_errors import LineErrors, layer_factors
from fe_squeal.accuracy.quantities import Split
from fe_squeal.geometry import Block, DiscPad
from fe_squeal.geometry.base import Line

BLOCK = Block(length=0.08, width=0.04, height=0.02, size=0.01)  # 8, 4, 2 elements
BRAKE = DiscPad(
    inner_radius=0.07, outer_radius=0.13, thickness=0.012, pad_inner_radius=0.085, pad_outer_radius=0.128,
    pad_angle_deg=50.0, pad_thickness=0.011, size=0.01,
)  # fmt: skip


def errors_of(parts, rate=2.0):
    """A part for each line of the block, each in a group of its own; what refining changes, for each quantity."""
    keys = ("elements_x", "elements_y", "layers")
    parts = np.asarray(parts, float)
    return LineErrors(
        BLOCK.lines, dict.fromkeys(keys, rate), parts, np.array(keys), np.zeros(3, int), np.arange(3),
        np.zeros(3, bool),
    )  # fmt: skip


def counts(geometry):
    return {key: line.elements for key, line in geometry.lines.items()}


def test_the_line_that_errs_is_cut():
    errors = errors_of(([0.06], [0.0], [0.0]))  # a bar of 4/3 of this change
    finer = finer_geometry(errors, BLOCK, 0.02)
    assert counts(finer) == {"elements_x": 16, "elements_y": 4, "layers": 2}
    assert errors.at(finer.lines)[0] == pytest.approx(0.02)
    assert told(finer, BLOCK) == "elements_x 8 to 16"


@pytest.mark.slow
def test_no_number_is_larger_than_needed():
    """Taking one element from any line that has got some misses the target."""
    rng = np.random.default_rng(3)
    for _ in range(30):
        errors = errors_of(rng.standard_normal((3, 5)) * 10.0 ** rng.uniform(-3, -1, (3, 1)), rng.uniform(1, 4))
        target = 0.3 * errors.at(BLOCK.lines).max()
        finer = finer_geometry(errors, BLOCK, target)
        if errors.at(finer.lines).max() > target:  # too far to go there at once
            assert finer.cells > BLOCK.cells
            continue
        for key, line in BLOCK.lines.items():
            fewer = {**counts(finer), key: counts(finer)[key] - 1}
            assert (
                fewer[key] < line.elements
                or errors.at(BLOCK.with_counts(fewer).lines).max() > target
            )


def test_a_target_that_is_just_missed_takes_little_more():
    """With the bar a tenth above the target, at a rate of 3, no more than a tenth of the elements is added."""
    errors = errors_of(([0.05], [0.03], [0.02]), rate=3.0)
    large = BLOCK.with_counts({key: 10 * line.elements for key, line in BLOCK.lines.items()})
    fine = replace(errors, lines=large.lines)
    finer = finer_geometry(fine, large, fine.at(fine.lines).max() / 1.1)
    assert large.cells < finer.cells < 1.1 * large.cells


def test_a_far_target_is_approached_in_steps():
    errors = errors_of(([0.5], [0.5], [0.5]))
    finer = finer_geometry(errors, BLOCK, 1e-4)
    assert BLOCK.cells < finer.cells <= 5 * BLOCK.cells


def test_parts_of_opposite_sign_do_not_pass_for_accuracy():
    """The bar expected now is the bar of the parts: those of one group cancel, those of two do not."""
    errors = errors_of(([0.1], [-0.1], [0.0]))
    parts = Parts.of(np.array([[0.1], [-0.1]]), np.array([False, False]))
    assert errors.at(BLOCK.lines) == pytest.approx(bar_of_parts(np.array([0.0]), parts, 2))
    assert errors.at(BLOCK.lines) == pytest.approx(0.2 * (4 / 3 - 16 / 15) / 2)
    alike = replace(errors, groups=np.zeros(3, int))
    assert alike.at(BLOCK.lines) == pytest.approx(0.0)


@pytest.mark.parametrize("rate", [1.0, 2.5, 4.0])
def test_layers_fall_with_the_length_of_elements_there(rate):
    """Halved everywhere, all layers fall by 2^rate; halved in one half, that layer alone does."""
    now = Line(("disc",), "radial", 2, places=(0.0, 0.4, 1.0))
    halves = Line(("disc",), "radial", 4, places=(0.0, 0.2, 0.4, 0.7, 1.0))
    np.testing.assert_allclose(layer_factors(now, halves, rate), [0.5**rate] * 2)
    inner = Line(("disc",), "radial", 3, places=(0.0, 0.2, 0.4, 1.0))
    np.testing.assert_allclose(layer_factors(now, inner, rate), [0.5**rate, 1.0])
    np.testing.assert_allclose(layer_factors(now, now, rate), 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("held", [False, True])
def test_an_error_at_the_hub_grades_the_disc_towards_it(held):
    """All of the error in the element at the hub: fewer elements than equal ones would take, the shortest there."""
    lines, keys = BRAKE.lines, list(BRAKE.lines)
    one = np.full((1, 1), 0.1)
    errors = LineErrors(
        lines, dict.fromkeys(keys, 2.0), one, np.array(["disc_elements_radial"]), np.zeros(1, int), np.zeros(1, int),
        np.array([held]),
    )
    finer = finer_geometry(errors, BRAKE, errors.at(lines).max() / 4)
    lengths = np.diff(finer.disc_radii)
    assert finer.disc_grading > 1 and lengths.argmin() in (0, len(lengths) - 1) and lengths[0] < lengths[1]
    assert errors.at(finer.lines).max() <= errors.at(lines).max() / 4
    even = finer.model_copy(update={"disc_grading": 1.0})
    assert errors.at(even.lines).max() > errors.at(finer.lines).max()
    if held:  # the element at the clamp alone counts
        shorter = lengths[0] / np.diff(BRAKE.disc_radii)[0]
        assert errors.at(finer.lines) == pytest.approx(errors.at(lines) * shorter**1.4)
    assert f"disc_grading = {finer.disc_grading:g}" in told(finer, BRAKE)


@pytest.mark.parametrize("rate", [1.0, 2.5, 4.0])
def test_singular_parts_fall_slowly(rate):
    """As the element's length to the power 1.4, unless the line is known to err with a lower one still."""
    smooth = errors_of(([0.06], [0.0], [0.0]), rate)
    singular = replace(smooth, singular=np.ones(3, bool))
    twice = BLOCK.with_counts({**counts(BLOCK), "elements_x": 16})
    fallen = [e.at(twice.lines)[0] / e.at(BLOCK.lines)[0] for e in (smooth, singular)]
    assert fallen == pytest.approx([0.5**rate, 0.5 ** min(rate, 1.4)])


def split_of(parts):
    parts = np.asarray(parts, float)[:, :, None]
    return Split(tuple(f"q{i}" for i in range(len(parts))), ("onsets",) * len(parts), np.ones(len(parts)), parts)


def missing(target):
    """The size of each quantity's change over a target, of a split."""
    return lambda split: np.abs(split.changes) / target


def test_marks_hold_what_has_to_go():
    """Of one element with nearly all of the error that one alone; of equal ones as many as the target needs."""
    alone = np.full((1, 100), 1e-5)
    alone[0, 42] = 0.1
    assert marked_elements(split_of(alone), missing(0.05)).tolist() == [42]
    even = split_of(np.full((1, 100), 1e-3))
    assert len(marked_elements(even, missing(0.05))) == pytest.approx(70, abs=2)  # half of it, 0.8 of each
    assert len(marked_elements(even, missing(0.01))) == 100


def test_parts_that_cancel():
    """Large parts of one sign are held up by many small ones of the other: the large ones alone must not vanish."""
    parts = np.concatenate([np.full(10, 1e-2), np.full(90, -1e-3)])[None, :]
    assert len(marked_elements(split_of(parts), missing(0.005))) == 100
    split = split_of(parts)
    marked = marked_elements(split, missing(0.009))
    left = split.parts.sum(axis=2)[0] * np.where(np.isin(np.arange(100), marked), 0.2, 1.0)
    assert abs(left.sum()) <= 0.009 < abs(parts.sum())
    sizes = np.random.default_rng(3).uniform(0.5e-3, 1.5e-3, 50)
    pairs = np.column_stack([sizes, -0.9 * sizes]).reshape(1, 100)  # the sum of sizes is 19 times the change
    half = np.abs(pairs.sum()) / 2
    marked = marked_elements(split_of(pairs), missing(half))
    assert len(marked) < 75 and abs((pairs[0] * np.where(np.isin(np.arange(100), marked), 0.2, 1.0)).sum()) <= half


def test_the_quantity_that_misses_most_decides():
    parts = np.zeros((2, 10))
    parts[0, 3], parts[1, 7] = 0.2, 0.02
    assert marked_elements(split_of(parts), missing(0.1)).tolist() == [3]
    assert marked_elements(split_of(-parts), missing(0.1)).tolist() == [3]
    assert marked_elements(split_of(parts), missing(np.array([1.0, 0.01]))).tolist() == [7]
