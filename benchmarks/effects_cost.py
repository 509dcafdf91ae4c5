"""What each effect costs: python benchmarks/effects_cost.py [--runs 5] [--write]

Prints tables of seconds, memory and counted work of the disc with two pads with each effect on and off; with `--write`
they become docs/effects_cost.md and docs/images/effects_cost.png.
"""

from __future__ import annotations

import argparse
import datetime
import os
import platform
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from effects_cost_cases import FRICTION, ROOT, absence_cases, effect_cases, scene_of
from effects_cost_measure import NEXT_MU, Row, measure

from fe_squeal.eigen.linear.choice import solver_name

TARGET = 3.0  # a solve of the quadratic class over one of the nonsymmetric class
COLOURS = {"symmetric": "#8c8c8c", "nonsymmetric": "#2f6fb5", "quadratic": "#e08a1e", "complex": "#8e4a9e"}
HEADER = (
    "effect", "unknowns", "class", "terms", "nonzeros", "modes", "factorisations", "solves", "assembly, s",
    "ratio", "solve, s", "ratio (middle half)", "next μ, s", "memory, MiB",
)  # fmt: skip
ABSENCE_HEADER = (
    "friction alone", "terms", "nonzeros", "factorisations", "solves", "assembly, s", "middle half", "solve, s",
    "middle half",
)  # fmt: skip


def table(rows: Sequence[Row]) -> str:
    """Return the Markdown table of the effects; ratios are those to friction alone in the same run."""
    reference = _named(rows, FRICTION)
    body = [
        (
            r.effect, r.unknowns, r.problem_class, r.terms, r.nonzeros, r.modes, f"{r.static} + {len(r.factorised)}",
            r.solves, _median(r.assembly), _median(_ratios(r.assembly, reference.assembly)), _median(r.solve),
            f"{_median(_ratios(r.solve, reference.solve))} ({_middle(_ratios(r.solve, reference.solve))})",
            _median(r.next_value, 3), "" if r.memory_mib is None else f"{r.memory_mib:.0f}",
        )
        for r in rows
    ]  # fmt: skip
    return _markdown(HEADER, body)


def absence_table(rows: Sequence[Row]) -> str:
    """Return the Markdown table of cases that have to cost the same as friction alone."""
    body = [
        (
            r.effect, r.terms, r.nonzeros, len(r.factorised), r.solves, _median(r.assembly, 3), _middle(r.assembly, 3),
            _median(r.solve, 3), _middle(r.solve, 3),
        )
        for r in rows
    ]  # fmt: skip
    return _markdown(ABSENCE_HEADER, body)


def target(rows: Sequence[Row]) -> str:
    """Return a sentence on whether the quadratic class meets its target.

    If the target is inside the middle half of the measured ratios, the sentence leaves it open.
    """
    reference = _named(rows, FRICTION)
    quadratic = [r for r in rows if r.problem_class == "quadratic"]
    ratios = {r.effect: _ratios(r.solve, reference.solve) for r in quadratic}
    verdicts: dict[str, list[str]] = {"met": [], "not met": [], "open, for noise,": []}
    for name, of_runs in ratios.items():
        low, high = np.percentile(of_runs, [25, 75])
        verdict = "met" if high <= TARGET else "not met" if low > TARGET else "open, for noise,"
        verdicts[verdict].append(f'"{name}" ({_median(of_runs)})')
    said = "; ".join(f"**{verdict}** by {', '.join(names)}" for verdict, names in verdicts.items() if names)
    counted = sorted({f"{r.solves / reference.solves:.2f}" for r in quadratic})
    return (
        f"Target: one solve of the quadratic class costs at most {TARGET:g} times one of friction alone: {said}."
        f" Counted in solves with the factors it is {' or '.join(counted)} times as many right-hand sides."
    )


def absence(rows: Sequence[Row]) -> str:
    """Return two sentences on whether absent effects cost nothing."""
    first = rows[0]
    same = all((r.terms, r.nonzeros, r.factorised, r.solves) == _counts(first) for r in rows)
    parts = []
    for what in ("assembly", "solve"):
        of_first = np.array(getattr(first, what))
        noise = max(float(np.subtract(*np.percentile(getattr(r, what), [75, 25]))) for r in rows[:2])
        apart = max((abs(float(np.median(getattr(r, what)) - np.median(of_first))), r.effect) for r in rows[1:])
        word = "within" if apart[0] <= noise else "beyond"
        parts.append(f"{what} {apart[0]:.3f} s ({apart[1]}), {word} the {noise:.3f} s")
    counts = "are the same in all rows" if same else "**differ**"
    return (
        f"Terms, nonzeros, factorisations and solves {counts}. The median farthest from that of the first row is off by"
        f" {'; '.join(parts)} that are the interquartile range of the scene as it is."
    )


def page(results: dict[str, tuple[list[Row], list[Row]]], runs: int) -> str:
    """Return docs/effects_cost.md from the rows of effects and absence by rung, the largest first."""
    largest = next(iter(results.values()))[0]
    before = [r.before_mib for r in largest if r.before_mib is not None]
    basis = f", of which {np.median(before):.0f} MiB are the libraries and the mesh" if before else ""
    machine = f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, {platform.system()}"
    damped, friction = _named(largest, "rayleigh"), _named(largest, FRICTION)
    text = f"""# What each effect costs

![Seconds of assembly and of one solve, with each effect](images/effects_cost.png)

An effect costs something only where its table is in the scene. What it costs is decided by the problem class that its
terms ask for, and next by the entries that they add to the matrices. Every row and bar below "friction" has friction
and the effect that it names:

- **No friction**: symmetric. One Lanczos run gives right and left modes at once.
- **Friction**: nonsymmetric. Right and left modes take a Krylov run each, {friction.solves} right-hand sides in all.
- **Damping, rotation** (terms with velocity): quadratic. A vector is twice as long. Discs around complex shifts cover
  the band, and a real shift shows that nothing is beside; that takes {damped.solves} solves. What is factorised has
  the size of the unknowns, not twice that.
- **Structural damping at each mode's own frequency**: the same steps as for friction in complex arithmetic; frozen at
  one frequency it is a damping matrix and quadratic. Together with velocity terms it is complex and quadratic, the
  dearest.
- **Preload and stress stiffening** leave the class as it is. Their cost is the static state: in assembly, and again at
  every further value of μ in a sweep (column "next μ").
- **Rotation with Rayleigh damping**, as in "all", couples nodes that share no element. Factors and products with the
  matrices grow with the nonzeros.

{target(largest)}
"""
    for rung, (rows, plain) in results.items():
        text += f"\n## {rung}, {rows[0].unknowns} unknowns\n\n{table(rows)}"
        text += f"\n### Effects that are not there\n\n{absence_table(plain)}\n{absence(plain)}\n"
    return f"""{text}
## How it was measured

By `python benchmarks/effects_cost.py --runs {runs} --write` on {machine},
{solver_name()}, Python {platform.python_version()}, on {datetime.date.today().isoformat()}. The scene is that of
`examples/disc_pad.toml` at μ = 0.4, all modes up to its `max_frequency`; the numbers of the effects are those of
`examples/disc_pad_effects.toml`, with a contact pressure of 1 MPa where there is no preload, a loss factor of 0.05 in
the linings, frozen at 3 kHz, and dampers of 100 N s/m at the six springs. The first size is the mesh that the
example names, the second a coarser one with linear elements.

- Seconds are medians of {runs} runs. All scenes of a table run in turn, every other time backwards, so that what else
  the machine does falls on all of them. Ratios are to friction alone in the same turn, their median, in brackets the
  middle half of them. The mesh is read before.
- Assembly makes the terms, with the static state. The solve adds them up at one μ, factorises and finds the modes.
  "Next μ" is the time to the matrices at μ = {NEXT_MU}. Nonzeros are those of M, C and K together.
- Factorisations are those of the static state + those of the solve. Solves are those with the factors, in the
  eigen-solver. Both are counted in a run that is not timed; they are the same every time.
- Memory is the largest resident one of a process that assembles and solves once{basis}.
- "Effects that are not there" is friction alone: twice as it is, which shows the noise; with every function of the
  other effects replaced by one that fails; with the matrices added up by a sum over the terms and handed to the
  eigen-solver; and with tables of effects whose coefficients are all zero.
"""


def chart(rows: Sequence[Row], path: Path) -> None:
    """Draw seconds of assembly and solve, a bar for each effect, coloured by problem class."""
    import matplotlib.pyplot as plt
    from matplotlib.patches import Patch

    plt.switch_backend("Agg")
    figure, axes = plt.subplots(figsize=(9.0, 5.4), layout="constrained")
    reference = _named(rows, FRICTION)
    longest = max(float(np.median(r.assembly) + np.median(r.solve)) for r in rows)
    for i, r in enumerate(rows):
        made, solved = float(np.median(r.assembly)), float(np.median(r.solve))
        axes.barh(i, made, color="#d9d9d9")
        axes.barh(i, solved, left=made, color=COLOURS[r.problem_class])
        ratio = _median(_ratios(r.solve, reference.solve), 1)
        axes.text(made + solved + 0.01 * longest, i, f"× {ratio}", va="center", fontsize=9)
    axes.set_yticks(range(len(rows)), [r.effect if i < 2 else f"+ {r.effect}" for i, r in enumerate(rows)])
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.2 * longest)
    axes.set_xlabel("seconds (× : the solve, relative to that with friction alone)")
    axes.set_title(f"Disc with two pads, {reference.unknowns} unknowns: assembly and one solve", fontsize=11)
    axes.spines[["top", "right"]].set_visible(False)
    classes = [c for c in COLOURS if any(r.problem_class == c for r in rows)]
    handles = [Patch(color=COLOURS[c], label=f"solve, {c}") for c in classes]
    handles = [Patch(color="#d9d9d9", label="assembly"), *handles]
    axes.legend(handles=handles, loc="upper right", frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main() -> None:
    """Measure both sizes and print the page's tables, or write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--write", action="store_true", help="write docs/effects_cost.md and its picture")
    arguments = parser.parse_args()
    results = {}
    for title, rung in (("Mesh of the example", "fine"), ("Coarse mesh", "coarse")):
        scene = scene_of(rung)
        rows = measure(effect_cases(scene), arguments.runs, memory=True)
        plain = measure(absence_cases(scene), arguments.runs)
        results[title] = rows, plain
        print(f"{title}\n\n{table(rows)}\n{target(rows)}\n\n{absence_table(plain)}\n{absence(plain)}\n", flush=True)
    if arguments.write:
        chart(results["Mesh of the example"][0], ROOT / "docs/images/effects_cost.png")
        (ROOT / "docs/effects_cost.md").write_text(page(results, arguments.runs), encoding="utf-8")


def _counts(row: Row) -> tuple[int, int, list[tuple[int, bool]], int]:
    return row.terms, row.nonzeros, row.factorised, row.solves


def _named(rows: Sequence[Row], name: str) -> Row:
    return next(r for r in rows if r.effect == name)


def _ratios(seconds: Sequence[float], reference: Sequence[float]) -> list[float]:
    return [a / b for a, b in zip(seconds, reference, strict=True)]


def _median(numbers: Sequence[float], digits: int = 2) -> str:
    return f"{np.median(numbers):.{digits}f}" if len(numbers) else ""


def _middle(numbers: Sequence[float], digits: int = 2) -> str:
    low, high = np.percentile(numbers, [25, 75])
    return f"{low:.{digits}f}–{high:.{digits}f}"


def _markdown(header: Sequence[str], body: Sequence[Sequence[object]]) -> str:
    lines = [header, ["---"] * len(header), *body]
    return "".join(f"| {' | '.join(str(cell) for cell in line)} |\n" for line in lines)


if __name__ == "__main__":
    main()
