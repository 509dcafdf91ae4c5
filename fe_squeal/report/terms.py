"""Names of the terms of a problem, as the column `term` of contributions.csv has them: KIND.PART."""

from __future__ import annotations

from dataclasses import dataclass

MASS, ELASTIC = "mass", "elastic"  # kinds of which every body has a term; the others are effects, contacts and springs


@dataclass(frozen=True)
class TermName:
    """The name of a term.

    Attributes
    ----------
    kind : str
        What acts: "mass", "elastic", "contact", "spring" or the name of an effect.
    part : str
        Where: a body, contact or spring; "" where the whole problem has one term of that kind.
    """

    kind: str
    part: str

    def __str__(self) -> str:
        """Return the name as tables have it."""
        return f"{self.kind}.{self.part}" if self.part else self.kind


def term_of(name: object) -> TermName:
    """Take a name apart; what is behind the first dot is the part, dots in it included.

    Examples
    --------
    >>> term_of("friction.pad.left")
    TermName(kind='friction', part='pad.left')
    >>> str(term_of("other"))
    'other'
    """
    kind, _, part = str(name).partition(".")
    return TermName(kind, part)
