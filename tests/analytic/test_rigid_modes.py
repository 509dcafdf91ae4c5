"""Free bodies: six rigid modes each, at zero to rounding, in any units and for every element."""

from __future__ import annotations

import dataclasses
import gc
import weakref

import numpy as np
import pytest
from selection import crossed, some

from fe_squeal.problem.forms import collect_powers
from meshes import KINDS, STEEL, annulus, box, distorted, join, make_problem, modes_of, rigid_motions

SIDE = 0.1
# Units of length, mass, time in m, kg, s: SI, mm-t-s, micrometre-gram-ms, km-Gt-h.
UNITS = {"si": (1, 1, 1), "mm_t_s": (1e-3, 1e3, 1), "um_g_ms": (1e-6, 1e-3, 1e-3), "km_gt_h": (1e3, 1e12, 3600)}


def steel_in(length, mass, time):
    """Young's modulus (mass / length time²) and density (mass / length³) in other units."""
    return {
        "youngs_modulus": STEEL["youngs_modulus"] * length * time**2 / mass,
        "poisson_ratio": STEEL["poisson_ratio"],
        "density": STEEL["density"] * length**3 / mass,
    }


def lame_hz(side):
    """Lamé mode of a free cube, exact: u = (cos κx sin κy, −sin κx cos κy, 0), κ = π/a, without volume change.

    ε_xx ∝ sin sin and σ_xy = 0, so no face is loaded; ω = √2 κ c_s. The three planes make it threefold.
    """
    c_s = np.sqrt(STEEL["youngs_modulus"] / (2 * (1 + STEEL["poisson_ratio"])) / STEEL["density"])
    return c_s / (np.sqrt(2) * side)


@pytest.mark.parametrize(
    ("kind", "n", "units"),  # 375 unknowns go to LAPACK, 2187 to ARPACK
    [
        *crossed(KINDS, [2], UNITS, fast=lambda kind, n, units: units in ("si", [*UNITS][KINDS.index(kind)])),
        *crossed(KINDS, [4], ["si"], fast=lambda kind, *_: kind == "hex2"),
        *crossed(["tet2"], [4], [u for u in UNITS if u != "si"], fast=lambda *_: False),
    ],
)
def test_free_body(kind, n, units):
    """λ = 0 for six modes, all marginal; the Lamé triple within 0.4 / n² (measured 7 % and 1 % on tetrahedra)."""
    length, mass, time = UNITS[units]
    mesh = box(kind, (n, n, n), (SIDE / length,) * 3)
    modes = modes_of(make_problem(mesh, materials={"steel": steel_in(length, mass, time)}), 24)
    assert (modes.lam[:6] == 0).all()
    assert (modes.lam[6:].imag > 0).all()
    assert (modes.lam.real == 0).all()
    assert set(modes.stability) == {"marginal"}
    f = np.sort(np.abs(modes.frequency_hz / time / lame_hz(SIDE) - 1))
    assert f[2] < 0.4 / n**2


@pytest.mark.parametrize("kind", some(KINDS, lambda kind: kind == "tet2"))
def test_two_free_bodies(kind):
    """Twelve rigid modes of two bodies that touch without a contact; their elastic modes are those of each alone."""
    pad, belt = box(kind, (3, 3, 3), (SIDE,) * 3), box(kind, (3, 3, 3), (SIDE,) * 3, (0, 0, -SIDE), name="belt")
    modes = modes_of(make_problem(join(pad, belt)), 20)
    alone = modes_of(make_problem(pad), 10)
    assert (modes.lam[:12] == 0).all()
    np.testing.assert_allclose(modes.frequency_hz[12:20:2], alone.frequency_hz[6:10], rtol=1e-9)
    np.testing.assert_allclose(modes.frequency_hz[13:20:2], alone.frequency_hz[6:10], rtol=1e-9)


@pytest.mark.parametrize(("other", "turns"), [((1, 1, 1), 3), ((0, 1, 1), 1), ((0, 0, 1), 0)])
@pytest.mark.parametrize(("kind", "order"), [("hex1", 1), ("tet1", 2)])
def test_blocks_that_share_a_point_a_line_or_a_face(kind, order, other, turns):
    """A ball joint leaves three rotations of one against the other, a hinge one: as many zeros as K has."""
    whole = box(kind, (2, 2, 2), (SIDE,) * 3)
    octant = (whole.p[:, whole.t].mean(axis=1) > SIDE / 2).T
    both = (octant == 0).all(axis=1) | (octant == other).all(axis=1)
    mesh = whole.restrict(np.flatnonzero(both)).with_boundaries({"end": lambda x: x[2] < 1e-9})
    mesh = mesh.with_subdomains({"block": np.arange(mesh.nelements)})
    for supports, whole_motions in (([], 6), ([{"surface": "end", "fixed": "xyz"}], 0)):
        problem = make_problem(mesh, order=order, supports=supports)
        stiff = np.linalg.eigvalsh(problem.pencil().K.toarray())
        found = problem.free_motions().motions
        assert np.count_nonzero(np.abs(stiff) < 1e-9 * stiff[-1]) == whole_motions + turns == found.shape[1]
        assert np.linalg.matrix_rank(found) == found.shape[1]
        assert problem.is_held() == (not found.shape[1])


@pytest.mark.parametrize("kind", ["hex1", "tet1"])
def test_rigid_modes_of_distorted_order_one(kind):
    """Linear displacements on straight, distorted cells carry all rigid motions."""
    mesh = distorted(box(kind, (5, 5, 5), (SIDE,) * 3), 0.15 * SIDE / 5)
    modes = modes_of(make_problem(mesh, order=1), 10)
    assert (modes.lam[:6] == 0).all()
    assert (modes.lam[6:].imag > 0).all()


def test_rigid_shapes_span_the_rigid_motions():
    """The six modes at zero are rigid motions: their M-projection on these changes nothing."""
    problem = make_problem(box("hex2", (4, 4, 4), (SIDE,) * 3))
    modes = modes_of(problem, 6)
    M = problem.pencil().M
    R = rigid_motions(problem)
    gram = R.T @ (M @ R)
    projected = R @ np.linalg.solve(gram, R.T @ (M @ modes.right))
    np.testing.assert_allclose(projected, modes.right, atol=1e-6 * np.abs(modes.right).max())


def test_order_one_on_curved_cells_keeps_rigid_motions():
    """`order = 1` with a file of quadratic cells must give six rigid modes too (curved, a turn would have 473 Hz)."""
    modes = modes_of(make_problem(annulus("hex2", (2, 12, 1), 0.1, 0.2, 0.02), order=1), 8)
    assert np.abs(modes.lam[:6]).max() < 1e-4 * modes.lam[7].imag


def test_free_ring():
    """An undamped symmetric problem has nothing unstable: six zeros, however small the gaps between them come out."""
    modes = modes_of(make_problem(annulus("hex1", (2, 12, 1), 0.1, 0.2, 0.02), order=1), 10)
    assert (modes.lam[:6] == 0).all()
    assert set(modes.stability) == {"marginal"}


def test_doublets_are_as_uncertain_as_single_modes():
    """A doublet of a symmetric pencil moves by the perturbation itself, so it is no surer than its neighbours."""
    ring = annulus("hex2", (2, 16, 1), 0.1, 0.2, 0.02)
    modes = modes_of(make_problem(ring, supports=[{"surface": "hub", "fixed": "xyz"}]), 6)
    assert modes.re_uncertainty[1] > 0.1 * modes.re_uncertainty[0]  # n = 0 and n = 1 at 1604 and 1624 Hz


ON_ROLLERS = [{"surface": "bottom", "fixed": "z"}]
GUIDED = [{"surface": "left", "fixed": "yz"}, {"surface": "right", "fixed": "yz"}]
SOFT_SPRING = [{"name": "soft", "surface": "top", "direction": [0, 0, 1], "stiffness": 1e-3}]  # 1e-13 of the body's own


@pytest.mark.parametrize("away", [0.0, 1e3], ids=["", "far from the origin"])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("tables", "free"),
    [({}, 6), ({"supports": ON_ROLLERS}, 3), ({"supports": GUIDED}, 1), ({"springs": SOFT_SPRING}, 3)],
    ids=["free", "on rollers", "guided", "soft spring"],
)
def test_motions_that_nothing_holds_are_known_by_geometry(kind, tables, free, away):
    """Six less what supports and springs hold, however soft: of the free motions all forces are rounding."""
    problem = make_problem(box(kind, (2, 2, 2), (SIDE,) * 3, (away,) * 3), **tables)
    pencil = problem.pencil()
    Z = pencil.free.motions
    assert Z.shape == (problem.unknowns, free)
    assert np.linalg.matrix_rank(Z) == free
    # Coordinates of 1 km are rounded to 1e-13 m, 1e-12 of a cell.
    assert np.abs(pencil.K @ Z).max() <= 1e-11 * abs(pencil.K).sum(axis=1).max() * np.abs(Z).max()


def test_parts_of_a_mesh_move_by_themselves():
    """Bodies that share nodes are one part, bodies that do not are two, and so are islands of one body."""
    one, other = box("hex2", (2, 2, 2), (SIDE,) * 3), box("hex2", (2, 2, 2), (SIDE,) * 3, (0, 0, -SIDE), name="belt")
    assert make_problem(join(one, other)).free_motions().motions.shape[1] == 12
    halves = {"low": np.arange(4), "high": np.arange(4, 8)}
    glued = dataclasses.replace(one, _subdomains=halves)
    assert make_problem(glued).free_motions().motions.shape[1] == 6
    islands = dataclasses.replace(join(one, other), _subdomains={"both": np.arange(16)})
    assert make_problem(islands).free_motions().motions.shape[1] == 12


def test_a_parameter_that_vanishes_frees_what_it_held():
    """At stiffness 0 the spring holds nothing: three motions more are free there, and only there."""
    problem = make_problem(box("hex1", (2, 2, 2), (SIDE,) * 3), order=1, springs=[{**SOFT_SPRING[0], "stiffness": 1e6}])
    stiffness = "springs.soft.stiffness"
    assert [problem.at({stiffness: k}).free_motions().motions.shape[1] for k in (1e6, 0.0, 1e3)] == [3, 6, 3]
    swept = collect_powers(problem.prepared(stiffness, np.array([0.0, 1e6])), stiffness)
    assert [swept.at({stiffness: k}).pencil().free.motions.shape[1] for k in (0.0, 1.0)] == [6, 3]


@pytest.mark.parametrize("held", [True, False])
def test_terms_of_a_held_body_are_let_go_when_collected(held):
    """Where supports hold a body whatever the spring's stiffness, no motion is free at any, and nobody asks the terms
    again, which are as large as their sums. Else they are asked: the spring may be gone at one value."""
    stiffness = "springs.soft.stiffness"
    problem = make_problem(
        box("hex1", (2, 2, 2), (SIDE,) * 3), order=1, springs=[{**SOFT_SPRING[0], "stiffness": 1e6}],
        supports=[{"surface": "left", "fixed": "xyz"}] if held else [],
    )  # fmt: skip
    assert problem.is_held([stiffness]) == held
    prepared = problem.prepared(stiffness, np.array([0.0, 1e6]))
    terms = tuple(dataclasses.replace(t, matrix=t.matrix.copy()) for t in prepared.terms)
    own = dataclasses.replace(prepared, terms=terms, source=None)
    kept = weakref.ref(max((t.matrix for t in terms if t.slot == "K"), key=lambda A: A.nnz))
    swept = collect_powers(own, stiffness)
    free = [swept.at({stiffness: k}).pencil().free.motions.shape[1] for k in (0.0, 1.0)]
    assert free == ([0, 0] if held else [6, 3])
    del own, terms
    gc.collect()
    assert (kept() is None) == held
