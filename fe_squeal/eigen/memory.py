"""How much memory there is, and the refusal of what needs more."""

from __future__ import annotations

import ctypes
import functools
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import cast

import numpy as np
import psutil
import scipy.linalg as la

from ..errors import SquealError, TooLargeError

# Linux: the control groups of the container, job or service that this process runs in, and which of them are its own.
_GROUP, _MEMBER = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")
# Files of a group's limit and of what it takes, and the line of the files' memory that it gives up: versions 2 and 1.
_LIMITS = {
    2: ("memory.max", "memory.current", "inactive_file"),
    1: ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
}
_GROWTH = 3 / 4  # exponent of the unknowns of a solid over the memory of its factors
_BUFFERS = 2**26  # bytes: more than OpenBLAS takes for its working memory, which it does once
_SMALLER = "take a larger mesh size or order = 1"


def available_memory() -> int:
    """Return the bytes that this process may still take: of the machine, of its groups and of its own limits."""
    free = [int(psutil.virtual_memory().available)]
    for folder, version in _groups():
        limit_file, used_file, unused = _LIMITS[version]
        with suppress(OSError, ValueError):  # no such files, or no limit ("max")
            limit, used = (int((folder / name).read_text()) for name in (limit_file, used_file))
            free.append(limit - used + _reclaimable(folder, unused))
    with suppress(AttributeError):  # not every system has these
        process = psutil.Process()
        limit = int(process.rlimit(psutil.RLIMIT_AS)[0])
        if limit != psutil.RLIM_INFINITY:
            free.append(limit - int(process.memory_info().vms))
    return max(min(free), 0)


def _groups() -> Iterator[tuple[Path, int]]:
    """Yield the folders of the groups that limit this process's memory, and their version: its own and all around."""
    yield _GROUP, 2
    lines = []
    with suppress(OSError):
        lines = _MEMBER.read_text(errors="surrogateescape").splitlines()
    for line in lines:
        _, controllers, path = [*line.split(":", 2), "", ""][:3]
        if controllers and "memory" not in controllers.split(","):
            continue
        folder, version = (_GROUP / "memory", 1) if controllers else (_GROUP, 2)
        yield folder, version
        for name in path.strip("/").split("/"):
            if name == "..":  # of a group outside of what can be seen from here
                break
            folder /= name
            yield folder, version


def _reclaimable(folder: Path, name: str) -> int:
    """Return the bytes of files that a group's memory holds, unused: the system gives them up when asked."""
    with suppress(OSError, ValueError):
        known = dict(line.split() for line in (folder / "memory.stat").read_text().splitlines())
        return int(known.get(name, 0))
    return 0


def release_freed() -> None:
    """Give back to the system what the allocator keeps of freed memory, where it does so when asked (glibc)."""
    trim = _trim()
    if trim is not None:
        trim(0)


@functools.cache
def _trim() -> Callable[[int], int] | None:
    if not sys.platform.startswith("linux"):
        return None
    with suppress(OSError, AttributeError):  # not every C library of Linux has it
        return cast(Callable[[int], int], ctypes.CDLL(None).malloc_trim)
    return None


def peak_memory_mib() -> float | None:
    """Return the largest resident memory of this process so far, MiB; None where the system does not tell."""
    with suppress(OSError, ValueError, IndexError):
        # What getrusage tells on Linux begins with the memory of the process that started this one.
        status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
        return float(status.split("VmHWM:")[1].split()[0]) / 1024
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(peak) / (1024**2 if sys.platform == "darwin" else 1024)


def require_memory(needed: int, unknowns: int, what: str = "factors", exponent: float = _GROWTH) -> None:
    """Refuse factors that cannot fit.

    Parameters
    ----------
    needed : int, bytes
    what : str
        What takes the memory, for the message.
    exponent : float
        The unknowns that fit grow with the memory to this power.

    Raises
    ------
    TooLargeError
        With what is needed, what there is and what would fit.
    """
    free = available_memory()
    if needed > free:
        raise _too_large(f"the {what} of {unknowns} unknowns need {memory_text(needed)} of memory", needed, free,
                         unknowns, exponent)  # fmt: skip


def require_vectors(unknowns: int, vectors: int, bytes_per_number: int, part: float = 1.0) -> None:
    """Refuse modes whose vectors cannot fit.

    Parameters
    ----------
    part : float
        Of the vectors, which this machine's processes hold where vectors are spread over several machines.

    Raises
    ------
    TooLargeError
    """
    needed, free = part * unknowns * vectors * bytes_per_number, available_memory()
    if needed > free:
        here = " on this machine" if part < 1 else ""
        raise TooLargeError(
            f"the {vectors} vectors that the modes of {unknowns} unknowns ask for need {memory_text(needed)} of memory"
            f"{here}, {memory_text(free)} are free; ask for fewer modes, or {_SMALLER}"
        )


@contextmanager
def refuse_shortage(
    what: str, unknowns: int | None = None, needed: Callable[[], int] = lambda: 0, cure: str = ""
) -> Iterator[None]:
    """Turn a MemoryError inside the block into a refusal.

    Parameters
    ----------
    what : str
        "the assembly", ...
    unknowns : int, optional
        How many there are.
    needed : callable, optional
        Predicts the bytes that the whole takes; called when what the block had taken is free again.
    cure : str
        What else helps.

    Raises
    ------
    TooLargeError
        With what there was, and as far as it is known what is needed and what would fit.
    """
    free = available_memory()
    short = f"{what} needs more memory than the {memory_text(free)} that are free; {_SMALLER}"
    if free < _BUFFERS:
        raise TooLargeError(short)
    _claim_buffers()
    free = available_memory()
    try:
        yield
        return
    except MemoryError as error:
        traceback.clear_frames(error.__traceback__)  # which hold what the block had taken
    total = 0
    with suppress(MemoryError, SquealError):
        total = needed()
    if unknowns is None:
        text = short
    elif total > free:
        need = f"{what} of {unknowns} unknowns needs about {memory_text(total)} of memory"
        text = str(_too_large(need, total, free, unknowns, _GROWTH))
    else:
        text = (
            f"{what} of {unknowns} unknowns needs more memory than the {memory_text(free)} that are free; fewer"
            f" unknowns than these would fit: {_SMALLER}"
        )
    raise TooLargeError(text + cure)


def _claim_buffers() -> None:
    """Make NumPy's and SciPy's OpenBLAS take their working memory now.

    Where there is none left when they first need it, they end the process instead of raising an exception.
    """
    small = np.eye(64)
    la.lu_factor(small @ small)


def _too_large(need: str, needed: int, free: int, unknowns: int, exponent: float) -> TooLargeError:
    fits = int(unknowns * (free / needed) ** exponent)
    return TooLargeError(
        f"{need}, {memory_text(free)} are free; about {float(f'{fits:.1g}'):.0f} unknowns would fit: {_SMALLER}"
    )


def memory_text(size: float) -> str:
    """Return a size in bytes for people.

    Examples
    --------
    >>> memory_text(3 * 2**30), memory_text(2**29)
    ('3 GiB', '512 MiB')
    """
    return f"{size / 2**30:.3g} GiB" if size >= 2**30 else f"{size / 2**20:.3g} MiB"
