"""Names of the terms of a problem, as in the column `term` of contributions.csv: KIND.PART."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from fe_squeal.report.branches import Bools

MASS, ELASTIC = "mass", "elastic"  # kinds that every body has a term of; others belong to effects, contacts, springs


@dataclass(frozen=True)
class TermName:
    """The name of a term.

    Attributes
    ----------
    kind : str
        What acts: "mass", "elastic", "contact", "spring" or the name of an effect.
    part : str
        The body, contact or spring that it belongs to; "" if the whole problem has one term of this kind.
    """

    kind: str
    part: str

    def __str__(self) -> str:
        """Return the name as it is in tables."""
        return f"{self.kind}.{self.part}" if self.part else self.kind


def term_of(name: object) -> TermName:
    """Return the kind and the part of a term from its name; the part is everything behind the first dot.

    Examples
    --------
    >>> term_of("friction.pad.left")
    TermName(kind='friction', part='pad.left')
    >>> str(term_of("other"))
    'other'
    """
    kind, _, part = str(name).partition(".")
    return TermName(kind, part)


def is_kinetic(contributions: pd.DataFrame) -> Bools:
    """Return (n,) bool, of which rows of contributions.csv the share is one of the kinetic energy.

    Tables of earlier versions have no column `energy`; there the masses of bodies are known by their names.

    Examples
    --------
    >>> is_kinetic(pd.DataFrame({"term": ["mass.disc", "elastic.disc"]})).tolist()
    [True, False]
    """
    if "energy" in contributions:
        return (contributions["energy"] == "kinetic").to_numpy(bool)
    return np.array([term_of(name).kind == MASS for name in contributions.get("term", ())], dtype=bool)
