"""Windows of instability between two values of a sweep."""

from __future__ import annotations

import pytest

from fe_squeal.sweep.onset import Onset
from fe_squeal.sweep.windows import windows


def onset(value, direction, branch=1):
    return Onset("mu", value, 100.0, "flutter", direction, 1.0, branch, branch + 1, 1e-9)


@pytest.mark.parametrize("moved", [-1e-13, 0.0, 2e-13])
@pytest.mark.parametrize(("low", "begin", "end"), [(0.2, 0.2, 0.3), (0.2, 0.3, 0.4), (0.2, 0.2, 0.4)])
def test_a_window_at_a_value_is_found_on_whichever_side_rounding_puts_it(moved, low, begin, end):
    """It is found once, between the two values that its middle lies between."""
    pair = onset(begin + moved, "into"), onset(end + moved, "out of")
    everything = [*pair, onset(0.1, "into", 5), onset(0.7, "out of", 5)]
    found = {a: windows(everything, a, a + 0.2) for a in (0.0, 0.2, 0.4)}
    assert found.pop(low) == [(pytest.approx((begin + end) / 2, rel=1e-9), pair)]
    assert not any(found.values())


def test_what_begins_or_ends_elsewhere_is_no_window_between_two_values():
    assert windows([onset(0.15, "into"), onset(0.35, "out of")], 0.2, 0.4) == []
    assert windows([onset(0.25, "out of"), onset(0.35, "into")], 0.2, 0.4) == []


def test_windows_one_in_another_come_by_their_middles_and_equal_ones_once():
    """Points of a sweep ascend: the middle of a short window that opens later may come first."""
    long, short = (onset(0.22, "into"), onset(0.38, "out of")), (onset(0.24, "into", 5), onset(0.26, "out of", 5))
    twin = onset(0.22 + 1e-12, "into", 7), onset(0.38 - 1e-12, "out of", 7)
    found = windows([*long, *short, *twin], 0.2, 0.4)
    assert [middle for middle, _ in found] == pytest.approx([0.25, 0.3]) and found[0][1] == short
