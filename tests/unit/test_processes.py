"""Steps of several processes as process 0 sees them, with messages that go nowhere."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from fe_squeal.eigen.linear import processes
from fe_squeal.errors import InputError, NotConvergedError, TooLargeError

Comm = SimpleNamespace


@pytest.fixture
def of_processes(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Comm]:
    """Make this one of several processes, with what each of the others tells at the beginning."""

    def of(*told: str | None, rank: int = 0) -> Comm:
        sent: list[object] = []
        comm = SimpleNamespace(
            size=len(told) + 1, rank=rank, sent=sent, send=lambda what, dest, tag: sent.append((dest, what)),
            recv=lambda source, tag: told[source - 1],
        )  # fmt: skip
        monkeypatch.setattr(processes, "_comm", lambda: comm)
        return comm

    monkeypatch.setattr(processes, "_state", processes._State())
    monkeypatch.setattr(processes, "_machine", lambda: "here")
    return of


@pytest.mark.parametrize(
    ("failure", "then", "said"),
    [
        (MemoryError(), TooLargeError, "too little memory for its part of a step of 2 processes"),
        (ValueError("what"), NotConvergedError, "a step of 2 processes failed: ValueError: what"),
        (KeyboardInterrupt(), KeyboardInterrupt, "^$"),
    ],
    ids=["memory", "another", "interrupted"],
)
def test_steps_behind_one_that_failed_say_why(
    failure: BaseException, then: type[BaseException], said: str, of_processes: Callable[..., Comm],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """The others are in the middle of that one: nothing is sent to them any more."""

    def fail(*_: object) -> None:
        raise failure

    comm = of_processes("elsewhere")
    monkeypatch.setitem(processes._STEPS, "solve", fail)
    with pytest.raises(type(failure)):
        processes.together("solve", None)
    sent = len(comm.sent)
    for _ in range(2):
        with pytest.raises(then, match=said) as raised:
            processes.together("solve", None)
        assert raised.value.__cause__ is failure
    assert len(comm.sent) == sent == 1


def test_processes_of_one_machine(of_processes: Callable[..., Comm], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(processes._STEPS, "solve", lambda *_: 7)
    assert processes.local_count() == 1
    of_processes("here", "there", "here")
    assert processes.together("solve", None) == 7
    assert processes.local_count() == 3


@pytest.mark.parametrize("rank", [0, 1])
def test_a_program_of_every_process_is_refused(rank: int, of_processes: Callable[..., Comm]) -> None:
    """Each says it; a process other than the first tells that one, which waits."""
    comm = of_processes("here", None, rank=rank)
    for _ in range(2):
        with pytest.raises(InputError, match=f"process {rank} of 3 runs a program that they all run"):
            processes.together("solve", None)
    assert comm.sent == [(0, None)] * rank


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGHUP")
@pytest.mark.parametrize("ignored", [False, True])
def test_a_helper_leaves_every_end_to_process_0(ignored: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal that is closed sends SIGHUP to all; under nohup it stays ignored."""
    monkeypatch.setattr(processes, "petsc", lambda: None)  # so that it returns at once
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.signal(number, signal.SIG_DFL) for number in numbers]
    try:
        signal.signal(signal.SIGHUP, signal.SIG_IGN if ignored else signal.SIG_DFL)
        assert processes.help_out() == 0
        *ends, hangup = [signal.getsignal(number) for number in numbers]
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
    assert ends[0] == ends[1] != signal.SIG_DFL
    assert hangup == (signal.SIG_IGN if ignored else ends[0])
