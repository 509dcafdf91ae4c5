"""Groups of so many modes that their stability is told not to be decided, instead of being sampled for minutes."""

import re

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal.eigen.dense import solve_dense
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.sweep import scan
from fe_squeal.sweep.onsets import Found, find_step_onsets

_ENDS = (0.0, 1.0)
_GAP = 0.1  # between the squares of the two frequencies: they meet where the friction is half of that


def _found(*, halved: bool) -> Found:
    friction = sp.csr_array(np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    terms = (
        Term("m", "M", sp.eye_array(3, format="csr"), True),
        Term("k", "K", sp.csr_array(np.diag([1.0, 1.0 + _GAP, 40.0])), True),
        Term("friction", "K", friction, False, {"p": 1}),
    )
    problem = Problem(terms, {"p": 0.0})
    first, second = (solve_dense(problem.pencil({"p": p})) for p in _ENDS)
    branches = np.arange(3)
    return find_step_onsets(problem, "p", _ENDS, (first, second), (branches, branches), 10.0, halved=halved)


def test_a_group_of_too_many_modes_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the two modes meet is not searched; the interval that is told has it inside, and is a narrow one."""
    known = _found(halved=False)
    assert [round(o.value, 9) for o in known.onsets] == [_GAP / 2] and not known.warnings
    monkeypatch.setattr(scan, "_LARGEST", 1)
    found = _found(halved=False)
    assert not found.onsets
    told = [re.search(r"between p = (\S+) and (\S+) modes near (\S+) Hz", text) for text in found.warnings]
    inside = [m for m in told if m and float(m[1]) < _GAP / 2 < float(m[2])]
    assert len(inside) == 1
    assert float(inside[0][2]) - float(inside[0][1]) < 1e-3
    assert float(inside[0][3]) == pytest.approx(np.sqrt(1 + _GAP / 2) / (2 * np.pi), rel=0.03)


def test_the_search_of_a_step_that_is_halved_ends_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scan, "_LARGEST", 1)
    values: list[float] = []
    between = scan.cluster_of

    def counted(ends, members, scale):
        assert len(members[0]) <= 1
        values.extend(node.value for node in ends)
        return between(ends, members, scale)

    monkeypatch.setattr(scan, "cluster_of", counted)
    assert _found(halved=True).warnings
    assert len(set(values)) <= scan._NODES_IF_HALVED + 2


def test_neighbouring_intervals_of_the_same_modes_are_told_as_one() -> None:
    intervals = [(0.0, 1.0, 5.0), (2.0, 3.0, 5.0), (1.0, 2.0, 4.8), (1.0, 2.0, 20.0), (5.0, 6.0, 5.0)]
    assert scan.joined(intervals) == [(0.0, 3.0, 4.8), (1.0, 2.0, 20.0), (5.0, 6.0, 5.0)]
    assert scan.joined([(0.0, 1.0, 0.0), (1.0, 2.0, 0.0)]) == [(0.0, 2.0, 0.0)]
