"""How parts of a change fall when the mesh is refined: regular ones at the rate of the elements, others slower."""

from __future__ import annotations

import numpy as np
import pytest

from fe_squeal import sweep
from fe_squeal.accuracy.bars import LIMITS
from fe_squeal.accuracy.edges import singular_elements
from fe_squeal.accuracy.quantities import split_changes
from fe_squeal.accuracy.refined import refine_problem
from fe_squeal.assembly.assembly import Assembly
from fe_squeal.mesh.refining import refine
from meshes import BELT, box, make_problem

CHILDREN = 8
CLAMPED = {"supports": [{"surface": "left", "fixed": "xyz"}]}
TIED = {"contacts": [{"surface": "left", "counterface": "rigid", "kind": "tied", "normal_stiffness": 1e16}]}


def belt(stiffness):
    """A block on a belt, whose contact is soft beside it or nearly rigid: its edges are not among the singular ones."""
    return {
        "materials": {"m": {"youngs_modulus": 2e9, "poisson_ratio": 0.3, "density": 2600.0}},
        "bodies": {"block": {"material": "m"}}, "effects": {"friction": {"mu": 0.3}},
        "contacts": [
            {"name": "c", "surface": "bottom", "counterface": "rigid", "normal_stiffness": stiffness, "sliding": BELT}
        ],
        "springs": [{"name": "x", "surface": "right", "direction": [1, 0, 0], "stiffness": 4e7},
                    {"name": "y", "surface": "front", "direction": [0, 1, 0], "stiffness": 3e7}],
    }  # fmt: skip


def parts_twice(problem, modes):
    """Return what regular and singular elements add to the changes of the modes at one value, (2, k), on two meshes.

    The elements of the second mesh are what those of the first are.
    """
    assembly, singular, found = problem.source, None, []
    for _ in range(2):
        result = sweep(assembly.problem({}), [0.3], modes=modes)
        refined = refine_problem(result)
        split = split_changes(result, refined).of(("frequencies",))
        whole = split.relative.sum(axis=2)
        singular = singular_elements(refined.coarse) if singular is None else np.repeat(singular, CHILDREN)
        found.append(np.stack([whole[:, ~singular].sum(axis=1), whole[:, singular].sum(axis=1)]))
        assembly = Assembly(assembly.scene, refine(assembly.loaded))
    return found


@pytest.mark.parametrize(("kind", "cells", "tables"), [
    ("hex1", (3, 2, 1), CLAMPED),
    ("hex1", (3, 2, 1), TIED),
    pytest.param("hex1", (3, 2, 1), belt(1e13), marks=pytest.mark.slow),
    pytest.param("hex1", (4, 3, 2), CLAMPED, marks=pytest.mark.slow),
    pytest.param("hex1", (4, 2, 2), belt(1e11), marks=pytest.mark.slow),
    pytest.param("tet1", (4, 3, 2), CLAMPED, marks=pytest.mark.slow),
    pytest.param("tet1", (3, 2, 2), belt(1e13), marks=pytest.mark.slow),
])  # fmt: skip
def test_limits_of_the_factors(kind, cells, tables):
    """Each part p of a change falls by 2^-q, and then lies p/(1 − 2^-q) from where it tends to: between the limits."""
    regular, singular = LIMITS[2]
    one, two = parts_twice(make_problem(box(kind, cells, (0.08, 0.05, 0.03)), 2, **tables), 6)
    ratio = two / np.where(one == 0, 1.0, one)
    assert (ratio[0] <= 1 - 1 / regular[2]).all() and np.median(ratio[0]) <= 0.125  # q = 2, 3
    if tables in (CLAMPED, TIED):
        assert (ratio[1] <= 1 - 1 / singular[2]).all() and (ratio[1] >= 1 - 1 / singular[0]).all()  # q = 1, 4
        assert 0.2 < np.median(ratio[1]) < 0.45 and (ratio[1] > 1.5 * ratio[0]).all()  # 0.38 in theory
    else:
        assert not one[1].any()
