"""Work on a thread of its own, beside what goes on until its result is wanted."""

from __future__ import annotations

import contextvars
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Generic, TypeVar

_T = TypeVar("_T")


class Ahead(Generic[_T]):
    """What is being made on another thread; the program does not end before that thread does.

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
                future.set_result(make())
            except BaseException as error:  # raised where the result is taken
                future.set_exception(error)

        self._future: Future[_T] | None = future
        threading.Thread(target=contextvars.copy_context().run, args=(work,), name="ahead").start()

    def take(self) -> _T:
        """Wait for it and return it, once: nothing keeps its memory then.

        Raises
        ------
        BaseException
            What making it raised.
        RuntimeError
            It was taken before.
        """
        future, self._future = self._future, None
        if future is None:
            raise RuntimeError("taken before")
        return future.result()
