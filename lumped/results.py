"""What a study computes: curves over one parameter, surfaces over two, time responses, and maps of μ_c."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, linear_sum_assignment

from .model import LumpedModel
from .spectrum import Complexes, Spectrum, mass_normalized, solve_spectrum
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
    return solve_spectrum(model.M, np.stack([m.C for m in models]), np.stack([m.K(mu) for m in models]))


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


def find_unstable_intervals(
    model: LumpedModel, axis: Axis, mu: float, unstable: NDArray[np.bool_] | None = None
) -> tuple[tuple[float, float], ...]:
    """Find the intervals of a parameter in which a model is unstable.

    A window narrower than the axis' step may be missed.
    Each end is bisected on the stability until one crossing is left and then refined: undamped on the discriminant
    Π (θi − θj)², which has a simple zero where two frequencies merge; damped on max Re λ.

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
    >>> axis = axis_of(TwoMass(), "k1x", np.linspace(5, 50, 46))
    >>> [[round(end, 10) for end in interval] for interval in find_unstable_intervals(TwoMass(), axis, 0.4)]
    [[5.0, 13.8862067739]]
    """
    if unstable is None:
        unstable = solve_stack(model, axis.names, axis.values, mu).unstable
    edges = [float(axis.values[0])] if unstable[0] else []
    for i in np.flatnonzero(unstable[1:] != unstable[:-1]):
        edges.append(_refine_edge(model, axis, mu, float(axis.values[i]), float(axis.values[i + 1]), bool(unstable[i])))
    if unstable[-1]:
        edges.append(float(axis.values[-1]))
    return tuple(zip(edges[::2], edges[1::2], strict=True))


def _refine_edge(model: LumpedModel, axis: Axis, mu: float, low: float, high: float, unstable_low: bool) -> float:
    def spectrum(p: float) -> Spectrum:
        return solve_stack(model, axis.names, np.array([p]), mu)

    measure = _crossing_measure(model, axis, mu)
    tolerance = 4 * np.finfo(float).eps * max(abs(low), abs(high))
    for _ in range(60):
        f_low, f_high = measure(low), measure(high)
        if f_low * f_high < 0 and high - low < 1e-3 * (1 + abs(low)):
            return float(brentq(measure, low, high, xtol=tolerance, rtol=4 * np.finfo(float).eps))
        if f_low == 0 or f_high == 0 or high - low <= tolerance:
            return low if f_low == 0 else high
        middle = (low + high) / 2
        if bool(spectrum(middle).unstable[0]) == unstable_low:
            low = middle
        else:
            high = middle
    return (low + high) / 2


def _crossing_measure(model: LumpedModel, axis: Axis, mu: float) -> Callable[[float], float]:
    """Return the function of the parameter that changes sign where stability does."""

    def at(p: float) -> tuple[LumpedModel, float]:
        if axis.names == ("mu",):
            return model, p
        return replace(model, **dict.fromkeys(axis.names, p)), mu

    def growth(p: float) -> float:
        other, friction = at(p)
        return float(other.eigenvalues(friction).real.max())

    def discriminant(p: float) -> float:
        other, friction = at(p)
        theta = np.linalg.eigvals(mass_normalized(other.M, other.K(friction))).astype(complex)
        i, j = np.triu_indices(len(theta), 1)
        return float(np.prod(((theta[i] - theta[j]) / np.abs(theta).max()) ** 2).real)

    damped = any(at(float(p))[0].C.any() for p in axis.values[[0, -1]])
    return growth if damped else discriminant


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
