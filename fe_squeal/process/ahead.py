"""Work on a thread of its own, beside what goes on until its result is wanted."""

from __future__ import annotations

import contextvars
import ctypes
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Generic, TypeVar

_T = TypeVar("_T")


class Ahead(Generic[_T]):
    """What is being made on another thread. Where a `with` block ends before it was taken, it is given up.

    The program does not end before that thread does, since libraries may stop the whole process if a thread is cut off
    in them. What is given up ends at its next step in Python.

    Parameters
    ----------
    make : callable
        Makes it, in the context (`contextvars`) of the caller. It shares nothing that changes with the work that goes
        on meanwhile.

    Examples
    --------
    >>> ahead = Ahead(lambda: 6 * 7)
    >>> ahead.take()
    42
    """

    def __init__(self, make: Callable[[], _T]) -> None:
        future: Future[_T] = Future()

        def work() -> None:
            try:
                made = make()
            except BaseException as error:  # raised where the result is taken
                future.set_exception(error)
            else:
                future.set_result(made)

        self._future: Future[_T] | None = future
        self._thread = threading.Thread(target=contextvars.copy_context().run, args=(work,), name="ahead")
        self._thread.start()

    def __enter__(self) -> Ahead[_T]:
        return self

    def __exit__(self, *_: object) -> None:
        if self._future is not None and self._thread.is_alive():
            # Raised in that thread, where Python ends it without a word.
            number = ctypes.c_ulong(self._thread.ident or 0)
            ctypes.pythonapi.PyThreadState_SetAsyncExc(number, ctypes.py_object(SystemExit))

    def take(self) -> _T:
        """Wait for it and return it, once: nothing keeps its memory then.

        Raises
        ------
        BaseException
            What making it raised.
        RuntimeError
            It was taken before.
        """
        if self._future is None:
            raise RuntimeError("taken before")
        made = self._future.result()
        self._future = None
        return made
