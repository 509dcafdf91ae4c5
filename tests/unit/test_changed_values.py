"""A problem at other values of its parameters: which are allowed, and what it keeps of values before."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest
import scipy.sparse as sp

import fe_squeal.problem.problem
from fe_squeal import SceneError
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from meshes import BELT, box, make_problem

PISTON, PRESSURE = "springs.piston.stiffness", "effects.friction_damping.contact_pressure"


def on_a_belt(**effects) -> Problem:
    """One hexahedron with a spring on a belt, with friction and other effects."""
    contact = {"surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e12, "sliding": BELT}
    spring = {"name": "piston", "surface": "top", "direction": [0.0, 0.0, 1.0], "stiffness": 1e7}
    return make_problem(box("hex1", (1, 1, 1)), order=1, contacts=[contact], springs=[spring],
                        effects={"friction": {"mu": 0.3}, **effects})  # fmt: skip


@pytest.mark.parametrize("call", [
    lambda p: p.at(mu=-0.3), lambda p: p.pencil({"effects.friction.mu": -0.3}), lambda p: p.at({PISTON: 2e7}, mu=-0.3),
    lambda p: p.derivative("mu", "C", {"mu": -0.3}), lambda p: p.at({PISTON: 2e7}).at({PRESSURE: 2e6, "mu": -0.3}),
])  # fmt: skip
def test_friction_damping_is_refused_for_a_negative_mu(call):
    """It would feed what it damps: its term counts with mu, and stands for |mu|."""
    problem = on_a_belt(friction_damping={"contact_pressure": 1e6})
    with pytest.raises(SceneError, match=r"mu = -0\.3.*: effects: given friction_damping and friction\.mu = -0\.3;"):
        call(problem)


def test_other_numbers_that_a_scene_does_not_allow_only_multiply():
    """A spring of 0 or below and a pressure of 0, beside friction damping; reversed friction without it."""
    damped = on_a_belt(friction_damping={"contact_pressure": 1e6})
    C = damped.pencil().C
    assert np.linalg.eigvalsh(C.toarray()).min() >= -1e-12 * abs(C).max()
    twice = damped.at({PISTON: -1e7}, mu=0.6).pencil().C
    assert abs(twice - 2 * C).max() <= 1e-15 * abs(C).max()
    for none in ({"mu": 0.0}, {PRESSURE: 0.0}):
        assert damped.at({PISTON: 0.0}).pencil(none).C is None
    plain = on_a_belt()
    K = [plain.pencil(mu=mu).K for mu in (-0.3, 0.0, 0.3)]
    assert abs(K[0] - 2 * K[1] + K[2]).max() <= 1e-15 * abs(K[1]).max() < abs(K[0] - K[2]).max()


def test_sums_are_kept_for_the_last_values_alone(monkeypatch):
    """Each is a whole matrix; K = (2 + s) 1 + mu F, of which (2 + s) 1 is summed once for all values of mu."""
    made, real = [], fe_squeal.problem.problem.sum_terms

    def noted(parts):
        found = real(parts)
        made.append((None if found is None else weakref.ref(found), found is not None and found.nnz == 5))
        return found

    monkeypatch.setattr(fe_squeal.problem.problem, "sum_terms", noted)
    one, F = sp.eye_array(5, format="csr"), sp.csr_array(np.eye(5, k=1))
    terms = (Term("m", "M", one, True, {"density": 1}), Term("k", "K", 2 * one, True),
             Term("s", "K", one, True, {"s": 1}), Term("f", "K", F, False, {"mu": 1}))  # fmt: skip
    problem = Problem(terms, {"density": 3.0, "s": 1.0, "mu": 0.3})
    for s in range(2, 22):
        here = problem.at(s=float(s))
        for mu in (0.25, 0.5):
            K = here.pencil(mu=mu).K
            assert abs(K - (2 + s) * one - mu * F).max() == 0
    del K
    gc.collect()
    assert sum(diagonal for _, diagonal in made) == 2 * 20
    assert sum(ref is not None and ref() is not None for ref, _ in made) == 2
