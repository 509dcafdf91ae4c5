"""Studies of scenes on a mesh: what is refused, and numbers that change matrices or the mesh itself."""

from __future__ import annotations

import os

import numpy as np
import pytest

import fe_squeal
from fe_squeal.errors import SceneError
from fe_squeal.scene.file import load_scene, parse_scene
from fe_squeal.scene.writing import scene_text

# A block on a belt that flutters from mu = 0.40 on.
SPRINGS = [
    ("inclined_1", "front", [-1.0, 0.0, 1.0], 4e5), ("inclined_2", "back", [-1.0, 0.0, 1.0], 4e5),
    ("up_1", "left", [0.0, 0.0, 1.0], 4.3e6), ("up_2", "right", [0.0, 0.0, 1.0], 4.3e6),
    ("along_1", "left", [1.0, 0.0, 0.0], 4.8e6), ("along_2", "right", [1.0, 0.0, 0.0], 4.8e6),
    ("across", "front", [0.0, 1.0, 0.0], 2e7),
]  # fmt: skip
SCENE = {
    "mesh": {"order": 1, "block": {"length": 0.08, "width": 0.04, "height": 0.02, "size": 0.02}},
    "materials": {"steel": {"youngs_modulus": 2e11, "poisson_ratio": 0.3, "density": 7800.0}},
    "bodies": {"block": {"material": "steel"}},
    "springs": [dict(zip(("name", "surface", "direction", "stiffness"), s, strict=True)) for s in SPRINGS],
    "contacts": [{"name": "belt", "surface": "bottom", "counterface": "rigid", "normal_stiffness": 3.125e8,
                  "sliding": {"direction": [1.0, 0.0, 0.0], "speed": 1.0}}],
    "effects": {"friction": {"mu": 0.3}},
    "solve": {"modes": 4},
}  # fmt: skip
MU = {"mu": {"uniform": {"low": 0.2, "high": 0.6}}}


def study(parameters, **more):
    return {**SCENE, "study": {"parameters": parameters, **more}}


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"materials.stel.density": {"values": [1.0, 2.0]}}, 'did you mean "materials.steel.density"'),
        ({"materials.steel.youngs_modulus": {"uniform": {"low": -1e9, "high": 1e9}}}, "expected a number > 0"),
        ({"solve.modes": {"values": [1.0, 2.0]}}, "expected a number of the physics"),
        ({"mesh.size": {"values": [1.0, 2.0]}}, "expected a number of the physics"),
        ({"mu": {"triangular": {"low": 0.1, "mode": 0.6, "high": 0.5}}}, "low ≤ mode ≤ high"),
        ({"mu": {"lognormal": {"median": 0.3, "factor": 0.9}}}, "factor"),
        ({"mu, mu": {"values": [0.1, 0.2]}}, 'given "mu" twice'),
    ],
)
def test_what_a_scene_refuses(parameters, message):
    with pytest.raises(SceneError, match=message.replace("(", r"\(")):
        parse_scene(study(parameters))


def test_numbers_without_effect_and_distributions_that_leave_the_range_are_refused():
    scene = parse_scene(SCENE)
    problem = fe_squeal.assemble(scene)
    with pytest.raises(SceneError, match="nothing in the problem depends"):
        fe_squeal.scatter(problem, {"contacts.belt.sliding.speed": {"uniform": {"low": 1.0, "high": 2.0}}}, samples=8)
    wide = {"materials.steel.density": {"normal": {"mean": 7800.0, "deviation": 8000.0}}}
    with pytest.raises(SceneError, match=r"reaches -[0-9.]+; expected a number > 0: cut it off by low and high$"):
        fe_squeal.scatter(problem, wide, samples=64, scene=scene)


STIFFNESS = "contacts.belt.normal_stiffness"


@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize(
    ("path", "mean", "deviation", "expected"),
    [(STIFFNESS, 1e8, 1e8, "a number > 0"), ("mu", 0.1, 0.2, "mu >= 0"), ("materials.steel.density", 1e3, 1e3, "a")],
)
def test_values_that_the_scene_of_a_problem_does_not_allow_are_refused(path, mean, deviation, expected, given):
    """Also where a script hands over the problem alone; slip damping makes a negative friction coefficient wrong."""
    scene = parse_scene({**SCENE, "effects": {"friction": {"mu": 0.3}, "friction_damping": {"contact_pressure": 1e6}}})
    problem, more = fe_squeal.assemble(scene), {"scene": scene if given else None}
    with pytest.raises(SceneError, match=f"the distribution of {path} reaches -.*; expected {expected}"):
        fe_squeal.scatter(problem, {path: {"normal": {"mean": mean, "deviation": deviation}}}, samples=64, **more)
    axis = {"parameter": path, "from": mean - 1.1 * deviation, "to": mean, "points": 3}
    other = {"parameter": "springs.across.stiffness", "from": 1e7, "to": 2e7, "points": 3}
    for i, axes in enumerate([(axis, other), (other, axis)]):
        with pytest.raises(SceneError, match=f"^stability_map: {'xy'[i]}: {path} = -.* expected {expected}"):
            fe_squeal.stability_map(problem, *axes, **more)


def test_a_stiffness_of_zero_is_a_contact_that_is_not_there():
    """As in a sweep: a scene does not allow it, and a problem has no such term then."""
    problem = fe_squeal.assemble(parse_scene(SCENE))
    two = {STIFFNESS: {"values": [0.0, 3.125e8]}}
    frame = fe_squeal.scatter(problem, two, samples=8, modes=2, indices=False).samples
    assert set(frame[STIFFNESS]) == {0.0, 3.125e8} and not frame["error"].isna().any()


def test_a_scene_is_written_as_it_was(tmp_path):
    path = tmp_path / "a" / "scene.toml"
    path.parent.mkdir()
    path.write_text(scene_text(parse_scene(study(MU, correlation=[])), path.parent), encoding="utf-8")
    assert load_scene(path).model_dump() == parse_scene(study(MU, correlation=[])).model_dump()


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="no links")
def test_a_scene_behind_a_link_to_a_folder_finds_its_mesh(tmp_path):
    """The folder lies deeper than the link to it; the mesh is a link as well, and keeps its name with the ending."""
    (tmp_path / "store" / "deep" / "results").mkdir(parents=True)
    (tmp_path / "results").symlink_to(tmp_path / "store" / "deep" / "results")
    (tmp_path / "store" / "blob").write_text("the mesh")
    (tmp_path / "block.msh").symlink_to(tmp_path / "store" / "blob")
    scene = parse_scene({**SCENE, "mesh": {"file": "block.msh"}})
    scene._source = tmp_path / "scene.toml"
    path = tmp_path / "results" / "scene.toml"
    path.write_text(scene_text(scene, path.parent), encoding="utf-8")
    written = load_scene(path)
    assert written.mesh.file == "../../../block.msh"
    assert (written.folder / written.mesh.file).read_text() == "the mesh"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "low", "high", "why"),
    [
        ("materials.steel.poisson_ratio", 0.2, 0.4, "changes matrices"),
        ("mesh.block.height", 0.0195, 0.0205, "changes the mesh"),
    ],
)
def test_numbers_that_change_matrices_are_solved_directly(path, low, high, why):
    """Each sample is what a scene with these numbers gives."""
    scene = parse_scene(SCENE)
    parameters = {**MU, path: {"uniform": {"low": low, "high": high}}}
    result = fe_squeal.scatter(fe_squeal.assemble(scene), parameters, samples=8, modes=4, indices=False, scene=scene)
    assert why in result.solver.why
    frame = result.samples
    assert set(frame["method"]) == {"direct"} and frame["worst_re"].max() > 0
    for row in frame.iloc[[1, 6]].to_dict("records"):
        tables = {**SCENE, "effects": {"friction": {"mu": row["mu"]}}}
        if "mesh" in path:
            tables["mesh"] = {"order": 1, "block": {**SCENE["mesh"]["block"], "height": row[path]}}
        else:
            tables["materials"] = {"steel": {**SCENE["materials"]["steel"], "poisson_ratio": row[path]}}
        alone = fe_squeal.sweep(fe_squeal.assemble(parse_scene(tables)), [row["mu"]], modes=4).points[0].modes
        assert row["worst_re"] == pytest.approx(alone.lam.real.max(), rel=1e-6, abs=1e-3)
        assert bool(row["unstable"]) == bool(np.any(alone.stability == "unstable"))


def test_both_axes_of_a_map_with_the_same_number_are_refused_from_python_too():
    problem, other = fe_squeal.assemble(parse_scene(SCENE)), "mu, springs.across.stiffness"
    for x, y in (("mu", "mu"), ("mu", "effects.friction.mu"), ("mu", other)):
        axes = ({"parameter": name, "from": 0.1, "to": 0.4, "points": 3} for name in (x, y))
        with pytest.raises(SceneError, match=r'^stability_map: .*given "mu" twice; expected every path once'):
            fe_squeal.stability_map(problem, *axes)


def test_a_correlation_may_stand_behind_the_numbers_it_is_about():
    numbers = {"mu": {"normal": {"mean": 0.4, "deviation": 0.05}},
               "materials.steel.density": {"normal": {"mean": 7800.0, "deviation": 10.0}}}  # fmt: skip
    pair = [["mu", "materials.steel.density", -0.4]]
    inside = parse_scene(study({**numbers, "correlation": pair})).study
    assert inside == parse_scene(study(numbers, correlation=pair)).study and inside.names == tuple(numbers)
    with pytest.raises(SceneError, match=r"correlation: given above and inside of \[study.parameters\]"):
        parse_scene(study({**numbers, "correlation": pair}, correlation=pair))
    with pytest.raises(SceneError, match=r"parameters.samples: .*expected it above \[study.parameters\]"):
        parse_scene(study({**numbers, "samples": 16}))


def test_an_axis_of_a_map_takes_a_list_of_paths():
    x, y = ({"from": a, "to": b, "points": 3} for a, b in ((1e5, 1e6), (0, 1)))
    paths = ["springs.up_1.stiffness", "springs.up_2.stiffness"]
    scene = {**SCENE, "study": {"x": {"parameter": paths, **x}, "y": {"parameter": "mu", **y}}}
    assert parse_scene(scene).study.x.parameter == ", ".join(paths)
