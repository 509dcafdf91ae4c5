"""What accuracy costs: python benchmarks/accuracy_and_cost.py [--write] [--folder FOLDER] [--budget SECONDS]

It measures errors and times of solids with exact or extrapolated frequencies and of the disc with two pads, without and
with damping, and whether the error bars of the mesh contain the true errors. Measurements are kept in the folder, and
not made again the next time; all of them take about twenty minutes. With a budget, those that do not fit are left out,
and the page says so.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import shutil
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from accuracy_cases import SOLIDS, Rung, brake_scene, extrapolated, solve

from fe_squeal.accuracy.settings import Setting, plan
from fe_squeal.accuracy.study import Study, run_study
from fe_squeal.compare import compare
from fe_squeal.report.accuracy import plot_accuracy
from fe_squeal.report.labels import place_labels
from fe_squeal.run.accuracy import uncertainty, write_study
from fe_squeal.run.measurements import MeasurementFolder
from fe_squeal.scene import Scene

DOCS = Path(__file__).parents[1] / "docs"
LADDERS = {  # sizes in m, from coarse to fine
    ("block", "hex", 1): (0.02, 0.014, 0.010), ("block", "hex", 2): (0.04, 0.028, 0.02),
    ("block", "tet", 1): (0.02, 0.014, 0.010), ("block", "tet", 2): (0.04, 0.028, 0.02),
    ("plate", "hex", 1): (0.01, 0.005, 0.0033), ("plate", "hex", 2): (0.02, 0.0125, 0.01),
    ("plate", "tet", 1): (0.01, 0.007, 0.005), ("plate", "tet", 2): (0.02, 0.014, 0.010),
    ("annular disc", "hex", 1): (0.012, 0.008, 0.006), ("annular disc", "hex", 2): (0.03, 0.02, 0.014),
    ("annular disc", "tet", 1): (0.012, 0.008, 0.006), ("annular disc", "tet", 2): (0.03, 0.02, 0.014),
}  # fmt: skip
COARSE = 0.02  # m: size of the elements of the brake, around which the study varies one thing at a time
FINE = 0.009  # m: size of the elements of the annular disc's reference
THEORY = {1: 2, 2: 4}  # power of the size by which errors of frequencies fall, by the order of the elements
EQUAL = 0.01  # relative error at which the times of both orders are compared
DAMPED: dict[str, Any] = {"friction": {"mu": 0.3}, "rayleigh": {"alpha": 20.0, "beta": 1e-8}}


def rate(rung: Rung) -> float:
    """Return the power of the size by which the error of the median mode falls when every element is cut into eight.

    These two meshes differ only in the size of their elements, unlike two meshes made for different sizes.
    """
    return float(-np.log2(max(1 - rung.wide / rung.bar, 1e-3)))


def time_for(rungs: Sequence[Rung], error: float) -> float:
    """Return the seconds for an error, interpolated or extrapolated linearly in the logarithms of some rungs."""
    e, t = (np.log([x(r) for r in rungs]) for x in (lambda r: r.errors.max(), lambda r: r.seconds))
    slope, at = np.polyfit(e, t, 1)
    return float(np.exp(at + slope * np.log(error)))


def solids() -> tuple[list[str], list[str], list[str]]:
    """Return the tables of errors, of rates and of bars, as lines of Markdown."""
    exact = {case: None for case in SOLIDS} | {"annular disc": extrapolated("annular disc", "hex", FINE)}
    table = ["| solid | elements | order | size, mm | unknowns | seconds | largest error | bars hold | bar / error |",
             "|---|---|---|---|---|---|---|---|---|"]  # fmt: skip
    rates = ["| solid | elements | order | rate | theory, smooth | seconds for 1 % |", "|---|---|---|---|---|---|"]
    held: list[float] = []
    times: dict[tuple[str, str, int], float] = {}
    for (case, element, order), sizes in LADDERS.items():
        print(case, element, order, file=sys.stderr)
        rungs = [solve(case, element, order, h, exact[case]) for h in sizes]
        for h, r in zip(sizes, rungs, strict=True):
            held.append(r.inside)
            table.append(
                f"| {case} | {element} | {order} | {1e3 * h:.3g} | {r.unknowns} | {r.seconds:.2g} |"
                f" {100 * r.errors.max():.2g} % | {100 * r.inside:.0f} % | {r.wide:.2f} |"
            )
        times[case, element, order] = time_for(rungs, EQUAL)
        rates.append(
            f"| {case} | {element} | {order} | {rate(rungs[-1]):.2f} | {THEORY[order]} |"
            f" {times[case, element, order]:.2g} |"
        )
    words = [f"Of all modes {100 * np.mean(held):.0f} % have the true error inside the bar."]
    for case, element in itertools.product(SOLIDS, ("hex", "tet")):
        factor = times[case, element, 1] / times[case, element, 2]
        words.append(f"{EQUAL * 100:g} % on the {case}, {element}: order 1 takes {factor:.2g} times as long as 2.")
    return table, rates, words


def small_plan(scene: Scene) -> list[Setting]:
    """Return the settings of a study without the finest mesh."""
    settings = plan(scene)
    smallest = min(s.size for s in settings)
    return [s for s in settings if s.size > smallest]


def plot_projection(study: Study, path: Path) -> None:
    """Draw the error of growth rates that projection alone makes against time: modal beside reduced."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    frame = study.to_dataframe()
    figure = Figure(figsize=(5.4, 4.0), layout="constrained")
    canvas = FigureCanvasAgg(figure)
    axes = figure.subplots()
    points, texts = [], []
    for method, mark in (("modal", "^"), ("reduced", "o")):
        rows = frame[(frame["method"] == method) & frame["algebraic_growth"].gt(0)].sort_values("algebraic_growth")
        axes.loglog(rows["seconds"], rows["algebraic_growth"], mark, ms=8, label=method)
        for row in rows.itertuples():
            texts.append(f"{row.modes} modes" if method == "modal" else f"tolerance {row.tolerance:.0e}")
            points.append((float(str(row.seconds)), float(str(row.algebraic_growth))))
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.margins(x=0.25, y=0.1)
    axes.set(xlabel="seconds", ylabel="error of growth rates by the projection alone")
    axes.grid(True, alpha=0.3)
    figure.legend(loc="outside upper center", ncols=2, frameon=False)
    canvas.draw()  # settles the layout, which the labels need in pixels
    figure.set_layout_engine("none")
    place_labels(axes, canvas, points, texts, np.empty((0, 2)))
    figure.savefig(path, dpi=130)


def lumped_table(frame: pd.DataFrame) -> list[str]:
    """Return the table of `compare` as lines of Markdown; as in the command, "none" stands for what is not there."""
    lines = ["| case | quantity | lumped | FE | difference |", "|---|---|---|---|---|"]
    for case, quantity, *values in frame.astype(object).itertuples(index=False, name=None):
        numbers = [f"{x:{form}}" for x, form in zip(values, (".9g", ".9g", ".1e"), strict=True)]
        cells = [case, quantity.replace("|", r"\|"), *("none" if n == "nan" else n for n in numbers)]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def of_others(text: str) -> str:
    """Return what stands in the page behind its last section: the sections of mesh_bars.py and onset_bars.py."""
    return "".join(text.partition(LAST)[2].partition("\n## ")[1:])


def kept(path: Path, make: Callable[[], Any]) -> Any:
    """Return what stands in a JSON file, or make it and write it there."""
    if not path.exists():
        path.write_text(json.dumps(make()), encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))


def main() -> None:
    """Print the page, or write it into docs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--folder", type=Path, default=Path("results/accuracy_and_cost"))
    parser.add_argument("--budget", type=float, default=np.inf)
    given = parser.parse_args()
    start = time.perf_counter()
    given.folder.mkdir(parents=True, exist_ok=True)
    table, rates, words = kept(given.folder / "solids.json", solids)
    brakes = {
        "disc with two pads": brake_scene(COARSE), "disc with two pads, damped": brake_scene(COARSE, effects=DAMPED)
    }  # fmt: skip
    parts, studies = [], {}
    for name, scene in brakes.items():
        print(name, file=sys.stderr)
        out = given.folder / name.replace(" ", "_").replace(",", "")
        rest = max(given.budget - (time.perf_counter() - start), 1e-9)
        studies[name] = study = run_study(
            scene, MeasurementFolder(out / "measurements"), None if np.isinf(rest) else rest, small_plan(scene),
            lambda i, n, text, _: print(f"{i}/{n} {text}", file=sys.stderr),
        )  # fmt: skip
        write_study(study, out, name)
        picture = f"accuracy_{out.name}.png"
        plot_accuracy(study.to_dataframe(), uncertainty(study), out / picture, name)
        lines = (out / "accuracy.md").read_text(encoding="utf-8").splitlines()
        body = "\n".join(line for line in lines if not line.startswith(("# ", "!["))).replace("## ", "### ")
        parts.append(f"## {name.capitalize()}\n\n![error against time](images/{picture})\n{body}\n")
    plot_projection(studies["disc with two pads"], given.folder / "modal_or_reduced.png")
    page = PAGE.format(
        when=f"{os.cpu_count()} cores, shared with other work, {time.strftime('%Y-%m-%d')}", table="\n".join(table),
        rates="\n".join(rates), words="\n".join(f"- {w}" for w in words), parts="\n".join(parts),
        lumped="\n".join(lumped_table(compare("all"))),
    )  # fmt: skip
    print(page)
    if given.write:
        there = DOCS / "accuracy_and_cost.md"
        there.write_text(page + of_others(there.read_text(encoding="utf-8")), encoding="utf-8")
        (DOCS / "images").mkdir(exist_ok=True)
        for picture in (*given.folder.glob("*/accuracy_*.png"), given.folder / "modal_or_reduced.png"):
            shutil.copy(picture, DOCS / "images" / picture.name)


LAST = "## Beside the lumped models"
PAGE = """# Accuracy and cost

How large errors are, what makes them smaller, and for how many seconds. Made by
`python benchmarks/accuracy_and_cost.py --write`; {when}. For a scene of your own: `fe-squeal accuracy SCENE.toml`.

## Solids with known frequencies

A block between smooth walls (u·n = 0 on all faces) and a thick plate whose edges slide along their normals have exact
frequencies in three dimensions; those of the annular disc, clamped at its hub, are extrapolated from a fine mesh. The
largest error of the 8 lowest frequencies counts. *Bars hold*: the share of these modes whose true error lies inside
the bar of `--estimate`; *bar / error*: the median. Orders 1 and 2 are measured. Order 3 (`order = 3` in `[mesh]`),
which is for hexahedra alone, pays where elements are large: [what was measured](report.md#errors-of-the-mesh).

{table}

{words}

### Rates

With which power of the size the error falls, from the finest mesh to the same with every element cut into eight, as
the corrections of `--estimate` find it (the median of the modes). Smooth modes give 2 for order 1 and 4 for order 2. At
the clamped hub of the disc the stress is singular (like r^−0.3 at a right angle between clamped and free faces of
steel), which takes order 2 down to between 1 and 2 in the end. Linear tetrahedra bend as if they were
far stiffer: on the plate, one of them through the thickness, the frequencies are nearly twice the true ones, and it
takes several through the thickness before the rate shows.

{rates}

{parts}
## The modal projection at equal cost

The error of growth rates that the projection alone makes, against a direct solve on the same mesh: the usual
projection on modes without friction, with more and more of them, and the reduced model of right and left modes, which
is grown until every residual meets the tolerance.

![modal and reduced](images/modal_or_reduced.png)

## Meeting a target

[Meshes for a target](mesh_targets.md): what `fe-squeal run SCENE.toml --accuracy TARGET` chooses, and how far off.

## Beside the lumped models

`fe-squeal compare`: finite-element models of the lumped systems; the difference is the elasticity that a lumped model
leaves out.

{lumped}
"""


if __name__ == "__main__":
    main()
