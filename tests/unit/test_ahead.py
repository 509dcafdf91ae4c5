"""Work on a thread beside other work: its result, its errors, and the threads of OpenBLAS meanwhile."""

import gc
import threading
import time
import weakref

import pytest

from fe_squeal.eigen.threads import _openblas, one_openblas_thread, thread_count
from fe_squeal.process.ahead import Ahead

WAIT = 30.0  # s: a test that waits longer has failed


class _Thing:
    pass


def test_it_is_made_while_other_work_goes_on():
    may_end = threading.Event()
    ahead = Ahead(lambda: may_end.wait(WAIT))
    may_end.set()  # would not be reached if the work above had to end first
    assert ahead.take()


def test_errors_are_raised_where_the_result_is_taken():
    def fail():
        raise MemoryError("too large")

    ahead = Ahead(fail)
    with pytest.raises(MemoryError, match="too large"):
        ahead.take()


def test_nothing_keeps_what_was_taken():
    ahead = Ahead(_Thing)
    known = weakref.ref(ahead.take())
    gc.collect()
    assert known() is None
    with pytest.raises(RuntimeError, match="taken before"):
        ahead.take()


def _openblas_threads():
    return {library["num_threads"] for library in _openblas().info()}


def test_openblas_has_one_thread_in_nested_blocks_and_ahead():
    before = _openblas_threads()

    @one_openblas_thread()
    def inner():
        return _openblas_threads()

    with one_openblas_thread():
        assert inner() == {1} == _openblas_threads()  # the inner block does not give back what the outer one took
        assert Ahead(inner).take() == {1} == _openblas_threads()
    assert _openblas_threads() == before == {thread_count()}
    assert inner() == {1}
    assert _openblas_threads() == before


def test_openblas_gets_its_threads_back_after_an_error():
    before = _openblas_threads()
    with pytest.raises(ValueError, match="inside"), one_openblas_thread():
        raise ValueError("inside")
    assert _openblas_threads() == before


def test_what_is_given_up_ends_at_once():
    """As after Ctrl-C, at which the program would otherwise wait for it; what was taken or has ended is not touched."""
    begun, ended = threading.Event(), threading.Event()

    def busy():
        begun.set()
        try:
            for _ in range(int(WAIT / 0.01)):
                time.sleep(0.01)
        finally:
            ended.set()

    with pytest.raises(KeyboardInterrupt), Ahead(busy):
        begun.wait(WAIT)
        raise KeyboardInterrupt
    assert ended.wait(WAIT / 3)
    with Ahead(lambda: 6 * 7) as ahead:
        assert ahead.take() == 42
    with pytest.raises(ValueError, match="not made"), Ahead(lambda: int("not made")) as ahead:
        ahead.take()
