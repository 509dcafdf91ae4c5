"""The benchmark of the effects: what it counts, and that its page can be read. Nothing is timed here."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from pictures import longest_bar

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "benchmarks"))

import effects_cost  # noqa: E402
from effects_cost_cases import absence_cases, effect_cases, scene_of  # noqa: E402
from effects_cost_measure import measure  # noqa: E402

CLASSES = {
    "no friction": "symmetric", "friction": "nonsymmetric", "rayleigh": "quadratic", "structural_damping": "complex",
    "structural_damping, frozen": "quadratic", "friction_damping": "quadratic", "falling_friction": "quadratic",
    "rotation": "quadratic", "springs' damping": "quadratic", "preload": "nonsymmetric",
    "preload, stress_stiffening": "nonsymmetric", "all, loss frozen": "quadratic", "all": "complex",
}  # fmt: skip
MORE_TERMS = {
    "no friction": -2, "friction": 0, "rayleigh": 6, "structural_damping": 1, "structural_damping, frozen": 1,
    "friction_damping": 2, "falling_friction": 2, "rotation": 2, "springs' damping": 6, "preload": 0,
    "preload, stress_stiffening": 3, "all, loss frozen": 24, "all": 24,
}  # fmt: skip


@pytest.fixture(scope="module")
def rows():
    """The counts, with seconds that are made up."""
    found = measure(effect_cases(scene_of("coarse")), runs=0)
    for number, row in enumerate(found, 1):
        row.assembly, row.solve, row.next_value = [0.2], [0.1 * number], [0.01]
    return found


@pytest.fixture(scope="module")
def plain():
    """The counts, with the seconds of one run."""
    return measure(absence_cases(scene_of("coarse")), runs=1)


@pytest.mark.slow
def test_classes_and_terms_follow_from_the_effects(rows):
    assert {r.effect: r.problem_class for r in rows} == CLASSES
    friction = rows[1]
    assert {r.effect: r.terms - friction.terms for r in rows} == MORE_TERMS
    assert len({r.unknowns for r in rows}) == 1 and all(r.modes > 10 for r in rows)


@pytest.mark.slow
def test_matrices_of_the_size_of_the_unknowns_are_factorised(rows):
    """Beside symmetric ones, which count modes: one, and without dampers another that looks for strong flutter; with
    dampers one for each disc, one of which lies at the end of the range. Never one of twice the size."""
    for r in rows:
        assert {size for size, _ in r.factorised} == {r.unknowns}
        plain = sum(not symmetric for _, symmetric in r.factorised)
        least, most = {"symmetric": (0, 0), "nonsymmetric": (2, 2), "quadratic": (2, 4)}.get(r.problem_class, (1, 3))
        assert least <= plain <= most, r.effect
        assert (r.static > 0) == (r.effect.startswith(("preload", "all")))


@pytest.mark.slow
def test_what_a_class_costs_in_solves(rows):
    solves = {r.effect: r.solves for r in rows}
    assert solves["no friction"] < solves["friction"] == solves["preload"] == solves["structural_damping"]
    assert all(solves["friction"] < r.solves for r in rows if r.problem_class == "quadratic")


@pytest.mark.slow
def test_effect_that_is_not_there_costs_nothing(plain):
    """Neither with all other effects out of reach, nor by hand, nor with coefficients of zero is there less to do."""
    first = plain[0]
    assert first.problem_class == "nonsymmetric"
    for r in plain[1:]:
        same = ("problem_class", "terms", "modes", "nonzeros", "factorised", "static", "solves")
        assert [getattr(r, key) for key in same] == [getattr(first, key) for key in same], r.effect
    assert "are the same in all rows" in effects_cost.absence(plain)


@pytest.mark.slow
def test_page_can_be_read(rows, plain, tmp_path):
    page = effects_cost.page({"Coarse mesh": (rows, plain)}, runs=1)
    tables = [[cells(line) for line in block.splitlines()] for block in page.split("\n\n") if block.startswith("| ")]
    assert [t[0] for t in tables] == [list(effects_cost.HEADER), list(effects_cost.ABSENCE_HEADER)]
    for table, of in zip(tables, (rows, plain), strict=True):
        assert [line[0] for line in table[2:]] == [r.effect for r in of]
        assert all(len(line) == len(table[0]) for line in table)
        for header in ("terms", "nonzeros", "solves", "assembly, s", "solve, s"):
            assert all(float(line[table[0].index(header)]) > 0 for line in table[2:])
    assert page.count("Target: one solve of the quadratic class") == 1
    assert str(ROOT) not in page
    effects_cost.chart(rows, tmp_path / "chart.png")
    # The bar of each class is as long as the seconds of its longest solve.
    seconds, colours = {}, effects_cost.COLOURS
    for r in rows:
        seconds[r.problem_class] = max(float(np.median(r.solve)), seconds.get(r.problem_class, 0.0))
    lengths = {c: longest_bar(tmp_path / "chart.png", colours[c]) for c in seconds}
    slowest = max(seconds, key=seconds.__getitem__)
    assert lengths[slowest] > 50
    for c in seconds:
        assert lengths[c] / lengths[slowest] == pytest.approx(seconds[c] / seconds[slowest], abs=0.1), c


def test_committed_page_has_every_effect():
    page = (ROOT / "docs/effects_cost.md").read_text(encoding="utf-8")
    for case in effect_cases(scene_of("fine")) + absence_cases(scene_of("fine")):
        assert f"\n| {case.name} | " in page
    assert (ROOT / "docs/images/effects_cost.png").is_file()


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]
