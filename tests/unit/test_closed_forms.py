"""Exact frequencies: complete for any shape, found for scenes that have them, and the reference of their studies."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from accuracy_cases import BLOCK, PLATE, STEEL, block_scene, plate_scene, sliding_scene
from closed_forms import exact_frequencies, sliding_block, sliding_plate, wave_speeds

from fe_squeal import parse_scene
from fe_squeal.accuracy.settings import Setting
from fe_squeal.accuracy.study import run_study
from fe_squeal.run.measurements import MeasurementFolder

SPEEDS = wave_speeds(**STEEL)


@pytest.mark.parametrize("size", [(1.0, 0.05, 0.05), (0.1, 0.083, 0.071)])
def test_none_is_missing_in_a_long_block(size):
    """Against far more half-waves along every edge than the formula looks at."""
    waves = []
    for lmn in product(range(60), range(6), range(6)):
        k = np.pi * np.linalg.norm(np.array(lmn) / size)
        waves += [SPEEDS[0] * k] * bool(k > 0) + [SPEEDS[1] * k] * (np.count_nonzero(lmn) - 1)
    np.testing.assert_allclose(sliding_block(size, SPEEDS, 40), np.sort(waves)[:40] / (2 * np.pi), rtol=1e-13)


@pytest.mark.slow
def test_plate_beyond_eight_half_waves():
    """A thin plate's bending waves: f² ≈ 2π D/(ρh) k⁴ where k h is small, up to a wave number that few waves reach."""
    side, h = 0.5, 0.002
    found = sliding_plate(side, h, SPEEDS, 6.5e3)
    D = STEEL["youngs_modulus"] * h**3 / 12 / (1 - STEEL["poisson_ratio"] ** 2)
    k2 = np.pi**2 * np.array([m**2 + n**2 for m, n in product(range(1, 30), repeat=2)]) / side**2
    bending = np.sort(k2 * np.sqrt(D / STEEL["density"] / h) / (2 * np.pi))
    shear = SPEEDS[1] * np.sqrt([m**2 + n**2 for m, n in product(range(4), repeat=2)]) / side / 2
    inplane = np.count_nonzero((shear > 0) & (shear < 6.5e3))
    # shear and rotatory inertia lower frequencies by (k h)²/12 (1 + 12/(5 (1 − ν))) at most, 2 % at k h = 0.23
    expected = np.count_nonzero(bending < 6.5e3)
    assert 0 <= len(found) - inplane - expected <= 0.04 * expected and expected > 200
    np.testing.assert_allclose(found[:5], bending[:5], rtol=2e-3)


def test_scenes_that_have_them():
    block, exact = sliding_scene("tet", 2, 0.04)
    np.testing.assert_array_equal(exact_frequencies(block, len(exact)), exact)
    plate, exact = plate_scene("hex", 1, 0.02)
    np.testing.assert_allclose(exact_frequencies(plate, len(exact)), exact, rtol=1e-12)
    in_mm = plate.model_dump(mode="json", by_alias=True, exclude_unset=True)
    in_mm["mesh"]["length_unit"] = "mm"
    in_mm["mesh"]["block"] |= {key: 1e3 * in_mm["mesh"]["block"][key] for key in ("length", "width", "height", "size")}
    np.testing.assert_allclose(exact_frequencies(parse_scene(in_mm), len(exact)), exact, rtol=1e-12)


@pytest.mark.parametrize(
    "change",
    [
        {"supports": [{"surface": "bottom", "fixed": "z"}]},
        {"springs": [{"name": "stay", "surface": "top", "stiffness": 1e6, "direction": [0.0, 0.0, 1.0]}]},
        {"effects": {"rayleigh": {"alpha": 1.0}}},
        {"bodies": {"block": {"material": "steel", "rayleigh": {"alpha": 1.0}}}},
        {"sweep": {"parameter": "materials.steel.poisson_ratio", "from": 0.2, "to": 0.3, "points": 2}},
        {"materials": {"steel": {"youngs_modulus": [2e11] * 3, "poisson_ratio": [0.3] * 3, "shear_modulus": [8e10] * 3,
                                 "density": 7800.0}}},
    ],
    ids=lambda change: next(iter(change)),
)  # fmt: skip
def test_scenes_that_have_none(change: dict[str, Any]):
    scene, _ = sliding_scene("hex", 1, 0.02)
    changed = parse_scene({**scene.model_dump(mode="json", by_alias=True, exclude_unset=True), **change})
    assert exact_frequencies(changed, 4) is None


def test_oblong_plate_has_none():
    fixed = {"left": "yz", "right": "yz", "front": "xz", "back": "xz"}
    assert exact_frequencies(block_scene((PLATE[0], 0.9 * PLATE[1], PLATE[2]), fixed, "hex", 1, 0.02), 4) is None
    assert exact_frequencies(block_scene(BLOCK, fixed, "hex", 1, 0.02), 4) is None


@pytest.mark.slow
def test_reference_of_a_study(tmp_path):
    """Errors against exact frequencies, whose own uncertainty is nothing, on meshes of which none is fine."""
    scene, exact = sliding_scene("hex", 1, 0.02)
    settings = [Setting(order, 0.04, 14, "reduced", 1e-8, estimated=order == 2) for order in (1, 2)]
    study = run_study(scene, MeasurementFolder(tmp_path), None, settings, exact=exact_frequencies(scene, 30))
    assert study.exact and study.reference.uncertainty.frequency == 0.0
    np.testing.assert_allclose(np.sort(study.reference.lam.imag)[:8], 2 * np.pi * exact, rtol=1e-14)
    fine = study.measurements[study.settings.index(settings[1])]
    limit = 0.8 * study.reference.lam.imag.max()
    compared = np.sort(study.reference.lam.imag)
    error = (np.sort(fine.lam[0].imag) / compared - 1)[compared <= limit].max()
    frame = study.to_dataframe().set_index("order")
    assert frame.loc[2, "error_frequency"] == pytest.approx(error, rel=0.3)
    assert 0.001 < frame.loc[2, "error_frequency"] < 0.1 < frame.loc[1, "error_frequency"]
