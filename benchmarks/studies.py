"""Figures of docs/studies.md: python benchmarks/studies.py [--write] [--keep FOLDER] [--samples N] [--fine SIZE]

Makes the scatter and the map of the examples, solves some of the samples directly, and says what that took in CPU
seconds of one thread; --samples solves many samples by one worker and by two, --fine makes the model of a finer mesh.
--write puts pictures into docs/images and what was measured into the page; what is in the folder already is not
measured again.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

for _key in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_key, "1")

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402
import psutil  # noqa: E402

from fe_squeal.assembly.assembly import assemble  # noqa: E402
from fe_squeal.cli import main as fe_squeal  # noqa: E402
from fe_squeal.eigen.request import Request  # noqa: E402
from fe_squeal.problem.problem import Problem  # noqa: E402
from fe_squeal.scene import Scene  # noqa: E402
from fe_squeal.scene.file import load_scene, parse_scene  # noqa: E402
from fe_squeal.study.engine import solve_places  # noqa: E402
from fe_squeal.study.models import DirectModel  # noqa: E402
from fe_squeal.study.outcome import COLUMNS  # noqa: E402
from fe_squeal.study.points import Scatter, sobol_points  # noqa: E402
from fe_squeal.study.pools import Processes  # noqa: E402
from fe_squeal.study.solving import TRAINED, Solving  # noqa: E402

ROOT = Path(__file__).parents[1]
PAGE, IMAGES = ROOT / "docs" / "studies.md", ROOT / "docs" / "images"
BEGIN, END = "<!-- measured: python benchmarks/studies.py --write -->\n", "<!-- end of measured -->\n"
PICTURES = {"disc_pad_scatter": ("probability", "scatter", "indices"), "disc_pad_map": ("map",)}


def results(name: str, folder: Path) -> Path:
    """Return the folder of a study of an example; the study is made if the folder does not exist."""
    out = folder / name
    if not (out / "report.html").exists():
        code = fe_squeal(["study", str(ROOT / "examples" / f"{name}.toml"), "-o", str(out)])
        if code:
            raise SystemExit(code)
    return out


def direct_checks(out: Path, count: int) -> str:
    """Solve some samples directly, and return a sentence on how verdicts and growth rates agree."""
    scene = load_scene(ROOT / "examples" / "disc_pad_scatter.toml")
    assert isinstance(scene, Scene) and scene.study is not None
    names, samples = scene.study.names, pd.read_csv(out / "samples.csv")
    request = Request(scene.solve.modes, scene.solve.max_frequency, 1e-8)
    model = DirectModel(assemble(scene), names, request)
    same, off = 0, 0.0
    for row in samples.iloc[:: len(samples) // count][:count].to_dict("records"):
        found = model.outcome([row[name] for name in names]).row
        same += int(found[0]) == row["unstable"]
        off = max(off, abs(found[1] - row["worst_re"]) / (2 * np.pi * row["worst_frequency_hz"]))
    return (
        f"Of {count} samples that were also solved directly, {same} have the same verdict; the largest growth rates"
        f" differ by {off:.0e} of |λ| at most."
    )


def solving(scene: Scene, problem: Problem, samples: int) -> tuple[Solving, np.ndarray]:
    """Return what solves the scatter of a scene, with its model, and points."""
    assert scene.study is not None and scene.study.parameters is not None
    whole = Scatter.of(scene.study.parameters, scene.study.correlation)

    def draw(i: int) -> np.ndarray:
        return whole.values(whole.normals(sobol_points(TRAINED, len(whole.names), i + 1)))

    points = whole.values(whole.normals(sobol_points(samples, len(whole.names), 0)))
    return Solving(
        problem, whole.names, points.min(axis=0), points.max(axis=0), draw, max_frequency=scene.solve.max_frequency,
        progress=lambda text, done, total, rate: print(text, flush=True) if not total else None,
    ), points  # fmt: skip


def worker_lines(samples: int) -> list[str]:
    """Solve many samples of the example by one worker and by two, and say what that took."""
    scene = load_scene(ROOT / "examples" / "disc_pad_scatter.toml")
    assert isinstance(scene, Scene)
    solver, points = solving(scene, assemble(scene), samples)
    lines, rows, rates = [], [], []
    direct = COLUMNS.index("direct")
    for workers in (1, 2):
        before, finished = resource.getrusage(resource.RUSAGE_CHILDREN), []
        largest = 0

        def count(done: int, total: int, rate: float, finished: list[tuple[float, int]] = finished) -> None:
            nonlocal largest
            finished.append((time.perf_counter(), done))
            for child in psutil.Process().children(recursive=True):
                with suppress(psutil.Error):  # a child that has ended
                    # A child that has not started its own program yet shares the memory of this process.
                    if "spawn_main" in " ".join(child.cmdline()):
                        largest = max(largest, child.memory_info().rss)

        rows.append(solve_places(solver.solver, points, Processes(workers), None, count)[0])
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        (begun, first), (ended, last) = finished[1], finished[-1]  # without the start of the workers
        rates.append((last - first) / (ended - begun))
        lines.append(
            f"- {samples} samples by {workers} worker{'s' if workers > 1 else ''}: {cpu:.0f} CPU seconds with the"
            f" start, so {samples / cpu:.0f} samples a second and core; {ended - finished[0][0]:.0f} s by the clock,"
            f" {rates[-1]:.0f} a second; a worker took {largest / 2**20:.0f} MiB."
        )
        print(lines[-1], flush=True)
    apart = np.abs(rows[1] - rows[0]).max()
    lines.append(
        f"- Two workers did {rates[1] / rates[0]:.2f} times as much by the clock as one;"
        f" {int((rows[0][:, direct] > 0).sum())} samples were solved directly, by the workers as well,"
        f" and the largest difference of a number between both tables is {apart:.0e}."
    )
    return lines


def fine_lines(size: float, samples: int = 200, checks: int = 5) -> list[str]:
    """Make the model of the example on a finer mesh, and say what it and its samples took."""
    data = tomllib.loads((ROOT / "examples" / "disc_pad_scatter.toml").read_text(encoding="utf-8"))
    data["mesh"].pop("file")
    data["mesh"]["disc_pad"]["size"] = size
    scene = parse_scene(data)
    assert isinstance(scene, Scene) and scene.study is not None
    problem, start = assemble(scene), time.process_time()
    solver, points = solving(scene, problem, samples)
    made = time.process_time()
    model = solver.solver
    rows = np.array([model.outcome(p).row for p in points])
    solved, missed = time.process_time(), int((rows[:, COLUMNS.index("direct")] > 0).sum())
    direct = DirectModel(problem, scene.study.names, Request(None, scene.solve.max_frequency, 1e-8))
    exact = np.array([direct.outcome(p).row for p in points[:checks]])
    off = np.abs(exact[:, 1] - rows[:checks, 1]) / (2 * np.pi * rows[:checks, 2])
    same = int((exact[:, 0] == rows[:checks, 0]).sum())
    return [
        f"- The same on {problem.unknowns} unknowns: {model.why}. {made - start:.0f} CPU seconds until the model is"
        f" there, then {samples / (solved - made):.0f} samples a CPU second, {missed} of {samples}"
        f" solved directly. Of {checks} that were also solved directly, {same} have the same verdict, and growth rates"
        f" differ by {off.max():.0e} of |λ| at most; a direct solve took"
        f" {(time.process_time() - solved) / checks:.0f} CPU seconds."
        f" {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB at most."
    ]


def kept(path: Path, measure: Callable[[], list[str]] | None) -> list[str]:
    """Return lines that were measured before, or are measured now; none where neither is so."""
    if not path.exists() and measure is not None:
        path.write_text("\n".join(measure()) + "\n", encoding="utf-8")
    return path.read_text(encoding="utf-8").splitlines() if path.exists() else []


def scatter_lines(out: Path, checks: int) -> list[str]:
    """Return lines with the results of the scatter and its time."""
    record, bands = json.loads((out / "study.json").read_text()), pd.read_csv(out / "bands.csv")
    whole, cpu = bands.iloc[-1], record.get("cpu_seconds", {})
    lines = [
        "![Probability of instability by band](images/study_probability.png)",
        "",
        f"`examples/disc_pad_scatter.toml`: five numbers, {record['samples']} samples of {record['unknowns']} unknowns."
        f" Unstable with a probability of {100 * whole['probability']:.3g} % (95 % interval"
        f" {100 * whole['lower']:.3g} to"
        f" {100 * whole['upper']:.3g} %);"
        f" what drives {'it' if 0 < whole['probability'] < 1 else 'the largest growth'} most is `{record['driver']}`.",
        "",
        "![Damping ratio against frequency of every unstable mode](images/study_scatter.png)",
        "",
        "![Sobol indices](images/study_indices.png)",
        "",
        f"- Method: {record['method']}.",
        f"- {record['solved_directly']} samples were solved directly. {direct_checks(out, checks)}",
    ]
    if cpu:
        again = record["samples"] // len(record["parameters"]) * len(record["parameters"])
        solved, seconds = record["samples"] + again, cpu.get("samples", 0.0) + cpu.get("indices", 0.0)
        lines.append(
            f"- One thread: {cpu['model']:.0f} CPU seconds until the model is there, then"
            f" {solved / seconds:.0f} samples a CPU second for {solved} samples, those for the indices among them; at"
            f" most {record['peak_memory_mib']:.0f} MiB."
        )
    return lines


def map_lines(out: Path) -> list[str]:
    """Return lines with the results of the map and its time."""
    record, boundaries = json.loads((out / "study.json").read_text()), pd.read_csv(out / "boundaries.csv")
    cpu = record.get("cpu_seconds", {})
    count, points, worst = boundaries["curve"].nunique(), len(boundaries), boundaries["uncertainty"].max()
    took = f" CPU seconds on one thread: {', '.join(f'{k} {v:.0f}' for k, v in cpu.items())}." if cpu else ""
    return [
        "",
        "![Map of the largest growth over friction and lining stiffness, with the boundaries](images/study_map.png)",
        "",
        f"`examples/disc_pad_map.toml`: {count} boundaries with {points} points, each sure to {worst:.0e} of the map's"
        f" width.{took}",
    ]


def main() -> None:
    """Run, measure, and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="put pictures and figures into docs/")
    parser.add_argument("--keep", type=Path, help="folder of the studies; what is there already is not made again")
    parser.add_argument("--checks", type=int, default=20, help="samples that are solved directly")
    parser.add_argument("--samples", type=int, help="that one worker and two solve")
    parser.add_argument("--fine", type=float, metavar="SIZE", help="of the elements of a finer mesh, m")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        folders = {name: results(name, folder) for name in PICTURES}
        scatter, samples, size = folders["disc_pad_scatter"], options.samples, options.fine
        lines = kept(folder / "scatter.md", lambda: scatter_lines(scatter, options.checks))
        lines += kept(folder / "workers.md", (lambda: worker_lines(samples)) if samples else None)
        lines += kept(folder / "fine.md", (lambda: fine_lines(size)) if size else None)
        lines += map_lines(folders["disc_pad_map"])
        print("\n".join(lines))
        if options.write:
            for name, pictures in PICTURES.items():
                for picture in pictures:
                    shutil.copyfile(folders[name] / f"{picture}.png", IMAGES / f"study_{picture}.png")
            head, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
            PAGE.write_text(head + BEGIN + "\n".join(lines) + "\n" + END + rest.split(END)[1], encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
