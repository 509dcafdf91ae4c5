"""Whether the bars of onsets hold: python benchmarks/onset_bars.py [--scenes N] [--write]

Random blocks on a belt, pads on a plate, damped blocks and blocks of linear elements, on coarse meshes, are swept over
the friction coefficient with --estimate. The true onsets are those of order 2 on meshes that are refined twice,
extrapolated from the last two with the rate 2 of singular edges. The bars, and the bars of the extrapolated onsets,
hold where they reach the true onset within its own uncertainty, which is what the extrapolation adds. An onset belongs
to that on the finer mesh whose value, frequency and crossing speed differ least, all onsets taken together; one that
has none by then is counted as not paired. Of the rules of `fe_squeal.accuracy.bars`, `SCATTERED` alone was chosen on
such scenes, the first twelve of each kind; the default is to measure others. --write puts the table into
docs/accuracy_and_cost.md.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mesh_bars import PAGE, Case, mesh_of, tables_of, with_section_of
from scipy.optimize import linear_sum_assignment

import fe_squeal
from fe_squeal.accuracy import with_discretisation
from fe_squeal.assembly.assembly import Assembly
from fe_squeal.errors import SquealError
from fe_squeal.mesh import LoadedMesh
from fe_squeal.mesh.refining import refine
from fe_squeal.sweep.onset import Onset

HEAD = "## Do the bars of onsets hold?"
KINDS = "block", "block, damped", "pad on a plate", "block of linear elements"
STOP, VALUES, MODES, MORE = 1.2, 13, 12, 4
_FAR, _LOST = 0.2, 2.0  # of the interval and of a frequency, cost 1 each; from this cost on two onsets are different
_RATE = 2  # of the extrapolation of the true values


def scene_tables(kind: str, seed: int, order: int | None = None) -> tuple[Case, dict[str, Any]]:
    """Return the case and the tables of a random scene; `order` instead of its own."""
    rng = np.random.default_rng([KINDS.index(kind), seed])
    own = 1 if "linear" in kind else 2
    counts = tuple(int(rng.integers(*ends)) * (3 - own) for ends in ((2, 5), (1, 3), (1, 3)))
    size = rng.uniform(0.05, 0.1), rng.uniform(0.03, 0.06), rng.uniform(0.012, 0.03)
    effects = {"rayleigh": {"alpha": float(rng.uniform(5, 40)), "beta": 4e-8}} if "damped" in kind else {}
    case = Case(
        kind, str(rng.choice(["hex", "tet"])), own, counts, size, tuple(np.linspace(0.0, STOP, VALUES).tolist()),
        plate="plate" in kind, lean=float(rng.uniform(0.0, 0.5)), effects=json.dumps(effects),
    )  # fmt: skip
    tables = tables_of(case, order or own)
    tables["contacts"][0]["normal_stiffness"] = float(10 ** rng.uniform(10, 12.5))
    for spring in tables["springs"][1:]:
        spring["stiffness"] = float(10 ** rng.uniform(6.5, 8))
    return case, tables


def swept(tables: dict[str, Any], mesh: LoadedMesh, case: Case, modes: int) -> fe_squeal.Sweep:
    """Return the sweep over μ on a mesh."""
    problem = Assembly(fe_squeal.parse_scene(tables), mesh).problem({})
    return fe_squeal.sweep(problem, np.array(case.values), case.parameter, modes=modes)


def paired(own: Sequence[Onset], other: Sequence[Onset]) -> dict[int, int]:
    """Return by the position of an onset that of the same onset on another mesh."""
    if not own or not other:
        return {}
    cost = np.array([[_unlike(a, b) for b in other] for a in own])
    rows, columns = linear_sum_assignment(cost)
    return {int(i): int(j) for i, j in zip(rows, columns, strict=True) if cost[i, j] < _LOST}


def _unlike(a: Onset, b: Onset) -> float:
    if (a.kind, a.direction) != (b.kind, b.direction):
        return 10.0
    speeds = abs(a.crossing_speed), abs(b.crossing_speed)
    moved = abs(a.value - b.value) / STOP + abs(a.frequency_hz - b.frequency_hz) / max(a.frequency_hz, 1e-300)
    return moved / _FAR + abs(speeds[0] - speeds[1]) / max(sum(speeds), 1e-300)


@dataclass(frozen=True)
class Errors:
    """Of k onsets with bars: true errors, bars, uncertainty of the true values; the same of the extrapolated onsets."""

    error: np.ndarray
    bar: np.ndarray
    unsure: np.ndarray
    likely: np.ndarray
    likely_bar: np.ndarray
    not_paired: int
    unknown: int  # onsets that the program itself says the refined mesh does not have, or has alone

    @classmethod
    def joined(cls, every: Sequence[Errors]) -> Errors:
        """Return those of several scenes together."""
        arrays = [
            np.concatenate([np.zeros(0), *(getattr(e, name) for e in every)])
            for name in ("error", "bar", "unsure", "likely", "likely_bar")
        ]
        return cls(*arrays, sum(e.not_paired for e in every), sum(e.unknown for e in every))


def measured(kind: str, seed: int) -> Errors:
    """Return the errors of the onsets of a scene."""
    case, tables = scene_tables(kind, seed)
    mesh = mesh_of(case)
    result = with_discretisation(swept(tables, mesh, case, MODES))
    fine, finer = [], mesh
    for _ in range(2):
        finer = refine(finer)
        fine.append(swept(scene_tables(kind, seed, 2)[1], finer, case, MODES + MORE).onsets)
    top = 0.9 * min(float(p.modes.frequency_hz.max()) for p in result.points)
    listed = [o for o in result.onsets if o.frequency_hz < top]
    known = [o for o in listed if np.isfinite(o.discretisation)]
    same, before = paired(known, fine[1]), paired(fine[1], fine[0])
    rows = []
    for i, j in same.items():
        step = fine[1][j].value - fine[0][before[j]].value if j in before else 0.0
        beyond = step / (2**_RATE - 1)
        true, o = fine[1][j].value + beyond, known[i]
        rows.append((
            true - o.value, o.discretisation, abs(beyond), true - o.extrapolated, o.extrapolated_discretisation
        ))  # fmt: skip
    columns = np.array(rows).reshape(-1, 5).T
    return Errors(*columns, len(known) - len(same), len(listed) - len(known))


def row(name: str, scenes: int, e: Errors) -> str:
    """Return a row of the table."""
    if not len(e.error):
        return f"| {name} | {scenes} | 0 |" + " |" * 6
    inside, likely = (np.abs(x) <= bar + e.unsure for x, bar in ((e.error, e.bar), (e.likely, e.likely_bar)))
    with np.errstate(divide="ignore", invalid="ignore"):
        wide = np.nanmedian(e.bar / np.abs(e.error))
        better = np.nanmedian(np.abs(e.likely) / np.abs(e.error))
    cells = [name, scenes, len(e.error), f"{100 * inside.mean():.0f} %", f"{wide:.1f}", f"{100 * likely.mean():.0f} %",
             f"{better:.2f}", e.not_paired, e.unknown]  # fmt: skip
    return "| " + " | ".join(map(str, cells)) + " |"


def section(rows: Sequence[str]) -> str:
    """Return the section of the page."""
    head = ("scenes of the kind", "how many", "onsets", "bars hold", "bar over error (median)",
            "bars of extrapolated onsets hold", "error of extrapolated over that of the mesh (median)", "not paired",
            "told to be unknown")  # fmt: skip
    note = (
        "Random scenes on coarse meshes of some hundred unknowns, swept over μ up to"
        f" {STOP}; the true onsets are those of order 2 on meshes two levels finer, extrapolated, and the bars may miss"
        " them by as much as that extrapolation adds. Onsets above 0.9 of the highest frequency are left out. Made by"
        f" `python benchmarks/onset_bars.py --write`; {time.strftime('%Y-%m-%d')}."
    )
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|", *rows]
    return f"{HEAD}\n\n{note}\n\n" + "\n".join(lines) + "\n"


def main() -> None:
    """Print the table, or write it into docs/accuracy_and_cost.md."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=12, help="of each kind")
    parser.add_argument("--first", type=int, default=12, help="seed of the first one")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--write", action="store_true")
    asked = parser.parse_args()
    rows, every = [], []
    for kind in asked.kinds:
        own = []
        for seed in range(asked.first, asked.first + asked.scenes):
            try:
                own.append(measured(kind, seed))
            except SquealError as error:
                print(f"{kind} {seed}: {error}", flush=True)
                continue
            print(f"{kind} {seed}:", row("", 1, own[-1]), flush=True)
        rows.append(row(kind, len(own), Errors.joined(own)))
        every += own
        print(rows[-1], flush=True)
    rows.append(row("**all**", len(every), Errors.joined(every)))
    print(rows[-1], flush=True)
    if asked.write:
        text = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(with_section_of(HEAD, text, section(rows)), encoding="utf-8")


if __name__ == "__main__":
    main()
