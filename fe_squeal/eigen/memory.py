"""How much memory there is, and the refusal of what needs more."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import psutil

from ..errors import TooLargeError

_GROUP = Path("/sys/fs/cgroup")  # Linux: of the container that this process runs in
_GROWTH = 3 / 4  # exponent of the unknowns of a solid over the memory of its factors


def available_memory() -> int:
    """Return the bytes that this process may still take: of the machine, of its container and of its own limits."""
    free = [int(psutil.virtual_memory().available)]
    with suppress(OSError, ValueError):  # no such files, or no limit ("max")
        limit, used = (int((_GROUP / f"memory.{name}").read_text()) for name in ("max", "current"))
        free.append(limit - used)
    with suppress(AttributeError):  # not on every system
        process = psutil.Process()
        limit = int(process.rlimit(psutil.RLIMIT_AS)[0])
        if limit != psutil.RLIM_INFINITY:
            free.append(limit - int(process.memory_info().vms))
    return max(min(free), 0)


def require_memory(needed: int, unknowns: int) -> None:
    """Refuse factors that cannot fit.

    Raises
    ------
    TooLargeError
        With what is needed, what there is and what would fit.
    """
    free = available_memory()
    if needed > free:
        fits = int(unknowns * (free / needed) ** _GROWTH)
        raise TooLargeError(
            f"the factors of {unknowns} unknowns need {memory_text(needed)} of memory, {memory_text(free)} are free;"
            f" about {float(f'{fits:.1g}'):.0f} unknowns would fit: take a larger mesh size or order = 1"
        )


def memory_text(size: float) -> str:
    """Return a size in bytes for people.

    Examples
    --------
    >>> memory_text(3 * 2**30), memory_text(2**29)
    ('3 GiB', '512 MiB')
    """
    return f"{size / 2**30:.3g} GiB" if size >= 2**30 else f"{size / 2**20:.3g} MiB"
