"""The discretisation that a problem comes from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..effects.static_state import StaticState
from ..fem.contact import ContactOperators
from ..fem.spaces import DisplacementSpace
from ..problem.problem import Problem


@dataclass(frozen=True)
class Discretisation:
    """Where the terms of a problem come from: the discretisation, for shapes and reports.

    Attributes
    ----------
    space : DisplacementSpace
    bodies : mapping of body to (e,) int elements
    contacts : mapping of contact to its operators
    notes, warnings : what was converted or looks doubtful, a sentence each
    static_state : StaticState or None
        The static state under preload.
    """

    space: DisplacementSpace
    bodies: Mapping[str, np.ndarray]
    contacts: Mapping[str, ContactOperators]
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    static_state: StaticState | None = None


def discretisation_of(problem: Problem) -> Discretisation | None:
    """Return the discretisation of a problem; None of one of matrices."""
    return problem.discretisation if isinstance(problem.discretisation, Discretisation) else None
