"""What a sweep tells of modes that its solves have not looked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from chains import CLASSES, chain

from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.eigen.unsearched import ALL_SEARCHED, GROWTH, Unsearched
from fe_squeal.study.outcome import COLUMNS, outcome_of
from fe_squeal.sweep import solving
from fe_squeal.sweep.running import RunningSweep
from fe_squeal.sweep.told import Told

DAMPED, GROWS = Unsearched(damped=True), Unsearched((GROWTH,))
LOST = f"{GROWTH} were not looked for everywhere, and an unstable one may be missing"
DECAYING = "modes with light damping were not looked for everywhere: some that decay may be missing"


def test_values_in_any_order_are_one_interval():
    told = Told("mu")
    for value in (0.3, 0.1, 0.2):
        told.not_searched(value, GROWS)
    assert told.warnings == told.unsettled == [f"at mu = 0.1 to 0.3 {LOST}"]


@pytest.mark.parametrize("low", [1.5, np.float64(1.5)])
def test_low_frequencies_that_were_left_out_are_told(low):
    """Whatever kind of number the search has for where they end."""
    told = Told("mu")
    told.not_searched(0.1, Unsearched(low=low).joined(DAMPED))
    assert len(told.unsettled) == 1 and "modes below 0.239 Hz" in told.unsettled[0]
    assert bool(Unsearched(low=low)) and not Unsearched(low=0 * low)


def test_what_decays_is_told_apart_and_leaves_no_onset_in_doubt():
    told = Told("mu")
    told.not_searched(0.1, DAMPED)
    assert told.warnings == [f"at mu = 0.1 {DECAYING}"] and not told.unsettled
    told.not_searched(0.2, DAMPED.joined(GROWS))
    told.not_searched(0.3, ALL_SEARCHED)
    told.not_searched(0.4, DAMPED)
    assert sorted(told.warnings) == [f"at mu = 0.1 to 0.4 {DECAYING}", f"at mu = 0.2 {LOST}"]
    assert told.unsettled == [f"at mu = 0.2 {LOST}"]
    again = Told("mu", told.warnings, told.unsettled, unsearched=told.unsearched)
    again.not_searched(0.5, DAMPED.joined(GROWS))
    assert sorted(again.warnings) == [f"at mu = 0.1 to 0.5 {DECAYING}", f"at mu = 0.2 to 0.5 {LOST}"]


def test_what_a_solve_leaves_out_is_no_onset_of_a_step():
    told = Told("mu")
    told.of_onsets("an onset was not refined")
    before = told.of_steps()
    told.not_searched(0.1, GROWS)
    told.not_searched(0.2, GROWS)
    assert told.of_steps() == before == {"an onset was not refined"} and len(told.unsettled) == 2


@pytest.mark.parametrize("left_out", [GROWS, DAMPED])
def test_solves_between_the_values_of_a_sweep_are_told_too(monkeypatch, left_out):
    """The first step is halved: its middle is no value of the sweep, and nothing else is left out."""
    at = []

    def incomplete(*given):
        modes = solve_modes(*given)
        return replace(modes, unsearched=left_out) if at[-1] == 0.25 else modes

    monkeypatch.setattr(solving, "solve_modes", incomplete)
    running = RunningSweep(chain(*CLASSES["quadratic"], n=60), "mu", Request(count=4), np.array([0.0, 0.5, 1.0]), False)
    solve = running._solver.modes
    monkeypatch.setattr(running._solver, "modes", lambda value, before: at.append(value) or solve(value, before))
    running.advance(0.0, keep_all=False)
    assert running._halved(0.5, running._previous)[0] == 0.25
    running.advance(0.5, keep_all=False)
    text = f"at mu = 0.25 {LOST if left_out is GROWS else DECAYING}"
    assert running.told.warnings.count(text) == 1 and (text in running.told.unsettled) == (left_out is GROWS)


def test_a_study_counts_what_may_grow():
    modes = solve_modes(chain(*CLASSES["quadratic"], n=60).pencil(), Request(count=4))
    for left_out, counts in ((DAMPED, 0.0), (GROWS, 1.0), (ALL_SEARCHED, 0.0)):
        outcome = outcome_of(replace(modes, unsearched=left_out), Request(count=4), 0.0, direct=True)
        assert outcome.row[COLUMNS.index("unsearched")] == counts
