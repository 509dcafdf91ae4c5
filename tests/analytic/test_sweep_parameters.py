"""Any number of a scene as the sweep's parameter, and sensitivities to all of them."""

from __future__ import annotations

import functools

import numpy as np
import pytest
import scipy.sparse as sp

import fe_squeal
from fe_squeal import parse_scene, sweep
from fe_squeal.assembly.assembly import Assembly
from fe_squeal.errors import SceneError
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.sensitivity import sensitivities
from fe_squeal.problem.terms import Term
from meshes import BELT, box, make_problem, modes_of

PATHS = [
    ("mu", 0.2, 0.5),
    ("contacts.belt.normal_stiffness", 8e9, 2e10),
    ("contacts.belt.friction_ratio", 0.5, 1.5),
    ("contacts.belt.sliding.speed", 1.0, 4.0),
    ("springs.caliper.stiffness", 1e7, 5e7),
    ("springs.caliper.damping", 0.0, 100.0),
    ("springs.abutment.direction.2", -0.5, 0.5),
    ("materials.lining.youngs_modulus", 1e9, 3e9),
    ("materials.lining.poisson_ratio", 0.1, 0.4),
    ("materials.lining.density", 2000.0, 3000.0),
    ("materials.lining.loss_factor", 0.0, 0.2),
    ("effects.rayleigh.beta", 0.0, 1e-7),
    ("effects.friction_damping.contact_pressure", 1e5, 2e6),
    ("effects.falling_friction.slope", -0.1, 0.1),
    ("springs.caliper.stiffness, springs.abutment.stiffness", 1e7, 5e7),
]  # fmt: skip


def scene(**changes):
    """A soft pad on a belt, with some of every effect."""
    return {
        "mesh": {"file": "none.msh"},
        "materials": {"lining": {
            "youngs_modulus": 2e9, "poisson_ratio": 0.25, "density": 2600.0, "loss_factor": 0.01
        }},
        "bodies": {"block": {"material": "lining"}},
        "springs": [
            {"name": "caliper", "surface": "top", "direction": [0, 0, 1.0], "stiffness": 2e7, "damping": 50.0},
            {"name": "abutment", "surface": "right", "direction": [1.0, 0, 0.1], "stiffness": 5e7},
            {"name": "guide", "surface": "right", "direction": [0, 1.0, 0], "stiffness": 1e7},
        ],
        "contacts": [{
            "name": "belt", "surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e10,
            "sliding": {**BELT, "speed": 2.0},
        }],
        "effects": {
            "friction": {"mu": 0.4}, "rayleigh": {"alpha": 5.0, "beta": 2e-8}, "structural_damping": {},
            "friction_damping": {"contact_pressure": 1e6}, "falling_friction": {"slope": -0.02},
        }, **changes,
    }  # fmt: skip


@functools.cache
def mesh():
    return fe_squeal.from_skfem(box("hex2", (2, 1, 1), (0.08, 0.04, 0.015)))


@functools.cache
def assembled():
    return fe_squeal.assemble(parse_scene(scene()), mesh())


@functools.cache
def lowest_modes():
    return modes_of(assembled(), 6)


@pytest.mark.parametrize(("path", "low", "high"), PATHS)
def test_problem_at_a_value_is_the_one_assembled_there(path, low, high):
    """Recombined or made anew, the matrices are those of a scene that was written with the value."""
    problem = assembled()
    for value in (low, high):
        moved = problem.pencil({path: value})
        written = Assembly(problem.source.scene, mesh()).problem(dict.fromkeys(path.split(", "), value)).pencil()
        for name in ("M", "C", "K"):
            a, b = getattr(moved, name), getattr(written, name)
            assert abs(a - b).max() <= 1e-13 * abs(b).max()


@pytest.mark.parametrize(("path", "low", "high"), PATHS)
def test_sensitivity_is_the_slope_of_the_eigenvalue(path, low, high):
    """∂λ/∂p from left and right modes against central differences of the eigenvalues, every mode of the lowest six."""
    problem = assembled()
    if not path.startswith("springs.caliper.stiffness,"):
        modes = lowest_modes()
        p = problem.value(path)
        step = 1e-4 * (abs(p) or high - low)
        above, below = (modes_of(problem, 9, **{path: p + s * step}) for s in (1, -1))
        slopes = sensitivities(problem, modes, np.arange(len(modes)), [path])[path]
        for lam, found in zip(modes.lam, slopes, strict=True):
            ends = [m.lam[np.argmin(np.abs(m.lam - lam))] for m in (above, below)]
            exact = (ends[0] - ends[1]) / (2 * step)
            scale = np.abs(lam) * 1e-7 / step + 1e-5 * abs(exact)
            assert abs(found - exact) <= scale


def test_only_what_depends_on_a_number_is_made_anew():
    """At another Poisson's ratio mass and elastic stiffness are new; springs and contact are the same objects."""
    problem = assembled.__wrapped__()  # with nothing of other numbers that would be kept instead
    other = problem.at({"materials.lining.poisson_ratio": 0.3})
    same = {t.name: t.matrix is o.matrix for t, o in zip(problem.terms, other.terms, strict=True)}
    assert same["spring.guide"] and same["contact.belt"] and same["friction.belt"]
    assert not same["elastic.block"]
    faster = problem.at({"contacts.belt.sliding.speed": 3.0})
    same = {t.name: t.matrix is o.matrix for t, o in zip(problem.terms, faster.terms, strict=True)}
    assert not same.pop("friction_damping.belt") and all(same.values())


def test_changes_add_up():
    """A number made anew stays when another one is recombined afterwards, and the other way round."""
    problem = assembled()
    a = problem.at({"materials.lining.poisson_ratio": 0.3}).at(mu=0.1)
    b = problem.at(mu=0.1).at({"materials.lining.poisson_ratio": 0.3})
    assert abs(a.pencil().K - b.pencil().K).max() <= 1e-14 * abs(a.pencil().K).max()
    assert a.value("mu") == b.value("mu") == 0.1


def test_onset_over_a_spring_is_the_onset_over_mu():
    """The critical friction at a spring's stiffness, and the critical stiffness at that friction, are one point."""
    plain = scene(effects={"friction": {"mu": 0.4}})
    plain["materials"]["lining"].pop("loss_factor")
    plain["springs"][0].pop("damping")
    problem = fe_squeal.assemble(parse_scene(plain), mesh())
    path = "springs.abutment.stiffness"
    by_mu = sweep(problem, np.linspace(0.1, 0.6, 6), modes=8).onsets
    assert by_mu
    mu = by_mu[0].value
    found = sweep(problem.at(mu=mu), np.linspace(4.5e7, 5.6e7, 4), path, modes=8).onsets
    assert min(abs(o.value / 5e7 - 1) for o in found) < 1e-6


def test_onset_over_a_number_that_is_made_anew():
    """Over Poisson's ratio, whose terms are interpolated inside a step, it is the same point."""
    plain = scene(effects={"friction": {"mu": 0.4}})
    plain["materials"]["lining"].pop("loss_factor")
    plain["springs"][0].pop("damping")
    problem = fe_squeal.assemble(parse_scene(plain), mesh())
    mu = sweep(problem, np.linspace(0.1, 0.6, 6), modes=8).onsets[0].value
    onsets = sweep(problem.at(mu=mu), np.linspace(0.15, 0.35, 4), "materials.lining.poisson_ratio", modes=8).onsets
    nearest = min(onsets, key=lambda o: abs(o.value - 0.25))
    assert nearest.value == pytest.approx(0.25, abs=1e-7)


@pytest.mark.parametrize(
    ("path", "word"),
    [
        ("springs.pistn.damping", "springs.guide"), ("springs.guide", "which is no number"),
        ("mesh.order", "on one mesh"), ("springs.guide.surface", "which is no number"),
        ("materials.lining.poisson_ratio", "expected a number with -1 < nu"),
        ("springs.guide.damping", "expected a number ≥ 0"),
    ],
)  # fmt: skip
def test_paths_and_values_that_are_refused(path, word):
    with pytest.raises(SceneError, match=word):
        parse_scene(scene(sweep={"parameter": path, "from": -1.0, "to": 1.0, "points": 3}))


def test_path_that_is_nearly_one():
    with pytest.raises(SceneError, match=r"did you mean .springs\.caliper\.damping"):
        parse_scene(scene(sweep={"parameter": "springs.calper.damping", "from": 0.0, "to": 1.0, "points": 3}))


def test_a_sweep_across_the_pole_of_a_negative_power_is_refused():
    """Friction in proportion to 1/p is infinite at p = 0, and nothing leads from one side to the other."""
    one, skew = sp.eye_array(2, format="csr"), sp.csr_array(np.array([[0.0, 1.0], [-1.0, 0.0]]))
    terms = Term("mass", "M", one, True), Term("elastic", "K", one, True), Term("push", "K", skew, False, {"p": -1})
    with pytest.raises(SceneError, match=r"p from -1 to 1, of which push has a negative power"):
        sweep(Problem(terms, {"p": 1.0}), [-1.0, 1.0], "p", modes=2)


def test_a_value_inside_the_sweep_that_the_scene_refuses_is_told_before_anything_is_solved():
    """A sliding speed of 0 has no direction, and lies between −1 and 1."""
    problem = make_problem(
        box("hex1", (2, 1, 1), (0.08, 0.04, 0.015)),
        materials={"lining": {"youngs_modulus": 2e9, "poisson_ratio": 0.25, "density": 2600.0}},
        contacts=[{"name": "belt", "surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e10,
                   "sliding": BELT}],
        effects={"friction": {"mu": 0.4}, "friction_damping": {"contact_pressure": 1e5}},
    )  # fmt: skip
    values = np.linspace(-1.0, 1.0, 5)
    with pytest.raises(SceneError, match=r"speed: given 0\.0"):
        sweep(problem, values, "contacts.belt.sliding.speed", modes=4, progress=lambda done, of: pytest.fail("solved"))


SLIP = {"friction_damping": {"contact_pressure": 1e5}}
SPEED = "contacts.belt.sliding.speed"


@pytest.mark.parametrize(
    ("parameter", "values", "contact", "effects", "flat"),
    [
        (SPEED, [1.0, 2.0, 3.0], {}, {}, True),
        (SPEED, [1.0, 2.0, 3.0], {}, SLIP, False),
        (SPEED, [2.0], {}, {}, False),
        (f"{SPEED}, mu", [0.2, 0.4], {}, {}, False),
        ("materials.unused.density", [1e3, 2e3], {}, {}, True),
        ("materials.lining.loss_factor", [0.0, 0.1], {}, {}, True),
        ("materials.lining.loss_factor", [0.0, 0.1], {}, {"structural_damping": {}}, False),
        ("materials.lining.poisson_ratio", [0.2, 0.3], {}, {}, False),
        ("mu", [0.0, 0.4], {}, {}, False),
        ("mu", [0.0, 0.4], {"friction_ratio": 0.0}, {}, True),
        ("contacts.belt.friction_ratio", [0.0, 1.0], {"friction_ratio": 0.0}, {}, False),
        ("contacts.belt.normal_damping", [0.0, 1e3], {}, {}, False),
    ],
)  # fmt: skip
def test_a_sweep_over_a_number_that_nothing_depends_on_is_told(parameter, values, contact, effects, flat):
    lining = {"youngs_modulus": 2e9, "poisson_ratio": 0.25, "density": 2600.0}
    problem = make_problem(
        box("hex1", (2, 1, 1), (0.08, 0.04, 0.015)), 1, materials={"lining": lining, "unused": lining},
        contacts=[{"name": "belt", "surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e10,
                   "sliding": BELT, **contact}],
        effects={"friction": {"mu": 0.4}, **effects},
    )  # fmt: skip
    result = sweep(problem, values, parameter, modes=4)
    told = [w for w in result.warnings if w.startswith(f"nothing in the problem depends on {parameter},")]
    assert len(told) == flat
    for name in set(result.points[0].branches) if flat else ():
        lam = np.array([p.modes.lam[p.branches == name] for p in result.points])
        assert np.ptp(lam.imag) <= 1e-9 * np.abs(lam).max()
