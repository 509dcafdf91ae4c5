"""Boundaries of stability whose equations are known: coalescence, Hopf points, a cusp, an island between the lines."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from selection import some

from fe_squeal.eigen.dense import solve_dense
from fe_squeal.errors import SceneError
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.study.boundary import Boundary, Scaled
from fe_squeal.study.islands import Stiffness, _minima
from fe_squeal.study.map import stability_map
from fe_squeal.study.scatter import scatter
from fe_squeal.study.seeds import point_near, seeds_on_lines
from meshes import BELT, box, make_problem
from tests.studies import STIFFNESS, two_modes


def axis(parameter, low, high, points=5, **more):
    return {"parameter": parameter, "from": low, "to": high, "points": points, **more}


def problem_of(values, **matrices):
    """K of matrices that count with parameters of their names, beside "always", and M = 1."""
    n = len(next(iter(matrices.values())))
    terms = [Term("m", "M", sp.csr_array(np.eye(n)), True)]
    for name, A in matrices.items():
        powers = {} if name == "always" else {name: 1}
        terms.append(Term(name, "K", sp.csr_array(np.asarray(A, float)), bool((np.transpose(A) == A).all()), powers))
    return Problem(tuple(terms), values)


def test_two_modes_flutter_where_the_gap_is_less_than_twice_the_coupling():
    found = stability_map(two_modes(), axis("mu", 0.01, 0.2, 3), axis("delta", 0.01, 0.3, 3, scale="log"), modes=2)
    curve = found.boundaries
    assert set(curve["curve"]) == {1} and set(curve["kind"]) == {"flutter"}
    assert curve["y"].to_numpy() == pytest.approx(2 * curve["x"].to_numpy(), rel=1e-12)
    theta = STIFFNESS * (1 + curve["y"] / 2)
    assert curve["frequency_hz"].to_numpy() == pytest.approx(np.sqrt(theta) / (2 * np.pi), rel=1e-12)
    assert curve["uncertainty"].max() < 1e-9
    # from edge to edge of the box, without gaps
    assert curve[["x", "y"]].iloc[[0, -1]].min().to_numpy() == pytest.approx([0.01, 0.02])
    assert curve[["x", "y"]].iloc[[0, -1]].max().to_numpy() == pytest.approx([0.15, 0.3])
    grid = found.grid
    assert (grid["unstable"].to_numpy() == (grid["y"] < 2 * grid["x"] - 1e-12).to_numpy()).all()
    assert found.told == []


@pytest.mark.slow
def test_hopf_curve_of_two_damped_modes():
    """With C = c √k the Hopf points of θ = a ± ib are at b² = c²k a: μ² − δ²/4 = c² (1 + δ/2)."""
    c = 0.02
    found = stability_map(two_modes(damping=c), axis("mu", 0.01, 0.1, 6), axis("delta", 0.0, 0.15, 6), modes=2)
    x, y, hz = found.boundaries[["x", "y", "frequency_hz"]].to_numpy().T
    assert found.boundaries["curve"].nunique() == 1 and found.told == []
    assert x**2 - y**2 / 4 == pytest.approx(c**2 * (1 + y / 2), rel=1e-9)
    assert hz == pytest.approx(np.sqrt(STIFFNESS * (1 + y / 2)) / (2 * np.pi), rel=1e-9)
    grid = found.grid
    assert (grid["unstable"] == (grid["x"] ** 2 - grid["y"] ** 2 / 4 > c**2 * (1 + grid["y"] / 2))).all()


def test_what_an_error_does_to_a_hopf_curve():
    """An error δ of ψᴴQφ, of any phase, moves each of the two numbers alone by |δ|/slope at most, the largest of many
    phases, where λ may move along the axis."""
    problem = two_modes(damping=0.02)
    found = stability_map(problem, axis("mu", 0.01, 0.1, 4), axis("delta", 0.0, 0.15, 4), modes=2)
    phases = np.exp(1j * np.linspace(0, np.pi, 2001))
    [curve] = found.curves
    for point in curve.points[::5]:
        mu, delta = curve.boundary.place(point.u)
        pencil, lam = problem.pencil({"mu": mu, "delta": delta}), curve.boundary.eigenvalue(point.u)
        unit = abs(pencil.K + lam * pencil.C + lam**2 * pencil.M).max()  # F is ψᴴQφ in this unit
        for k, slope in enumerate(point.residual.slopes):
            moved = np.linalg.solve(point.residual.J[:, [0, 1 + k]], np.stack([phases.real, phases.imag]) / unit)[1]
            assert np.abs(moved).max() == pytest.approx(1 / slope, rel=1e-5)


def three_modes():
    """Return K with the eigenvalues θ = 10 + t, t³ + pt + q = 0."""
    low, shift = np.zeros((3, 3)), np.diag([1.0, 1.0], 1) + 10 * np.eye(3)
    p, q = low.copy(), low.copy()
    p[2, 1], q[2, 0] = -1.0, -1.0
    return problem_of({"p": -0.1, "q": 0.01}, always=shift, p=p, q=q)


def test_verdicts_around_a_cusp():
    box = {"p": {"uniform": {"low": -0.5, "high": 0.1}}, "q": {"uniform": {"low": -0.1, "high": 0.12}}}
    found = scatter(three_modes(), box, samples=256, modes=3, indices=False)
    p, q = found.points.T
    assert (found.samples["unstable"] == (4 * p**3 + 27 * q**2 > 0)).all()
    # Stable is what lies between both branches, |q| < √(4|p|³/27), as far as it is in the box.
    p = np.linspace(-0.5, 0.0, 10_001)
    half = np.sqrt(4 * -(p**3) / 27)
    stable = np.mean(np.minimum(half, 0.12) + np.minimum(half, 0.1)) * 0.5 / (0.6 * 0.22)
    assert found.bands["lower"].iloc[-1] < 1 - stable < found.bands["upper"].iloc[-1]
    assert found.probability == pytest.approx(1 - stable, abs=0.015)


@pytest.mark.slow
def test_the_curve_turns_at_a_cusp_where_three_modes_meet():
    """θ = 10 + t with t³ + pt + q = 0: two of three meet where 4p³ + 27q² = 0, all three at p = q = 0."""
    found = stability_map(three_modes(), axis("p", -0.5, 0.1), axis("q", -0.1, 0.12), modes=3)
    curve = found.boundaries
    assert curve["curve"].nunique() == 1
    x, y = curve[["x", "y"]].to_numpy().T
    assert 4 * x**3 + 27 * y**2 == pytest.approx(np.zeros(len(x)), abs=1e-9)
    near = np.argmin(np.abs(x))
    assert 0 < near < len(x) - 1 and abs(x[near]) < 1e-2 and np.sign(y[0]) == -np.sign(y[-1])
    assert x.max() < 1e-9  # none beyond the cusp


@pytest.mark.slow
def test_an_island_that_no_line_meets_is_found():
    """θ = 1 ± √((x − x₀)² + (y − y₀)² − r²): flutter inside a circle between the lines of the grid."""
    x0, y0, r = 0.47, 0.33, 0.04
    always = np.array([[1 + x0, r - y0], [-r - y0, 1 - x0]])
    x, y = np.diag([-1.0, 1.0]), np.array([[0.0, 1.0], [1.0, 0.0]])
    problem = problem_of({"x": 0.0, "y": 0.0}, always=3 * np.eye(2) + always, x=x, y=y)
    found = stability_map(problem, axis("x", 0.0, 1.0, 6), axis("y", 0.0, 1.0, 6), modes=2)
    assert not found.grid["unstable"].any()
    curve = found.boundaries
    assert curve["curve"].nunique() == 1 and found.curves[0].closed
    assert np.hypot(curve["x"] - x0, curve["y"] - y0).to_numpy() == pytest.approx(np.full(len(curve), r), rel=1e-9)
    angle = np.unwrap(np.arctan2(curve["y"] - y0, curve["x"] - x0))
    assert abs(angle[-1] - angle[0]) == pytest.approx(2 * np.pi)


def test_a_circle_that_leaves_the_box_ends_at_its_edges():
    """As the island, but met by lines of the grid, and cut by the edge x = 0."""
    x0, y0, r = 0.1, 0.5, 0.25
    always = np.array([[1 + x0, r - y0], [-r - y0, 1 - x0]])
    x, y = np.diag([-1.0, 1.0]), np.array([[0.0, 1.0], [1.0, 0.0]])
    problem = problem_of({"x": 0.0, "y": 0.0}, always=3 * np.eye(2) + always, x=x, y=y)
    curve = stability_map(problem, axis("x", 0.0, 1.0, 4), axis("y", 0.0, 1.0, 4), modes=2).boundaries
    assert curve["curve"].nunique() == 1 and curve["x"].max() == pytest.approx(x0 + r, abs=0.01)
    assert np.hypot(curve["x"] - x0, curve["y"] - y0).to_numpy() == pytest.approx(np.full(len(curve), r), rel=1e-9)
    ends = curve[["x", "y"]].iloc[[0, -1]].sort_values("y").to_numpy()
    half = np.sqrt(r**2 - x0**2)
    assert ends == pytest.approx(np.array([[0.0, y0 - half], [0.0, y0 + half]]), abs=1e-9)


@pytest.mark.parametrize("far", some([4.0, 1.0], lambda far: far == 1), ids=["apart", "same frequency"])
def test_curves_of_two_pairs_that_cross_are_both_followed(far):
    """Pairs with the gaps δ and 0.3 − δ: their curves δ = 2μ and 0.3 − δ = 2μ cross at δ = 0.15."""
    skew, zero = np.array([[0.0, 1.0], [-1.0, 0.0]]), np.zeros((2, 2))
    friction, gaps = np.block([[skew, zero], [zero, skew]]), np.diag([0.0, 1.0, 0.0, -1.0])
    values = {"mu": 0.05, "delta": 0.1}
    problem = problem_of(values, always=np.diag([1.0, 1.0, far, far + 0.3]), mu=friction, delta=gaps)
    curve = stability_map(problem, axis("mu", 0.01, 0.12, 4), axis("delta", 0.02, 0.28, 4), modes=4).boundaries
    assert curve["curve"].nunique() == 2
    off = [(g["y"] - 2 * g["x"], 0.3 - g["y"] - 2 * g["x"]) for _, g in curve.groupby("curve")]
    first, second = sorted((np.abs(a).max(), np.abs(b).max()) for a, b in off)
    assert first[0] < 1e-12 < first[1] and second[1] < 1e-12 < second[0]
    for _, g in curve.groupby("curve"):  # past the crossing, from edge to edge
        assert g["x"].min() == pytest.approx(0.01) and g["x"].max() == pytest.approx(0.12)


def test_divergence_is_followed():
    """K = [[1 − x, 0], [0, 2 + y]] loses its stiffness at x = 1."""
    problem = problem_of(
        {"x": 0.5, "y": 0.1}, always=np.diag([1.0, 2.0]), x=np.diag([-1.0, 0.0]), y=np.diag([0.3, 1.0])
    )
    found = stability_map(problem, axis("x", 0.5, 1.7, 4), axis("y", 0.1, 1.0, 4), modes=2)
    curve = found.boundaries
    assert set(curve["kind"]) == {"divergence"} and (curve["frequency_hz"] == 0).all()
    assert (curve["x"] - 0.3 * curve["y"]).to_numpy() == pytest.approx(np.ones(len(curve)), abs=1e-12)


@pytest.mark.parametrize(
    ("x", "message"),
    [
        (axis("mu", 0.3, 0.1), "from < to"),
        (axis("mu", 0.0, 0.1, scale="log"), "from > 0"),
        (axis("nu", 0.0, 0.1), "no parameter"),
    ],
)
def test_bad_input_is_told(x, message):
    with pytest.raises(SceneError, match=message):
        stability_map(two_modes(), x, axis("delta", 0.0, 0.3), modes=2)


@pytest.mark.slow
@pytest.mark.parametrize(("damping", "uneven"), [(1e-4, 0.3), (1e-3, 0.0)])
def test_an_island_with_light_damping_that_no_line_meets_is_found(damping, uneven):
    """Re λ is flat beside it and rises as a root at its edge, so that only the gap without damping has a minimum."""
    Z, X, J = np.diag([1.0, -1.0]), np.array([[0.0, 1.0], [1.0, 0.0]]), np.array([[0.0, 1.0], [-1.0, 0.0]])
    radius = 0.035
    parts = [("m", "M", np.eye(2), True, {}), ("k", "K", 4 * np.eye(2) - (Z + X) / 2, True, {}),
             ("f", "K", radius * J, False, {}), ("u", "K", Z, True, {"x": 1}), ("v", "K", X, True, {"y": 1}),
             ("c", "C", damping * np.diag([1.0, 1.0 + uneven]), True, {})]  # fmt: skip
    terms = tuple(Term(n, slot, sp.csr_array(A), sym, powers) for n, slot, A, sym, powers in parts)
    axes = ({"parameter": p, "from": 0.0, "to": stop, "points": 11} for p, stop in (("x", 1.03), ("y", 1.07)))
    found = stability_map(Problem(terms, {"x": 1.0, "y": 1.0}), *axes, modes=2)
    assert not (found.rows[:, 0] > 0).any()
    edge = found.boundaries
    assert len(found.curves) == 1
    away = np.hypot(edge["x"] - 0.5, edge["y"] - 0.5)
    assert len(edge) > 20 and (np.abs(away - radius) < 0.02 * radius).all()


@pytest.mark.slow
def test_flutter_of_a_conservative_system_is_not_followed_and_told():
    """Re λ is zero wherever nothing grows, so that it says nothing about the place of a boundary."""
    J = np.array([[0.0, 1.0], [-1.0, 0.0]])
    soft = sp.csr_array(-np.diag([1.0, 1.3]))
    terms = (
        Term("m", "M", sp.csr_array(np.eye(2)), True), Term("k", "K", soft, True, {"a": 1}),
        Term("g", "C", sp.csr_array(J), False, {"w": 1}, True),
    )  # fmt: skip
    axes = ({"parameter": p, "from": 0.1, "to": stop, "points": 9} for p, stop in (("w", 4.0), ("a", 2.0)))
    found = stability_map(Problem(terms, {"a": 1.0, "w": 1.0}), *axes, modes=2)
    assert all(c.boundary.kind == "divergence" for c in found.curves)
    assert sum("boundaries of flutter are not followed" in text for text in found.told) == 1


def test_no_boundary_is_found_where_all_stiffness_is_zero():
    """Newton's method for K = a K₀ ends at a = 0, where the bordered matrix is exactly zero or rounding."""
    problem = problem_of({"a": 1.0, "b": 1.0}, a=-np.diag([1.0, 1.3]), b=np.zeros((2, 2)))
    axes = Scaled("a", 0.0, 1.0), Scaled("b", 0.0, 1.0)
    first = np.array([1.0, 0.0])
    with pytest.raises(np.linalg.LinAlgError):
        Boundary(problem, axes, "divergence", 1.0, first, first).at(np.zeros(2))
    assert point_near(problem, axes, np.array([1e-3, 0.5]), 0.0, 1) is None


@pytest.mark.parametrize("half", some([0.004, 0.012, 0.03], lambda half: half == 0.012))
def test_both_sides_of_a_narrow_tongue_are_one_boundary(half):
    """θ = 4 ± √(d² − h²(x − x₀)) with d = y − y₀ − x/10: flutter between d = ± h√(x − x₀), from the tip at x₀ on."""
    x0, y0 = 0.13, 0.42
    always = np.diag([4 - y0, 4 + y0]) + np.array([[0.0, half], [half * x0, 0.0]])
    x = np.array([[-0.1, 0.0], [-half, 0.1]])
    problem = problem_of({"x": 0.0, "y": 0.0}, always=always, x=x, y=np.diag([1.0, -1.0]))
    found = stability_map(problem, axis("x", 0.0, 1.0, 6), axis("y", 0.0, 1.0, 8), modes=2)
    curve = found.boundaries
    assert curve["curve"].nunique() == 1 and found.told == [] and not found.curves[0].closed
    d = (curve["y"] - y0 - curve["x"] / 10).to_numpy()
    assert d**2 == pytest.approx(half**2 * (curve["x"] - x0).to_numpy(), abs=1e-12)
    assert sorted(d[[0, -1]]) == pytest.approx([-half * np.sqrt(1 - x0), half * np.sqrt(1 - x0)])
    assert curve["x"].iloc[[0, -1]].to_numpy() == pytest.approx(1.0)


def test_where_modes_cross_the_error_of_a_model_is_no_instability():
    """Coupled by 1e-7, as a reduced model may couple modes that are not: followed in an exact problem alone."""
    problem = problem_of(
        {"x": 0.1, "y": 0.0}, always=np.array([[1.5, 1e-7], [-1e-7, 2.5]]), x=np.diag([1.0, -1.0]),
        y=np.diag([0.3, -0.1]),
    )  # fmt: skip
    axes = (Scaled("x", 0.0, 1.0), Scaled("y", 0.0, 1.0))
    grids = (np.linspace(0.0, 1.0, 7), np.linspace(0.0, 1.0, 5))
    for blind, count in ((0.0, 2), (1e-9, 2), (1e-6, 0)):
        told = []
        seeds = list(seeds_on_lines(problem, axes, grids, 0, np.array([0.25]), 2, None, told.append, blind))
        assert len(seeds) == count and len(told) == (count == 0), blind
        assert [s[1].u[1] for s in seeds] == pytest.approx([0.45] * count, abs=1e-6)
    assert "taken for crossings" in told[0]


@pytest.mark.parametrize("damping", some([0.0, 0.05], bool))
@pytest.mark.parametrize("axes, centre", some(
    [((0.09, 0.09), (0.52, 0.47)), ((0.05, 0.03), (0.52, 0.47)), ((0.05, 0.05), (0.5, 0.5))],
    lambda axes, centre: axes[0] > axes[1],
))  # fmt: skip
def test_an_island_of_divergence_between_the_lines_of_the_grid(axes, centre, damping):
    """A stiffness that is negative inside an ellipse, which no line of the grid crosses; also one amid four nodes."""
    a, b, x, y = *axes, *centre

    def spring(name, value, powers):
        return Term(name, "K", sp.csr_array(np.diag([value, 0.0])), True, powers)

    terms = [Term("mass", "M", sp.eye_array(2, format="csr"), True),
             Term("elastic", "K", sp.csr_array(np.diag([x**2 / a**2 + y**2 / b**2 - 1, 9.0])), True),
             spring("xx", 1 / a**2, {"x": 2}), spring("x", -2 * x / a**2, {"x": 1}),
             spring("yy", 1 / b**2, {"y": 2}), spring("y", -2 * y / b**2, {"y": 1})]  # fmt: skip
    terms += [Term("damper", "C", sp.csr_array(damping * np.eye(2)), True)] if damping else []
    sides = [{"parameter": p, "from": 0.0, "to": 1.0, "points": 6} for p in "xy"]
    found = stability_map(Problem(tuple(terms), {"x": 0.1, "y": 0.1}), *sides, modes=2)
    assert not (found.grid["unstable"] > 0).any()
    edge = found.boundaries
    assert set(edge["kind"]) == {"divergence"} and edge["curve"].nunique() == 1 and len(edge) > 10
    np.testing.assert_allclose(((edge["x"] - x) / a) ** 2 + ((edge["y"] - y) / b) ** 2, 1.0, atol=1e-6)


@pytest.mark.parametrize("moves", [{}, {"x": 1}])
def test_islands_of_divergence_are_not_looked_for_where_stiffness_does_not_change(moves):
    """θ is the same all over the map, or along one of its axes: a plateau of minima, and no island in it."""
    one = sp.eye_array(2, format="csr")
    terms = (Term("mass", "M", one, True), Term("elastic", "K", sp.csr_array(np.diag([4.0, 9.0])), True),
             Term("spring", "K", one, True, moves),
             Term("first", "C", sp.csr_array(np.diag([1.0, 0.0])), True, {"x": 1}),
             Term("second", "C", sp.csr_array(np.diag([0.0, 1.0])), True, {"y": 1}))  # fmt: skip
    axes = (Scaled("x", 0.0, 1.0), Scaled("y", 0.0, 1.0))
    asked = []

    def modes_at(x, y):
        asked.append((x, y))
        return solve_dense(Problem(terms, {"x": x, "y": y}).pencil())

    side = np.linspace(0.1, 1.0, 5)
    search = Stiffness(axes, modes_at)
    assert not list(_minima(search, axes, (side, side))) and len(asked) == 25


def test_boundaries_over_a_damper_that_the_scene_has_at_zero():
    """Where it is zero the problem has no such term, and the boundaries need it."""
    pad = box("hex1", (2, 1, 1), (0.04, 0.03, 0.02))
    springs = [{"name": name, "surface": side, "direction": direction, "stiffness": 1e7, "damping": 0.0}
               for name, side, direction in (("abut", "right", [1, 0, 0]), ("guide", "front", [0, 1, 0]))]  # fmt: skip
    contact = {"surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e11, "sliding": BELT}
    problem = make_problem(pad, 1, springs=springs, contacts=[contact], effects={"friction": {"mu": 0.5}})
    found = stability_map(problem, axis("mu", 0.1, 1.5, 3), axis("springs.abut.damping", 0.0, 50.0, 3), modes=6)
    assert not any("not followed" in text for text in found.told)
