"""What is read off the table of a study: rates, Pareto front and advice, on tables with known rates."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from fe_squeal.report.advice import advice, fitted, lines_of, pareto


def table(rates=(2.0, 4.0), work=(1.0, 2.0)):
    """Errors that follow powers of the size exactly, and times of half a second and what grows with the elements."""
    rows = []
    for order, rate, at_once in zip((1, 2), rates, work, strict=True):
        for size in (0.02, 0.014, 0.01, 0.007):
            error = (0.5 if order == 1 else 0.1) * (size / 0.02) ** rate
            seconds = 0.5 + at_once * (size / 0.02) ** -3.5
            rows.append((order, size, "size", seconds, error, error, error))
    columns = ["order", "size", "knob", "seconds", "error_frequency", "error_growth", "error_onset"]
    return pd.DataFrame(rows, columns=columns)


def test_fits_find_the_powers():
    for order, rate in ((1, 2.0), (2, 4.0)):
        assert fitted(table(), order, "error_onset") == pytest.approx(rate)


def test_advice_says_what_the_table_shows():
    """Of order 2, with 0.1 (h/20 mm)^4, 14 mm has 2.4 %, 10 mm 0.63 %; of order 1, with 0.5 (h/20 mm)², 7 mm 6.1 %."""
    [five, two, one] = advice(table(), "error_onset")
    assert five.startswith("5 % on critical values: order 2, 14 mm, 7.5 s (2.4 %); order 1 does not have it")
    for text, target in ((two, 2), (one, 1)):
        assert text.startswith(f"{target} % on critical values: order 2, 10 mm, 23 s (0.62 %); order 1 does not")
    both = advice(table((4.0, 4.0)), "error_onset")[0]
    assert "order 2, 14 mm, 7.5 s (2.4 %); order 1, 10 mm, 12 s (3.1 %) has it as well." in both
    none = advice(table((0.1, 0.1)), "error_onset")[2]
    assert none.startswith("1 % on critical values: no mesh that was measured has it; nearest is order 2, 7 mm")
    assert not any("extrapolated" in text for text in (five, two, one, both, none))


def test_advice_names_the_order_that_its_table_has():
    """Order 1 falls faster by a fit, and is not there; order 2 is there with 1.1 %: that is what is advised for 2 %."""
    rows = [(1, 0.02, "size", 1.0, 0.5), (1, 0.01, "size", 4.0, 0.06),
            (2, 0.02, "size", 6.0, 0.011)]
    frame = pd.DataFrame(rows, columns=["order", "size", "knob", "seconds", "error_growth"])
    assert advice(frame, "error_growth")[1].startswith("2 % on growth rates: order 2, 20 mm, 6 s (1.1 %); order 1")


def test_adapted_meshes_stand_beside_uniform_ones():
    """The fastest of order 2 is named, adapted or not; rates are those of uniform meshes alone."""
    frame = table()
    adapted = pd.DataFrame([(2, 0.012, "adapted", 3.0, *[0.004] * 3)], columns=frame.columns)
    both = pd.concat([frame, adapted])
    assert advice(both, "error_onset")[2].startswith("1 % on critical values: order 2, 12 mm adapted, 3 s (0.4 %)")
    assert fitted(both, 2, "error_onset") == pytest.approx(4.0)
    assert [line.knob for line, _ in lines_of(both)] == ["size", "size", "adapted"]


def test_pareto_front():
    frame = pd.DataFrame({"seconds": [1.0, 2.0, 3.0, 2.5], "error_onset": [0.1, 0.05, 0.06, np.nan]})
    assert pareto(frame, "error_onset").tolist() == [True, True, False, False]
