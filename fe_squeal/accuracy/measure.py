"""Solve one setting of a study in a process of its own: its modes and onsets, and the time and memory it takes."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import compress
from multiprocessing.connection import Connection

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from ..assembly.assembly import Assembly
from ..assembly.swept import swept
from ..eigen.memory import peak_memory_mib
from ..errors import NotConvergedError, SquealError, TooLargeError
from ..process.isolation import isolated_children
from ..scene import Scene
from ..scene.solver import solver_of
from ..sweep.onset import Onset
from ..sweep.result import Sweep
from ..sweep.sweep import sweep
from .adapt import finer_geometry
from .corrections import Correction, right_corrections
from .discretisation import with_changes
from .estimate import changes_by
from .line_errors import line_errors
from .quantities import split_changes
from .refined import Refined, refine_problem
from .settings import Setting, scene_at

_PROBES = 200  # points at which shapes on different meshes are compared
_LESS = 0.4  # times the bars of a mesh: those that the adapted mesh after it is made for
_NEAREST = 4  # nodes from which the displacement of a point is interpolated


@dataclass(frozen=True)
class Measurement:
    """The results of a setting and what they cost.

    Attributes
    ----------
    unknowns : int
        Number of unknowns of the problem.
    seconds : mapping of str to float, s
        By stage: "mesh", "assembly", those of the sweep, and "estimate".
    peak_memory_mib : float, MiB
        The largest memory that the process had before the estimate; NaN where the system does not tell.
    values : (m,) float
        Values of the swept parameter.
    lam : (m, k) complex, rad/s
        The eigenvalues at each value; rows with fewer than k modes are filled up with NaN.
    first, last : (3 p, k) complex
        Displacements of the modes at the p probes, at the first and at the last value.
    onsets : (o, 6) float
        A row for each onset: value, frequency in Hz, 1 for flutter, 1 for an onset into instability, the branches a and
        b (NaN where there is one alone).
    likely : (m, k) complex, rad/s
        The likely eigenvalues for an infinitely fine mesh, see `discretisation`; NaN of modes that are not found again
        when the mesh is refined once, and empty where that was not asked for or did not succeed.
    bars : (m, k) complex, rad/s
        The bars of Re λ and of Im λ of these.
    likely_onsets : (o, 2) float
        The likely value of each onset, and its bar; NaN of onsets that are not found again, empty as `likely`.
    appeared : (a, 6) float
        Rows as those of `onsets`, of onsets that only the refined mesh has.
    finer : str
        A geometry, as JSON, whose mesh is finer where the error comes from; empty where there is none.
    """

    unknowns: int
    seconds: dict[str, float]
    peak_memory_mib: float
    values: np.ndarray
    lam: np.ndarray
    first: np.ndarray
    last: np.ndarray
    onsets: np.ndarray
    likely: np.ndarray
    bars: np.ndarray
    likely_onsets: np.ndarray
    appeared: np.ndarray
    finer: str = ""

    @property
    def total(self) -> float:
        """Seconds of all stages but the estimate."""
        return sum(t for stage, t in self.seconds.items() if stage != "estimate")


def measure(
    scene: Scene, setting: Setting, probes: np.ndarray | None, estimate: bool
) -> tuple[Measurement, np.ndarray]:
    """Solve a scene at a setting, in this process.

    Parameters
    ----------
    scene : Scene
    setting : Setting
    probes : (p, 4) float, optional
        Points at which shapes are stored: the number of the body, and the position in m. Without them they are chosen.
    estimate : bool
        Also find what refining the mesh once changes. If that does not fit into memory or does not converge, the
        measurement is returned without it.

    Returns
    -------
    Measurement
    probes : (p, 4) float

    Raises
    ------
    SquealError
        The mesh cannot be made, or the modes are not found.
    """
    clock = time.perf_counter()
    changed, loaded = scene_at(scene, setting)
    seconds = {"mesh": time.perf_counter() - clock}
    clock = time.perf_counter()
    assembly = Assembly(changed, loaded)
    problem = assembly.problem({})
    seconds["assembly"] = time.perf_counter() - clock
    probes = _choose(assembly) if probes is None else probes
    parameter, grid = swept(changed, problem)
    count = min(setting.modes, problem.unknowns)
    solver = solver_of(changed)
    result = sweep(
        problem, grid, parameter, modes=count, tolerance=setting.tolerance, keep_shapes=True, method=setting.method,
        linear_solver=solver,
    )  # fmt: skip
    seconds |= dict(result.seconds)
    at, own = _at(assembly, probes), [not point.between for point in result.points]  # of the points: those of the grid
    if len(result.points) == 1:
        first = result.points[0].shapes
    elif result.reduced_model is not None:
        modes = result.reduced_model.modes(float(grid[0]))
        first = {i: result.reduced_model.lift(modes.right[:, i]) for i in range(len(result.points[0].modes))}
    else:
        alone = sweep(
            problem, grid[:1], parameter, modes=count, keep_shapes=True, method="direct", linear_solver=solver
        )
        first = alone.points[0].shapes
    appeared: tuple[Onset, ...] = ()
    wide, finer, peak = result, "", peak_memory_mib()
    if estimate:
        clock = time.perf_counter()
        try:
            refined = refine_problem(result, solver)
            corrections = right_corrections(result, refined)
            changes = changes_by(result, refined, solver, corrections)
            wide, appeared = with_changes(result, changes), changes.appeared
        except (TooLargeError, NotConvergedError):  # the rest is worth keeping
            seconds["estimate"] = time.perf_counter() - clock
        else:
            seconds["estimate"] = time.perf_counter() - clock
            with suppress(TooLargeError, NotConvergedError):
                finer = _finer(result, refined, corrections)
    points = list(compress(wide.points, own))
    onsets = [onset for onset in wide.onsets if not any(onset is new for new in appeared)]
    return Measurement(
        unknowns=problem.unknowns, seconds=seconds, peak_memory_mib=np.nan if peak is None else peak,
        values=np.array(grid), lam=_padded([p.modes.lam for p in points]),
        first=np.stack([at @ first[i] for i in range(len(result.points[0].modes))], axis=1),
        last=np.stack([at @ result.points[-1].shapes[i] for i in range(len(result.points[-1].modes))], axis=1),
        onsets=_rows(onsets), likely=_padded([p.extrapolated for p in points if p.extrapolated is not None]),
        bars=_padded([p.extrapolated_discretisation for p in points if p.extrapolated_discretisation is not None]),
        likely_onsets=np.array([(o.extrapolated, o.extrapolated_discretisation) for o in onsets]).reshape(-1, 2),
        appeared=_rows(appeared), finer=finer,
    ), probes  # fmt: skip


def _rows(onsets: Sequence[Onset]) -> np.ndarray:
    """Return onsets as rows of `Measurement.onsets`."""
    return np.array([
        (o.value, o.frequency_hz, o.kind == "flutter", o.direction == "into", o.branch_a,
         np.nan if o.branch_b is None else o.branch_b) for o in onsets
    ], float).reshape(-1, 6)  # fmt: skip


def _finer(result: Sweep, refined: Refined, corrections: Mapping[float, Correction]) -> str:
    """Return the geometry whose bars, to first order, are expected to be `_LESS` times those of a sweep, as JSON."""
    geometry = refined.coarse.scene.mesh.geometry
    if geometry is None or geometry.element != "hex":
        return ""
    errors = line_errors(split_changes(result, refined, corrections), refined.coarse)
    target = _LESS * float(errors.at(errors.lines).max(initial=0.0))
    return finer_geometry(errors, geometry, target).model_dump_json()


def measure_apart(
    scene: Scene, setting: Setting, probes: np.ndarray | None, estimate: bool, seconds: float | None
) -> tuple[Measurement, np.ndarray] | None:
    """Do what `measure` does in a new process, so that its peak of memory is that of this setting alone.

    Parameters
    ----------
    scene, setting, estimate
        As for `measure`.
    probes : (p, 4) float, optional
        As for `measure`.
    seconds : float, s, optional
        After so long the process is ended, and None is returned.

    Raises
    ------
    SquealError
        The error that `measure` raised in the process.
    NotConvergedError
        The process was killed or ran out of memory.
    """
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_child, args=(there, scene, setting, probes, estimate), daemon=True)
    with isolated_children():
        process.start()
    there.close()
    try:
        if not here.poll(seconds):
            return None
        try:
            found = here.recv()
        except EOFError as error:
            raise NotConvergedError(f"{setting}: the process was killed, or out of memory") from error
    finally:
        process.kill()
        process.join()
        here.close()
    if isinstance(found, SquealError):
        raise found
    plain, chosen = found
    return Measurement(**plain), chosen


def _child(pipe: Connection, scene: Scene, setting: Setting, probes: np.ndarray | None, estimate: bool) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to both; the parent ends this process
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        found, chosen = measure(scene, setting, probes, estimate)
        pipe.send((asdict(found), chosen))
    except SquealError as error:
        pipe.send(type(error)(str(error)))


def _end_with_parent() -> None:
    """End this process when the parent, which waits for its result, has been killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _choose(assembly: Assembly) -> np.ndarray:
    """Return probes (p, 4), see `measure`: random nodes of every body, in proportion to its number of nodes."""
    rng = np.random.default_rng(11)
    nodes = _nodes(assembly)
    total = sum(len(n) for n in nodes)
    found = []
    for number, own in enumerate(nodes):
        some = rng.choice(own, min(len(own), -(-_PROBES * len(own) // total)), replace=False)
        found.append(np.column_stack([np.full(len(some), number), assembly.space.coordinates[some]]))
    return np.vstack(found)


def _nodes(assembly: Assembly) -> list[np.ndarray]:
    """Return the numbers of the nodes of each body."""
    return [np.unique(assembly.space.dofs.element_dofs[:, elements]) for elements in assembly.bodies.values()]


def _at(assembly: Assembly, probes: np.ndarray) -> sp.csr_array:
    """Return the operator (3 p, n) that gives displacements at probes, from the nearest nodes of their bodies."""
    space = assembly.space
    rows, columns, data = [], [], []
    for number, own in enumerate(_nodes(assembly)):
        mine = np.flatnonzero(probes[:, 0] == number)
        count = min(_NEAREST, len(own))
        distance, near = cKDTree(space.coordinates[own]).query(probes[mine, 1:], k=np.arange(1, count + 1))
        weight = 1 / (distance + 1e-9 * distance.max(initial=1e-300))
        rows.append(np.repeat(mine, count))
        columns.append(own[near].ravel())
        data.append((weight / weight.sum(axis=1, keepdims=True)).ravel())
    values = sp.csr_array(
        (np.concatenate(data), (np.concatenate(rows), np.concatenate(columns))), shape=(len(probes), space.nodes)
    )
    return sp.csr_array(sp.kron(values, sp.eye_array(3), format="csr") @ space.nodal_map)


def _padded(rows: list[np.ndarray]) -> np.ndarray:
    """Return complex rows of different lengths as one array, filled up with NaN."""
    out = np.full((len(rows), max((len(r) for r in rows), default=0)), np.nan * (1 + 1j))
    for i, row in enumerate(rows):
        out[i, : len(row)] = row
    return out
