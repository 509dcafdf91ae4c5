"""The scenes of docs/accuracy_and_cost.md, and one solve of each at a size, an order and a shape of elements."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from closed_forms import sliding_block, sliding_plate, wave_speeds

from fe_squeal import load_scene, parse_scene, sweep
from fe_squeal.accuracy.bars import BARS
from fe_squeal.accuracy.estimate import refined_changes
from fe_squeal.assembly.assembly import Assembly
from fe_squeal.assembly.bodies import read_mesh
from fe_squeal.scene import Scene

EXAMPLES = Path(__file__).parents[1] / "examples"
STEEL = {"youngs_modulus": 2.0e11, "poisson_ratio": 0.3, "density": 7800.0}
BLOCK, PLATE = (0.10, 0.083, 0.071), (0.10, 0.10, 0.01)  # m
COMPARED = 8  # lowest modes that are compared
_MORE = 6  # further modes that are solved for, since on a coarse mesh modes may have another order
_LONG = 2.0  # s: if a solve takes longer, its time is measured only once
_ALL = {"x": ("left", "right"), "y": ("front", "back"), "z": ("bottom", "top")}


@dataclass(frozen=True)
class Rung:
    """One solve: its cost, its errors, and how good the error bars are.

    Attributes
    ----------
    errors : (k,) float
        Relative errors of the lowest frequencies.
    inside : float
        Part of the modes whose bar contains the true error.
    wide : float
        Median of bar over error.
    bar : float
        Bar over the change when every element is cut into eight.
    """

    unknowns: int
    seconds: float
    seconds_bars: float
    errors: np.ndarray
    inside: float
    wide: float
    bar: float = 2.0


def block_scene(size: tuple[float, float, float], fixed: dict[str, str], element: str, order: int, h: float) -> Scene:
    """Return a steel block with held components on its sides."""
    geometry = {"length": size[0], "width": size[1], "height": size[2], "size": h, "element": element}
    return parse_scene({
        "mesh": {"block": geometry, "order": order}, "materials": {"steel": STEEL},
        "bodies": {"block": {"material": "steel"}},
        "supports": [{"surface": s, "fixed": f} for s, f in fixed.items()], "solve": {"modes": COMPARED + _MORE},
    })  # fmt: skip


def sliding_scene(element: str, order: int, h: float) -> tuple[Scene, np.ndarray]:
    """Return the block with u·n = 0 on all faces, and its exact frequencies."""
    fixed = {side: component for component, sides in _ALL.items() for side in sides}
    return block_scene(BLOCK, fixed, element, order, h), sliding_block(BLOCK, wave_speeds(**STEEL), COMPARED)


def plate_scene(element: str, order: int, h: float) -> tuple[Scene, np.ndarray]:
    """Return the thick plate on sliding edges, and its exact frequencies."""
    fixed = {"left": "yz", "right": "yz", "front": "xz", "back": "xz"}
    exact = sliding_plate(PLATE[0], PLATE[2], wave_speeds(**STEEL), 30e3)
    return block_scene(PLATE, fixed, element, order, h), exact[:COMPARED]


def annulus_scene(element: str, order: int, h: float) -> tuple[Scene, np.ndarray | None]:
    """Return the clamped annular disc; the pad of the geometry is held by its back and does not touch the disc."""
    own = load_scene(EXAMPLES / "disc_pad.toml").mesh.disc_pad
    assert own is not None
    update = {"size": h, "element": element, "pads": 1, "back_plate_thickness": 0.0, "pad_thickness": 0.004}
    geometry: dict[str, Any] = {**own.model_dump(), **update}
    stiff = {**STEEL, "youngs_modulus": 2e13}
    return parse_scene({
        "mesh": {"disc_pad": geometry, "order": order}, "materials": {"steel": STEEL, "stiff": stiff},
        "bodies": {"disc": {"material": "steel"}, "pad_1": {"material": "stiff"}},
        "supports": [{"surface": "hub", "fixed": "xyz"}, {"surface": "pad_back_1", "fixed": "xyz"}],
        "solve": {"modes": COMPARED + _MORE},
    }), None  # fmt: skip


SOLIDS = {"block": sliding_scene, "plate": plate_scene, "annular disc": annulus_scene}


def solve(case: str, element: str, order: int, h: float, exact: np.ndarray | None = None) -> Rung:
    """Solve one of `SOLIDS`; without exact frequencies, given or known, the errors are NaN."""
    scene, known = SOLIDS[case](element, order, h)
    exact = known if exact is None else exact
    seconds = np.inf
    for _ in range(2):  # the first time includes the loading of libraries
        start = time.perf_counter()
        problem = Assembly(scene, read_mesh(scene)).problem({})
        result = sweep(problem, [0.0], modes=COMPARED + _MORE)
        seconds = min(seconds, time.perf_counter() - start)
        if seconds > _LONG:
            break
    start = time.perf_counter()
    changes = refined_changes(result).modes[0].imag / (2 * np.pi)
    found = result.points[0].modes.frequency_hz
    bars = time.perf_counter() - start
    if exact is None:
        return Rung(problem.unknowns, seconds, bars, np.full(COMPARED, np.nan), np.nan, np.nan)
    rank = np.argsort(found + changes / (1 - 0.25**order))[: len(exact)]  # modes in the order of their true frequencies
    error, bar = np.abs(found[rank] - exact), BARS[order] * np.abs(changes[rank])
    ratio = float(np.median(bar / error))
    return Rung(problem.unknowns, seconds, bars, error / exact, float(np.mean(error <= bar)), ratio, BARS[order])


def extrapolated(case: str, element: str, h: float) -> np.ndarray:
    """Return the lowest frequencies on a fine mesh of order 2, plus 1.5 times what refining it changes."""
    scene, _ = SOLIDS[case](element, 2, h)
    result = sweep(Assembly(scene, read_mesh(scene)).problem({}), [0.0], modes=COMPARED + _MORE)
    changes = refined_changes(result).modes[0].imag / (2 * np.pi)
    return np.sort(result.points[0].modes.frequency_hz + 1.5 * changes)[:COMPARED]


def brake_scene(size: float | None = None, **changes: Any) -> Scene:
    """Return the example of the disc with two pads, with elements of a size, m, and with some tables replaced."""
    scene = load_scene(EXAMPLES / "disc_pad.toml")
    data = scene.model_dump(mode="json", by_alias=True, exclude_unset=True)
    data["mesh"].pop("file", None)
    if size is not None:
        data["mesh"]["disc_pad"]["size"] = size
    return parse_scene({**data, **changes})


def belt_scene(**changes: Any) -> Scene:
    """Return the example of the pad on a belt, with some tables replaced."""
    data = load_scene(EXAMPLES / "pad_on_belt.toml").model_dump(mode="json", by_alias=True, exclude_unset=True)
    data["mesh"].pop("file", None)
    return parse_scene({**data, **changes})
