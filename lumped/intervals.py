"""The intervals of a parameter in which a model is unstable."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .axis import Axis, solve_stack
from .following import Follower
from .model import LumpedModel
from .spectrum import Complexes, Spectrum


def find_unstable_intervals(
    model: LumpedModel, axis: Axis, mu: float, unstable: NDArray[np.bool_] | None = None
) -> tuple[tuple[float, float], ...]:
    """Find the intervals of a parameter in which a model is unstable.

    A window narrower than the axis' step may be missed.
    Each end is bisected on the stability, and the motion that turns there is followed to where it surely grows and
    surely does not: between these is the end.

    Parameters
    ----------
    model : LumpedModel
    axis : Axis
        Its values are the ones first looked at.
    mu : float
        Ignored where the axis is friction itself.
    unstable : array of bool, optional
        At these values, if known.

    Examples
    --------
    >>> from lumped import TwoMass
    >>> from lumped.axis import axis_of
    >>> axis = axis_of(TwoMass(), "k1x", np.linspace(5, 50, 46))
    >>> [[round(end, 10) for end in interval] for interval in find_unstable_intervals(TwoMass(), axis, 0.4)]
    [[5.0, 13.8862067739]]
    """
    if unstable is None:
        unstable = solve_stack(model, axis.names, axis.values, mu).unstable
    path = _Path(model, axis, mu)
    follower = Follower(path, float(axis.values.min()), float(axis.values.max()))
    edges = [float(axis.values[0])] if unstable[0] else []
    for i in np.flatnonzero(unstable[1:] != unstable[:-1]):
        ends = float(axis.values[i]), float(axis.values[i + 1])
        edges.append(_refine_edge(path, follower, *ends, bool(unstable[i])))
    if unstable[-1]:
        edges.append(float(axis.values[-1]))
    return tuple(zip(edges[::2], edges[1::2], strict=True))


class _Path:
    """A model over one of its parameters."""

    def __init__(self, model: LumpedModel, axis: Axis, mu: float) -> None:
        self.model, self.names, self.mu = model, axis.names, mu
        self.undamped = not any(self._at(float(p))[0].C.any() for p in axis.values[[0, -1]])

    def eigenvalues(self, p: float) -> Complexes:
        model, mu = self._at(p)
        return model.eigenvalues(mu)

    def spectrum(self, p: float) -> Spectrum:
        model, mu = self._at(p)
        return model.spectrum(mu)

    def _at(self, p: float) -> tuple[LumpedModel, float]:
        if self.names == ("mu",):
            return self.model, p
        return replace(self.model, **dict.fromkeys(self.names, p)), self.mu


def _refine_edge(path: _Path, follower: Follower, low: float, high: float, unstable_low: bool) -> float:
    """Bisect on stability, then follow the motion that turns there to both sides."""
    while low < (middle := (low + high) / 2) < high:
        if bool(path.spectrum(middle).unstable) == unstable_low:
            low = middle
        else:
            high = middle
    inside = low if unstable_low else high
    spectrum = path.spectrum(inside)
    excess = np.where(spectrum.lam.imag >= 0, spectrum.lam.real - spectrum.uncertainty, -np.inf)
    lam = complex(spectrum.lam[np.where(excess > 0, excess, np.inf).argmin()])
    passage = follower.settle(inside, 1j * lam.imag if path.undamped else lam)
    return passage.mu if passage.is_crossing else inside
