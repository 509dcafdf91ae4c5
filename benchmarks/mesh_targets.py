"""Meshes for a target: python benchmarks/mesh_targets.py [--write] [--folder FOLDER] [--only NAME ...] [--random N]

It shows which meshes `fe-squeal run --accuracy` finds for scenes that its rules were not fitted to, and the true errors
there. True values are extrapolated from the same mesh with 1.5 times as many elements along every line, those of the
brake in a file from another mesh of smaller elements. Measurements are kept in the folder, and not made again the next
time.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from accuracy_cases import belt_scene, brake_scene
from chamfered import chamfered_scene, write_chamfered

from fe_squeal import sweep
from fe_squeal.accuracy.choose import Choice, choose
from fe_squeal.accuracy.estimate import COMPARED
from fe_squeal.accuracy.measure import measure_apart
from fe_squeal.accuracy.quantities import KINDS
from fe_squeal.accuracy.reference import errors_of, reference_of
from fe_squeal.accuracy.settings import own_setting
from fe_squeal.errors import NotConvergedError
from fe_squeal.mesh.writing import write_loaded
from fe_squeal.scene import Scene

DOCS = Path(__file__).parents[1] / "docs"
FINER = 1.5  # times the elements along every line, for the true values
FILE, FILE_FINER = 0.016, 0.006  # m: sizes of the tetrahedra in the file, and of those for the true values
DAMPED: dict[str, Any] = {"friction": {"mu": 0.3}, "rayleigh": {"alpha": 20.0, "beta": 1e-8}}
ONE_PAD: dict[str, Any] = {"pads": 1, "pad_angle_deg": 70.0}
_ABOVE = 1.05  # times the highest frequency that was asked for: up to there modes of both meshes are compared
_COLUMNS = {"frequencies": "frequency", "growth": "growth", "onsets": "onset"}
SOFT = {"lining": {"youngs_modulus": 8e8, "poisson_ratio": 0.35, "density": 2200.0}}


def one_long_pad() -> Scene:
    """Return the brake of the examples with one pad, 70 degrees long."""
    brake = brake_scene()
    assert brake.mesh.disc_pad is not None
    data = brake.model_dump(mode="json", by_alias=True, exclude_unset=True)
    data["mesh"]["disc_pad"] |= ONE_PAD
    data["contacts"], data["springs"] = data["contacts"][:1], [s for s in data["springs"] if "2" not in s["name"]]
    bodies = {
        name: body | ({"groups": [g for g in body["groups"] if "2" not in g]} if "groups" in body else {})
        for name, body in data["bodies"].items()
    }
    return brake_scene(mesh=data["mesh"], contacts=data["contacts"], springs=data["springs"], bodies=bodies)


def thin_pad() -> Scene:
    """Return the pad on a belt with a height of 1 mm, a tenth of the size of its elements."""
    data = belt_scene().model_dump(mode="json", by_alias=True, exclude_unset=True)
    data["mesh"]["block"] |= {"height": 0.001, "size": 0.01}
    return belt_scene(mesh=data["mesh"])


def random_brake(seed: int) -> Scene:
    """Return a brake of other dimensions, materials, stiffnesses and, every third one, damping."""
    rng = np.random.default_rng(seed)
    data = brake_scene().model_dump(mode="json", by_alias=True, exclude_unset=True)
    table = data["mesh"]["disc_pad"]
    table |= {
        "thickness": rng.uniform(0.008, 0.02), "pad_angle_deg": rng.uniform(30, 80), "size": 0.025,
        "pad_thickness": rng.uniform(0.008, 0.015), "pad_inner_radius": rng.uniform(0.08, 0.095),
    }  # fmt: skip
    data["materials"]["lining"]["youngs_modulus"] *= float(rng.uniform(0.3, 3))
    stiffness = 2e11 * 10 ** rng.uniform(-1, 0.5)
    for contact in data["contacts"]:
        contact["normal_stiffness"] = stiffness
    for spring in data["springs"]:
        spring["stiffness"] *= float(10 ** rng.uniform(-0.5, 0.5))
    data["sweep"]["points"], data["solve"] = 8, {"max_frequency": 4000.0}
    effects = DAMPED if seed % 3 == 2 else data["effects"]
    more = {key: data[key] for key in ("mesh", "materials", "contacts", "springs", "sweep", "solve")}
    return brake_scene(**more, effects=effects)


def random_pad(seed: int) -> Scene:
    """Return a pad on a belt of other dimensions, stiffnesses and, every third one, damping."""
    rng = np.random.default_rng(seed)
    data = belt_scene().model_dump(mode="json", by_alias=True, exclude_unset=True)
    data["mesh"]["block"] |= {
        "length": rng.uniform(0.06, 0.1), "width": rng.uniform(0.03, 0.05), "height": rng.uniform(0.012, 0.03),
        "size": 0.02,
    }  # fmt: skip
    (material,) = data["materials"].values()
    material["youngs_modulus"] *= float(10 ** rng.uniform(-0.5, 0.5))
    for contact in data["contacts"]:
        contact["normal_stiffness"] *= float(10 ** rng.uniform(-1, 1))
    for spring in data["springs"]:
        spring["stiffness"] *= float(10 ** rng.uniform(-0.5, 0.5))
    data["sweep"]["points"] = 8
    return belt_scene(
        **{key: data[key] for key in ("mesh", "materials", "contacts", "springs", "sweep")},
        effects=DAMPED if seed % 3 == 2 else data["effects"],
    )


def cases(count: int, imported: Path | None = None) -> dict[str, tuple[Scene, float, tuple[str, ...]]]:
    """Return by name a scene, a target, and the kinds of quantities that are to meet it; without a mesh one less."""
    onsets = ("onsets",)
    found = {
        "soft pad on a belt": (belt_scene(materials=SOFT), 0.02, KINDS),
        "thin pad on a belt": (thin_pad(), 0.05, KINDS),
        "disc with two pads": (brake_scene(), 0.05, KINDS),
        "disc with two pads, onsets": (brake_scene(), 0.02, onsets),
        "disc with one long pad": (one_long_pad(), 0.05, KINDS),
        "disc with one long pad, onsets": (one_long_pad(), 0.05, onsets),
        "disc with two pads, damped, onsets": (brake_scene(effects=DAMPED), 0.05, onsets),
    }
    if imported is not None:
        found["tetrahedra from a file, chamfers and slots"] = chamfered_scene(imported), 0.05, KINDS
    found |= {f"random pad {seed}": (random_pad(seed), 0.02, KINDS) for seed in range(count)}
    return found | {f"random brake {seed}, onsets": (random_brake(seed), 0.1, onsets) for seed in range(count)}


def reach(
    name: str, scene: Scene, target: float, kinds: tuple[str, ...] = KINDS, folder: Path = Path()
) -> dict[str, Any]:  # fmt: skip
    """Return the mesh that was found for a target, what it cost, and its true errors; meshes are put in a folder."""
    start = time.perf_counter()
    print(name, file=sys.stderr)
    try:
        choice = choose(scene, target, lambda text: print(text, file=sys.stderr), kinds)
    except NotConvergedError as error:  # the target is not met, and the nearest mesh is shown
        if error.partial is None:
            raise
        choice = error.partial
    seconds = time.perf_counter() - start
    errors = true_errors(choice, folder)
    last = choice.trials[-1]
    wanted = [errors[_COLUMNS[kind]] for kind in kinds]
    return {
        "name": name, "target": target, "first": choice.trials[0].unknowns, "unknowns": last.unknowns,
        "bar": last.error, "true": _worst(choice, kinds, wanted), **errors,
        "runs": len(choice.trials), "seconds": seconds,
    }  # fmt: skip


def _worst(choice: Choice, kinds: tuple[str, ...], errors: list[float]) -> float:
    """Return the largest of some true errors: 0 where the sweep has none of the quantities, infinite if one is lost."""
    points, onsets = choice.result.points, choice.result.onsets
    asked = {"frequencies": True, "onsets": bool(onsets), "growth": (points[-1].modes.stability == "unstable").any()}
    if not any(asked[kind] for kind in kinds):
        return 0.0
    lost = [kind for kind, error in zip(kinds, errors, strict=True) if asked[kind] and not np.isfinite(error)]
    return float("inf") if lost else float(np.nanmax(errors))


def true_errors(choice: Choice, folder: Path) -> dict[str, float]:
    """Return the errors of a choice against values extrapolated from a finer mesh; meshes are put in a folder."""
    scene = choice.scene
    if scene.mesh.geometry is None:
        scene = chamfered_scene(write_loaded(choice.mesh, folder / "found.msh"))
        finer = chamfered_scene(write_chamfered(folder / "finer.msh", FILE_FINER))
        setting = own_setting(finer)
    else:
        finer, setting = scene, replace(own_setting(scene), size=own_setting(scene).size / FINER)
    # Modes up to a part of the highest frequency are compared: so many more that these are all that were asked for.
    first, last = choice.result.points[0], choice.result.points[-1]
    top = max(float(p.modes.frequency_hz.max()) for p in (first, last))
    top = max([top, *(o.frequency_hz for o in choice.result.onsets)])
    wide = sweep(choice.result.problem, [first.value], choice.result.parameter, max_frequency=_ABOVE * top / COMPARED)
    more = {"method": "reduced", "modes": len(wide.points[0].modes)}
    best, probes = measure_apart(finer, replace(setting, **more), None, True, None) or (None, None)
    own = replace(own_setting(scene), **more)
    there, _ = measure_apart(scene, own, probes, False, None) or (None, None)
    assert best is not None and there is not None
    errors = errors_of(there, reference_of(best))
    return {"frequency": errors.frequency, "growth": errors.growth, "onset": errors.onset}


def row(found: dict[str, Any]) -> str:
    """Return a row of the table."""
    parts = " | ".join(
        f"{100 * found[key]:.2g} %" if np.isfinite(found[key]) else "–" for key in ("frequency", "growth", "onset")
    )
    return (
        f"| {found['name']} | {100 * found['target']:g} % | {found['first']} | {found['unknowns']} |"
        f" {100 * found['bar']:.2g} % | {parts} | {found['runs']} | {found['seconds']:.0f} |"
    )


def main() -> None:
    """Print the page, or write it into docs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--folder", type=Path, default=Path("results/mesh_targets"))
    parser.add_argument("--only", nargs="*")
    parser.add_argument("--random", type=int, default=20)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    found, missing = [], []
    imported = write_chamfered(given.folder / "chamfered.msh", FILE)
    for name, case in cases(given.random, imported).items():
        path = given.folder / f"{name.replace(' ', '_').replace(',', '').replace('%', 'percent')}.json"
        if not path.exists() and (given.only is None or name in given.only):
            path.write_text(json.dumps(reach(name, *case, given.folder)), encoding="utf-8")
        if path.exists():
            found.append(json.loads(path.read_text(encoding="utf-8")))
        else:
            missing.append(name)
    asked = [f for f in found if f["true"]]
    within = sum(f["true"] <= f["target"] and f["bar"] <= f["target"] for f in asked)
    without = f" ({len(found) - len(asked)} more have none of the quantities)" if len(found) > len(asked) else ""
    unmeasured = f"\nNot measured: {'; '.join(missing)}.\n" if missing else ""
    page = PAGE.format(
        when=f"{os.cpu_count()} cores, shared with other work, {time.strftime('%Y-%m-%d')}", within=within,
        finer=1e3 * FILE_FINER, all=f"{len(asked)}{without}", missing=unmeasured, rows="\n".join(row(f) for f in found),
    )  # fmt: skip
    print(page)
    if given.write:
        (DOCS / "mesh_targets.md").write_text(page, encoding="utf-8")


PAGE = """# Meshes for a target

`fe-squeal run SCENE.toml --accuracy TARGET` solves on the scene's own mesh (of a geometry of hexahedra, if the scene
says no order: on elements of order 3 that are 1.5 times as long), finds out by body, direction and element where the
error comes from, cuts there finer (and grades a disc towards its hub), and ends when the bars of frequencies, growth
rates and onsets meet the target. Made by `python benchmarks/mesh_targets.py --write`; {when}. The
true errors are those against a mesh with 1.5 times as many elements along every line (of the brake in a file, whose
tetrahedra are cut where errors are: another mesh of gmsh, of size {finer:g} mm), extrapolated: of the frequencies
at the first value, of growth at the last one relative to the fastest, of the critical values; where the name ends in
"onsets" these alone are to meet the target (`--accuracy-of onsets`). An onset that one of the two meshes alone has
counts as an error of 100 %; both ends of a window of instability that one alone has, as half its width, by which its
ends move where it closes. Seconds are those of the whole search; other work on the machine makes them longer.

*Bar* is the largest one on the last mesh. A bar of 0 % means that the sweep has nothing of what is to meet the target,
such as no onset; the search ends there. A dash stands where there is nothing to compare. At most eight meshes are tried
(*runs*). Where none of them meets the target, or the next one cannot be made or solved or does not fit into memory, the
command ends with exit code 3, and its folder has the results of the nearest one.

Runs whose bars met the target, and whose true errors are within it: {within} of {all}. One whose true error is not
known, since the finer mesh has no such onset or growth, does not count among them.
{missing}
| scene | target | first unknowns | last unknowns | bar | frequencies | growth | onsets | runs | seconds |
|---|---|---|---|---|---|---|---|---|---|
{rows}
"""


if __name__ == "__main__":
    main()
