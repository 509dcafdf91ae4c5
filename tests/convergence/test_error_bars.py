"""The bars of the discretisation: they hold the true error in nine of ten cases, and are not much wider than it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from closed_forms import sliding_block, sliding_plate, wave_speeds
from selection import some

from fe_squeal import assemble, parse_scene, sweep
from fe_squeal.accuracy import with_discretisation
from fe_squeal.accuracy.bars import BARS, NOTCHED
from fe_squeal.accuracy.estimate import refined_changes
from fe_squeal.errors import SceneError
from fe_squeal.mesh import from_skfem
from fe_squeal.mesh.groups import NodeSet
from fe_squeal.problem.problem import Problem
from meshes import BELT, STEEL, annulus, box, frequencies, join, make_problem

SIZE = (1.0, 0.83, 0.71)
SLIDING = [
    {"surface": s, "fixed": c} for c, pair in zip("xyz", ("left right", "front back", "bottom top"), strict=True)
    for s in pair.split()
]  # fmt: skip
EDGES = [{"surface": s, "fixed": f} for s, f in (("left", "yz"), ("right", "yz"), ("front", "xz"), ("back", "xz"))]
PLATE = {"youngs_modulus": 200e9, "poisson_ratio": 0.3, "density": 8000.0}


def check(modes, changes, exact, order):
    """Nine of ten true errors are inside the bars, which are at most five times as wide in the median.

    Which mode is which is told by the frequencies extrapolated for smooth modes: on the coarse mesh neighbours may have
    changed places.
    """
    changes = changes.imag / (2 * np.pi)
    rank = np.argsort(modes.frequency_hz + changes / (1 - 0.25**order))[: len(exact)]
    error, bar = np.abs(modes.frequency_hz[rank] - exact), BARS[order] * np.abs(changes[rank])
    assert np.isfinite(bar).all() and len(bar) >= 8
    assert np.mean(error <= bar) >= 0.9
    assert 1.0 <= np.median(bar / error) <= 5.0


@pytest.mark.parametrize(
    ("kind", "order", "cells"),
    some([("hex1", 1, 5), ("hex1", 2, 2), ("hex2", 2, 3), ("hex1", 3, 2), ("tet1", 1, 4), ("tet1", 2, 2),
          ("tet2", 2, 3)],
         lambda kind, order, _: (kind, order) in {("hex1", 1), ("hex2", 2), ("tet1", 2), ("hex1", 3)}),
)  # fmt: skip
def test_block_with_sliding_faces(kind, order, cells):
    exact = sliding_block(SIZE, wave_speeds(**STEEL), 12)
    result = sweep(make_problem(box(kind, (cells, cells, cells), SIZE), order, supports=SLIDING), [0.0], modes=18)
    check(result.points[0].modes, refined_changes(result).modes[0], exact, order)


@pytest.mark.parametrize(
    ("kind", "order", "cells"),
    some([("hex1", 1, (8, 8, 2)), ("hex1", 2, (4, 4, 1)), ("tet1", 2, (5, 5, 1))],
         lambda kind, order, _: (kind, order) != ("hex1", 2)),
)
def test_thick_plate(kind, order, cells):
    """Bending, which linear elements resist, is corrected as well: nothing that the refined mesh cannot do is asked."""
    exact = sliding_plate(10.0, 1.0, wave_speeds(**PLATE), 230.0)
    mesh = box(kind, cells, (10.0, 10.0, 1.0), name="plate")
    supports = [{**s, "surface": f"{s['surface']}_plate"} for s in EDGES]
    problem = make_problem(mesh, order, {"plate": PLATE}, supports=supports)
    result = sweep(problem, [0.0], modes=len(exact) + 6)
    check(result.points[0].modes, refined_changes(result).modes[0], exact, order)


def brake(refinement, **effects):
    """A clamped ring with a pad on it, whose friction couples modes."""
    n = refinement
    mesh = join(
        annulus("hex2", (2 * n, 12 * n, n), 0.07, 0.13, 0.012),
        box("hex2", (2 * n, 2 * n, n), (0.04, 0.04, 0.011), (0.08, -0.02, 0.012), name="pad"),
    )
    return make_problem(
        mesh, 2, supports=[{"surface": "hub", "fixed": "xyz"}],
        springs=[{"name": "back", "surface": "top_pad", "direction": [0, 0, 1], "stiffness": 2e8},
                 {"name": "side", "surface": "top_pad", "direction": [1, 0, 0], "stiffness": 1e8},
                 {"name": "end", "surface": "top_pad", "direction": [0, 1, 0], "stiffness": 1e8}],
        contacts=[{"name": "c", "surface": "bottom_pad", "counterface": "top", "normal_stiffness": 2e12,
                   "sliding": {"axis": [0, 0, 1], "centre": [0, 0, 0], "speed": 5.0}}],
        effects={"friction": {"mu": 0.3}, **effects},
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.long
def test_disc_and_pad():
    """Frequencies and growth rates with friction and damping, against the mesh of half the size, extrapolated.

    Against that mesh alone the bars would be held to what they are made of.
    """
    damping = {"rayleigh": {"alpha": 30.0, "beta": 2e-8}}
    coarse, fine = (sweep(brake(n, **damping), [0.8], modes=12) for n in (1, 2))
    changes, further = (refined_changes(s).modes[0] for s in (coarse, fine))
    true = np.sort(fine.points[0].modes.frequency_hz + 1.2 * further.imag / (2 * np.pi))
    check(coarse.points[0].modes, changes, true[:10], 2)
    a, b = (s.points[0].modes.lam for s in (coarse, fine))
    i, j = int(np.argmax(a.real)), int(np.argmax(b.real))
    assert b[j].imag == pytest.approx(a[i].imag, rel=0.01)  # the same mode on both meshes
    error = abs(b[j].real + 1.2 * further[j].real - a[i].real)
    assert error <= BARS[2] * abs(changes[i].real) <= 5 * error


@pytest.mark.slow
def test_belt_with_one_value_and_preload():
    """A single value, and a parameter that changes matrices: the bars of a block pressed on a belt."""
    tables = {
        "springs": [{"name": "x", "surface": "top", "direction": [1, 0, 0], "stiffness": 3e7},
                    {"name": "y", "surface": "top", "direction": [0, 1, 0], "stiffness": 3e7}],
        "contacts": [
            {"name": "c", "surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e12, "sliding": BELT}
        ],
        "effects": {"friction": {"mu": 0.3}, "preload": {"pressures": {"top": 1e6}}},
    }  # fmt: skip
    problem, fine = (make_problem(box("hex1", n, (0.1, 0.05, 0.05)), 2, **tables) for n in ((3, 2, 2), (6, 4, 4)))
    better = {mu: frequencies(fine, 8, mu=mu) for mu in (0.1, 0.2, 0.3)}
    for values in ([0.3], [0.1, 0.2, 0.3]):
        result = with_discretisation(sweep(problem, values, modes=8))
        for point in result.points:
            change = np.abs(better[point.value] - point.modes.frequency_hz)
            bars = point.discretisation.imag / (2 * np.pi)
            assert (change <= bars).all() and np.median(bars / change) < 3


def test_matrices_have_no_mesh():
    problem = make_problem(box("hex1", (2, 1, 1)), 1)
    bare = Problem(problem.terms, problem.parameters)
    with pytest.raises(SceneError, match="instead of a mesh"):
        with_discretisation(sweep(bare, [0.0], modes=7))


def test_bars_hold_where_a_clamp_ends_in_a_notch():
    """Errors fall with the power 0.55 there (a right angle inside 270 degrees of steel), not with 1.

    Refined values are extrapolated with that power, and the bars of the coarsest mesh have to reach them. The clamp is
    a node set, as in decks.
    """
    found = []
    tables = {"materials": {"steel": STEEL}, "bodies": {"block": {"material": "steel"}}}
    tables["supports"] = [{"nodes": "held", "fixed": "xyz"}]
    scene = parse_scene({"mesh": {"file": "none.msh", "order": 2}, **tables})
    for cells in (2, 4, 8):
        whole = box("hex1", (cells, 1, cells), (0.06, 0.02, 0.06))
        centre = whole.p[:, whole.t].mean(axis=1)
        angular = whole.restrict(np.flatnonzero(~((centre[0] > 0.03) & (centre[2] > 0.03))))
        named = angular.with_subdomains({"block": np.arange(angular.nelements)})
        loaded = from_skfem(named)
        p = loaded.mesh.p
        held = np.flatnonzero((np.abs(p[0] - 0.03) < 1e-9) & (p[2] > 0.03 - 1e-9))
        loaded = replace(loaded, node_groups={"held": NodeSet(held, held)})
        found.append(sweep(assemble(scene, loaded), [0.0], modes=4))
    omega = np.array([r.points[0].modes.lam.imag for r in found])
    exact = omega[2] + (omega[2] - omega[1]) / (2**0.55 - 1)
    bars = with_discretisation(found[0]).points[0].discretisation.imag
    assert (np.abs(exact - omega[0]) <= bars).all()
    assert (np.abs(exact - omega[0])[:2] > bars[:2] / NOTCHED).any()


@pytest.mark.slow
@pytest.mark.parametrize("end", [0.0225, 0.0275])
def test_bars_hold_where_the_counterface_ends_within_facets_of_the_pad(end):
    """Two facets of 20 mm, of which one hangs over the end of a plate by 17.5 or 12.5 mm.

    Where points of a rule for smooth functions alone tell the area in contact, it is off on the mesh and on the refined
    one, and no bar knows. On the fine mesh the plate ends between facets.
    """
    def swept(n, m):
        pad = box("hex1", (n, m, m), (0.04, 0.02, 0.01), (0, 0, 0.01), name="pad")
        plate = box("hex1", (3 * n // 2, m, m), (0.06, 0.02, 0.01), (end - 0.06, 0, 0), name="plate")
        problem = make_problem(
            join(pad, plate), materials={"lining": {"youngs_modulus": 2e9, "poisson_ratio": 0.3, "density": 2600.0}},
            supports=[{"surface": "bottom_plate", "fixed": "xyz"}], effects={"friction": {"mu": 0.1}},
            springs=[{"name": a, "surface": "top_pad", "direction": e, "stiffness": k}
                     for a, e, k in zip("xyz", np.eye(3).tolist(), (1e7, 1e7, 1e5), strict=True)],
            contacts=[{"surface": "bottom_pad", "counterface": "top_plate", "normal_stiffness": 2e10, "sliding": BELT}],
        )  # fmt: skip
        return sweep(problem, [0.1], modes=6)

    coarse, fine = swept(2, 1), swept(16, 2)
    error = np.abs((fine.points[0].modes.lam - coarse.points[0].modes.lam).imag)
    bars = with_discretisation(coarse).points[0].discretisation.imag
    assert (error <= bars).all() and np.median(bars / error) < 3
