"""What is printed never decides over what is computed: streams that take every character, and survive their end."""

from __future__ import annotations

import codecs
import errno
import os
import sys
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO

_PLAIN = {
    "μ": "mu", "µ": "mu", "λ": "lambda", "σ": "sigma", "θ": "theta", "φ": "phi", "ω": "omega", "Δ": "Delta",
    "±": "+-", "−": "-", "–": "-", "×": "x", "·": "*", "≤": "<=", "≥": ">=", "√": "sqrt", "…": "...", "°": "deg",
}  # fmt: skip
_HANDLER = "fe_squeal.plain"


def plain(text: str) -> str:
    """Return a text in ASCII: names of Greek letters, letters without their accents, "?" for what has no such name.

    Examples
    --------
    >>> plain("μ = 0.4 ± 0.1, |λ|², Bremsträger, 摩")
    'mu = 0.4 +- 0.1, |lambda|2, Bremstrager, ?'
    """
    found = []
    for c in text:
        simple = _PLAIN.get(c) or unicodedata.normalize("NFKD", c).encode("ascii", "ignore").decode()
        found.append(c if c.isascii() else simple or "?")
    return "".join(found)


def _replace(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return plain(error.object[error.start : error.end]), error.end


codecs.register_error(_HANDLER, _replace)


class LastingStream:
    """A text stream that takes everything, whether or not somebody still reads it.

    Attributes
    ----------
    failure : OSError or None
        Why something was lost; a reader that went on purpose (`| head -1`) is no failure.
    used : bool
        Whether anything was written.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._lost = False
        self.failure: OSError | None = None
        self.used = False
        with suppress(AttributeError, ValueError):
            stream.reconfigure(errors=_HANDLER)  # type: ignore[attr-defined]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write, or do nothing where that has failed before."""
        self.used = True
        if not self._lost:
            try:
                self._stream.write(text)
            except (OSError, ValueError) as error:
                self._lose(error)
        return len(text)

    def flush(self) -> None:
        """Flush, or do nothing where that has failed before."""
        if not self._lost:
            try:
                self._stream.flush()
            except (OSError, ValueError) as error:
                self._lose(error)

    def _lose(self, error: OSError | ValueError) -> None:
        self._lost = True
        if isinstance(error, OSError) and error.errno not in (errno.EPIPE, errno.EBADF):
            self.failure = error
        # What is left in the buffer would fail once more when Python ends; it goes nowhere instead.
        with suppress(OSError, ValueError, AttributeError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)


@contextmanager
def lasting_streams() -> Iterator[tuple[LastingStream, LastingStream]]:
    """Put lasting streams in the place of stdout and stderr inside the block."""
    _occupy_closed()
    before = sys.stdout, sys.stderr
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        out, err = (LastingStream(stream or nowhere) for stream in before)
        sys.stdout, sys.stderr = out, err
        try:
            yield out, err
        finally:
            out.flush()
            err.flush()
            sys.stdout, sys.stderr = before


def _occupy_closed() -> None:
    """Open standard streams that are closed: else the next file takes their place, and libraries print into it."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
