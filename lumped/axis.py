"""A parameter of a model that is swept, and the spectra over it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from .model import LumpedModel
from .spectrum import Spectrum, mass_normalized, solve_spectrum
from .springs import Floats


@dataclass(frozen=True)
class Axis:
    """A parameter that is swept: the fields of the model it sets (`mu` for friction), its unit and its values."""

    names: tuple[str, ...]
    unit: str
    values: Floats

    @property
    def name(self) -> str:
        """Name of the column in the tables."""
        return self.names[0] if len(self.names) == 1 else f"{self.names[0]}_{self.names[-1]}"


def axis_of(model: LumpedModel, names: str | Sequence[str], values: Sequence[float] | Floats) -> Axis:
    """Return the axis of a parameter, with the unit that the model gives it.

    Examples
    --------
    >>> from lumped import TwoMass
    >>> axis_of(TwoMass(), "ky", [5, 100]).unit
    'N/m'
    """
    given = (names,) if isinstance(names, str) else tuple(names)
    units = {f.name: f.metadata["unit"] for f in fields(model)}
    return Axis(given, "" if given == ("mu",) else units[given[0]], np.asarray(values, dtype=float))


def solve_stack(model: LumpedModel, names: Sequence[str], values: Floats, mu: float) -> Spectrum:
    """Solve for the spectra of a model at each value of a parameter, in one call of the eigen-solver.

    Examples
    --------
    >>> from lumped import Minimal
    >>> solve_stack(Minimal(), ("k2",), np.array([5.0, 20.0]), mu=0.5).unstable.tolist()
    [False, True]
    """
    if tuple(names) == ("mu",):
        return model.spectrum(values)
    models = [replace(model, **dict.fromkeys(names, float(v))) for v in values]
    M, C, K = model.M, [m.C for m in models], [m.K(mu) for m in models]
    if any((m.M != M).any() for m in models):  # the parameter is a mass
        C, K = ([mass_normalized(m.M, X) for m, X in zip(models, Xs, strict=True)] for Xs in (C, K))
        M = np.eye(len(M))
    return solve_spectrum(M, np.stack(C), np.stack(K))
