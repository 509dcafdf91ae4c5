"""Abaqus decks whose steps repeat OP=NEW on each block of a keyword, as preprocessors write them."""

from __future__ import annotations

import pytest
from deck_scenes import deck, written
from deck_texts import deck_of

from fe_squeal.decks.scene import draft_of
from fe_squeal.errors import MeshError
from meshes import box

BLOCK = deck_of(box("hex1", (2, 1, 1), (100.0, 50.0, 20.0), name="P"))
BLOCK += "*Solid Section, elset=P, material=S\n*Material, name=S\n*Elastic\n210000., 0.3\n*Density\n7.85e-9\n"
FIRST = "*Step\n*Static\n*Dsload\nleft_P, P, 1.\n*Dload\nP, P3, 1.\n*End Step\n"
SECOND = "*Step\n*Static\n{}*End Step\n*Step\n*Frequency\n10\n*End Step\n"


def tables(draft, *path):
    return [t.values for t in draft.tables if t.path == path]


@pytest.mark.parametrize(("loads", "left"), [
    ("*Dsload, op=NEW\ntop_P, P, 1.\n*Dsload, op=NEW\nbottom_P, P, 2.\n",
     {"DLOAD_P_P3": 1e6, "top_P": 1e6, "bottom_P": 2e6}),
    ("*Dload, op=NEW\nP, P1, 2.\n*Dload, op=NEW\nP, P2, 3.\n", {"left_P": 1e6, "DLOAD_P_P1": 2e6, "DLOAD_P_P2": 3e6}),
    ("*Dsload, op=NEW\n*Dsload\ntop_P, P, 1.\n", {"DLOAD_P_P3": 1e6, "top_P": 1e6}),
    ("*Cload, op=NEW\nN_top_P, 3, -1.\n*Cload, op=NEW\nN_bottom_P, 3, 2.\n*Dload, op=NEW\n*Dsload, op=NEW\n",
     {"N_top_P": 6 / 5e-3, "N_bottom_P": 12 / 5e-3}),
])  # fmt: skip
def test_loads_of_one_step_stay_beside_each_other(tmp_path, loads, left):
    """Two pads are pressed on by two blocks: the second one takes nothing from the first."""
    (preload,) = tables(draft_of(written(tmp_path, BLOCK + FIRST + SECOND.format(loads))), "effects", "preload")
    assert preload["pressures"] == {name: pytest.approx(value, rel=1e-12) for name, value in left.items()}


def test_supports_of_one_step_stay_beside_each_other(tmp_path):
    new = "*Boundary, op=NEW\nN_hub, 1, 3\n*Boundary, op=NEW\nN_left_pad, XSYMM\n*Boundary, op=NEW\nN_back_pad, 2\n"
    plain, split = (draft_of(written(tmp_path, deck().replace("*Static\n", f"*Static\n{text}"))) for text in ("", new))
    assert tables(split, "supports") == tables(plain, "supports")


def test_another_step_takes_away_what_one_before_had_renewed(tmp_path):
    first, second = (f"*Dsload, op=NEW\n{side}, P, 1.\n" for side in ("top_P", "bottom_P"))
    text = BLOCK + SECOND.format(first).partition("*Step\n*Frequency")[0] + SECOND.format(second)
    (preload,) = tables(draft_of(written(tmp_path, text)), "effects", "preload")
    assert preload["pressures"] == {"bottom_P": 1e6}


@pytest.mark.parametrize("given", ["*Dsload\ntop_P, P, 1.\n*Dsload, op=NEW\nbottom_P, P, 2.\n", "*Dsload, op=OLD\n"])
def test_operations_that_contradict_each_other_are_refused(tmp_path, given):
    with pytest.raises(MeshError, match=r"brake.inp line \d+: \*Dsload has OP=.*expected OP="):
        draft_of(written(tmp_path, BLOCK + FIRST + SECOND.format(given)))


def test_supports_that_vibrations_alone_lose_are_told(tmp_path):
    text = deck().replace("*Complex Frequency\n12,\n", "*Complex Frequency\n12,\n*Boundary, op=NEW\n")
    draft = draft_of(written(tmp_path, text))
    assert not tables(draft, "supports")
    assert any("*Boundary" in line and "counts for these alone" in line for line in draft.told)


@pytest.mark.parametrize(("load", "times"), [
    ("*Dsload\ntop_P, P, 1.\n", 2), ("*Dsload\ntop_P, P, 1.\n", 1), ("*Dload\nP, P2, 1.\n", 2),
    ("*Cload\nN_top_P, 3, -1.\n", 2), ("*Cload\nN_top_P, 3, -1.\nN_top_P, 2, 0.\n", 1),
])  # fmt: skip
def test_a_load_that_stands_twice_in_a_step_is_told(tmp_path, load, times):
    """Of two steps the second load takes the place of the first one, without a word."""
    one, other = BLOCK + SECOND.format(load * times), BLOCK + (SECOND.format(load).partition("*Step\n*Freq")[0]) * 2
    told = [line for line in draft_of(written(tmp_path, one)).told if "twice in one step" in line]
    assert len(told) == times - 1
    assert not any("twice" in line for line in draft_of(written(tmp_path, other + SECOND.format(""))).told)
