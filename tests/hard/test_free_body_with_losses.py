"""A free body with its own dashpots beside a body with loss factors: what decays far away must not pass for near.

The free motion decays with ν = −α, far from every shift. It is known beforehand, and says nothing about how far around
the shift a search has come. Nor do loss factors say anything of a motion that grows without swinging.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from dense import all_eigenvalues

import fe_squeal
from fe_squeal.eigen.dense import DENSE_LIMIT
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from meshes import box, join, make_problem

FREE, HELD, ALPHA, LIMIT = 20, DENSE_LIMIT, 50.0, 0.3


def chain(n):
    k = np.ones(n - 1)
    return np.diag(np.r_[1.0, 2 * np.ones(n - 2), 1.0]) - np.diag(k, 1) - np.diag(k, -1)


def test_the_decay_of_a_free_body_does_not_hide_the_band():
    held = chain(HELD)
    held[0, 0] += 1.0
    flutter = (0.9 * LIMIT) ** 2 * np.array([[1.0, 0.06], [-0.06, 1.0]])
    losses = la.block_diag(np.zeros((FREE, FREE)), 0.02 * held, 0.01 * LIMIT**2 * np.eye(2))
    K = la.block_diag(chain(FREE), held, flutter) + 1j * losses
    C = np.diag(np.r_[np.full(FREE, ALPHA), np.zeros(HELD + 2)])
    pencil = Pencil(*(sp.csr_array(A) for A in (np.eye(len(K)), K, C)))
    modes = solve_modes(pencil, Request(max_frequency_hz=LIMIT / (2 * np.pi)))
    theta = np.append(la.eigvalsh(held) * (1 + 0.02j), la.eigvals(flutter) + 0.01j * LIMIT**2)
    expected = 1j * np.sqrt(theta)
    expected = np.where(expected.imag < 0, -expected, expected)
    expected = expected[expected.imag <= LIMIT]  # the free body creeps, or is slowed at once
    found = modes.lam[modes.lam.imag > 1e-6]
    assert len(found) == len(expected)
    np.testing.assert_allclose(np.sort(found.imag), np.sort(expected.imag), rtol=1e-9)
    assert np.count_nonzero(modes.stability == "unstable") == np.count_nonzero(expected.real > 0) == 1
    assert np.count_nonzero(modes.lam == 0) == 1


def creeping_pad():
    """A pad that contact alone holds, and that falling friction drives: three of its motions creep or grow."""
    pad = box("hex1", (1, 1, 1), (0.06, 0.04, 0.002), name="pad")
    belt = box("hex1", (2, 1, 1), (0.1, 0.06, 0.02), (-0.02, -0.01, -0.02), name="belt")
    soft = {"youngs_modulus": 1e8, "poisson_ratio": 0.0, "density": 3000.0, "loss_factor": 1e-4}
    effects = {"friction": {"mu": 0.0}, "friction_damping": {"contact_pressure": 1e6}, "structural_damping": {},
               "falling_friction": {"slope": -1.0, "contact_pressure": 1e6}}  # fmt: skip
    return make_problem(
        join(pad, belt), order=1, materials={"soft": soft},
        bodies={"pad": {"material": "soft"}, "belt": {"material": "soft"}}, effects=effects,
        supports=[{"surface": "bottom_belt", "fixed": "xyz"}],
        contacts=[{"name": "face", "surface": "bottom_pad", "counterface": "top_belt", "normal_stiffness": 1e7,
                   "normal_damping": 100.0, "sliding": {"direction": [1, 0, 0], "speed": -1.0}}],
    )  # fmt: skip


@pytest.mark.parametrize("method", ["direct", "reduced"])
def test_what_grows_without_swinging_is_no_onset_where_losses_are_complex(method):
    """Its λ is marginal at the values of a sweep, and so it is between them; beside it one mode begins to flutter."""
    problem, highest = creeping_pad(), 900.0
    result = fe_squeal.sweep(problem, [0.4, 0.6], max_frequency=highest, method=method)
    (onset,) = result.onsets
    assert not any("not refined" in w for w in result.warnings)

    def growing(mu):
        pencil = problem.pencil({"mu": mu})
        lam = all_eigenvalues(pencil.M, pencil.C, pencil.K, 2 * np.pi * highest)
        swings = (lam.imag > np.abs(lam.real)) & (lam.imag > 1e-9 * 2 * np.pi * highest)  # or it is a zero, rounded
        return lam[swings & (lam.imag < 2 * np.pi * highest) & (lam.real > 0)]

    assert len(growing(onset.value - 1e-5)) == 0
    (lam,) = growing(onset.value + 1e-5)
    assert lam.imag == pytest.approx(2 * np.pi * onset.frequency_hz, rel=1e-5)
