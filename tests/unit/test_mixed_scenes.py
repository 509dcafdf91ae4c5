"""`formulation = "mixed"` in scene files: what runs, what is written, what is refused, what is warned of."""

from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import pyvista
from scene_texts import CRITICAL_MU, HEAD, SCENE, read_rows, replaced, write_scene

import fe_squeal.report.export
from fe_squeal.cli import main
from fe_squeal.errors import SceneError
from fe_squeal.scene.file import load_scene

MIXED = replaced('material = "steel"\n', 'material = "steel"\nformulation = "mixed"\n')
SOFT = replaced("poisson_ratio = 0.3", "poisson_ratio = 0.4999", MIXED)
SHAPES = 'shapes = "none"', 'shapes = "all"'


@pytest.mark.parametrize("order", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_run(tmp_path: Path, order: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The stiff block squeals at the minimal model's μ but for its own elasticity (measured 0.5 and 0.7 % above);
    shapes are on the nodes, finite and not zero."""
    # Pictures take most of the time.
    monkeypatch.setattr(fe_squeal.report.export, "drawing_shapes", lambda *_: nullcontext())
    text = replaced("order = 1", f"order = {order}", replaced(*SHAPES, SOFT))
    assert main(["run", str(write_scene(tmp_path, text)), "-o", str(tmp_path / "out")]) == 0
    (onset,) = read_rows(tmp_path / "out" / "onsets.csv")
    assert float(onset["value"]) == pytest.approx(CRITICAL_MU, rel=1e-2)
    record = json.loads((tmp_path / "out" / "run.json").read_text(encoding="utf-8"))
    assert record["completeness"]["proven"] and record["warnings"] == []
    nodes = {1: 5 * 3 * 2, 2: 9 * 5 * 3}[order]
    inner = {1: 4 * 2 * 6 / 2 - (4 * 2 + 4 + 2), 2: 0}[order]  # 24 half-faces less 28 / 2 on the boundary
    assert record["unknowns"] == 3 * nodes + inner
    shapes = sorted((tmp_path / "out" / "shapes").glob("*.vtu"))
    assert shapes
    amplitude = np.asarray(pyvista.read(shapes[0]).point_data["amplitude"])
    assert len(amplitude) == nodes and amplitude.max() == pytest.approx(1.0) and np.isfinite(amplitude).all()


def test_check_tells_which_bodies_are_mixed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(write_scene(tmp_path, SOFT))]) == 0
    said = capsys.readouterr().out
    assert "8 mixed elements of steel" in said and "warning" not in said


def test_locking_is_warned_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Body, material, value and way out in one sentence; none at 0.3, nor for the mixed body above."""
    text = replaced("poisson_ratio = 0.3", "poisson_ratio = 0.4999")
    assert main(["check", str(write_scene(tmp_path, text))]) == 0
    said = " ".join(capsys.readouterr().out.split())
    for part in ("bodies.block", "materials.steel.poisson_ratio = 0.4999", 'bodies.block.formulation = "mixed"'):
        assert part in said
    assert main(["check", str(write_scene(tmp_path, SCENE))]) == 0
    assert "formulation" not in capsys.readouterr().out


ORTHOTROPIC = (
    "youngs_modulus = [1e9, 1e9, 2e9]\npoisson_ratio = [0.3, 0.3, 0.3]\nshear_modulus = [4e8, 4e8, 4e8]\n"
    "density = 1.0\n"
)
ROTATION = "[effects.rotation]\nbodies = ['block']\naxis = [0, 0, 1]\nspeed = 1.0\n"
STEEL = HEAD[HEAD.index("youngs_modulus") : HEAD.index("[bodies.block]")]


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (replaced('"mixed"', '"mixt"', MIXED), ('bodies.block.formulation: given "mixt"', '"standard" or "mixed"')),
        (
            replaced(STEEL, ORTHOTROPIC, MIXED),
            ('bodies.block.formulation: given "mixed"', "materials.steel", "orthotropic", 'expected "standard"'),
        ),
        (
            replaced("[sweep]", ROTATION + "[sweep]", MIXED),
            ('bodies.block.formulation: given "mixed"', "effects.rotation.bodies", 'expected "standard"'),
        ),
        (
            replaced("poisson_ratio = 0.3", "poisson_ratio = 0.5", MIXED),
            ("materials.steel.poisson_ratio: given 0.5", "nu < 0.5"),
        ),
    ],
    ids=["misspelt", "orthotropic", "rotating", "incompressible"],
)
def test_refused(tmp_path: Path, text: str, parts: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    path = write_scene(tmp_path, text)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    for part in (str(path), *parts):
        assert part in str(caught.value)
    assert main(["check", str(path)]) == 2
