"""Studies of the friction oscillator, and the map of noise by frequency."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..models import Oscillator
from ..noise import name_noise
from ..results import Curves, Responses, Table, responses
from ..study import Notes, Result, Study, of_curves, solve_curve

BASE = Oscillator()


def _friction_notes(result: Curves) -> Notes:
    mu_c = BASE.critical_mu()[0]
    contact = Oscillator(friction="contact").critical_mu()[0]
    return Notes(
        f"The frequencies meet at μ_c = {mu_c:.4f}; the source reads about 0.35 off its figure. If only the contact "
        f"spring carries load the threshold is {contact:.4f}.",
        "The threshold is a property of the structure, not of the friction law: here friction is constant and does "
        "not fall with sliding speed.",
    )


def _responses() -> Responses:
    mu_c = BASE.critical_mu()[0]
    mu = {"below": 0.9 * mu_c, "at μ_c": mu_c, "above": 1.1 * mu_c}
    return responses(BASE, [1.0, 0.0], np.linspace(0, 30, 1201), mu)


def _responses_notes(result: Result) -> Notes:
    assert isinstance(result, Responses)
    late = BASE.response([1.0, 0.0], [0.0, 0.0], np.linspace(996, 1000, 801), result.mu[1])
    slope = float(np.abs(late[:, 0]).max() / 1000)
    return Notes(
        "From rest at x = 1 m, y = 0: bounded beating below μ_c, growth in proportion to t at μ_c, growth like "
        f"exp({result.rates[2]:.4f} t) above it.",
        "A measured amplitude that rises in a straight line marks the threshold; an exponential one says how far "
        "above it the brake is.",
        "The claim that the motion at μ_c is neutral: two eigenvectors fall into one there, the motion holds a "
        f"term t sin ωt, and the amplitude of x rises by {slope:.3f} m each second.",
    )


def _noise_map() -> Table:
    rows = []
    for exponent in np.linspace(2, 9, 29):
        scale = 10.0 ** float(exponent)
        model = replace(BASE, kx=BASE.kx * scale, ky=BASE.ky * scale, k=BASE.k * scale)
        onset = next(o for o in model.critical_points() if o.kind == "flutter")
        frequency = onset.omega / (2 * math.pi)
        rows.append((scale, onset.mu, frequency, name_noise(frequency)))
    return Table(("stiffness_scale", "critical_mu", "frequency_hz", "noise"), tuple(rows))


def _noise_notes(result: Result) -> Notes:
    return Notes(
        "All stiffnesses of the oscillator times one factor: the threshold stays at 0.362, the frequency at which "
        "it flutters rises with the root of the factor, from groan (below 100 Hz) through the range between to "
        "squeal (1 kHz and up). The factor that makes it squeal is near 1.9e6.",
        "Ratios of stiffness decide whether a brake is noisy, stiffness over mass decides what the noise is called.",
    )


STUDIES = [
    Study("friction", "1.1.2", "friction oscillator over friction",
          lambda: solve_curve(BASE, "mu", 0, 1, 0.0, 400), of_curves(_friction_notes)),
    Study("responses", "1.1.2", "friction oscillator, free motion", _responses, _responses_notes),
    Study("noise-map", "1.1.1", "noise by frequency", _noise_map, _noise_notes),
]  # fmt: skip
