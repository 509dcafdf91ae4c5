"""Modes between values at which they are known: the same as by LAPACK on the whole projection, or none at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from chains import CLASSES, chain
from selection import crossed, some

from fe_squeal.eigen.dense import solve_dense
from fe_squeal.eigen.pencil import FreeMotions
from fe_squeal.eigen.request import Request, is_needed
from fe_squeal.reduced import ReducedModel
from fe_squeal.reduced.estimate import GUARDED, neighbours
from fe_squeal.reduced.two_sided import TwoSided, _is_missing, _Node

TOLERANCE, SIZE = 1e-8, 140
REQUEST = Request(count=12, tolerance=TOLERANCE)
NODES, BETWEEN = (0.0, 0.3, 0.6, 0.9), (0.1, 0.45, 0.6, 0.83)
DAMPED = [kind for kind, effects in CLASSES.items() if {"damper", "gyroscope", "loss"} & set(effects)]


class Whole:
    """All of a problem in units in which its stiffness without friction is one, as those of a reduced model are."""

    has_slow = False

    def __init__(self, problem, free=0):
        self.problem, self.free = problem, free
        w, v = np.linalg.eigh(problem.pencil(mu=0.0).K.real.toarray())
        self.root = v / np.sqrt(w)

    def __len__(self):
        return len(self.root)

    def matrices(self, value):
        pencil, V = self.problem.pencil(mu=value), self.root
        M, C, K = (None if A is None else V.T @ A @ V for A in (pencil.M, pencil.C, pencil.K))
        return M, C, K, False

    def free_motions(self, value):
        return FreeMotions(np.zeros((len(self), self.free)), None)

    def modes(self, value, highest):
        M, C, K, _ = self.matrices(value)
        pencil = self.problem.pencil(mu=value)
        dense = replace(pencil, M=M, C=C, K=K, symmetric=False, cancelled=None, free=FreeMotions.none(len(M)))
        return solve_dense(dense, highest)


def known_at(whole, values, without=None):
    """What is known of the modes at some values, perhaps without one of them; and the highest frequency."""
    highest = float(np.abs(whole.modes(0.0, np.inf).lam[: REQUEST.count + 6]).max())
    found = TwoSided(TOLERANCE, not np.iscomplexobj(whole.matrices(0.0)[2]))
    for value in values:
        every = whole.modes(value, GUARDED * highest)
        exact = every.select(np.flatnonzero(is_needed(every)))
        if without is not None:
            exact = exact.select(np.delete(np.arange(len(exact)), without))
        near = float(np.abs(neighbours(exact, REQUEST).lam).max())
        found.add(value, every, exact, near)
    return found, highest


@pytest.mark.parametrize("kind", some(DAMPED, lambda kind: kind in ("gyroscopic", "complex with C")))
def test_modes_between_are_those_of_lapack(kind):
    """Every one, within a part of the tolerance and within what it says of itself; vectors meet the square root."""
    whole = Whole(chain(*CLASSES[kind], n=SIZE))
    known, highest = known_at(whole, NODES)
    for value in BETWEEN:
        modes = known.modes(whole, value, REQUEST, highest)
        assert modes is not None
        exact = whole.modes(value, GUARDED * highest).lam[: REQUEST.count]
        apart = np.abs(modes.lam[: REQUEST.count] - exact)
        assert (apart <= 1e-2 * TOLERANCE * np.abs(exact)).all()
        assert (modes.re_uncertainty[: REQUEST.count] < 1e-6 * np.abs(exact)).all()
        M, C, K, _ = whole.matrices(value)
        x, y, lam = modes.right[:, : REQUEST.count], modes.left[:, : REQUEST.count], modes.lam[: REQUEST.count]
        damping = np.zeros_like(x) if C is None else C @ x
        residual = M @ x * lam**2 + damping * lam + K @ x
        length = np.linalg.norm(x, axis=0)
        assert (np.linalg.norm(residual, axis=0) <= 0.1 * TOLERANCE**0.5 * length).all()
        slope = np.einsum("ij,ij->j", y.conj(), 2 * M @ x * lam + damping)
        assert np.abs(slope if C is not None else slope / (2 * lam)) == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize(
    ("kind", "without"), crossed(["quadratic", "complex"], [0, 5, 11], fast=lambda kind, _: kind == "complex")
)
def test_a_mode_that_is_missing_is_noticed(kind, without):
    """Nothing is returned where the vectors that are known lack a mode, wherever it is."""
    whole = Whole(chain(*CLASSES[kind], n=SIZE))
    known, highest = known_at(whole, NODES, without)
    assert known_at(whole, NODES)[0].modes(whole, BETWEEN[0], REQUEST, highest) is not None
    for value in BETWEEN:
        modes = known.modes(whole, value, REQUEST, highest)
        if modes is not None:  # it was found all the same, by the share that other modes have in it
            exact = whole.modes(value, GUARDED * highest).lam[: REQUEST.count]
            assert (np.abs(modes.lam[: REQUEST.count] - exact) <= 1e-2 * TOLERANCE * np.abs(exact)).all()


def test_a_count_that_is_one_short_is_noticed():
    """Of |λ| between two nodes: whichever is left out, but not where one mode alone rises and falls between them."""
    sizes = np.cumsum(np.random.default_rng(8).uniform(0.02, 0.1, 40)) + 1.0
    none, swings = np.zeros((0, 0)), np.ones(40, bool)
    around = _Node(0.0, none, none, sizes, swings), _Node(1.0, none, none, 1.002 * sizes, swings)
    middle = 1.001 * sizes
    assert not _is_missing(1j * middle, 30, around)
    bump = middle + 0.015 * middle * (np.arange(40) == 12)
    assert not _is_missing(1j * bump, 30, around)
    for left_out in range(30):
        assert _is_missing(1j * np.delete(middle, left_out), 30, around)


def test_nothing_is_told_beyond_what_is_known():
    whole = Whole(chain(*CLASSES["quadratic"], n=SIZE))
    known, highest = known_at(whole, (0.2, 0.5))
    assert known.modes(whole, 0.1, REQUEST, highest) is None and known.modes(whole, 0.6, REQUEST, highest) is None
    assert known.modes(whole, 0.35, REQUEST, highest, count=1) is None  # between two values, of which one counts
    assert known.modes(whole, 0.35, replace(REQUEST, count=200), highest) is None
    whole.free = 1  # motions that nothing holds have zeros that are known exactly, of which these spans do not know
    assert known.modes(whole, 0.35, REQUEST, highest) is None


def test_modes_that_do_not_swing_are_left_to_lapack():
    """Of damping that is so strong that the lowest modes creep; with a twentieth of it all swing."""
    problem, answers = chain(*CLASSES["quadratic"], n=SIZE), []
    for factor in (3, 60):
        terms = tuple(replace(t, matrix=factor * t.matrix) if t.slot == "C" else t for t in problem.terms)
        whole = Whole(replace(problem, terms=terms))
        known, highest = known_at(whole, NODES)
        answers.append(known.modes(whole, 0.45, REQUEST, highest) is not None)
    assert answers == [True, False]


def test_modes_that_do_not_swing_elsewhere_leave_other_values_alone():
    """Where a mode creeps at the last node, nothing is told next to that; what is told elsewhere is right."""
    whole = Whole(chain(*CLASSES["quadratic"], n=SIZE))
    known, highest = known_at(whole, NODES)
    last = known._nodes[-1]
    known._nodes[-1] = replace(last, swings=np.arange(len(last.swings)) > 0)
    for value in BETWEEN:
        modes = known.modes(whole, value, REQUEST, highest)
        assert (modes is None) == (value > NODES[-2])
        if modes is not None:
            exact = whole.modes(value, GUARDED * highest).lam[: REQUEST.count]
            assert (np.abs(modes.lam[: REQUEST.count] - exact) <= 1e-2 * TOLERANCE * np.abs(exact)).all()


@pytest.mark.parametrize("kind", some(["quadratic", "complex"], lambda kind: kind == "complex"))
def test_a_stored_model_gives_the_same_modes(kind):
    """At the values that it was made for, whatever it became after these, and between them."""
    problem, values = chain(*CLASSES[kind]), np.linspace(0.0, 0.9, 13)
    model = ReducedModel(problem, "mu", values, REQUEST)
    again = ReducedModel.restored(problem, "mu", values, REQUEST, *model.stored())
    for value in (*values.tolist(), 0.02, 0.51):
        one, other = model.modes(value), again.modes(value)
        np.testing.assert_allclose(other.lam, one.lam, rtol=1e-11)
        np.testing.assert_allclose(abs(other.right), abs(one.right), atol=1e-9 * np.abs(one.right).max())


def test_what_lacks_a_mode_is_forgotten(monkeypatch):
    """Once the basis gets a mode that it lacked, no modes between values follow from those that were known before."""
    sizes, search, forget = [], ReducedModel._add_missing, ReducedModel._know_less

    def something(self, values):
        new = np.random.default_rng(4).standard_normal((SIZE, 3))
        return search(self, values) or (not sizes and self.basis.append(new) > 0)

    def counted(self):
        sizes.append(len(self._between))
        forget(self)
        sizes.append(len(self._between))

    monkeypatch.setattr(ReducedModel, "_add_missing", something)
    monkeypatch.setattr(ReducedModel, "_know_less", counted)
    model = ReducedModel(chain(*CLASSES["quadratic"], n=SIZE), "mu", np.linspace(0.0, 0.9, 13), REQUEST)
    assert sizes == [2, 0]
    assert all(vectors > 0 and nodes <= len(model._between) for vectors, nodes in model._met.values())
