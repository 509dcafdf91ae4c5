"""The smallest rung of every ladder of docs/accuracy_and_cost.md, with its errors, and the page's parts."""

from __future__ import annotations

import string
from dataclasses import replace

import accuracy_and_cost as page
import numpy as np
import pandas as pd
import pytest
from accuracy_cases import Rung, extrapolated, solve

from fe_squeal.accuracy.bars import BARS

# The largest errors of the coarsest meshes, by the exact frequencies: a mistake in a benchmark moves them.
COARSEST = {
    ("block", "hex", 1): 0.10506, ("block", "hex", 2): 0.016021, ("block", "tet", 1): 0.1536,
    ("block", "tet", 2): 0.01842, ("plate", "hex", 1): 0.29533, ("plate", "hex", 2): 0.048809,
    ("plate", "tet", 1): 0.8526, ("plate", "tet", 2): 0.07443,
}  # fmt: skip


@pytest.mark.parametrize(
    "ladder",
    [pytest.param(x, marks=() if x == ("block", "hex", 1) else pytest.mark.slow, id=" ".join(map(str, x)))
     for x in COARSEST],
)  # fmt: skip
def test_smallest_rung(ladder):
    rung = solve(*ladder, page.LADDERS[ladder][0])
    # Hexahedra are structured, so that digits count; another version of gmsh may place tetrahedra otherwise.
    assert rung.errors.max() == pytest.approx(COARSEST[ladder], rel=1e-3 if ladder[1] == "hex" else 0.05)
    assert rung.inside >= 7 / 8 and 1.0 <= rung.wide <= 5.0


@pytest.mark.slow
def test_smallest_rung_of_the_extrapolated_disc():
    exact = extrapolated("annular disc", "hex", 0.03)
    rung = solve("annular disc", "hex", 1, 0.03, exact)
    assert 0.1 < rung.errors.max() < 1.0 and rung.inside == 1.0


def test_ladders_are_complete_and_fall():
    assert set(page.LADDERS) >= set(COARSEST) and len(page.LADDERS) == 12
    for sizes in page.LADDERS.values():
        assert (np.diff(sizes) < 0).all()


def test_rate_and_time_of_a_known_law():
    """A cut that takes 15/16 of the error: rate 4; times of unknowns: the time where the error is 1 %."""
    rungs = [Rung(n, n / 1e3, 0.0, np.array([n ** (-4 / 3) * 1e3]), 1.0, 2.0) for n in (10**3, 10**4, 10**5)]
    assert page.rate(replace(rungs[-1], wide=BARS[2] * 15 / 16, bar=BARS[2])) == pytest.approx(4.0)
    assert page.time_for(rungs, 0.01) == pytest.approx((1e5) ** (3 / 4) / 1e3)


def test_table_beside_the_lumped_models():
    frame = pd.DataFrame([("two-mass", "|λ| at μ = 0 (rad/s)", 4.9, np.nan, 3.3e-6)])
    assert page.lumped_table(frame)[-1] == r"| two-mass | \|λ\| at μ = 0 (rad/s) | 4.9 | none | 3.3e-06 |"


def test_page_names_what_it_needs():
    """What main() fills in is what the page asks for, and the page that is there has all of its chapters."""
    asked = {name for _, name, _, _ in string.Formatter().parse(page.PAGE) if name}
    assert asked == {"when", "table", "words", "rates", "parts", "lumped"}
    written = (page.DOCS / "accuracy_and_cost.md").read_text(encoding="utf-8")
    for line in page.PAGE.splitlines():
        if line.startswith("## "):
            assert line in written
    own, others = page.PAGE[page.PAGE.index(page.LAST) :], page.of_others(written)
    assert own.count("\n## ") == 0 and written.endswith(others)
    assert [s for s in others.splitlines() if s.startswith("## ")] == [
        "## Do the bars hold?", "## Do the bars of onsets hold?"
    ]  # fmt: skip
    for case, element, order in page.LADDERS:
        assert f"| {case} | {element} | {order} |" in written
