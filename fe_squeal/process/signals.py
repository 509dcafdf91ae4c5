"""Signals that ask the program to end."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_ENDS = ("SIGINT", "SIGTERM", "SIGHUP")


@contextmanager
def stopped_by_signals() -> Iterator[None]:
    """Let every signal that asks for the end do what Ctrl-C does: what is finished is kept, children are ended."""
    before = {}
    for name in _ENDS:
        number = getattr(signal, name, None)  # Windows knows no SIGHUP
        if number is None or signal.getsignal(number) in (signal.SIG_IGN, None):
            continue
        with suppress(ValueError):  # not in the main thread
            before[number] = signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


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
