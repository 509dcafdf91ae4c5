"""Free motions against numerical integration, and growth in proportion to time where two eigenvectors fall into one."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from lumped import Minimal, NineDof, Oscillator, TwoMass

MU_C = Oscillator().critical_mu()[0]


@pytest.mark.parametrize(
    ("model", "mu"),
    [
        (Oscillator(), 0.8 * MU_C), (Oscillator(), MU_C), (Oscillator(), 1.2 * MU_C),
        (Minimal(), 0.5),  # degenerate: defective for every μ
        (Minimal(k2=20.0, c1=0.3, c2=0.2, c3=0.1), 0.5), (TwoMass(c1x=0.1), 0.4), (NineDof(), 1.0),
    ],
)  # fmt: skip
def test_against_integration(model, mu):
    n = len(model.coordinates)
    rng = np.random.default_rng(5)
    x0, v0 = rng.normal(size=(2, n))
    times = np.linspace(0, 10, 41)
    inverse = 1 / np.diag(model.M)
    K, C = model.K(mu), model.C

    def rate(_, state):
        return np.concatenate([state[n:], -inverse * (K @ state[:n] + C @ state[n:])])

    reference = solve_ivp(rate, (0, 10), [*x0, *v0], "DOP853", times, rtol=1e-13, atol=1e-13).y[:n].T
    # the integrator's local error of 1e-13 over some hundred steps, of motions that grow by at most a hundred
    assert_allclose(model.response(x0, v0, times, mu), reference, atol=1e-10 * np.abs(reference).max())


def test_growth_in_proportion_to_time_at_the_threshold():
    model = Oscillator()
    times = np.array([1e2, 1e3, 1e4])
    # the envelope over one period at each time
    period = 2 * np.pi / model.critical_points()[0].omega
    window = np.linspace(0, period, 200)
    ratio = []
    for t in times:
        motion = model.response([1.0, 0.0], [0.0, 0.0], t + window, MU_C)
        ratio.append(np.linalg.norm(motion, axis=1).max() / t)
    # bounded and growing motions differ from c t by O(1): the ratio settles like 1/t
    assert abs(ratio[1] / ratio[2] - 1) < 5e-3 and abs(ratio[0] / ratio[2] - 1) < 5e-2
    # closed form: with N = A − θ I, N² = 0, q ~ t sin(ωt)/(2ω) N x0
    theta = 20.5
    N = model.K(MU_C) - theta * np.eye(2)
    assert_allclose(N @ N, 0, atol=1e-12)
    assert_allclose(ratio[2], np.linalg.norm(N @ [1.0, 0.0]) / (2 * np.sqrt(theta)), rtol=1e-3)


def test_below_bounded_above_exponential():
    model = Oscillator()
    times = np.linspace(0, 200, 2001)
    below = np.abs(model.response([1, 0], [0, 0], times, 0.9 * MU_C))
    assert below[1000:].max() < 1.01 * below[:1000].max()
    growth = model.eigenvalues(1.1 * MU_C).real.max()
    above = np.linalg.norm(model.response([1, 0], [0, 0], times, 1.1 * MU_C), axis=1)
    peak = [above[1000:1500].max(), above[1500:].max()]
    # 50 s apart, up to the phase of the motion within the last sample
    assert_allclose(np.log(peak[1] / peak[0]) / 50, growth, rtol=2e-2)


def test_bad_initial_conditions():
    with pytest.raises(ValueError, match="2 finite initial displacements"):
        Oscillator().response([1, 0, 0], [0, 0], [0.0], 0.2)
    with pytest.raises(ValueError, match="take a shorter time"):
        Oscillator().response([1, 0], [0, 0], [1e5], 2.0)
