"""The count of modes of damped and frictional pencils, apart from the solver that found them, against dense spectra."""

import numpy as np
import pytest
from chains import CLASSES, MODES, chain, dense
from selection import some

from fe_squeal import sweep
from fe_squeal.eigen.dense import DENSE_LIMIT
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.errors import NotConvergedError
from fe_squeal.sweep import solving
from fe_squeal.sweep.counting import count_apart

MU = 0.4
LARGE = DENSE_LIMIT + 40


@pytest.mark.parametrize("kind", some(CLASSES, lambda kind: kind in ("nonsymmetric", "quadratic")))
def test_direct_solves_are_counted(kind):
    """Found and expected are what LAPACK has below the highest mode found."""
    problem = chain(*CLASSES[kind], n=LARGE)
    result = sweep(problem, [MU], modes=MODES, method="direct")
    lam = result.points[0].modes.lam
    assert not result.method.startswith("dense")
    every = dense(problem, MU)
    below = np.count_nonzero(every.imag <= lam.imag.max() * (1 + 1e-9))
    assert result.completeness.found == result.completeness.expected == below == len(lam)
    assert not result.completeness.proven


@pytest.mark.parametrize("effects", [(), ("damper",)])
@pytest.mark.parametrize("lost", [0, 5])
def test_a_mode_that_the_solver_misses_is_an_error(monkeypatch, effects, lost):
    def careless(pencil, *how):
        modes = solve_modes(pencil, *how)
        return modes.select(np.delete(np.arange(len(modes)), lost))

    monkeypatch.setattr(solving, "solve_modes", careless)
    with pytest.raises(NotConvergedError, match=f"{MODES - 1} modes found where .* counts {MODES}"):
        sweep(chain(*effects, n=LARGE), [MU], modes=MODES, method="direct")


def test_no_count_without_a_gap():
    """Where all frequencies found are one, nothing says where to stop counting."""
    problem = chain("damper", n=LARGE)
    modes = solve_modes(problem.pencil(mu=MU), Request(count=1))
    assert count_apart(problem.at(mu=MU), modes, Request(count=1)) is None
