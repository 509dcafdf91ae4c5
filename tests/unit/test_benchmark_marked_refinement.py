"""Marked refinement beside uniform refinement: more exact with fewer unknowns where a clamped edge is singular."""

from itertools import pairwise

import marked_refinement as page
import numpy as np
import pytest

from fe_squeal.mesh.marking import doerfler
from fe_squeal.mesh.refining import refine


@pytest.mark.slow
def test_a_clamped_edge_needs_fewer_unknowns_where_stresses_jump():
    """Each mesh has θ above the true one (Rayleigh–Ritz), so that the lower one is the more exact."""
    case = page.CASES["clamped thick plate"]
    whole = list(page.refined(*case, 3, lambda loaded, shares: refine(loaded)))
    marked = list(page.refined(*case, 4, page.where_stresses_jump))
    (many, _, coarse), (few, _, fine) = whole[-1], marked[-1]
    assert few < 0.9 * many and (fine < coarse).sum() >= 3 and np.mean(fine / coarse) < 1
    for (_, _, before), (_, _, after) in pairwise(marked):
        assert (after < before).all()


def test_stress_jumps_vanish_where_the_stress_is_linear():
    """Of a quadratic displacement, whose stress the mesh has exactly; of another one they do not."""
    loaded = page.block((2, 2, 2), (1.0, 0.8, 0.6))
    problem = page.problem_on(loaded, [])
    space = problem.discretisation.space
    law = page.elasticity(problem.source.scene.materials["steel"])
    x, y, z = space.coordinates.T
    jumps = [
        page.stress_jumps(space, law, space.gather(np.stack([power * y, x * z, power], axis=1)))
        for power in (x, x**4)
    ]  # fmt: skip
    assert jumps[0].max() < 1e-9 * jumps[1].max() and (jumps[1] >= 0).all()


@pytest.mark.parametrize("part", [0.3, 0.5, 0.9, 1.0])
def test_doerfler_takes_the_fewest(part):
    """Against all sets of a few elements: none that is smaller has the part."""
    shares = np.random.default_rng(5).exponential(size=9) ** 3
    shares[4] = 0.0
    chosen = doerfler(shares, part)
    whole = shares.sum()
    sets = (np.arange(2**9)[:, None] >> np.arange(9)) & 1
    enough = sets @ shares >= part * whole * (1 - 1e-12)
    assert shares[chosen].sum() >= part * whole * (1 - 1e-12)
    assert len(chosen) == len(set(chosen)) == sets[enough].sum(axis=1).min()
    assert (np.diff(shares[chosen]) <= 0).all()


def test_doerfler_at_its_limits():
    assert len(doerfler(np.zeros(5), 0.5)) == 0 == len(doerfler(np.zeros(0), 1.0))
    assert doerfler(np.array([1.0, 1.0]), 0.5).tolist() == [0]
    assert len(doerfler(np.array([1.0, *[1e-20] * 100]), 1.0)) == 101
    for shares, part in (([1.0, -1.0], 0.5), ([np.nan], 0.5), ([1.0], 0.0), ([1.0], 1.5)):
        with pytest.raises(ValueError, match=r"of the error|not negative"):
            doerfler(np.array(shares), part)
