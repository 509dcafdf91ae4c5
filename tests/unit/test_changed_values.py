"""A problem at other values of its parameters: which are allowed, and what it keeps of values before."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import scipy.sparse as sp

import fe_squeal.problem.problem
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term


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
