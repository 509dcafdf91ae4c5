"""Signals that ask the program to end."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from types import FrameType

_ENDS = ("SIGINT", "SIGTERM", "SIGHUP")
_IMPORTING = "<frozen importlib._bootstrap>"
_WAIT = 0.01  # seconds until a signal that came during an import is sent again


@contextmanager
def stopped_by_signals() -> Iterator[list[int]]:
    """Let every signal that asks for the end do what Ctrl-C does: what is finished is kept, children are ended.

    A signal that comes during an import waits for its end: a compiled module that is interrupted while it is set up
    says ImportError instead of KeyboardInterrupt, and a module in Python is left half made.

    An interruption that Python ignores, as in a finalizer that ran just then, is sent again, too.

    The list that the block gets has the numbers of the signals that interrupted it so far, see `uncovered`.
    """
    # The frame of the `with` block. Its own file may be run by an import; that import is not waited for.
    caller = sys._getframe(2)
    came: list[int] = []
    before = {}
    for name in _ENDS:
        number = getattr(signal, name, None)  # Windows knows no SIGHUP
        if number is None or signal.getsignal(number) in (signal.SIG_IGN, None):
            continue
        with suppress(ValueError):  # not in the main thread
            before[number] = signal.signal(number, lambda number, frame: _interrupt(number, frame, caller, came))
    hook = sys.unraisablehook
    sys.unraisablehook = partial(_ignored, came, hook)
    try:
        yield came
    finally:
        sys.unraisablehook = hook
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def uncovered(came: list[int]) -> Iterator[None]:
    """Raise KeyboardInterrupt in place of any other exception if there were signals.

    Where compiled code calls Python, or takes its objects apart, it may answer an interruption by an exception of its
    own, such as a TypeError about what it was given. A reader of files takes that for a damaged file.
    """
    try:
        yield
    except Exception as error:
        if came:
            raise KeyboardInterrupt from error
        raise


def _interrupt(number: int, frame: FrameType | None, caller: FrameType, came: list[int]) -> None:
    """Raise KeyboardInterrupt, or have the signal sent again a little later.

    That is while `caller` is importing something, and where Python tells of an interruption that it ignores: it would
    ignore another one there too.
    """
    while frame is not None and frame is not caller:
        if frame.f_code.co_filename == _IMPORTING or frame.f_code is _ignored.__code__:
            _again(number)
            return
        frame = frame.f_back
    came.append(number)
    raise KeyboardInterrupt


def _ignored(came: list[int], hook: Callable[[sys.UnraisableHookArgs], object], what: sys.UnraisableHookArgs) -> None:
    """Have the last signal sent again if what Python ignores is an interruption by it; else call the usual hook."""
    if what.exc_type is KeyboardInterrupt and came:
        _again(came[-1])
    else:
        hook(what)


def _again(number: int) -> None:
    """Send a signal a little later.

    On a busy machine a thread may take long to start. The time counts from when it has, so that the signal does not
    come while this function is still waiting for that.
    """
    started = threading.Event()

    def send() -> None:
        started.wait()
        time.sleep(_WAIT)
        _send(number)

    threading.Thread(target=send, daemon=True).start()  # a program that ends meanwhile does not wait for it
    started.set()


def _send(number: int) -> None:
    if sys.platform == "win32":
        signal.raise_signal(number)
    else:  # to the main thread, where it ends waiting
        signal.pthread_kill(threading.main_thread().ident or 0, number)


@contextmanager
def signals_deferred() -> Iterator[None]:
    """Let these signals wait until the block has ended; as a decorator, until the function has.

    What a block starts is whole before it is ended again. And Matplotlib calls Python from compiled code to measure
    text: an interruption that is raised there comes out of Matplotlib as another exception, such as a TypeError.
    """
    came: list[int] = []
    before = {}
    for name in _ENDS:
        number = getattr(signal, name, None)
        if number is not None and callable(signal.getsignal(number)):
            with suppress(ValueError):  # not in the main thread
                before[number] = signal.signal(number, lambda number, _: came.append(number))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if came:
        raise KeyboardInterrupt
