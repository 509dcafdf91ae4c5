"""What fits into the memory of this machine, or of several processes: for `fe-squeal check`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ..eigen.linear.choice import factor_memory
from ..eigen.linear.mumps import MUMPS, has_mumps
from ..eigen.memory import memory_text
from ..errors import SceneError, SquealError
from ..problem.problem import Problem
from ..process.ranks import process_count
from ..sweep.forecast import MemoryCount, MemoryPrediction, factorised_matrix

# Bytes of factors on the process that has most, by P processes, are those of one process times P to minus this; MUMPS'
# analyses of 437 886 unknowns on 1, 2 and 4 processes (docs/cluster.md) give 0.7 to 0.8.
_SPREAD = 0.7
_PROGRAM = 120 * 2**20  # bytes of a process that takes part in factorisations alone: Python, PETSc and MPI
_MOST_MODES, _MOST_PROCESSES = 10_000, 1024  # that are tried
_GIB = 2**30


@dataclass(frozen=True)
class Machines:
    """P processes, each with so many bytes; None where that is not given."""

    processes: int
    memory: int | None


def machines_of(processes: int | None, gib: float | None) -> Machines | None:
    """Return what the command line asks about.

    Raises
    ------
    SceneError
        Memory is given without processes, or is not positive.
    """
    if gib is not None and not 0 < gib < float("inf"):
        raise SceneError(f"--memory-per-process: given {gib:g}; expected a number of GiB > 0")
    if processes is None:
        if gib is not None:
            raise SceneError(f"--memory-per-process: given {gib:g} alone; expected --processes P beside it")
        return None
    return Machines(processes, None if gib is None else int(gib * _GIB))


def fits_here(count: MemoryCount, modes: int, forecast: MemoryPrediction) -> str:
    """Return how many modes fit into this machine's memory, and if those asked for do not, what else helps."""
    most = modes_that_fit(count, forecast.room)
    values = f"{count.values} value{'s' if count.values > 1 else ''}"
    if count.fixed["program and model"] == forecast.total:
        return f"all modes × {values} (LAPACK on whole matrices)"
    if most >= modes:
        lacks = forecast.strong and forecast.total + forecast.strong > forecast.room
        more = f"; not {modes} modes if friction or damping is strong" if lacks else ""
        return f"{_rounded(most)} modes × {values} or more; {memory_text(forecast.free)} are free{more}"
    helps = [f"{_rounded(most)} modes instead of {modes}"] if most else []
    if not count.reduced:
        helps.append('solve.method = "reduced"')
    if count.factors:
        helps.append("MUMPS with factors on disk (solve.mumps.out_of_core)" + _not_here())
    helps.append("several processes (--processes)")
    return f"not {modes} modes × {values}; what takes less: {', '.join(helps)}"


def fits_there(problem: Problem, count: MemoryCount, modes: int, machines: Machines) -> Iterator[tuple[str, str]]:
    """Yield rows, name and text, on P processes: what process 0 and each other take, and whether that fits."""
    P, analysed = machines.processes, process_count()
    factors, disk, source = _factors(problem, count, P)

    def share(parts: int, of: int = factors) -> int:
        return int(of * (parts / analysed) ** -_SPREAD)

    def first(parts: int, of: int = factors) -> int:
        return count.with_factors(share(parts, of)).at(modes, parts).total

    vectors, rows = count.share(modes, P), count.rows(P)
    others = _PROGRAM + share(P) + vectors + rows
    parts = [f"{memory_text(share(P))} of the factors"]
    parts += [f"{memory_text(vectors)} of the reduced model's vectors"] if vectors else []
    parts += [f"{memory_text(rows)} of the matrices"] if rows else []
    alone = "vectors" if rows else "matrices and other vectors" if vectors else "matrices and vectors"
    yield f"on {P} process{'es' if P > 1 else ''}", (
        f"process 0 {memory_text(first(P))}: {', '.join(parts)}, and {'other ' if rows else ''}{alone}, which it holds"
        " alone"
        + (f"; each other {memory_text(others)}" if P > 1 else "") + f" ({source})"
    )
    if machines.memory is None:
        return
    room, limit = machines.memory, f"of {memory_text(machines.memory)} each"
    most = modes_that_fit(count.with_factors(share(P)), room, P)
    if first(P) <= room:
        yield limit, f"fits; {_rounded(most)} modes would"
        return
    helps = []
    enough = next((p for p in range(P, _MOST_PROCESSES + 1) if first(p) <= room), None)
    if enough is not None:
        helps.append(f"{enough} processes")
    if disk is not None and first(P, disk) <= room:
        helps.append("factors on disk (solve.mumps.out_of_core)")
    if most:
        helps.append(f"{_rounded(most)} modes")
    helps.append(f"{memory_text(first(P))} for process 0 alone")
    yield limit, f"does not fit; what would: {', or '.join(helps)}"


def modes_that_fit(count: MemoryCount, room: int, processes: int | None = None) -> int:
    """Return the largest number of modes, up to 10 000 and the unknowns, for which the total fits, or 0."""
    low, high = 0, min(_MOST_MODES, count.unknowns) + 1
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if count.at(middle, processes).total <= room else (low, middle)
    return low


def _factors(problem: Problem, count: MemoryCount, processes: int) -> tuple[int, int | None, str]:
    """Return the bytes of the factors on the process that has most, the same out of core if known, and who says so.

    They are those on the processes that there are now, from which others' follow.
    """
    if not count.factors:
        return 0, 0, "LAPACK, no factors"
    pencil = problem.pencil()
    A, symmetric = factorised_matrix(pencil), pencil.symmetric and pencil.C is None
    if not has_mumps():  # whose factors are in double precision
        own = factor_memory(A, symmetric, False)
        return own, None, "by the analysis of this machine's solver, as MUMPS is not installed here"
    analysed = process_count()
    try:
        told = MUMPS.told(A, symmetric)
    except (SquealError, MemoryError):
        if analysed > 1:  # whose solver is MUMPS, too
            raise
        return count.factors, None, "by the analysis of this machine's solver, as MUMPS' own failed"
    on = "one process" if analysed == 1 else f"{analysed} processes"
    extrapolated = "" if analysed == processes > 1 else f" on {on}, and P to the -0.7"
    return told.largest, told.largest_on_disk, f"by MUMPS' analysis{extrapolated}"


def _not_here() -> str:
    return "" if has_mumps() else ", which is not installed here"


def _rounded(modes: int) -> str:
    """Return a number of modes: large ones to one digit, rounded down."""
    if modes < 100:
        return str(modes)
    size = 10 ** (len(str(modes)) - 1)
    return f"{'' if modes >= _MOST_MODES else 'about '}{modes // size * size}"
