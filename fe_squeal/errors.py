"""One exception family: what the user can mend, and what did not converge."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

INTERRUPTED = 130  # what the command returns where the user stopped it
_LIKE = 0.66  # of difflib: "EE" is like "E", "rotation" is not like "friction"
_MOST = 100  # names in one message: more than any table has keys


class SquealError(Exception):
    """Base of every error this package raises on purpose; `exit_code` is what the command returns."""

    exit_code = 1


class SceneWarning(UserWarning):
    """Something of a scene looks doubtful, and is simulated as it is."""


class InputError(SquealError):
    """Bad input. The message names the file and key, what was given and what is expected."""

    exit_code = 2


class SceneError(InputError):
    """The scene file, or an object built from it, is wrong."""


class MeshError(InputError):
    """The mesh file, or a geometry to be meshed, is wrong."""


class OutputError(InputError):
    """The results cannot be written where the user wants them."""


class TooLargeError(InputError):
    """The problem does not fit into the memory of this machine."""


class NotConvergedError(SquealError):
    """A solver stopped short; `partial` carries what did converge (None if nothing did)."""

    exit_code = 3

    def __init__(self, message: str, partial: object = None) -> None:
        super().__init__(message)
        self.partial = partial


def one_line(text: str) -> str:
    r"""Return a message in which control characters, of file and group names, are spelled out.

    Examples
    --------
    >>> print(one_line("no group \x1b[2Jpad\n, é"))
    no group \x1b[2Jpad\n, é
    """
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def suggest(name: str, valid: Iterable[str]) -> str:
    """Return the tail of a message about an unknown name: the nearest valid one, or all where none is nearest.

    Examples
    --------
    >>> suggest("pad_facee", ["pad_face", "disc_face"])
    '; did you mean "pad_face"?'
    >>> suggest("hub", ["pad_face", "disc_face"])
    '; valid: disc_face, pad_face'
    >>> suggest("bottom", ["bottom_1", "bottom_2", "top_1"])
    '; valid: bottom_1, bottom_2, top_1'
    """
    names = sorted(set(valid))
    nearest = nearest_name(name, names)
    if nearest is not None:
        return f'; did you mean "{nearest}"?'
    if not names:
        return "; there are none"
    shown = ", ".join(names[:_MOST]) + (f" and {len(names) - _MOST} more" if len(names) > _MOST else "")
    return f"; valid: {shown}"


def nearest_name(name: str, valid: Iterable[str]) -> str | None:
    """Return the name that the given one is probably a misspelling of; None where none is close, or two are alike."""
    close = difflib.get_close_matches(name, list(valid), n=2, cutoff=_LIKE)
    likeness = [difflib.SequenceMatcher(None, other, name).ratio() for other in close]
    return None if not close or likeness[1:] == likeness[:1] else close[0]
