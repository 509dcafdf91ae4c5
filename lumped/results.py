"""What a study computes: curves over one parameter, surfaces over two, time responses, and maps of μ_c."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from .axis import Axis, solve_stack
from .intervals import find_unstable_intervals
from .model import LumpedModel
from .spectrum import Complexes, Spectrum
from .springs import Floats


@dataclass(frozen=True)
class Case:
    """The eigenvalues of one model over a parameter.

    Attributes
    ----------
    label, panel : str
        What it is, and the column of the figure it is drawn in.
    lam : (p, n) complex, rad/s
        The eigenvalues with Im λ ≥ 0, each column followed from one value of the parameter to the next.
    uncertainty : (p, n) float, rad/s
    unstable : tuple of (float, float)
        The intervals of the parameter in which an eigenvalue grows.
    """

    label: str
    panel: str
    lam: Complexes
    uncertainty: Floats
    unstable: tuple[tuple[float, float], ...]

    @property
    def growth(self) -> Floats:
        """Largest Re λ at each value, rad/s."""
        return np.asarray(self.lam.real.max(1))


@dataclass(frozen=True)
class Curves:
    """Eigenvalues over one parameter, for one or more cases."""

    axis: Axis
    cases: tuple[Case, ...]


@dataclass(frozen=True)
class Surface:
    """Largest Re λ over two parameters: `growth[case]` is (len(y), len(x)), rad/s, and `critical_mu[case]` the lowest
    critical μ at each y, infinite where there is none."""

    x: Axis
    y: Axis
    labels: tuple[str, ...]
    growth: tuple[Floats, ...]
    critical_mu: tuple[Floats, ...]


@dataclass(frozen=True)
class Responses:
    """Free motions q(t): `motion[case]` is (k, n), m; `rates[case]` the largest Re λ, rad/s."""

    times: Floats
    coordinates: tuple[str, ...]
    labels: tuple[str, ...]
    mu: tuple[float, ...]
    rates: tuple[float, ...]
    motion: tuple[Floats, ...]


@dataclass(frozen=True)
class Grid:
    """A quantity over a full grid of parameters; infinite where there is none."""

    axes: tuple[Axis, ...]
    quantity: str
    values: Floats


@dataclass(frozen=True)
class Table:
    """Rows for the noise map: a few columns of numbers and words."""

    columns: tuple[str, ...]
    rows: tuple[tuple[float | str, ...], ...]


def solve_curves(axis: Axis, cases: Mapping[tuple[str, str], tuple[LumpedModel, float]]) -> Curves:
    """Compute the eigenvalues of one or more models over a parameter.

    Parameters
    ----------
    axis : Axis
    cases : mapping
        From (label, panel) to the model and its friction coefficient.

    Examples
    --------
    >>> from lumped import Minimal
    >>> from lumped.axis import axis_of
    >>> model = Minimal()
    >>> result = solve_curves(axis_of(model, "k2", np.linspace(0, 50, 101)), {("base", "base"): (model, 0.5)})
    >>> [[round(end, 9) for end in interval] for interval in result.cases[0].unstable]
    [[10.0, 26.580071928]]
    """
    done = []
    for (label, panel), (model, mu) in cases.items():
        spectrum = solve_stack(model, axis.names, axis.values, mu)
        lam, uncertainty = _upper_half(spectrum)
        unstable = find_unstable_intervals(model, axis, mu, spectrum.unstable)
        done.append(Case(label, panel, *_follow(lam, uncertainty), unstable))
    return Curves(axis, tuple(done))


def surface(x: Axis, y: Axis, cases: Mapping[str, LumpedModel]) -> Surface:
    """Compute the largest Re λ over two parameters, of which `x` is the friction coefficient.

    Examples
    --------
    >>> from lumped import Minimal
    >>> from lumped.axis import axis_of
    >>> model = Minimal()
    >>> result = surface(axis_of(model, "mu", [0.0, 0.5]), axis_of(model, "k2", [5.0, 20.0]), {"base": model})
    >>> result.growth[0].round(6).tolist()
    [[0.0, 0.0], [0.0, 0.399788]]
    """
    growth, onset = [], []
    for model in cases.values():
        models = [replace(model, **dict.fromkeys(y.names, float(v))) for v in y.values]
        growth.append(np.stack([m.eigenvalues(x.values).real.max(-1) for m in models]))
        onset.append(np.array([min(m.critical_mu(), default=np.inf) for m in models]))
    return Surface(x, y, tuple(cases), tuple(growth), tuple(onset))


def responses(model: LumpedModel, x0: Sequence[float], times: Floats, mu: Mapping[str, float]) -> Responses:
    """Compute the free motions from rest at x0, for each labelled friction coefficient."""
    v0 = np.zeros(len(model.coordinates))
    motion = tuple(model.response(x0, v0, times, value) for value in mu.values())
    rates = tuple(float(model.spectrum(value).growth) for value in mu.values())
    return Responses(times, model.coordinates, tuple(mu), tuple(mu.values()), rates, motion)


def _upper_half(spectrum: Spectrum) -> tuple[Complexes, Floats]:
    """Return the n eigenvalues of highest Im λ: one of each conjugate pair."""
    n = spectrum.lam.shape[-1] // 2
    return spectrum.lam[..., n:], spectrum.uncertainty[..., n:]


def _follow(lam: Complexes, uncertainty: Floats) -> tuple[Complexes, Floats]:
    """Order each row so that a column continues, by the least total distance from a linear prediction."""
    lam, uncertainty = lam.copy(), uncertainty.copy()
    for p in range(1, len(lam)):
        expected = lam[p - 1] if p == 1 else 2 * lam[p - 1] - lam[p - 2]
        _, order = linear_sum_assignment(np.abs(expected[:, None] - lam[p]))
        lam[p], uncertainty[p] = lam[p, order], uncertainty[p, order]
    return lam, uncertainty
