"""Where work is done: in this process, or in many, by dask.distributed."""

from __future__ import annotations

import gc
import logging
import tempfile
import time
import warnings
from collections.abc import Callable, Hashable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

from ..errors import NotConvergedError, SceneError
from ..process.isolation import isolated_children
from ..process.signals import signals_deferred
from ..version import __version__

_PATIENCE = 5  # s: a scheduler has to answer within this time
_RESTART = 120  # s: Dask starts a dead worker of this machine again within this time, or never
_POLL = 0.02  # s: how often it is looked whether work is finished, or no worker is left
_USED = 0.8  # of the memory that a worker may take: beyond it Dask gives the worker no more work


@dataclass(frozen=True)
class Processes:
    """The processes that do the work, if not this one.

    Attributes
    ----------
    workers : int
        Processes that are started on this machine, with one thread each; 0 for none.
    scheduler : str
        Address of a running scheduler of Dask; "" for none.
    """

    workers: int = 0
    scheduler: str = ""


class Pool(Protocol):
    """Does work in some process.

    Iterating yields a pair (key, result) for every item as it is finished. Work can be added meanwhile.
    """

    def add(self, function: Callable[[Any, Any], Any], shared: Any, work: Iterable[tuple[Hashable, Any]]) -> None:
        """Add items, given with their keys; the result of one is function(shared, item).

        What was added last is done first. `shared` is sent to each process once.
        """

    def __iter__(self) -> Iterator[tuple[Any, Any]]: ...

    def has_room(self, needed: int) -> bool:
        """Return whether a process may take so many bytes."""


class Here:
    """Does all work in this process."""

    def __init__(self) -> None:
        self._left: list[tuple[Callable[[Any, Any], Any], Any, Iterator[tuple[Hashable, Any]]]] = []

    def add(self, function: Callable[[Any, Any], Any], shared: Any, work: Iterable[tuple[Hashable, Any]]) -> None:
        """Add items with their keys."""
        self._left.append((function, shared, iter(work)))

    def __iter__(self) -> Iterator[tuple[Any, Any]]:
        while self._left:
            function, shared, work = self._left[-1]
            found = next(work, None)
            if found is None:
                self._left.pop()
            else:
                yield found[0], function(shared, found[1])

    def has_room(self, needed: int) -> bool:
        """Return whether this process may take so many bytes; what is too much is refused where it is taken."""
        return True


class Cluster:
    """Does work in the processes of a cluster; if one dies, another one does its items.

    Parameters
    ----------
    distributed : module
    client : distributed.Client
    """

    def __init__(self, distributed: Any, client: Any) -> None:
        self._distributed, self._client = distributed, client
        self._keys: dict[Any, Hashable] = {}
        self._finished = distributed.as_completed()
        self._sent: dict[int, tuple[Any, Any]] = {}  # by identity: what is shared, and the future of its copies

    def add(self, function: Callable[[Any, Any], Any], shared: Any, work: Iterable[tuple[Hashable, Any]]) -> None:
        """Add items with their keys.

        Raises
        ------
        NotConvergedError
            The scheduler is gone.
        """
        with self._told():
            if id(shared) not in self._sent:
                # As the result of a task, not as data: the scheduler makes it again if all workers die. What Dask
                # warns of is that the scheduler keeps it for that.
                with warnings.catch_warnings():
                    warnings.filterwarnings("ignore", "Sending large graph", UserWarning)
                    sent = self._client.submit(_itself, shared, pure=False)
                self._client.replicate([sent])
                self._sent[id(shared)] = shared, sent
            sent, priority = self._sent[id(shared)][1], len(self._sent)
            for key, item in work:
                future = self._client.submit(function, sent, item, pure=False, retries=2, priority=priority)
                self._keys[future] = key
                self._finished.add(future)

    def __iter__(self) -> Iterator[tuple[Any, Any]]:
        while self._keys:
            with self._told():
                self._wait()
                future = next(self._finished)
                key, result = self._keys.pop(future), future.result()
                future.release()  # or workers would keep all results to the end
            yield key, result

    def _wait(self) -> None:
        """Return when some work is finished.

        Dask waits for ever if a worker dies before Dask has noted that it runs, and is therefore not started again.
        Processes of this machine do not come back from that. To a scheduler of the user's new ones may be added.
        """
        last = time.monotonic()
        while not self._finished.has_ready():
            if self._client.cluster is None or self._client.cluster.scheduler.workers:
                last = time.monotonic()
            elif time.monotonic() - last > _RESTART:
                raise NotConvergedError("all workers died, and Dask did not start them again")
            time.sleep(_POLL)

    def has_room(self, needed: int) -> bool:
        """Return whether every worker may take so many bytes."""
        workers = self._client.scheduler_info()["workers"].values()
        limits = [w.get("memory_limit") or float("inf") for w in workers]
        return needed <= _USED * min(limits, default=float("inf"))

    @contextmanager
    def _told(self) -> Iterator[None]:
        lost = self._distributed.client
        gone = (OSError, TimeoutError, self._distributed.core.CommClosedError, lost.CancelledError,
                lost.FuturesCancelledError)  # fmt: skip
        try:
            yield
        except gone as error:
            raise NotConvergedError(f"the scheduler is gone ({type(error).__name__})") from error
        except self._distributed.scheduler.KilledWorker as error:
            raise NotConvergedError(
                "several workers died one after the other at the same work, which may take more memory than they have;"
                " start fewer of them"
            ) from error


def _itself(shared: Any) -> Any:
    return shared


def require_processes(processes: Processes) -> None:
    """Check, before long work is done for them, that other processes can be had.

    Raises
    ------
    SceneError, NotConvergedError
        As `pool_of`; that workers can be started is seen when they are.
    """
    if processes.scheduler:
        with pool_of(processes):
            pass
    elif processes.workers:
        _distributed()


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise SceneError(
            "--workers and --scheduler need dask.distributed, which is not installed; expected"
            ' pip install "fe-squeal[cluster]"'
        ) from error
    return distributed


@contextmanager
def pool_of(processes: Processes | None) -> Iterator[Pool]:
    """Yield what does work in this process or in others.

    Raises
    ------
    SceneError
        Other processes are asked for, and dask.distributed is not installed, or what is given is no address.
    NotConvergedError
        The scheduler does not answer, is gone, or has workers without this version of the program.
    """
    if processes is None or not (processes.workers or processes.scheduler):
        yield Here()
        return
    distributed = _distributed()
    with _client(distributed, processes) as client:
        yield Cluster(distributed, client)


@contextmanager
def _client(distributed: Any, processes: Processes) -> Iterator[Any]:
    """Yield a client of the scheduler, or of processes that are started for the block and ended after it."""
    if processes.scheduler:
        try:
            client = distributed.Client(processes.scheduler, timeout=_PATIENCE)
        except ValueError as error:  # it cannot be taken apart
            raise SceneError(
                f"--scheduler: given {processes.scheduler}; expected an address such as tcp://10.0.0.5:8786"
                f" ({_told_by(error)})"
            ) from error
        except (ImportError, OSError, RuntimeError, TypeError) as error:  # by the kind of the address
            raise NotConvergedError(
                f"--scheduler: no scheduler of Dask answers at {processes.scheduler} ({_told_by(error)})"
            ) from error
        with client:
            _check_versions(client, processes.scheduler)
            yield client
        return
    settings = {"n_workers": processes.workers, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    # Dask serves HTTP even without a dashboard, by default at port 8787, which may be taken: any free port is used.
    free = {"dashboard_address": "127.0.0.1:0"}
    import dask

    with (
        tempfile.TemporaryDirectory(prefix="fe_squeal_", ignore_cleanup_errors=True) as scratch,
        # Profiles of what workers do would take more memory the longer they work.
        dask.config.set({"temporary-directory": scratch, "distributed.worker.profile.enabled": False}),
        isolated_children(),  # for as long as the cluster is there: Dask starts workers again that have died
        _quiet_asyncio(),
        ExitStack() as opened,
    ):
        with signals_deferred():  # a cluster that is only half there cannot be closed
            local = opened.enter_context(distributed.LocalCluster(**settings, scheduler_kwargs=free, silence_logs=50))
            client = opened.enter_context(distributed.Client(local))
        yield client


def _check_versions(client: Any, address: str) -> None:
    """Check that this version is on all workers: one without it would die of its first task unnoticed.

    Raises
    ------
    NotConvergedError
        It is not, or the scheduler cannot read what it is sent.
    """
    try:
        client.wait_for_workers(1)
        found = {*client.run(_version).values(), client.submit(_version, pure=False).result()}
    except Exception as error:  # of any class: it was raised there
        found = {_told_by(error)}
    if found != {__version__}:
        raise NotConvergedError(
            f"--scheduler: given {address}; expected fe-squeal {__version__} on the scheduler there and all its"
            f" workers, found {', '.join(sorted(found - {__version__}))}"
        )


def _version() -> str:
    return __version__


def _told_by(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


@contextmanager
def _quiet_asyncio() -> Iterator[None]:
    """Keep errors of Dask's own tasks, which lose their workers when a study is interrupted, from the terminal."""
    logger = logging.getLogger("asyncio")
    level = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        gc.collect()  # a task tells what became of it when it is collected
        logger.setLevel(level)

