"""The smallest rung of benchmarks/gallery: peers and the program's own ways find the same modes, as the table says."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
sys.path[:0] = [str(BENCHMARKS), str(BENCHMARKS / "gallery")]
import compare  # noqa: E402
import gallery_kept  # noqa: E402
import gallery_table  # noqa: E402
import profiles  # noqa: E402
from gallery_models import MODELS  # noqa: E402


@pytest.mark.slow
@pytest.mark.parametrize("name", ["weak", "Rayleigh"])
def test_every_way_finds_the_same_modes(name):
    model = replace(next(m for m in MODELS if m.name == name), modes=8, stop=0.2)
    group = [{"model": name, "way": w, "values": 2} | compare.measure(w, model, 0.04, 2, 0.0) for w in compare.OWN]
    exact = compare._lam(group[1])
    group.append({"model": name, "way": "scipy", "values": 2})
    group[-1] |= compare.measure("scipy", model, 0.04, 2, float(exact.imag.max()))
    rows = compare.judged(group, exact)
    assert len(exact) >= 8 and [r["found"] for r in rows] == [len(exact)] * 4
    assert max(r["error"] for r in rows) <= 1e-8 and group[0]["damped"] == model.damped
    assert rows[-1]["ratio"] == 1.0 and rows[0]["ratio"] == pytest.approx(rows[-1]["seconds"] / rows[0]["seconds"])
    lines = gallery_table.table(rows).splitlines()
    assert len({line.count("|") for line in lines}) == 1 and len(lines) == 6
    assert f"| {len(exact)} of {len(exact)} |" in lines[2]


def test_modes_that_a_way_misses_do_not_count():
    exact = np.array([1j, 2j, -0.5 + 0j])
    assert compare.agreement(np.array([1j * (1 + 1e-9), 3j]), exact) == (1, pytest.approx(1e-9, rel=1e-6))
    failed = {"model": "a", "way": "direct", "values": 2, "failed": "over 1 s"}
    peer = {"model": "a", "way": "scipy", "values": 2, "unknowns": 9, "MiB": 1.0, "lam": [[0.0, 1.0]], "seconds": 1.0}
    lines = gallery_table.table(compare.judged([failed, peer], exact)).splitlines()
    assert "over 1 s" in lines[2] and "1 of 2" in lines[3]
    assert len({line.count("|") for line in lines}) == 1


def test_rows_of_other_models_stay_as_they_are():
    """Measured now are two models, then one of them again: its rows are new, the lists name both."""
    exact, both = np.array([1j]), []
    for name, seconds in (("weak", 2.0), ("loss", 4.0)):
        own = {"model": name, "values": 2, "unknowns": 9, "MiB": 1.0, "lam": [[0.0, 1.0]], "onsets": 0, "warnings": 0}
        own |= {"stages": {"reduction": 1.0, "onsets": 1.0}, "method": "direct", "complete": True}
        group = [own | {"way": "auto", "seconds": seconds, "damped": name == "loss"}]
        failed = {"model": name, "values": 2, "way": "direct", "failed": "over 1 s"}
        group += [own | {"way": "scipy", "seconds": 1.0}, failed]
        both += compare.judged(group, exact)
    models = [m for m in MODELS if m.name in ("weak", "loss")]
    page = gallery_table.section(both, models, 1.0)
    faster = [r | ({"ratio": 0.75} if r["way"] == "auto" else {}) for r in both if r["model"] == "weak"]
    kept = gallery_kept.in_order(gallery_kept.earlier_rows(page, faster) + faster)
    again = gallery_table.section(kept, models[:1], 1.0)
    assert [r["model"] for r in kept] == ["weak"] * 3 + ["loss"] * 3
    assert [x for x in again.splitlines() if x.startswith("| loss")] == [
        x for x in page.splitlines() if x.startswith("| loss")
    ]
    assert "slower on weak (9: 0.75), loss (9: 0.25)" in again and "Measured earlier: loss." in again
    assert "| all | auto | 2 | 0.4 | 0.25 | loss (9) | reduced model 50 %, onsets 50 % |" in again


def test_a_profile_holds_all_seconds(needs_pardiso):
    model = replace(next(m for m in MODELS if m.name == "weak"), modes=4, stop=0.2)
    row = profiles.profile(model, 0.04, 2)
    seconds = row["seconds"]
    assert set(seconds) == set(profiles.PARTS) and min(seconds.values()) >= 0 and seconds["LAPACK"] > 0
    shares = [float(cell.strip(" %")) for cell in profiles.line(row).split("|")[5:-3]]
    assert sum(shares) == pytest.approx(100, abs=3)
    calls = profiles.part_of(("a/linear/pardiso.py", 1, "_call"), Counter({"__init__": 1.0, "_solved": 3.0}))
    assert calls == {"factorisations": 0.25, "solves": 0.75}
