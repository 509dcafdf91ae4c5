"""Every study writes its table, figure and notes, and the notes carry the numbers of the equations."""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pictures import ink, pixels
from selection import some

from lumped import STUDIES, run_study
from lumped.document import write_document

ALL = [(model, study) for model, studies in STUDIES.items() for study in studies]


@pytest.mark.parametrize(("model", "study"), some(ALL, lambda model, study: study == next(iter(STUDIES[model]))))
def test_study_writes_table_figure_and_notes(model, study, tmp_path):
    table, figure, notes = run_study(model, study, tmp_path / "new" / "folder")
    assert [p.name for p in (table, figure, notes)] == [f"{model}_{study}.{end}" for end in ("csv", "png", "md")]
    with open(table, encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) > 20 and all(None not in row and None not in row.values() for row in rows)
    if "re" in rows[0]:
        assert {row["stability"] for row in rows} <= {"unstable", "marginal", "stable"}
        assert all(np.isfinite(float(row["re"])) for row in rows)
    # Lines or areas in colour besides the black and grey of axes and words.
    shown = pixels(figure)
    assert (np.ptp(shown, axis=2) > 0.2).mean() > 0.002 and ink(figure).mean() > 0.02
    assert "For the designer" in notes.read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "study", "numbers"),
    [
        ("minimal", "friction", ["marginal"]), ("minimal", "k2", ["26.58"]),
        ("minimal", "damping", ["0.325997", "0.247436"]), ("two-mass", "friction", ["-0.2925", "+0.2925"]),
        ("two-mass", "k", ["Re λ is 0"]), ("two-mass", "c2x", ["+0.0732"]), ("two-mass", "cy", ["+0.1360"]),
        ("two-mass", "damping-0.1", ["1.536", "+0.241"]),
        ("two-mass", "damping-0.3", ["1.536", "+0.169"]),
        ("oscillator", "responses", ["0.497 m each second"]), ("uncoupled-disc", "rigid-pad", ["0.36675"]),
    ],
)  # fmt: skip
def test_contradictions_carry_their_numbers(model, study, numbers):
    item = STUDIES[model][study]
    text = item.notes(item.compute()).contradicts
    assert all(number in text for number in numbers), text


def test_the_sum_of_growth_rates_is_that_of_the_eigenvalues():
    """Of all six, since each of the three listed has its conjugate."""
    for c in (0.1, 0.3):
        study = STUDIES["two-mass"][f"damping-{c:g}"]
        result = study.compute()
        sums = 2 * result.cases[1].lam.real.sum(axis=1)
        assert_allclose(sums, -2.5 * c, rtol=1e-9)
        assert f"−tr(M⁻¹C) = {-2.5 * c:.3g} rad/s" in study.notes(result).contradicts


@pytest.mark.slow
def test_base_values_are_never_unstable_in_the_tables(tmp_path):
    for study in ("friction", "damping"):
        with open(run_study("minimal", study, tmp_path)[0], encoding="utf-8", newline="") as file:
            base = [row for row in csv.DictReader(file) if row["case"].startswith("base")]
        assert base and all(row["stability"] != "unstable" for row in base)


def test_surface_onsets_are_the_closed_form():
    surface = STUDIES["minimal"]["surface-k2"].compute()
    k2 = surface.y.values
    inside = k2 > 10
    expected = ((k2 - 10) / 2) ** 2 + 3 * (k2 - 10) ** 2 / 4
    expected = expected[inside] / (np.sqrt(3) * (k2 - 10) * (17.5 + (k2 - 20) / 4))[inside]
    assert_allclose(surface.critical_mu[0][inside], expected, rtol=1e-12)
    assert np.isinf(surface.critical_mu[0][~inside]).all()
    assert (surface.growth[0][~inside] == 0).all()


def test_map_holds_no_negative_threshold_as_best():
    grid = STUDIES["minimal"]["map"].compute()
    assert grid.values.shape == (10, 10, 10, 36)
    assert_allclose(grid.values[1, 3, 1, 12], 4 / (7 * np.sqrt(3)), rtol=1e-13)  # k1 = k3 = 10, k2 = 20, θ2 = 60°
    assert np.isinf(grid.values[1, 1, 1, 12])  # the base values


def test_unknown_names_are_answered_with_the_nearest():
    with pytest.raises(ValueError, match='no lumped model "two_mass"; did you mean "two-mass"'):
        run_study("two_mass", "friction", ".")
    with pytest.raises(ValueError, match='two-mass: no study "frictoin"; did you mean "friction"'):
        run_study("two-mass", "frictoin", ".")


@pytest.mark.slow
def test_document_holds_every_study(tmp_path, monkeypatch):
    """Of a catalogue with two studies of one model, and one of each other. All are drawn by the first test here."""
    few = {model: dict(list(studies.items())[: 1 + (model == "two-mass")]) for model, studies in STUDIES.items()}
    monkeypatch.setattr("lumped.document.STUDIES", few)
    page, *pictures = write_document(tmp_path)
    names = [f"{model}_{study}.png" for model, studies in few.items() for study in studies]
    assert [p.name for p in pictures] == names and len(names) > 5
    text = page.read_text(encoding="utf-8")
    assert all(f"(lumped/{name})" in text for name in names)
    assert all(picture.stat().st_size < 100_000 for picture in pictures)


def test_page_has_every_study():
    docs = Path(__file__).parents[2] / "docs"
    text = (docs / "lumped.md").read_text(encoding="utf-8")
    for model, study in ALL:
        assert f"(lumped/{model}_{study}.png)" in text
        assert 0 < (docs / "lumped" / f"{model}_{study}.png").stat().st_size < 100_000


def test_import_is_light():
    code = "import sys, lumped; print([m for m in ('matplotlib', 'pandas', 'fe_squeal', 'PIL') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
