"""One exception family: what the user can mend, and what did not converge."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class SquealError(Exception):
    """Base of every error this package raises on purpose; `exit_code` is what the command returns."""

    exit_code = 1


class InputError(SquealError):
    """Bad input. The message names the file and key, what was given and what is expected."""

    exit_code = 2


class SceneError(InputError):
    """The scene file, or an object built from it, is wrong."""


class MeshError(InputError):
    """The mesh file, or a geometry to be meshed, is wrong."""


class OutputError(InputError):
    """The results cannot be written where the user wants them."""


class NotConvergedError(SquealError):
    """A solver stopped short; `partial` carries what did converge (None if nothing did)."""

    exit_code = 3

    def __init__(self, message: str, partial: object = None) -> None:
        super().__init__(message)
        self.partial = partial


def suggest(name: str, valid: Iterable[str]) -> str:
    """Return the tail of a message about an unknown name: the nearest valid one, or all of them.

    Examples
    --------
    >>> suggest("pad_facee", ["pad_face", "disc_face"])
    '; did you mean "pad_face"?'
    >>> suggest("hub", ["pad_face", "disc_face"])
    '; valid: disc_face, pad_face'
    """
    names = sorted(valid)
    close = difflib.get_close_matches(name, names, n=1)
    if close:
        return f'; did you mean "{close[0]}"?'
    if not names:
        return "; there are none"
    shown = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    return f"; valid: {shown}"
