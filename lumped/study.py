"""What a study is, and the helpers with which the studies are written down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .axis import axis_of
from .model import LumpedModel
from .results import Case, Curves, Grid, Responses, Surface, Table, solve_curves

Result = Curves | Surface | Responses | Grid | Table


@dataclass(frozen=True)
class Notes:
    """What the figure shows, what follows for a designer, and what of the source the equations contradict."""

    see: str
    follows: str
    contradicts: str = ""


@dataclass(frozen=True)
class Study:
    """One study of the source document.

    Attributes
    ----------
    name : str
        As in the command line.
    section : str
        Of the source document; empty for an addition.
    title : str
    compute : callable
        Without arguments, returns arrays.
    notes : callable
        From the result to its notes, numbers included.
    spatial : bool
        Whether curves over one parameter are also drawn in (parameter, |ω|, σ).
    """

    name: str
    section: str
    title: str
    compute: Callable[[], Result]
    notes: Callable[[Result], Notes]
    spatial: bool = False


def static(notes: Notes) -> Callable[[Result], Notes]:
    """Return notes that do not depend on the result."""
    return lambda _: notes


def of_curves(write: Callable[[Curves], Notes]) -> Callable[[Result], Notes]:
    """Let a function of curves stand for a function of any result."""

    def notes(result: Result) -> Notes:
        assert isinstance(result, Curves)
        return write(result)

    return notes


def solve_curve(model: LumpedModel, names: str | tuple[str, ...], low: float, high: float, mu: float, n: int) -> Curves:
    """Sweep one parameter of one model over n equal steps."""
    return solve_curves(axis_of(model, names, np.linspace(low, high, n + 1)), {(model.name, model.name): (model, mu)})


def intervals(case: Case, digits: int = 5) -> str:
    """Return the unstable intervals of a case in words.

    Examples
    --------
    >>> import numpy as np
    >>> intervals(Case("a", "a", np.zeros((2, 1), complex), np.zeros((2, 1)), ((10.0, 26.5800719),)))
    '10 to 26.58'
    """
    if not case.unstable:
        return "nowhere"
    return ", ".join(f"{a:.{digits}g} to {b:.{digits}g}" for a, b in case.unstable)
