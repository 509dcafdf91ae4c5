"""Sweeps whose list of onsets is wrong where pairs of branches alone are watched, against closed forms and LAPACK."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from families import Family, judge, make, rigid
from selection import crossed, some

import fe_squeal
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.problem.forms import collect_powers
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.sweep import onsets
from fe_squeal.sweep.scale import Scale
from fe_squeal.sweep.step import Step
from meshes import STEEL, annulus, join, make_problem

STIFFNESS = "contacts.belt.normal_stiffness"


def unstable(problem, parameter, value, count):
    """Count the unstable modes among the lowest ones."""
    pencil = problem.pencil({parameter: float(value)})
    return int((solve_modes(pencil, Request(count=count)).stability == "unstable").sum())


def check_sides(problem, result, count, least=1e-7):
    """Check that the problem itself has one unstable mode more or less behind every onset, close to it."""
    for o in result.onsets:
        assert o.uncertainty > 0 and np.isfinite(o.crossing_speed)
        aside = max(10 * o.uncertainty, least * o.value)
        before, behind = (unstable(problem, o.parameter, o.value + s * aside, count) for s in (-1, 1))
        assert behind - before == (1 if o.direction == "into" else -1), o


def family_of(problem, parameter, values):
    """Return a problem of finite elements as the judge wants it: full matrices."""
    terms = collect_powers(problem, parameter).terms
    parts = [(t.slot, t.matrix.toarray(), sum(t.powers.values()), t.imaginary) for t in terms]
    return Family("finite elements", tuple(parts), values)


@pytest.mark.parametrize("seed", some([15, 18], lambda seed: seed == 15))
def test_a_mode_changes_its_partner_inside_a_step(seed):
    """A pair parts, and one of the two meets a third mode before the step ends: the count of unstable modes is the same
    at both ends, and the second meeting belongs to no pair of neighbours at either."""
    family = make(rigid, seed)
    result = fe_squeal.sweep(family.problem(), family.values, "p", modes=len(family.parts[0][1]))
    assert not judge(family, [(o.value, o.direction, o.uncertainty) for o in result.onsets])
    changed = []
    for a, b in itertools.pairwise(family.values):
        inside = [o for o in result.onsets if a < o.value <= b]
        pairs = [{o.branch_a, o.branch_b} for o in inside]
        changed += [(p, q) for p, q in itertools.pairwise(pairs) if len(p & q) == 1]
        if changed and changed[-1][0] in pairs:
            assert [o.direction for o in inside] == ["out of", "into"]
    assert len(changed) == 1


@pytest.mark.parametrize(("unknowns", "damping"), crossed([12, 480], [0.0, 1e-3], fast=lambda n, c: n == 12 or not c))
def test_window_narrower_than_a_fifth_of_a_step(unknowns, damping):
    """Two branches θ = 100 ± s(p − a) cross with couplings ±κp: D = s²(p − a)² − κ²p², and with damping c of all modes
    alike Re λ > 0 where −D > 100 c². Sampled at the steps, or where the branches cross by their slopes at the
    ends, nothing is to be seen."""
    at, slope, width = 0.55, 25.8, 0.0186
    kappa = slope * width / 2 / at
    theta = 120 + 7.0 * np.arange(unknowns)
    theta[:2] = 100 + slope * at, 100 - slope * at
    F = sp.lil_array((unknowns, unknowns))
    F[0, 0], F[1, 1], F[0, 1], F[1, 0] = -slope, slope, kappa, -kappa
    terms = [Term("mass", "M", sp.eye_array(unknowns, format="csr"), True)]
    terms += [Term("stiffness", "K", sp.csr_array(sp.diags_array(theta)), True)]
    terms += [Term("friction", "K", sp.csr_array(F), False, {"p": 1})]
    if damping:
        terms += [Term("dashpots", "C", damping * sp.eye_array(unknowns, format="csr"), True)]
    problem = Problem(tuple(terms), {"p": 0.0})
    result = fe_squeal.sweep(problem, np.linspace(0.0, 1.0, 11), "p", modes=8)
    ends = at + np.roots([slope**2 - kappa**2, -2 * kappa**2 * at, 100 * damping**2 - (kappa * at) ** 2])
    assert [o.direction for o in result.onsets] == ["into", "out of"]
    for o, end in zip(result.onsets, np.sort(ends), strict=True):
        assert abs(o.value - end) <= o.uncertainty + 1e-12
        assert o.uncertainty <= 1e-7  # 1e-6 of a step
    assert not result.unsettled


def belt(youngs_modulus, abutment, guide, mu, loss_factor=0.0):
    """Return a pad on an elastic belt, 54 unknowns."""
    lining = {"youngs_modulus": youngs_modulus, "poisson_ratio": 0.25, "density": 2600.0, "loss_factor": loss_factor}
    on = {"caliper": ("top", [0, 0, 1], 2e7), "abutment": ("right", [1, 0, 0], abutment)}
    on["guide"] = ("right", [0, 1, 0], guide)
    geometry = {"length": 0.08, "width": 0.04, "height": 0.015, "size": 0.04, "belt_thickness": 0.012}
    scene = {
        "mesh": {"order": 1, "block": geometry}, "materials": {"lining": lining, "steel": STEEL},
        "bodies": {"block": {"material": "lining"}, "belt": {"material": "steel"}},
        "supports": [{"surface": "belt_bottom", "fixed": "xyz"}],
        "springs": [{"name": n, "surface": s, "direction": d, "stiffness": k} for n, (s, d, k) in on.items()],
        "contacts": [{"name": "belt", "surface": "bottom", "counterface": "belt_top", "normal_stiffness": 1e10,
                      "sliding": {"direction": [1, 0, 0], "speed": 1.0}}],
        "effects": {"friction": {"mu": mu}} | ({"structural_damping": {}} if loss_factor else {}),
    }  # fmt: skip
    return fe_squeal.assemble(fe_squeal.parse_scene(scene))


@pytest.mark.slow
@pytest.mark.parametrize("start", [1e7, 2e7])
def test_contact_stiffness_over_six_decades(start, monkeypatch):
    """Steps that change everything are halved again and again. A pair that is unstable already where such a part of a
    step begins is no doublet that couples there. Along ln p modes are followed at about as many values inside the
    steps as along p: 0.97 times on average over start values and numbers of nodes, 0.73 to 1.21 times in each, since
    rounding decides where near modes are parted. Values beside onsets, where modes are only counted, are left out."""
    inside = []
    between, unshown = Step.between, onsets.unshown

    def counting(*arguments):
        followed = len(inside)
        told = unshown(*arguments)
        del inside[followed:]
        return told

    monkeypatch.setattr(Step, "between", lambda step, p: (inside.append(p), between(step, p))[1])
    monkeypatch.setattr(onsets, "unshown", counting)
    problem, values = belt(2.58687e9, 2.07246e6, 6.04594e8, 0.866197), np.geomspace(start, 1e6 * start, 13)
    result = fe_squeal.sweep(problem, values, STIFFNESS, modes=10)
    assert len(result.onsets) == 7
    check_sides(problem, result, 14)
    needed = len(inside)
    monkeypatch.setattr(Scale, "of", lambda values: Scale())
    linear = fe_squeal.sweep(problem, values, STIFFNESS, modes=10)
    np.testing.assert_allclose([o.value for o in result.onsets], [o.value for o in linear.onsets], rtol=1e-9)
    assert 0 < needed <= 1.5 * (len(inside) - needed)


@pytest.mark.slow
@pytest.mark.parametrize("count", [10, 11, 12])
def test_structural_damping_over_two_decades(count):
    """Re λ of single modes changes its sign. Modes that are counted within a window of frequency are more or fewer as
    another unstable mode passes its edge; here the list must be the same whatever the steps."""
    problem = belt(3.99279e8, 1.57043e8, 1.21646e6, 0.852936, loss_factor=3.4e-4)
    result = fe_squeal.sweep(problem, np.geomspace(1e9, 1e11, count), STIFFNESS, modes=10)
    values = [4.23125e9, 6.2382922e9, 7.0572335e9, 9.974271e9, 3.7209383e10, 4.9538109e10]
    np.testing.assert_allclose([o.value for o in result.onsets], values, rtol=1e-6)
    assert [o.direction for o in result.onsets] == ["into", "out of", "into", "into", "into", "out of"]
    check_sides(problem, result, 14)


def ring_pad(spot):
    """Return a ring pad on a disc, with a spring on a part of the rim that makes doublets two."""
    disc, pad = (
        annulus("hex2", (1, 16, 1), *sizes) for sizes in ((0.1, 0.2, 0.02), (0.12, 0.18, 0.015, 0.02, "pad"))
    )
    mesh = join(disc, pad)
    x = mesh.p[:, mesh.facets[:, mesh.boundaries["rim"]]].mean(axis=1)
    mesh = mesh.with_boundaries(
        {**mesh.boundaries, "spot": mesh.boundaries["rim"][np.abs(np.arctan2(x[1], x[0]) - 0.3) < 0.3]}
    )
    springs = [("x", "top_pad", [1, 0, 0], 1e8), ("y", "top_pad", [0, 1, 0], 1e8), ("z", "top_pad", [0, 0, 1], 1e8)]
    springs += [("spot", "spot", [0, 0, 1], spot)]
    contact = {
        "surface": "bottom_pad", "counterface": "top", "normal_stiffness": 1e11,
        "sliding": {"axis": [0, 0, 1], "speed": 5.0},
    }  # fmt: skip
    return make_problem(
        mesh, order=1, supports=[{"surface": "hub", "fixed": "xyz"}], contacts=[contact],
        springs=[dict(zip(("name", "surface", "direction", "stiffness"), s, strict=True)) for s in springs],
        effects={"friction": {"mu": 0.0}},
    )  # fmt: skip


@pytest.mark.slow
def test_onset_of_split_doublets_is_not_the_mirror_root():
    """Doublets that are split by δ couple at μ = ±δ/2b, both within 1e-4 of a step from the start: D is even in μ, so
    that Newton's method may end at the root outside the sweep."""
    problem = ring_pad(1e3)
    values = np.linspace(0.0, 0.6, 7)
    result = fe_squeal.sweep(problem, values, modes=10)
    assert all(values[0] <= o.value <= values[-1] for o in result.onsets)
    split = [o for o in result.onsets if o.value > 0]
    np.testing.assert_allclose([o.value for o in split[:2]], [1.801e-6, 4.697e-6], rtol=1e-3)
    for o in split[:2]:
        growth = [
            max(m.lam.real[np.abs(m.frequency_hz - o.frequency_hz) < 1])
            for m in (solve_modes(problem.pencil({"mu": s * o.value}), Request(count=14)) for s in (0.99, 1.01))
        ]
        assert growth[0] <= 1e-6 < growth[1]
        assert growth[1] == pytest.approx(o.crossing_speed * np.sqrt(0.01 * o.value), rel=0.05)


FIVE_SPRINGS = {
    "a quartet after zero": (1.277, "s1", 5, [
        ("left", [0.395, 2.553, -0.091], 330137.0), ("right", [1.267, -0.134, -0.821], 15265136.0),
        ("front", [0.162, 1.11, 0.272], 1132424.0), ("back", [-0.379, 0.561, -2.136], 604818.0),
        ("top", [0.028, -1.37, 2.176], 165185.0)]),
    "a quartet parts beside zero": (2.75, "s4", 4, [
        ("left", [-0.668, 0.138, -1.416], 2872261.0), ("right", [0.51, -0.303, -0.453], 238630.0),
        ("front", [-0.585, -0.686, -0.46], 2267556.0), ("back", [0.06, -1.195, -0.303], 4646271.0),
        ("top", [1.871, -1.142, 0.339], 116515.0)]),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("case", FIVE_SPRINGS)
def test_divergence_and_quartet_in_one_step(case):
    """A real pair ±s swings again, and with an oscillating pair forms or leaves a quartet, within one step of a
    spring's stiffness: branches that are followed by |λ| or shape alone are lost there."""
    mu, swept, count, springs = FIVE_SPRINGS[case]
    scene = {
        "mesh": {"order": 1, "block": {"length": 0.08, "width": 0.04, "height": 0.04, "size": 0.08}},
        "materials": {"lining": {"youngs_modulus": 1e10, "poisson_ratio": 0.25, "density": 2600.0}},
        "bodies": {"block": {"material": "lining"}},
        "springs": [
            {"name": f"s{i}", "surface": s, "direction": d, "stiffness": k} for i, (s, d, k) in enumerate(springs)
        ],
        "contacts": [{"surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e9,
                      "sliding": {"direction": [1, 0, 0], "speed": 1.0}}],
        "effects": {"friction": {"mu": mu}},
    }  # fmt: skip
    problem = fe_squeal.assemble(fe_squeal.parse_scene(scene))
    values, parameter = np.linspace(0.0, 5e7, count), f"springs.{swept}.stiffness"
    result = fe_squeal.sweep(problem, values, parameter, modes=8)
    assert {o.kind for o in result.onsets} == {"flutter", "divergence"}
    assert not judge(
        family_of(problem, parameter, values), [(o.value, o.direction, o.uncertainty) for o in result.onsets]
    )
    check_sides(problem, result, 12)


@pytest.mark.parametrize("seed", range(4))
def test_conservative_gyroscopic_system_that_friction_leaves(seed):
    """M = 1, G skew, K > 0: at p = 0 all λ are on the imaginary axis. Those with Re λ' = −Re(φᴴFφ / φᴴ(2λ + G)φ) > 0
    grow as soon as p leaves it: their onsets are at 0 itself, none before it, and have this speed."""
    rng = np.random.default_rng(seed)
    n = 5 + seed
    Q = la.qr(rng.standard_normal((n, n)))[0]
    K, G, F = Q @ np.diag(rng.uniform(1, 30, n)) @ Q.T, 0.3 * rng.standard_normal((n, n)), rng.standard_normal((n, n))
    K, G = (K + K.T) / 2, G - G.T
    lam, phi = la.eig(np.block([[np.zeros((n, n)), np.eye(n)], [-K, -G]]))
    lam, phi = lam[lam.imag > 0], phi[:n, lam.imag > 0]
    norm = np.einsum("ik,ij,jk->k", phi.conj(), G, phi) + 2 * lam * (np.abs(phi) ** 2).sum(axis=0)
    speeds = -(np.einsum("ik,ij,jk->k", phi.conj(), F, phi) / norm).real
    terms = [Term("mass", "M", sp.eye_array(n, format="csr"), True), Term("stiffness", "K", sp.csr_array(K), True),
             Term("gyroscopic", "C", sp.csr_array(G), False, skew=True),
             Term("friction", "K", sp.csr_array(F), False, {"p": 1})]  # fmt: skip
    result = fe_squeal.sweep(Problem(tuple(terms), {"p": 0.0}), [0.0, 0.1], "p", modes=n)
    assert not result.warnings
    first = [o for o in result.onsets if o.value < 1e-6]
    assert all(0 <= o.value <= o.uncertainty + 1e-13 and o.direction == "into" for o in first)
    found = sorted((2 * np.pi * o.frequency_hz, o.crossing_speed) for o in first)
    expected = sorted(zip(lam.imag[speeds > 0], speeds[speeds > 0], strict=True))
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("tolerance", some([1e-3, 1e-5], lambda tolerance: tolerance == 1e-3))
def test_errors_of_a_reduced_model_where_a_stiffness_is_swept(tolerance):
    """It moves frequencies far more than growth. An error of λ is one of Re λ as well, whatever λ does along the axis,
    and moves an onset by itself over dRe λ/dp."""
    n = 260
    chain = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n), format="csr")
    friction, damper, other = (sp.lil_array((n, n)) for _ in range(3))
    for i, j in itertools.product((60, 61), (90, 91)):
        friction[i, j] = 0.02 if j == 90 else -0.02
    damper[40, 40], other[43, 43] = -2e-3, 2e-3
    terms = [Term("m", "M", sp.eye_array(n, format="csr"), True), Term("k", "K", chain, True, {"p": 1}),
             Term("f", "K", sp.csr_array(friction), False), Term("negative", "C", sp.csr_array(damper), True),
             Term("positive", "C", sp.csr_array(other), True, {"p": 1})]  # fmt: skip
    problem, values = Problem(tuple(terms), {"p": 1.0}), np.linspace(0.5, 1.6, 9)
    found = fe_squeal.sweep(problem, values, "p", 6, method="reduced", tolerance=tolerance).onsets
    exact = fe_squeal.sweep(problem, values, "p", 6, method="direct").onsets
    assert len(found) == len(exact) == 4
    for a, b in zip(found, exact, strict=True):
        assert abs(a.value - b.value) <= a.uncertainty + b.uncertainty < 0.01


@pytest.mark.parametrize("parts", [1, 2, 4])
@pytest.mark.parametrize("method", ["direct", "reduced"])
def test_waves_that_meet_on_the_axis(method, parts):
    """M = 1, G = 2 [[0, 1], [−1, 0]], K = diag(1.05 − p, 1.25 − p): K is indefinite between 1.05 and 1.25; beyond, both
    modes swing until √(p − 1.05) + √(p − 1.25) = 2, where two λ = iω meet, whose shapes are no real ones. Equal parts
    have all that as often as there are parts."""
    turning = np.kron(np.eye(parts), [[0.0, 2.0], [-2.0, 0.0]])
    terms = [Term("m", "M", sp.eye_array(2 * parts, format="csr"), True),
             Term("k", "K", sp.diags_array(np.tile([1.05, 1.25], parts)).tocsr(), True),
             Term("soft", "K", sp.csr_array(-np.eye(2 * parts)), True, {"p": 1}),
             Term("g", "C", sp.csr_array(turning), False, skew=True)]  # fmt: skip
    problem, aside = Problem(tuple(terms), {"p": 0.0}), 1e-4
    result = fe_squeal.sweep(problem, np.linspace(0, 3, 11), "p", modes=2 * parts, method=method)
    assert not result.warnings and not result.unsettled
    assert [o.direction for o in result.onsets] == np.repeat(["into", "out of", "into"], parts).tolist()
    exact_values, sides = np.repeat([[1.05, 1.25, 2.1525], [1, -1, 1]], parts, axis=1)
    for onset, exact, side in zip(result.onsets, exact_values, sides, strict=True):
        assert abs(onset.value - exact) <= onset.uncertainty < 1e-6
        pencil = problem.pencil({"p": exact + side * aside})
        growth = solve_modes(pencil, Request(count=2 * parts)).lam.real.max()
        assert onset.crossing_speed == pytest.approx(growth / np.sqrt(aside), rel=0.02)


@pytest.mark.parametrize("method", ["direct", "reduced"])
def test_a_window_between_values_at_which_the_only_mode_is_overdamped(method):
    """ü + 5u̇ + (1 − 8p + 8.2p²)u = 0 diverges between the roots of its stiffness, (8 ± √31.2)/16.4."""
    terms = [Term("m", "M", sp.csr_array([[1.0]]), True), Term("c", "C", sp.csr_array([[5.0]]), True)]
    terms += [Term(f"k{i}", "K", sp.csr_array([[k]]), True, {"p": i}) for i, k in enumerate((1.0, -8.0, 8.2))]
    result = fe_squeal.sweep(Problem(tuple(terms), {"p": 0.0}), [0.0, 1.0], "p", modes=1, method=method)
    assert [o.direction for o in result.onsets] == ["into", "out of"]
    for onset, sign in zip(result.onsets, (-1, 1), strict=True):
        assert abs(onset.value - (8 + sign * 31.2**0.5) / 16.4) <= onset.uncertainty < 1e-6
