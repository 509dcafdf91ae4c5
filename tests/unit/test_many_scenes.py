"""The sweeps of many scenes: what each of them is warned of, and the solver that it names."""

from __future__ import annotations

import warnings

import pytest

import fe_squeal
import fe_squeal.scene.solver
from fe_squeal.errors import SceneWarning
from meshes import STEEL
from tests.studies import write_study

FLAT = '[sweep]\nparameter = "unused"\nfrom = 0.0\nto = 0.3\npoints = 3\n'
QUIET = '[sweep]\nparameter = "mu"\nfrom = 0.0\nto = 0.3\npoints = 4\n'
BEAM = {
    "mesh": {"order": 1, "block": {"length": 200.0, "width": 10.0, "height": 10.0, "size": 50.0}},
    "materials": {"steel": STEEL}, "bodies": {"block": {"material": "steel"}}, "solve": {"modes": 7},
}  # fmt: skip


@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_warnings_have_the_name_of_the_scene(tmp_path, workers):
    """Of a sweep over what nothing depends on, and of a beam of 200 m; a scene that is as it should be has none."""
    if workers:
        pytest.importorskip("distributed")
    path = write_study(tmp_path, FLAT)
    path.write_text(path.read_text().replace("[parameters]", "[parameters]\nunused = 0.1"))
    (tmp_path / "quiet.toml").write_text(path.read_text().replace(FLAT, QUIET))
    scenes = {"flat": path, "quiet": tmp_path / "quiet.toml", "beam": fe_squeal.parse_scene(BEAM)}
    with pytest.warns(SceneWarning) as told:
        modes, _ = fe_squeal.run_many(scenes, workers=workers)
    said = [str(w.message) for w in told]
    assert any(text.startswith("flat: ") and "unused" in text for text in said)
    assert any(text.startswith("beam: ") and "length_unit" in text for text in said)
    assert not any("quiet" in text for text in said) and {w.filename for w in told} == {__file__}
    assert modes["scene"].unique().tolist() == list(scenes)


def test_options_of_mumps_reach_the_solver(tmp_path, monkeypatch):
    """As in a run; they are without effect where another solver factorises."""
    path = write_study(tmp_path, QUIET + "[solve]\nmodes = 2\n[solve.mumps]\nlow_rank = 1e-10\n")
    seen, choose = [], fe_squeal.scene.solver.choose

    def noted(name, options):
        seen.append((name, options.low_rank))
        return choose("superlu")

    monkeypatch.setattr(fe_squeal.scene.solver, "choose", noted)
    with warnings.catch_warnings():
        warnings.simplefilter("error", SceneWarning)
        modes, onsets = fe_squeal.run_many([path])
    assert seen == [("auto", 1e-10)] and len(modes) == 8
    assert onsets["value"].tolist() == pytest.approx([0.05], rel=1e-10)
