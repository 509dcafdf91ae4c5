"""Sweeps on a reduced model against dense solves of the whole problem: every mode, every value, every class."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from chains import CLASSES, MODES, N, chain, dense
from hard_problems import brake
from selection import some

import fe_squeal.reduced.begun as begun
import fe_squeal.reduced.places as reduced_places
from fe_squeal import assemble, parse_scene, sweep
from fe_squeal.eigen import blocks
from fe_squeal.eigen.block_lanczos import lowest_modes
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.errors import NotConvergedError, SceneError
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.reduced import ReducedModel
from fe_squeal.reduced.basis import ReducedBasis
from fe_squeal.reduced.missing import holds_all
from fe_squeal.reduced.vectors import unit_columns
from fe_squeal.sweep import solving

VALUES = np.linspace(0.0, 0.9, 7)


@pytest.mark.parametrize("kind", some(CLASSES, lambda kind: kind == "nonsymmetric"))
def test_every_mode_at_every_value(kind):
    """Within the tolerance, and within what the model itself says; none is missing below the highest."""
    problem = chain(*CLASSES[kind])
    if kind == "gyroscopic":  # the model alone: each onset of a sweep would be bisected, which takes seconds
        model = ReducedModel(problem, "mu", VALUES, Request(count=MODES))
        found = [(float(value), model.modes(float(value))) for value in VALUES]
    else:
        result = sweep(problem, VALUES, modes=MODES, method="reduced")
        assert result.method.startswith("reduced model of")
        found = [(point.value, point.modes) for point in result.points]
    assert len(found) >= len(VALUES)
    for value, modes in found:
        exact = dense(problem, value)
        assert len(modes) >= MODES
        distance = np.abs(modes.lam[:, None] - exact[None, :])
        assert (distance.min(axis=1) <= 1e-8 * np.abs(modes.lam)).all()
        # The dense reference has rounding of its own: n ε times the largest of all eigenvalues.
        rounding = N * np.finfo(float).eps * np.abs(exact).max()
        assert (distance.min(axis=1) <= modes.re_uncertainty + rounding).all()
        below = exact.imag < 0.999 * modes.lam.imag.max()
        assert np.count_nonzero(below) == np.count_nonzero(modes.lam.imag < 0.999 * modes.lam.imag.max())


@pytest.mark.parametrize("kind", some(["nonsymmetric", "quadratic", "complex"], lambda kind: kind == "nonsymmetric"))
def test_shapes_that_are_written_are_exact(kind):
    """A shape lifted from the basis has the backward error of its row; one that is written meets the tolerance."""
    problem = chain(*CLASSES[kind])
    result = sweep(problem, VALUES, modes=MODES, method="reduced", keep_shapes=True)
    point = result.points[-1]
    pencil, positions = problem.pencil({"mu": point.value}), list(range(len(point.modes)))
    shapes, errors = result.exact_shapes(point, positions)
    assert errors.max() <= 1e-8
    lifted = np.stack([point.shapes[i] for i in positions], axis=1)
    for vectors, said in ((shapes, errors), (lifted, point.modes.backward_error)):
        lam = point.modes.lam
        rest, size = (np.linalg.norm(x, axis=0) for x in (pencil.apply(lam, vectors), pencil.magnitude(lam, vectors)))
        np.testing.assert_allclose(rest / size, said, rtol=0.7, atol=1e-12)  # lifted ones are estimated by samples
    likeness = np.abs(np.einsum("ij,ij->j", shapes.conj(), lifted))
    assert (likeness >= (1 - 1e-6) * np.linalg.norm(shapes, axis=0) * np.linalg.norm(lifted, axis=0)).all()


def test_onsets_and_branches_are_those_of_direct_solves():
    problem = chain()
    reduced, direct = (sweep(problem, VALUES, modes=MODES, method=m) for m in ("reduced", "direct"))
    assert len(reduced.onsets) == len(direct.onsets) > 0
    for a, b in zip(reduced.onsets, direct.onsets, strict=True):
        assert a.value == pytest.approx(b.value, rel=1e-9)
        assert abs(a.value - b.value) <= a.uncertainty + b.uncertainty
        assert max(a.uncertainty / 100, b.uncertainty) <= 1e-9
        assert a.crossing_speed == pytest.approx(b.crossing_speed, rel=1e-6)
        assert (a.kind, a.direction, a.branch_a, a.branch_b) == (b.kind, b.direction, b.branch_a, b.branch_b)
    assert reduced.warnings == direct.warnings
    for a, b in zip(reduced.points, direct.points, strict=True):
        np.testing.assert_array_equal(a.branches, b.branches)
        np.testing.assert_array_equal(a.modes.stability, b.modes.stability)


@pytest.mark.slow
def test_reports_are_those_of_direct_solves():
    """Shares and sensitivities come from the small matrices, shapes from the basis."""
    problem = chain("damper")
    reduced, direct = (sweep(problem, VALUES, modes=MODES, method=m) for m in ("reduced", "direct"))
    for name in ("contributions_dataframe", "sensitivities_dataframe"):
        a, b = getattr(reduced, name)(), getattr(direct, name)()
        assert len(a) == len(b) > 0
        numbers = a.select_dtypes(float).columns
        np.testing.assert_allclose(a[numbers], b[numbers], rtol=1e-5, atol=1e-9)
    for a, b in zip(reduced.points, direct.points, strict=True):
        for i, u in a.shapes.items():
            v = b.shapes[i]
            assert u.shape == (N,)
            assert abs(np.vdot(u, v)) == pytest.approx(np.linalg.norm(u) * np.linalg.norm(v), rel=1e-8)


def with_pair(problem, low, high, *, theta=0.04):
    """Add two oscillators of θ ± √((μ − low)(μ − high)) θ and no other tie."""

    def joined(A, B):
        return sp.csr_array(sp.block_diag([A, B]))

    none, one = np.zeros((2, 2)), np.eye(2)
    own = {"mass": one, "elastic": theta * one + theta * np.array([[0.0, 0.0], [1.0, 0.0]]), "damper": 1e-5 * one}
    terms = [
        Term(t.name, t.slot, joined(t.matrix, own.get(t.name, none)), t.symmetric and t.name != "elastic", t.powers)
        for t in problem.terms
    ]
    upper = joined(sp.csr_array((problem.unknowns,) * 2), theta * np.array([[0.0, 1.0], [0.0, 0.0]]))
    for power, c in ((0, low * high), (1, -low - high), (2, 1.0)):
        terms.append(Term(f"pair{power}", "K", upper * c, False, {"mu": power}))
    return Problem(tuple(terms), problem.parameters)


@pytest.mark.parametrize(
    "effects", [(), pytest.param(("damper",), marks=pytest.mark.slow)], ids=["nonsymmetric", "quadratic"]
)
def test_pair_that_couples_and_parts_within_one_step(effects):
    problem = with_pair(chain(*effects), 0.35, 0.55)
    values = np.linspace(0.0, 0.9, 4)  # nothing of it shows at 0.3 and 0.6
    result = sweep(problem, values, modes=MODES, method="reduced")
    pair = [o for o in result.onsets if abs(2 * np.pi * o.frequency_hz - 0.2) < 1e-3]
    assert [o.direction for o in pair] == ["into", "out of"]
    assert [o.value for o in pair] == pytest.approx([0.35, 0.55], abs=1e-8 if not effects else 1e-4)
    assert result.method.startswith("reduced")


@pytest.mark.slow
def test_values_asked_for_later_reuse_the_model():
    problem = chain()
    model = ReducedModel(problem, "mu", VALUES, Request(count=MODES))
    before = model.factorizations, model.solves
    for mu in np.random.default_rng(1).uniform(0.0, 0.9, 12):
        lam = model.modes(float(mu)).lam
        assert np.abs(lam[:, None] - dense(problem, mu)[None, :]).min(axis=1).max() <= 1e-8 * np.abs(lam).min()
    assert (model.factorizations, model.solves) == before
    # Fewer factorisations than values, and a basis much smaller than the problem
    assert model.factorizations < len(VALUES) and len(model.basis) < N / 2


@pytest.mark.parametrize("factor", [1 - 1e-9, 1.0, 1 + 1e-9])
def test_modes_are_counted_however_the_highest_one_is_rounded(factor):
    """Beyond it the basis has a value that is no mode: nothing is counted between the two."""
    pencil = Pencil(sp.eye_array(20, format="csr"), sp.diags_array(np.arange(1.0, 21.0)).tocsr(), symmetric=True)
    held = np.append(np.arange(1.0, 9.0), 15.0)
    assert holds_all(held, np.sqrt(8.0) * factor, pencil, "auto")
    assert holds_all(np.delete(held, 2), np.sqrt(8.0) * factor, pencil, "auto") is False
    assert holds_all(np.array([8.0, 15.0]), np.sqrt(8.0) * factor, pencil, "auto") is None


def test_a_mode_that_the_basis_misses_is_found(monkeypatch):
    """A mass on a spring of its own, of which residuals of the other modes know nothing; it has to be looked for."""
    n = N + 1
    terms = [
        Term(t.name, t.slot, sp.csr_array(sp.block_diag([t.matrix, sp.csr_array([[own]])])), t.symmetric, t.powers)
        for t, own in zip(chain().terms, (1.0, 0.04, 0.0, 0.0), strict=True)
    ]  # fmt: skip
    problem = Problem(tuple(terms), {"mu": 0.3})

    def forgetful(*arguments):
        theta, vectors = lowest_modes(*arguments)
        others = np.abs(vectors[-1]) < 1e-3
        assert np.count_nonzero(~others) == 1
        return theta[others], vectors[:, others]

    monkeypatch.setattr(begun, "lowest_modes", forgetful)
    model = ReducedModel(problem, "mu", VALUES, Request(count=MODES))
    for mu in (0.0, 0.45, 0.9):
        modes = model.modes(mu)
        own = np.flatnonzero(np.abs(modes.lam - 0.2j) < 1e-9)
        assert len(own) == 1 and n == len(model.lift(modes.right))
        exact = dense(problem, mu)
        assert np.count_nonzero(exact.imag < 0.999 * modes.lam.imag.max()) == np.count_nonzero(
            modes.lam.imag < 0.999 * modes.lam.imag.max()
        )


def test_onsets_of_the_small_model_tell_how_far_they_are_off():
    """Newton's method on the problem itself is left out: the error lies inside the bar."""
    problem = chain()
    exact = sweep(problem, VALUES, modes=MODES, method="direct").onsets
    found = sweep(problem, VALUES, modes=MODES, method="reduced").onsets
    assert len(found) == len(exact) > 0
    for a, b in zip(found, exact, strict=True):
        assert a.value == pytest.approx(b.value, rel=1e-9)
        assert abs(a.value - b.value) <= a.uncertainty + b.uncertainty
        assert a.uncertainty <= 1e-7 * a.value


def test_modal_projection_tells_its_error():
    """The usual projection misses by percents; its estimate is of that size, and it is told."""
    problem = chain()
    result = sweep(problem, VALUES, modes=MODES, method="modal")
    assert any("modal projection" in d for d in result.warnings)
    assert result.method.startswith("modal projection on")
    model = ReducedModel(problem, "mu", VALUES, Request(count=MODES), modal=True)
    errors = []
    for mu in VALUES[1:]:
        lam = model.modes(float(mu)).lam
        errors.append((np.abs(lam[:, None] - dense(problem, mu)[None, :]).min(axis=1) / np.abs(lam)).max())
    assert 1e-5 < max(errors) <= model.worst < 1e3 * max(errors)


def test_modal_projection_keeps_its_own_onsets_and_tells_their_errors():
    """They are those of the projected problem, solved by itself; the true ones are within their uncertainties."""
    problem = brake()
    values = np.linspace(0.0, 0.9, 13)
    modal = sweep(problem, values, modes=30, method="modal")
    alone = sweep(modal.reduced_model.projected, values, modes=30, method="direct")
    assert len(modal.onsets) >= 3 and all("is uncertain by" in told for told in modal.unsettled)
    assert [o.value for o in modal.onsets] == pytest.approx([o.value for o in alone.onsets], rel=1e-7)
    exact = sweep(problem, values, modes=30, method="reduced").onsets
    for onset in exact:
        found = min(modal.onsets, key=lambda o: abs(o.frequency_hz - onset.frequency_hz))
        assert 1e-5 < abs(found.value - onset.value) <= found.uncertainty


@pytest.mark.parametrize("tolerance", some([1e-4, 1e-3, 1e-2], lambda tolerance: tolerance == 1e-2))
def test_a_loose_tolerance_loses_no_onset(tolerance):
    """Errors of λ may exceed growth rates, but do not make modes unstable and stable by turns. Onsets are made exact
    one by one, and one that this moves out of the sweep is told."""
    values = np.linspace(0.0, 0.9, 13)
    exact, loose = (sweep(brake(), values, modes=30, method="reduced", tolerance=t) for t in (1e-8, tolerance))
    assert len(exact.reduced_model.basis) > len(loose.reduced_model.basis)
    assert len(exact.onsets) == 5 and not loose.unsettled
    assert [o.value for o in loose.onsets] == pytest.approx([o.value for o in exact.onsets], rel=1e-7)
    assert [o.direction for o in loose.onsets] == [o.direction for o in exact.onsets]
    assert all("0.91646682 and not listed: it lies outside of the sweep" in w for w in loose.warnings)
    assert bool(loose.warnings) == (tolerance == 1e-2)
    for point in loose.points:  # whose modes tell the errors of the projection
        lam = exact.reduced_model.modes(point.value).lam
        off = np.abs(point.modes.lam[:, None] - lam).min(axis=1)
        assert (off <= point.modes.re_uncertainty + 1e-8 * np.abs(point.modes.lam)).all()
    assert loose.points[-1].modes.re_uncertainty.max() > 1e-7 * np.abs(lam).max()


def test_an_onset_that_a_modal_projection_hardly_knows_is_told():
    """One is uncertain by more than the sweep is long; the result does not count as settled."""
    result = sweep(brake(), np.linspace(0.0, 0.9, 13), modes=30, method="modal")
    vague = [o for o in result.onsets if o.uncertainty > 0.9]
    assert vague and len(result.unsettled) >= len(vague)
    assert all(f"the onset at mu = {o.value:.5g} is uncertain by" in " ".join(result.unsettled) for o in vague)


def test_a_parameter_that_changes_matrices_cannot_be_reduced():
    with pytest.raises(SceneError, match="speed"):
        sweep(chain(), VALUES, "speed", method="reduced")


@pytest.mark.slow
def test_a_tolerance_out_of_reach_is_an_error():
    with pytest.raises(NotConvergedError, match="tolerance"):
        sweep(chain(n=130), VALUES, modes=MODES, method="reduced", tolerance=1e-17)


@pytest.mark.slow
@pytest.mark.parametrize(
    "effects", [("damper",), ("loss", "damper")], ids=["quadratic", "complex"]
)
def test_modes_of_damped_problems_are_counted(effects, monkeypatch):
    """By the inertia without damping and friction; a basis that lacks one of its modes does not pass."""
    problem = chain(*effects)
    result = sweep(problem, VALUES + 0.1, modes=MODES, method="reduced")
    c = result.completeness
    assert c.found == c.expected == len(result.points[0].modes) and not c.proven
    undamped_values = ReducedBasis.undamped_values
    monkeypatch.setattr(ReducedBasis, "undamped_values", lambda *a: np.delete(undamped_values(*a), 3))
    with pytest.raises(NotConvergedError, match="inertia"):
        sweep(problem, VALUES + 0.1, modes=MODES, method="reduced")


@pytest.mark.slow
def test_threads_and_seeds_do_not_matter(monkeypatch):
    """Within the uncertainties that the results carry. Work is sliced from fewer rows on, to be sliced here at all."""
    monkeypatch.setattr(blocks, "_TALL", 300)
    problem = chain("gyroscope", "damper", n=602)
    first = sweep(problem, VALUES, modes=MODES, method="reduced")
    monkeypatch.setattr(blocks, "thread_count", lambda: 3)
    for module in ("reduced.basis", "reduced.missing", "eigen.block_lanczos"):
        monkeypatch.setattr(f"fe_squeal.{module}._SEED", 7)
    second = sweep(problem, VALUES, modes=MODES, method="reduced")
    for a, b in zip(first.points, second.points, strict=True):
        assert (np.abs(a.modes.lam - b.modes.lam) <= a.modes.re_uncertainty + b.modes.re_uncertainty).all()
        np.testing.assert_array_equal(a.modes.stability, b.modes.stability)


@pytest.mark.slow
def test_a_mode_that_vanishes_inside_the_range_is_an_error(monkeypatch):
    """What a solver returns without a mode that was there before; what came before is kept."""
    problem = chain()
    solve = solving.solve_modes

    def careless(pencil, *how):
        modes = solve(pencil, *how)
        return modes.select(np.delete(np.arange(len(modes)), 4)) if len(calls) > 3 else modes

    calls: list[float] = []
    monkeypatch.setattr(solving, "solve_modes", lambda *a: (calls.append(0.0), careless(*a))[1])
    with pytest.raises(NotConvergedError, match="missing between") as caught:
        sweep(problem, VALUES, modes=MODES, method="direct")
    assert len(caught.value.partial.points) >= 2


@pytest.mark.slow
def test_onsets_far_from_the_values_of_a_sweep_are_those_of_the_problem():
    """Strong coupling between two values: the model has to hold there, and Newton's root on the problem to count."""
    pad = {"material": "lining", "groups": ["pad_1", "pad_2"]}
    scene = {
        "mesh": {"disc_pad": {
            "inner_radius": 0.06, "outer_radius": 0.118, "thickness": 0.02, "pad_inner_radius": 0.076,
            "pad_outer_radius": 0.115, "pad_angle_deg": 84.0, "pad_thickness": 0.012, "back_plate_thickness": 0.006,
            "size": 0.03, "element": "hex", "pads": 2,
        }},
        "materials": {
            "iron": {"youngs_modulus": 1.1e11, "poisson_ratio": 0.26, "density": 7100.0},
            "steel": {"youngs_modulus": 2.05e11, "poisson_ratio": 0.29, "density": 7800.0},
            "lining": {"youngs_modulus": 9.0e9, "poisson_ratio": 0.2, "density": 2400.0},
        },
        "bodies": {
            "disc": {"material": "iron"}, "linings": pad,
            "plates": {"material": "steel", "groups": ["back_plate_1", "back_plate_2"]},
        },
        "supports": [{"surface": "hub", "fixed": "xyz"}],
        "springs": [
            {"name": f"{name}_{i}", "surface": f"pad_back_{i}", "direction": axis, "stiffness": stiffness}
            for i in (1, 2)
            for name, axis, stiffness in (("x", [1, 0, 0], 2e7), ("y", [0, 1, 0], 6e7), ("z", [0, 0, 1], 8e7))
        ],
        "contacts": [
            {"name": f"pad_{i}", "surface": f"pad_face_{i}", "counterface": f"disc_face_{i}",
             "normal_stiffness": 3.0e12, "sliding": {"axis": [0, 0, 1], "speed": 8.0}}
            for i in (1, 2)
        ],
        "effects": {"friction": {"mu": 0.3}},
    }  # fmt: skip
    problem = assemble(parse_scene(scene))
    found = sweep(problem, [0.0, 1.0], modes=20, method="reduced").onsets
    exact = sweep(problem, [0.15, 0.25], modes=20, method="direct").onsets
    assert len(exact) == 2
    for onset in exact:
        near = min(found, key=lambda o: abs(o.value - onset.value))
        assert abs(near.value - onset.value) <= near.uncertainty + onset.uncertainty <= 1e-6


def test_modes_that_miss_by_a_hair_are_corrected_further(monkeypatch):
    """Their errors in a basis of their own may be just below the tolerance where those in the whole basis are above."""
    estimated, restricted, harsh = reduced_places.estimated, ReducedBasis.restricted, {}

    def inside(basis, *args):
        found = restricted(basis, *args)
        found.is_inside = True
        return found

    def harsher(basis, value, *args):
        modes, off, relative = estimated(basis, value, *args)
        if value == VALUES[-1] and not getattr(basis, "is_inside", False):
            worst = float(off.max())
            if harsh or worst <= 1:  # from the first estimate on that meets the tolerance
                off = off * harsh.setdefault("factor", 1.5 / worst)
        return modes, off, relative

    monkeypatch.setattr(ReducedBasis, "restricted", inside)
    monkeypatch.setattr(reduced_places, "estimated", harsher)
    model = ReducedModel(chain(*CLASSES["quadratic"]), "mu", VALUES, Request(count=MODES))
    assert harsh["factor"] > 1.5 and model._estimated(float(VALUES[-1]))[1].max() <= 1


def test_columns_of_modes_are_as_long_as_their_parts():
    """The slight imaginary part of a hardly damped mode counts as slight: blown up, it would fill a basis."""
    rng = np.random.default_rng(11)
    right, left = rng.standard_normal((2, 30, 3)) + 1e-7j * rng.standard_normal((2, 30, 3))
    columns = unit_columns(right, left)
    assert columns.shape == (30, 12)
    length = np.linalg.norm(columns, axis=0).reshape(2, 2, 3)
    np.testing.assert_allclose((length**2).sum(axis=1), 1.0)
    assert (length[:, 1] < 1e-6).all()


@pytest.mark.parametrize("turn", [1.0, 1.0 + 0.5j])
def test_left_modes_that_are_zero_give_no_columns(turn):
    right = np.random.default_rng(12).standard_normal((30, 3)) * turn
    left = right.copy()
    left[:, 1] = 0.0
    columns, parts = unit_columns(right, left), 1 + np.iscomplexobj(right)
    assert columns.shape == (30, 5 * parts) and np.isfinite(columns).all()
    np.testing.assert_allclose((columns**2).sum(), 5.0)
