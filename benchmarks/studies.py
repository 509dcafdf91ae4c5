"""Figures of docs/studies.md: python benchmarks/studies.py [--write] [--keep FOLDER]

Makes the scatter and the map of the examples, solves some of the samples directly, and says what that took in CPU
seconds of one thread; --write puts pictures into docs/images and what was measured into the page.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import tempfile
from pathlib import Path

for _key in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_key, "1")

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402

from fe_squeal.assembly.assembly import assemble  # noqa: E402
from fe_squeal.cli import main as fe_squeal  # noqa: E402
from fe_squeal.eigen.request import Request  # noqa: E402
from fe_squeal.scene import Scene  # noqa: E402
from fe_squeal.scene.file import load_scene  # noqa: E402
from fe_squeal.study.models import DirectModel  # noqa: E402

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
            f" {solved / seconds:.0f} samples a CPU second, {solved} with those for the indices; at most"
            f" {record['peak_memory_mib']:.0f} MiB."
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
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folders = {name: results(name, options.keep or Path(scratch)) for name in PICTURES}
        lines = scatter_lines(folders["disc_pad_scatter"], options.checks) + map_lines(folders["disc_pad_map"])
        print("\n".join(lines))
        if options.write:
            for name, pictures in PICTURES.items():
                for picture in pictures:
                    shutil.copyfile(folders[name] / f"{picture}.png", IMAGES / f"study_{picture}.png")
            head, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
            PAGE.write_text(head + BEGIN + "\n".join(lines) + "\n" + END + rest.split(END)[1], encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
