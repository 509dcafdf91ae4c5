"""Forms of commands that only CDWRITE writes into Ansys archives."""

from __future__ import annotations


def is_release(field: str) -> bool:
    """Return whether a field says how CDWRITE wrote a command: the number of a release, such as R5.0, or UNBL."""
    return field == "UNBL" or (field[:1] == "R" and field[1:2].isdigit())
