"""Whether the bars of the mesh hold: python benchmarks/mesh_bars.py [--write] [--fit]

It writes a section of docs/accuracy_and_cost.md with the true errors of some hundred modes beside the error bars of
--estimate. True values are those with order 2 on meshes that are refined twice, extrapolated from the last two
(Richardson) with the rate 2 of singular edges; their uncertainty is shown too. In `fe_squeal.accuracy.bars`, `SHARE`
and the factor of order 1 are not derived: they were chosen and fitted on the scenes `FITTED` (with --fit), which are
not among the scenes that are measured. A mode has no error, and is counted separately, if the coarse mesh has no mode
of its shape (MAC below one half). This file is longer than others, so that scenes, measurement, fit and page can be
read together.
"""

from __future__ import annotations

import argparse
import functools
import json
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import skfem
from planes import on_plane
from scipy.spatial import cKDTree

import fe_squeal
from fe_squeal.accuracy import bars
from fe_squeal.accuracy.discretisation import with_changes
from fe_squeal.accuracy.estimate import Changes, refined_changes
from fe_squeal.accuracy.reference import same_modes
from fe_squeal.assembly.assembly import Assembly
from fe_squeal.eigen.pencil import Modes
from fe_squeal.eigen.solve import Request, solve_modes
from fe_squeal.mesh import LoadedMesh, from_skfem
from fe_squeal.mesh.refining import refine
from fe_squeal.problem.problem import Problem
from fe_squeal.reduced import ReducedModel
from fe_squeal.sweep.result import Sweep

PAGE = Path(__file__).parents[1] / "docs" / "accuracy_and_cost.md"
_HEAD = "## Do the bars hold?"
_LEVELS = 2  # refinements of the mesh of the scene for the true values
_MORE = 5  # modes that are solved for in addition to those compared
_RATE = 2  # power of the size in the extrapolation of the true values
_COMPARED = 0.8  # of the highest frequency: modes above may leave the range on another mesh, and are not compared
_ALIKE = 0.5  # MAC of two shapes at common nodes: with a smaller one they are not the same mode
LINING = {"youngs_modulus": 2e9, "poisson_ratio": 0.25, "density": 2600.0}
STEEL = {"youngs_modulus": 2.1e11, "poisson_ratio": 0.3, "density": 7800.0}
BELT = {"direction": [1, 0, 0], "speed": 2.0}
_SIDES = {"left": (0, 0), "right": (0, -1), "front": (1, 0), "back": (1, -1), "bottom": (2, 0), "top": (2, -1)}


@dataclass(frozen=True)
class Case:
    """A scene on a coarse mesh, and what is swept."""

    name: str
    kind: str
    order: int
    counts: tuple[int, int, int]
    size: tuple[float, float, float]
    values: tuple[float, ...]
    parameter: str = "mu"
    plate: bool = False
    lean: float = 0.3  # the spring of the piston has the direction (lean, 0, 1)
    modes: int = 12
    effects: str = "{}"  # JSON
    mu: float = 0.5


def _mu(stop: float, points: int = 12) -> tuple[float, ...]:
    """Return zero, and values of μ at which modes grow."""
    return (0.0, *np.linspace(0.3 * stop, stop, points - 1).tolist())


_RAYLEIGH = '{"rayleigh": {"alpha": 20.0, "beta": 4e-8}}'
_PRESSED = '{"preload": {"pressures": {"top": 2e6}}}'
FITTED = (
    Case("block", "hex", 1, (2, 1, 1), (0.08, 0.05, 0.03), _mu(1.4)),
    Case("block, damped", "tet", 2, (1, 1, 1), (0.06, 0.05, 0.025), _mu(1.2), effects=_RAYLEIGH),
    Case("pad on a plate", "tet", 1, (2, 1, 1), (0.06, 0.04, 0.016), _mu(1.0), plate=True, modes=9),
    Case("block, pressed", "hex", 2, (1, 1, 1), (0.07, 0.04, 0.03), _mu(1.2, 5), effects=_PRESSED),
)  # fmt: skip
MEASURED = (
    Case("block", "hex", 1, (2, 2, 1), (0.1, 0.055, 0.025), _mu(1.5), lean=0.4, modes=10),
    Case("block", "tet", 1, (2, 1, 1), (0.075, 0.06, 0.03), _mu(1.3), lean=0.2, modes=9),
    Case("block", "hex", 2, (2, 1, 1), (0.09, 0.04, 0.02), _mu(1.6), lean=0.35),
    Case("block, damped", "tet", 2, (2, 1, 1), (0.08, 0.045, 0.022), _mu(1.4), effects=_RAYLEIGH, lean=0.25),
    Case("pad on a plate", "hex", 2, (1, 1, 1), (0.05, 0.035, 0.014), _mu(1.2), plate=True),
    Case("pad on a plate, damped", "hex", 1, (2, 1, 1), (0.07, 0.045, 0.02), _mu(1.0), plate=True,
         effects=_RAYLEIGH, modes=10),
    Case("block, over the contact's stiffness", "tet", 2, (2, 1, 1), (0.085, 0.05, 0.02),
         tuple(np.geomspace(1e10, 1e12, 10).tolist()), "contacts.face.normal_stiffness", mu=0.9),
    Case("block, pressed", "hex", 2, (1, 1, 1), (0.085, 0.05, 0.025), _mu(1.3, 6), lean=0.25, effects=_PRESSED),
    Case("block, over a guide's stiffness", "hex", 1, (2, 1, 1), (0.09, 0.05, 0.03),
         tuple(np.linspace(1e7, 2e8, 10).tolist()), "springs.abutment.stiffness", mu=1.1, modes=10),
)  # fmt: skip


def mesh_of(case: Case) -> LoadedMesh:
    """Return the coarse mesh: a block, or one on a plate that is clamped at its bottom."""
    pad = _box(case.kind, case.counts, case.size, (0.0, 0.0, 0.0), "pad")
    if not case.plate:
        return from_skfem(pad, "block")
    x, y, _ = case.size
    plate = _box(case.kind, (2, 1, 1), (1.6 * x, 1.4 * y, 0.01), (-0.3 * x, -0.2 * y, -0.01), "plate")
    return from_skfem(_joined(pad, plate), "pad on a plate")


def _box(kind: str, counts: Iterable[int], size: Any, corner: Any, name: str) -> skfem.Mesh:
    axes = [c + np.linspace(0, s, n + 1) for c, s, n in zip(corner, size, counts, strict=True)]
    mesh = (skfem.MeshHex if kind == "hex" else skfem.MeshTet).init_tensor(*axes)
    suffix = "" if name == "pad" else f"_{name}"
    sides = {s + suffix: on_plane(a, axes[a][end]) for s, (a, end) in _SIDES.items()}
    return mesh.with_subdomains({name: np.arange(mesh.nelements)}).with_boundaries(sides)


def _joined(one: skfem.Mesh, other: skfem.Mesh) -> skfem.Mesh:
    both = type(one)(np.hstack([one.p, other.p]), np.hstack([one.t, other.t + one.p.shape[1]]))
    volumes = {**one.subdomains, **{n: e + one.nelements for n, e in other.subdomains.items()}}
    facets = {tuple(sorted(f)): i for i, f in enumerate(both.facets.T.tolist())}
    surfaces = {}
    for mesh, shift in ((one, 0), (other, one.p.shape[1])):
        for name, members in mesh.boundaries.items():
            surfaces[name] = np.array([facets[tuple(sorted(f))] for f in (mesh.facets[:, members].T + shift).tolist()])
    return both.with_subdomains(volumes).with_boundaries(surfaces)


def scene_of(case: Case, order: int) -> fe_squeal.Scene:
    """Return the scene at an order."""
    return fe_squeal.parse_scene(tables_of(case, order))


def tables_of(case: Case, order: int) -> dict[str, Any]:
    """Return the tables of the scene at an order."""
    x, y, _ = case.size
    springs = [
        {"name": "piston", "surface": "top", "direction": [case.lean, 0, 1], "stiffness": 3e7 * x * y / 0.004},
        {"name": "abutment", "surface": "right", "direction": [1, 0, 0], "stiffness": 4e7},
        {"name": "guide", "surface": "front", "direction": [0, 1, 0], "stiffness": 3e7},
    ]
    contact = {
        "name": "face", "surface": "bottom", "counterface": "top_plate" if case.plate else "rigid",
        "normal_stiffness": 1e11, "sliding": BELT, "gap_tolerance": 1e-6,
    }  # fmt: skip
    bodies = {"pad": {"material": "lining"}} | ({"plate": {"material": "steel"}} if case.plate else {})
    return {
        "mesh": {"file": "made", "order": order}, "materials": {"lining": LINING, "steel": STEEL}, "bodies": bodies,
        "supports": [{"surface": "bottom_plate", "fixed": "xyz"}] if case.plate else [],
        "springs": springs, "contacts": [contact], "effects": {"friction": {"mu": case.mu}, **json.loads(case.effects)},
    }  # fmt: skip


def shapes_at(problem: Problem, case: Case, points: np.ndarray, modes: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return eigenvalues (k,) and shapes (3 p, k) at p given points, for each value."""
    assembly = problem.source
    assert isinstance(assembly, Assembly)
    space = assembly.space
    distance, near = cKDTree(space.coordinates).query(points)
    assert distance.max() < 1e-9
    rows = (3 * near[:, None] + np.arange(3)).ravel()
    position = np.full(3 * space.nodes, -1)
    position[space.free] = np.arange(len(space.free))
    found, model = [], None
    request = Request(modes, tolerance=1e-7)
    if problem.is_affine(case.parameter):
        model = ReducedModel(problem, case.parameter, np.array(case.values), request)
    for value in case.values:
        if model is not None:
            reduced: Modes = model.modes(value)
            lam, right = reduced.lam, model.lift(reduced.right)
        else:
            solved = solve_modes(problem.pencil({case.parameter: value}), request)
            lam, right = solved.lam, solved.right
        at = position[rows]
        shape = np.where((at >= 0)[:, None], right[np.maximum(at, 0)], 0.0)
        found.append((lam, shape))
    return found


@dataclass(frozen=True)
class Pairs:
    """Errors and bars of the modes of a case; all arrays are (k,), with an entry for each mode and value.

    `likely` and `likely_bar` are those of the extrapolated values.
    """

    error: np.ndarray
    bar: np.ndarray
    unsure: np.ndarray
    growing: np.ndarray
    likely: np.ndarray
    likely_bar: np.ndarray
    lost: int


def measured(case: Case) -> Pairs:
    """Return the true errors of a case and its bars."""
    result, changes, own, levels = _solved(case)
    return _paired(with_changes(result, changes), own, levels)


@functools.cache
def _solved(case: Case) -> tuple[Sweep, Changes, list[Any], list[Any]]:
    """Return the sweep on the coarse mesh, what refining it once changes, and modes there and on finer meshes."""
    loaded = mesh_of(case)
    problem = Assembly(scene_of(case, case.order), loaded).problem({})
    result = fe_squeal.sweep(problem, np.array(case.values), case.parameter, modes=case.modes)
    assembly = problem.source
    assert isinstance(assembly, Assembly)
    corners = np.unique(assembly.space.dofs.nodal_dofs)
    points = _apart(assembly.space.coordinates[corners])
    own = shapes_at(problem, case, points, case.modes + _MORE)
    finer = loaded
    levels = []
    for _ in range(_LEVELS):
        finer = refine(finer)
        fine = Assembly(scene_of(case, 2), finer).problem({})
        levels.append(shapes_at(fine, case, points, case.modes + 2 * _MORE))
    return result, refined_changes(result), own, levels


def _apart(points: np.ndarray) -> np.ndarray:
    """Return the points that are on one body only: where two bodies touch, nodes of both are at the same place."""
    tree = cKDTree(points)
    return points[[len(tree.query_ball_point(p, 1e-9)) == 1 for p in points]]


def _paired(result: Sweep, own: list[Any], levels: list[Any]) -> Pairs:
    rows, lost = [], 0
    points = [p for p in result.points if not p.between]
    for point, (lam, shape), (once, shape_1), (twice, shape_2) in zip(points, own, *levels, strict=True):
        assert point.discretisation is not None
        assert point.extrapolated is not None and point.extrapolated_discretisation is not None
        top = _COMPARED * point.modes.lam.imag.max()
        same, before = same_modes(shape, lam, shape_2, twice), same_modes(shape_2, twice, shape_1, once)
        for i, here in enumerate(point.modes.lam.tolist()):
            if not 0 < here.imag < top:
                continue
            k = int(np.argmin(np.abs(lam - here)))
            j = same.get(k)
            alike = j is not None and _mac(shape[:, k], shape_2[:, j]) >= _ALIKE
            if not alike or j not in before or not np.isfinite(point.discretisation[i]):
                lost += 1
                continue
            step = twice[j] - once[before[j]]
            true = twice[j] + step / (2**_RATE - 1)
            growing = here.real > 1e-6 * here.imag or true.real > 1e-6 * true.imag
            rows.append((
                true - here, point.discretisation[i], abs(step) / (2**_RATE - 1), growing,
                true - point.extrapolated[i], point.extrapolated_discretisation[i],
            ))  # fmt: skip
    columns = [np.array(c) for c in zip(*rows, strict=True)]
    return Pairs(*columns, lost)


def _mac(a: np.ndarray, b: np.ndarray) -> float:
    size = np.vdot(a, a).real * np.vdot(b, b).real
    return float(abs(np.vdot(a, b)) ** 2 / size) if size else 0.0


def held(pairs: Pairs, likely: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Return (k,) bool twice, which bars of Re λ and of Im λ contain the true error; `likely`, of extrapolated values.

    A hundredth of the uncertainty of the true value, and 1e-3 1/s, are allowed for errors of extrapolation and solver;
    the whole uncertainty for extrapolated values, whose errors are often smaller than it.
    """
    error, bar, part = (pairs.likely, pairs.likely_bar, 1.0) if likely else (pairs.error, pairs.bar, 1e-2)
    slack = part * pairs.unsure + 1e-3
    return np.abs(error.real) <= bar.real + slack, np.abs(error.imag) <= bar.imag + slack


def table(cases: Iterable[Case]) -> tuple[list[str], dict[str, float]]:
    """Return the rows of the table in Markdown, and the totals."""
    rows, every = [], []
    for case in cases:
        clock = time.perf_counter()
        pairs = measured(case)
        every.append(pairs)
        rows.append(_row(f"{case.name}, {case.kind}, order {case.order}", pairs))
        print(rows[-1], f"{time.perf_counter() - clock:.0f} s", flush=True)
    names = ("error", "bar", "unsure", "growing", "likely", "likely_bar")
    whole = Pairs(
        *(np.concatenate([getattr(p, name) for p in every]) for name in names),
        sum(p.lost for p in every),
    )
    rows.append(_row("**all**", whole))
    print(rows[-1], flush=True)
    re, im = held(whole)
    return rows, {
        "pairs": len(re), "held": float((re & im).mean()), "growing": int(whole.growing.sum()),
        "held_growing": float((re & im)[whole.growing].mean()),
        "held_likely": float(np.logical_and(*held(whole, likely=True)).mean()),
    }  # fmt: skip


def _row(name: str, p: Pairs) -> str:
    re, im = held(p)
    both, g = re & im, p.growing
    unsure = np.median(p.unsure / np.maximum(np.abs(p.error), 1e-300))
    with np.errstate(divide="ignore", invalid="ignore"):
        wide = np.median((p.bar.imag / np.abs(p.error.imag))[np.abs(p.error.imag) > 0])
        tall = np.median((p.bar.real / np.abs(p.error.real))[g]) if g.any() else np.nan
        closer = np.median(np.abs(p.likely) / np.abs(p.error))
        grown = np.median((np.abs(p.likely.real) / np.abs(p.error.real))[g]) if g.any() else np.nan
    likely = np.logical_and(*held(p, likely=True))
    return (
        f"| {name} | {len(both)} | {100 * both.mean():.1f} % | {int(g.sum())} | "
        f"{f'{100 * both[g].mean():.1f} %' if g.any() else ''} | {f'{100 * re[g].mean():.1f} %' if g.any() else ''} | "
        f"{wide:.1f} | {tall:.1f} | {100 * unsure:.1g} % | {p.lost} | {closer:.2f} | {grown:.2f} | "
        f"{100 * likely.mean():.1f} % |"
    )


def page(rows: list[str]) -> str:
    """Return the section of docs/accuracy_and_cost.md."""
    head = (
        "| scene | modes × values | both bars hold | growing | both bars hold | bar of Re λ holds | bar over error, Im"
        " (median) | Re of growing | true value unsure by | not paired | error of λ extrapolated over that of the mesh"
        " (median) | of Re λ, growing | bars of extrapolated hold |"
    )
    text = (
        f"{_HEAD}\n\nMade by `python benchmarks/mesh_bars.py --write`. Each row is a sweep with `--estimate` on a"
        " coarse mesh; the true values are those of order 2 on meshes two levels finer, extrapolated. A mode is not"
        " paired where its shape on the coarse mesh is another one (MAC below one half), or where no bar is known. The"
        f" bars are {bars.BARS[1]:g} (order 1) and {bars.BARS[2]:g} (order 2) times the change on the mesh refined"
        " once; for Re λ of growing modes and onsets, of order 2, 4/3 times the parts of elements that are not at"
        " singular edges, widened by how far the parts by body, direction and place cancel; for order 1 and modes that"
        f" do not grow with a floor of {bars.SHARE:g} of this times |Δλ|."
        " The factor of order 1 was fitted on other scenes (`FITTED` there) than those measured here, the floor"
        " chosen.\n\n"
    )
    return text + "\n".join([head, "|---" * 13 + "|", *rows]) + "\n"


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into the page")
    parser.add_argument("--fit", action="store_true", help="try floors on the scenes they are fitted on")
    given = parser.parse_args()
    if given.fit:
        for factor in (2.0, 3.0, 4.0):
            for share in (0.0, 0.125, 0.25, 0.5):
                bars.BARS[1], bars.SHARE = factor, share
                print(f"order 1: {factor:g}; share {share:g}: {table(FITTED)[1]}", flush=True)
        return
    rows, totals = table(MEASURED)
    print(totals)
    if given.write:
        PAGE.write_text(with_section(PAGE.read_text(encoding="utf-8"), page(rows)), encoding="utf-8")


def with_section(text: str, section: str) -> str:
    """Return a page with the section in place of the one of the same heading, or at its end."""
    return with_section_of(_HEAD, text, section)


def with_section_of(head: str, text: str, section: str) -> str:
    """Return a page with the section in place of the one under a heading, or at its end."""
    start = text.find(head)
    if start < 0:
        return f"{text.rstrip()}\n\n{section}"
    after = text.find("\n## ", start + len(head))
    return text[:start] + section + (text[after:] if after >= 0 else "")


if __name__ == "__main__":
    main()
