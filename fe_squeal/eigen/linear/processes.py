"""Several processes under mpiexec: one runs the program, the others take part where the work and memory are large.

That is where matrices are factorised and solved, and where columns of the problem's length are kept.

Process 0 does everything that a single one does. Before a step that all take part in it sends the others what to do.
They wait for that asleep most of the time, so that they take no core from it.
"""

from __future__ import annotations

import importlib
import os
import socket
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import InputError, NotConvergedError, TooLargeError
from ...process.ranks import is_helper, process_count
from . import column_parts, matrix_parts
from .column_parts import ends, gathered, scattered
from .petsc import MumpsOptions, MumpsReport, PetscMatrix, petsc
from .scratch import own_folder, remove_scratch

_COMMAND, _READY, _END = 7, 8, "end"  # tags of messages to the others, and of the first one from each; the last one
_FIRST_WAIT, _LONGEST_WAIT = 1e-5, 2e-3  # s, between two looks for a message
_PATIENCE = 20  # s, for which a process that is to end waits for the first one
_matrices: dict[int, PetscMatrix] = {}
_given_up: list[int] = []  # handles that nothing uses any more: released with the next command


@dataclass
class _State:
    handle: int = 0
    under_way: bool = False  # a step that did not end leaves the others in the middle of it
    failure: BaseException | None = None  # what ended it
    machines: list[str] | None = None  # of all processes, once all are known to take part


_state = _State()


def _comm() -> Any:
    if process_count() == 1:
        return None
    petsc()  # which starts MPI
    from mpi4py import MPI

    return MPI.COMM_WORLD


def _factorize(comm: Any, what: dict[str, Any], A: sp.csr_array | None) -> MumpsReport:
    """Spread the rows over the processes if they are not, and factorise."""
    if "parts" in what:
        rows = matrix_parts.rows_to_factorise(comm, what, A)
    elif comm is None:
        assert A is not None
        rows = A
    else:
        rows = _scattered_rows(comm, what["n"], A)
    matrix = PetscMatrix(rows, what["n"], what["symmetric"], what["definite"], comm)
    options: MumpsOptions = what["options"]
    if options.out_of_core and not what["analyse_only"]:
        options = replace(options, folder=str(own_folder(options.folder, 0 if comm is None else comm.rank)))
    told = matrix.factorize(options, what["analyse_only"])
    if what["analyse_only"] or told.error:
        matrix.destroy()
    else:
        _matrices[what["handle"]] = matrix
    return told


def _solve(comm: Any, what: dict[str, Any], b: np.ndarray | None) -> tuple[np.ndarray | None, int]:
    """Return A⁻¹ b or A⁻ᵀ b (n, k) on process 0, and the error that MUMPS tells, on which no process raises alone."""
    matrix = _matrices[what["handle"]]
    if comm is None:
        assert b is not None
        return matrix.solve(b, what["transposed"])
    own = scattered(comm, what["n"], what["columns"], b, what["rows"])
    x, error = matrix.solve(own, what["transposed"])
    return gathered(comm, what["n"], x, what["rows"]), error


def _scattered_rows(comm: Any, n: int, A: sp.csr_array | None) -> sp.csr_array:
    if comm.rank:
        return matrix_parts.received_rows(comm, 0, n)
    assert A is not None
    at = ends(n, comm.size)
    for other in range(1, comm.size):
        matrix_parts.send_rows(comm, sp.csr_array(A[at[other] : at[other + 1]]), other)
    return sp.csr_array(A[: at[1]])


def _call(comm: Any, what: dict[str, Any], data: Any) -> Any:
    """Do a step of a room that this one does not know, named "module:function"."""
    module, name = what["function"].split(":")
    return getattr(importlib.import_module(module), name)(comm, what, data)


_STEPS: dict[str, Callable[..., Any]] = {
    "factorize": _factorize, "solve": _solve,
    "make columns": column_parts.make, "put columns": column_parts.put, "mix columns": column_parts.mix,
    "keep columns": column_parts.keep,
    "combine columns": column_parts.combine, "cross columns": column_parts.cross,
    "rows of columns": column_parts.rows,
    "partition": matrix_parts.partition, "put rows": matrix_parts.put_rows, "product of rows": matrix_parts.product,
    "call": _call, "diagonal of rows": matrix_parts.diagonal, "some rows": matrix_parts.some_rows,
    "scale of rows": matrix_parts.scale, "largest of rows": matrix_parts.largest,
}  # fmt: skip


def _take_part(comm: Any, name: str, what: dict[str, Any], data: Any) -> Any:
    for handle in what["given_up"]:
        if handle in _matrices:
            _matrices.pop(handle).destroy()
        column_parts.release(handle)
        matrix_parts.release(handle)
    return _STEPS[name](comm, what, data)


def together(name: str, data: Any, **what: Any) -> Any:
    """Do a step on all processes; called by process 0, which has the data and gets the result."""
    comm = _comm()
    what["given_up"] = _given_up[:]
    del _given_up[: len(what["given_up"])]
    if comm is None:
        return _take_part(comm, name, what, data)
    _meet(comm)
    if _state.under_way:
        raise _after(_state.failure, comm.size) from _state.failure
    _state.under_way = True
    try:
        for other in range(1, comm.size):
            comm.send((name, what), dest=other, tag=_COMMAND)
        result = _take_part(comm, name, what, data)
    except BaseException as failure:
        _state.failure = failure
        raise
    _state.under_way = False
    return result


def _meet(comm: Any) -> None:
    """Wait until all others are there to take part; a process that runs a program of its own is refused, and tells."""
    if _state.machines is None and comm.rank:
        _state.machines = []
        comm.send(None, dest=0, tag=_READY)
    elif _state.machines is None:
        found = [comm.recv(source=other, tag=_READY) for other in range(1, comm.size)]
        _state.machines = [] if None in found else [_machine(), *found]
    if not _state.machines:
        raise InputError(
            f"MPI: process {comm.rank} of {comm.size} runs a program that they all run; expected one process, the"
            f" command fe-squeal, or a program of process 0 alone while the others are in"
            f" fe_squeal.eigen.linear.processes.help_out()"
        )


def _after(failure: BaseException | None, count: int) -> BaseException:
    """Return what a step raises behind one that failed: the others are in the middle of that."""
    if isinstance(failure, MemoryError):
        return TooLargeError(f"this process had too little memory for its part of a step of {count} processes")
    if isinstance(failure, Exception):
        return NotConvergedError(f"a step of {count} processes failed: {type(failure).__name__}: {failure}")
    return KeyboardInterrupt()


def local_count() -> int:
    """Return how many processes run on this machine, 1 without others; process 0 waits until all are there.

    Raises
    ------
    InputError
        Another process runs a program of its own.
    """
    if (comm := _comm()) is not None:
        _meet(comm)
    return (_state.machines or [_machine()]).count(_machine())


def _machine() -> str:
    return socket.gethostname()


def new_handle() -> int:
    """Return a number for what all processes have a part of: a matrix, or columns."""
    _state.handle += 1
    return _state.handle


def give_up(handle: int) -> None:
    """Release what has this number, with the next step; this may be called at any moment, also during a step."""
    _given_up.append(handle)


def help_out() -> int:
    """Take part in what process 0 does until it ends; the exit code is for mpiexec."""
    import signal

    def last_call(number: int, frame: Any) -> None:
        """Process 0 is told as well, writes what is finished, and ends all; if it does not, the alarm does."""
        if hasattr(signal, "alarm"):
            signal.alarm(_PATIENCE)

    signal.signal(signal.SIGINT, last_call)
    signal.signal(signal.SIGTERM, last_call)
    hangup = getattr(signal, "SIGHUP", None)  # Windows has none, and nohup lets it be ignored
    if hangup is not None and signal.getsignal(hangup) != signal.SIG_IGN:
        signal.signal(hangup, last_call)
    parent = os.getppid()
    comm, wait = None, _FIRST_WAIT
    try:
        if petsc() is None:
            return 0  # process 0 says what is missing
        comm = _comm()
        comm.send(_machine(), dest=0, tag=_READY)
        while True:
            if not comm.iprobe(source=0, tag=_COMMAND):
                time.sleep(wait)
                wait = min(2 * wait, _LONGEST_WAIT)
                if os.getppid() != parent:  # mpiexec is gone
                    remove_scratch()
                    os._exit(1)
                continue
            wait = _FIRST_WAIT
            name, what = comm.recv(source=0, tag=_COMMAND)
            if name == _END:
                return int(what)
            _take_part(comm, name, what, None)
    except InputError:
        return 0  # process 0 finds the same, and says it
    except BaseException as error:  # whatever it is, the others wait for this process
        lines = traceback.format_exception_only(error)
        rank = comm.rank if comm is not None else "?"
        print(f"error: process {rank} of {process_count()} failed: {''.join(lines).strip()[:300]}", file=sys.stderr)
        sys.stderr.flush()
        remove_scratch()
        if comm is None:
            return 1
        comm.Abort(1)
        raise


def prepare() -> None:
    """Start MPI on process 0, for which the others wait.

    Raises
    ------
    InputError
        MPI counts other processes than those that its variables tell of.
    """
    if process_count() > 1:
        petsc()


def dismiss(code: int) -> None:
    """Let the other processes end, as the last thing that process 0 does."""
    if process_count() == 1 or is_helper():
        return
    try:
        comm = None if petsc() is None else _comm()
    except InputError:  # which `prepare` has raised
        comm = None
    if comm is None:
        return
    sys.stdout.flush()
    sys.stderr.flush()
    if _state.under_way:  # the others wait for a step that does not come
        remove_scratch()
        comm.Abort(code)
    _meet(comm)
    for other in range(1, comm.size):
        comm.send((_END, 0), dest=other, tag=_COMMAND)
