"""Studies of the minimal model: each at the source's base values, which are degenerate, and at k2 = 20 N/m."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..axis import Axis, axis_of
from ..models import Minimal, critical_friction
from ..results import Curves, Grid, Responses, Surface, responses, solve_curves, surface
from ..study import Notes, Result, Study, intervals, of_curves

BASE = Minimal()
REGULAR = Minimal(k2=20.0)
_DAMPED: dict[str, Any] = {"c1": 0.3, "c2": 0.3, "c3": 0.3}
_LABELS = {"base values (k2 = 10 N/m)": BASE, "k2 = 20 N/m": REGULAR}


def _both(names: str, values: np.ndarray, mu: float = 0.5, **changes: Any) -> Curves:
    cases = {(label, label): (replace(model, **changes), mu) for label, model in _LABELS.items()}
    return solve_curves(axis_of(BASE, names, values), cases)


def _friction() -> Curves:
    return _both("mu", np.linspace(0, 1, 401))


def _friction_notes(result: Curves) -> Notes:
    readings = [Minimal(k2=20.0, friction=f).critical_mu()[0] for f in ("printed", "contact", "full")]
    return Notes(
        f"At k2 = 20 N/m the two frequencies meet at μ_c = {readings[0]:.6f} and a growing and a decaying motion "
        "leave the axis like a square root. At the base values both frequencies are √15 rad/s for every μ: nothing "
        "merges, there is no threshold, and the growth rate is zero to rounding.",
        "The gap between the two frequencies at μ = 0 buys friction. Which stiffness carries the normal load "
        f"matters: the threshold is {readings[0]:.5f} if all of it does, {readings[1]:.5f} if the contact spring "
        f"alone does, and {readings[2]:.5f} if the whole normal equation is taken.",
        "The claim that the base values have a threshold: a = d = 15 N/m and b = 0 leave the eigenvalues at ±i√15 "
        "for every μ. Computed with rounding, b = −1.8e-15 N/m gives Re λ near 1e-8; it is "
        f"{BASE.spectrum(0.5).stability}, not unstable.",
    )


def _theta2() -> Curves:
    return _both("theta2", np.linspace(0, 360, 721))


def _theta2_notes(result: Curves) -> Notes:
    base, regular = result.cases
    return Notes(
        f"At μ = 0.5 and k2 = 10 N/m the mass is unstable for θ2 in {intervals(base)} degrees; at k2 = 20 N/m in "
        f"{intervals(regular)} degrees; the window from {regular.unstable[1][0]:.0f}° to "
        f"{regular.unstable[1][1]:.0f}° is a divergence, det K < 0, without oscillation. A spring has no sense of "
        "direction: everything repeats after 180°.",
        "The sign of the coupling b decides: b ≥ 0 cannot flutter with this direction of sliding. The base angle, "
        "60°, is exactly the edge of an unstable window.",
    )


def _k2() -> Curves:
    cases = {(f"friction: {f}", f"friction: {f}"): (Minimal(friction=f), 0.5) for f in ("printed", "contact")}
    return solve_curves(axis_of(BASE, "k2", np.linspace(0, 50, 501)), cases)


def _k2_notes(result: Curves) -> Notes:
    printed, contact = result.cases
    edge = printed.unstable[0][1]
    return Notes(
        f"At μ = 0.5 the mass is unstable for k2 in {intervals(printed, 7)} N/m; if the contact spring alone "
        f"carries load, in {intervals(contact, 7)} N/m.",
        "A stiffness is good or bad by what it does to the two frequencies and to their coupling, not by its size. "
        "The base value 10 N/m is the lower edge of the window.",
        "The claim that higher stiffness delays instability: raising k2 from 10 N/m creates flutter, and it lasts "
        f"up to {edge:.2f} N/m.",
    )


def _surface(name: str) -> Surface:
    y = axis_of(BASE, name, np.linspace(0, 50, 101))
    cases = {"base values (k2 swept)": BASE} if name == "k2" else _LABELS
    return surface(axis_of(BASE, "mu", np.linspace(0, 1, 101)), y, cases)


def _surface_notes(name: str) -> Notes:
    seen = {
        "k1": "With k2 = 10 N/m only k1 < 10 N/m can flutter: beyond it the coupling b is positive. With k2 = "
        "20 N/m the edge lies at k1 = 20 N/m.",
        "k2": "The unstable region opens at k2 = 10 N/m, where its threshold falls to zero, and closes "
        "towards larger k2 as the frequencies move apart.",
        "k3": "At the base values k3 changes nothing but one frequency: b = 0, and the plane stays at zero. At "
        "k2 = 20 N/m the threshold is lowest at k3 = 16.6 N/m, next to 15 N/m, where a = d.",
    }  # fmt: skip
    follows = {
        "k1": "The two inclined springs act through their difference; balance is the edge of instability, not "
        "the middle of safety.",
        "k2": "Near the edge the threshold grows like (k2 − 10)/(15√3): the base point has no margin at all.",
        "k3": "Move the contact stiffness away from the value at which a = d; to both sides the threshold rises.",
    }  # fmt: skip
    return Notes(seen[name], follows[name])


def _damping() -> Curves:
    cases = {}
    for label, model in _LABELS.items():
        cases[("undamped", label)] = (model, 0.0)
        cases[("c1 = c2 = c3 = 0.3 N s/m", label)] = (replace(model, **_DAMPED), 0.0)
        if model is REGULAR:
            cases[("c1 = c2 = 0.3, c3 = 0", label)] = (replace(model, c1=0.3, c2=0.3), 0.0)
    return solve_curves(axis_of(BASE, "mu", np.linspace(0, 1, 401)), cases)


def _damping_notes(result: Curves) -> Notes:
    models = (REGULAR, replace(REGULAR, **_DAMPED), replace(REGULAR, c1=0.3, c2=0.3), replace(REGULAR, c3=0.3))
    plain, equal, unequal, single = (model.critical_mu()[0] for model in models)
    base = replace(BASE, **_DAMPED).eigenvalues(1.0)[-1]
    return Notes(
        f"Equal dampers move the onset at k2 = 20 N/m from {plain:.5f} to {equal:.5f} and round the square root "
        f"off. At the base values λ = {base.real:.3f} ± {base.imag:.4f}i rad/s for every μ.",
        "Damping must reach both motions alike. A damper on one of them alone can lower the threshold.",
        f"The claim that damping delays the onset: without c3 it falls to {unequal:.6f}, and c3 alone, however "
        f"small, lowers it to {single:.6f} = |b|/d.",
    )


def _c3() -> Curves:
    return _both("c3", np.linspace(0, 0.7, 281), c1=0.3, c2=0.3)


def _c3_notes(result: Curves) -> Notes:
    regular = result.cases[1]
    return Notes(
        f"At μ = 0.5 and k2 = 20 N/m the largest growth rate goes from {regular.growth[0]:.4f} to "
        f"{regular.growth[-1]:.4f} rad/s over the sweep (unstable for c3 in {intervals(regular)} N s/m). At the "
        "base values the mass decays throughout.",
        "More normal damping helps here because c1 and c2 are there too; by itself it lowers the threshold (see "
        "the damping study).",
    )


def _surface_c() -> Surface:
    y = axis_of(BASE, ("c1", "c2", "c3"), np.linspace(0, 0.7, 71))
    return surface(axis_of(BASE, "mu", np.linspace(0, 1, 101)), y, _LABELS)


def _surface_c_notes(result: Result) -> Notes:
    onsets = [f"{replace(REGULAR, c1=c, c2=c, c3=c).critical_mu()[0]:.4f} at {c:g} N s/m" for c in (0.1, 0.3, 0.7)]
    return Notes(
        f"With c = c1 = c2 = c3 the threshold at k2 = 20 N/m rises: {', '.join(onsets)}. At the base values damping "
        "pulls the whole plane below zero, whatever μ is.",
        "Three equal dampers damp both directions and only then does more damping mean more margin.",
    )


def _responses() -> Responses:
    mu_c = REGULAR.critical_mu()[0]
    mu = {"below": 0.9 * mu_c, "at μ_c": mu_c, "above": 1.1 * mu_c}
    return responses(REGULAR, [1.0, 0.0], np.linspace(0, 40, 1601), mu)


def _responses_notes(result: Result) -> Notes:
    assert isinstance(result, Responses)
    return Notes(
        "k2 = 20 N/m. Below μ_c the two frequencies beat and x(t) stays bounded; at μ_c its envelope grows like t; "
        f"above it like exp({result.rates[2]:.4f} t).",
        "Beating with a long period is the sign that two frequencies are about to merge: friction is near its limit.",
    )


def _map() -> Grid:
    k = np.arange(5.0, 51.0, 5.0)
    axes = (*(axis_of(BASE, name, k) for name in ("k1", "k2", "k3")), axis_of(BASE, "theta2", np.arange(0.0, 180.0, 5)))
    k1, k2, k3, theta2 = np.meshgrid(*(a.values for a in axes), indexing="ij")
    return Grid(axes, "critical_mu", critical_friction(k1, k2, k3, BASE.theta1, theta2))


def _best(axes: tuple[Axis, ...], values: np.ndarray) -> str:
    place = np.unravel_index(np.argmax(values), values.shape)
    return ", ".join(f"{a.name} = {a.values[i]:g} {a.unit}" for a, i in zip(axes, place, strict=True))


def _map_notes(result: Result) -> Notes:
    assert isinstance(result, Grid)
    forward = np.where((result.values > 0) & np.isfinite(result.values), result.values, -np.inf)
    either = np.where(np.isfinite(result.values), np.abs(result.values), -np.inf)
    free = float(np.mean((result.values < 0) | np.isinf(result.values)))
    return Notes(
        f"θ1 = 120°. Over k1, k2, k3 from 5 to 50 N/m and θ2 from 0° to 175°, {100 * free:.1f} % of the grid cannot "
        f"flutter with this direction of sliding (b ≥ 0). Of the rest the largest threshold is {forward.max():.4g}, "
        f"at {_best(result.axes, forward)}; for either direction of sliding the largest is {either.max():.4g}, at "
        f"{_best(result.axes, either)}.",
        "There is no optimal point but an optimal region: no coupling (b → 0) with the two frequencies far apart "
        "(a ≠ d), where the threshold has no upper bound. b → 0 with a = d, the base values, is the worst "
        "neighbourhood: there the threshold falls to zero.",
    )


STUDIES = [
    Study("friction", "1.2.2", "minimal model over friction", _friction, of_curves(_friction_notes)),
    Study("theta2", "1.2.3", "minimal model over θ2, μ = 0.5", _theta2, of_curves(_theta2_notes)),
    Study("k2", "1.2.4", "minimal model over k2, μ = 0.5", _k2, of_curves(_k2_notes)),
    Study("surface-k1", "1.2.5", "largest growth rate over friction and k1", lambda: _surface("k1"),
          lambda _: _surface_notes("k1")),
    Study("surface-k2", "1.2.5", "largest growth rate over friction and k2", lambda: _surface("k2"),
          lambda _: _surface_notes("k2")),
    Study("surface-k3", "1.2.5", "largest growth rate over friction and k3", lambda: _surface("k3"),
          lambda _: _surface_notes("k3")),
    Study("damping", "1.2.6", "minimal model, damped and undamped", _damping, of_curves(_damping_notes)),
    Study("c3", "1.2.6", "minimal model over c3, c1 = c2 = 0.3 N s/m, μ = 0.5", _c3, of_curves(_c3_notes)),
    Study("surface-c", "1.2.6", "largest growth rate over friction and c = c1 = c2 = c3", _surface_c, _surface_c_notes),
    Study("responses", "1.1.2", "minimal model, free motion at k2 = 20 N/m", _responses, _responses_notes),
    Study("map", "1.6", "minimal model, critical friction over k1, k2, k3 and θ2", _map, _map_notes),
]  # fmt: skip
