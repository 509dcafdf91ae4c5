"""Seconds, memory and counted work of the disc with two pads with each effect on and off; see effects_cost.py.

As a script it is the process of one measurement of memory: a case in JSON on standard input, MiB on standard output.
"""

from __future__ import annotations

import gc
import json
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import scipy.sparse as sp
from effects_cost_cases import Case

from fe_squeal import assemble, parse_scene
from fe_squeal.assembly.bodies import read_mesh
from fe_squeal.effects import EFFECTS
from fe_squeal.effects.effect import Effect
from fe_squeal.eigen.linear import choice
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.eigen.threads import one_openblas_thread
from fe_squeal.problem.problem import Problem
from fe_squeal.scene import Scene

NEXT_MU = 0.41

@dataclass
class Row:
    """The cost of a case: seconds of each run, and counts of one solve at μ = 0.4.

    Attributes
    ----------
    factorised : list of (size, symmetric)
        All factorisations of the eigensolver, in order.
    static : int
        Number of factorisations during assembly, for the static state under preload.
    solves : int
        Number of right-hand sides that are solved for with the factors.
    nonzeros : int
        Entries of M, C and K together.
    memory_mib, before_mib : float or None, MiB
        Largest memory of a separate process, at its end and before assembly.
    """

    effect: str
    unknowns: int
    problem_class: str
    terms: int
    modes: int
    nonzeros: int
    factorised: list[tuple[int, bool]]
    static: int
    solves: int
    assembly: list[float] = field(default_factory=list)
    solve: list[float] = field(default_factory=list)
    next_value: list[float] = field(default_factory=list)
    memory_mib: float | None = None
    before_mib: float | None = None


def measure(cases: Sequence[Case], runs: int, memory: bool = False) -> list[Row]:
    """Measure every case once for its counts, then `runs` times, in turn, for its seconds."""
    scenes = [_parsed(c) for c in cases]
    mesh = read_mesh(scenes[0])  # all scenes have the same mesh
    rows = []
    for case, scene in zip(cases, scenes, strict=True):
        with _counted() as static:
            problem = _assembled(case, scene, mesh)
        with _counted() as work:
            pencil = _pencil(case, problem)
            modes = solve_modes(pencil, _request(scene))
        nonzeros = sum(A.nnz for A in (pencil.M, pencil.C, pencil.K) if A is not None)
        rows.append(
            Row(
                case.name, problem.unknowns, problem.problem_class, len(problem.terms), len(modes), nonzeros,
                work.factorised, len(static.factorised), work.solves,
            )
        )  # fmt: skip
        if memory:
            rows[-1].before_mib, rows[-1].memory_mib = _memory(case)
    for run in range(runs):
        order = list(zip(cases, scenes, rows, strict=True))
        for case, scene, row in order[:: -1 if run % 2 else 1]:  # alternates, so that drifts of the machine cancel
            gc.collect()
            start = time.perf_counter()
            problem = _assembled(case, scene, mesh)
            assembled = time.perf_counter()
            with one_openblas_thread():  # a sweep does the same
                solve_modes(_pencil(case, problem), _request(scene))
            solved = time.perf_counter()
            if problem.has("mu"):
                problem.pencil(mu=NEXT_MU)
                row.next_value.append(time.perf_counter() - solved)
            row.assembly.append(assembled - start)
            row.solve.append(solved - assembled)
    return rows


def _parsed(case: Case) -> Scene:
    scene = parse_scene(case.scene)
    assert isinstance(scene, Scene)
    return scene


def _request(scene: Scene) -> Request:
    return Request(scene.solve.modes, scene.solve.max_frequency, scene.solve.tolerance)


def _assembled(case: Case, scene: Scene, mesh: Any) -> Problem:
    def fail(*_: object, **__: object) -> None:
        raise AssertionError("an effect that is not in the scene was called")

    with ExitStack() as stack:
        absent = [kind for kind in EFFECTS if case.unreachable and kind.name not in scene.effect_names]
        for kind in absent:
            for name in set(vars(Effect)) & set(vars(kind)):
                if callable(getattr(kind, name)) and not name.startswith("_") and name != "warnings_without":
                    stack.enter_context(patch.object(kind, name, fail))
        return assemble(scene, mesh)


def _pencil(case: Case, problem: Problem) -> Pencil:
    if not case.by_hand:
        return problem.pencil()
    numbers = problem.parameters
    M, K = (
        sp.csr_array(sum(t.matrix * t.coefficient(numbers) for t in problem.terms if t.slot == slot)) for slot in "MK"
    )
    return Pencil(M, K, free=problem.free_motions())


@dataclass
class _Work:
    factorised: list[tuple[int, bool]] = field(default_factory=list)
    solves: int = 0


class _CountingFactor:
    def __init__(self, factor: choice.Factor, work: _Work) -> None:
        self.negative_pivots = factor.negative_pivots
        self.solve = self._counting(factor.solve, work)
        self.solve_transposed = self._counting(factor.solve_transposed, work)
        self.solve_adjoint = self._counting(factor.solve_adjoint, work)

    @staticmethod
    def _counting(solve: choice.Solve, work: _Work) -> choice.Solve:
        def counted(b: np.ndarray) -> np.ndarray:
            work.solves += 1 if b.ndim == 1 else b.shape[1]
            return solve(b)

        return counted


@contextmanager
def _counted() -> Iterator[_Work]:
    work, original = _Work(), choice.factorize

    def counting(
        A: sp.csr_array, symmetric: bool, linear_solver: choice.LinearSolver | str = "auto"
    ) -> _CountingFactor:
        work.factorised.append((A.shape[0], symmetric))
        return _CountingFactor(original(A, symmetric, linear_solver), work)

    with ExitStack() as stack:
        for module in [m for n, m in sys.modules.items() if n.startswith("fe_squeal.")]:
            if getattr(module, "factorize", None) is original:  # in modules that have imported it by name
                stack.enter_context(patch.object(module, "factorize", counting))
        yield work


def _memory(case: Case) -> tuple[float, float]:
    """Return the largest memory, MiB, of a process before and after assembly and solve of one case."""
    command = [sys.executable, __file__]
    done = subprocess.run(command, input=json.dumps(asdict(case)), check=True, capture_output=True, text=True)
    before, after = json.loads(done.stdout)
    return before, after


def _peak_mib() -> float:
    status = Path("/proc/self/status")
    if status.exists():  # Linux: ru_maxrss of a child begins with that of its parent
        return int(status.read_text().partition("VmHWM:")[2].split()[0]) / 2**10
    import resource  # not on Windows

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)


def _main() -> None:
    case = Case(**json.load(sys.stdin))
    scene = _parsed(case)
    mesh = read_mesh(scene)
    choice.choose()  # loads the library, so that its memory is in every case
    before = _peak_mib()
    problem = _assembled(case, scene, mesh)
    with one_openblas_thread():
        solve_modes(_pencil(case, problem), _request(scene))
    print(json.dumps([before, _peak_mib()]))


if __name__ == "__main__":
    _main()
