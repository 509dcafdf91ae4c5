"""An effect costs nothing unless its table is there: no call, no slot, no dearer problem class."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from selection import some

from fe_squeal import parse_scene
from fe_squeal.effects import EFFECTS, rotating_bodies
from fe_squeal.effects.effect import Effect
from fe_squeal.effects.rayleigh import Rayleigh
from fe_squeal.effects.rotating_bodies import motion_of_body
from fe_squeal.errors import InputError, SceneError
from fe_squeal.scene.contacts import SlidingSection
from meshes import STEEL, annulus, box, join, make_problem

SLIDING = {"axis": [0.0, 0.0, 1.0], "speed": 20.0}
CONTACT = {"name": "pad", "surface": "bottom_pad", "counterface": "top", "normal_stiffness": 1e11, "sliding": SLIDING}
PRELOAD = {"preload": {"pressures": {"top_pad": 1e5}}}
# case: table with what the effect needs, functions that make it, its terms (name, slot), problem class
CASES = {
    "friction": ({}, ["friction_terms"], {("friction.pad", "K")}, "nonsymmetric"),
    "rayleigh": (
        {"rayleigh": {"alpha": 10.0, "beta": 1e-7}}, ["rayleigh_terms"],
        {("rayleigh.disc", "C"), ("rayleigh.pad", "C")}, "quadratic",
    ),
    "structural_damping": (
        {"structural_damping": {}}, ["structural_terms"], {("structural_damping.pad", "K")}, "complex"
    ),
    "frozen structural_damping": (
        {"structural_damping": {"reference_frequency_hz": 1e3}}, ["structural_terms"],
        {("structural_damping.pad", "C")}, "quadratic",
    ),
    "friction_damping": (
        {"friction_damping": {"contact_pressure": 1e6}}, ["friction_damping_terms"], {("friction_damping.pad", "C")},
        "quadratic",
    ),
    "falling_friction": (
        {"falling_friction": {"contact_pressure": 1e6, "slope": -0.01}}, ["falling_friction_terms"],
        {("falling_friction.pad", "C")}, "quadratic",
    ),
    "rotation": (
        {"rotation": {"bodies": ["disc"]}}, ["rotation_terms", "check_revolution"],
        {("gyroscopic.disc", "C"), ("convection.disc", "K")}, "quadratic",
    ),
    "rotation of a damped body": (
        {"rotation": {"bodies": ["disc"]}, "rayleigh": {"alpha": 3.0, "beta": 1e-7}},
        ["rotation_terms", "check_revolution", "rayleigh_terms"],
        {("gyroscopic.disc", "C"), ("convection.disc", "K"), ("rotating_damping.disc", "K"), ("rayleigh.disc", "C"),
         ("rayleigh.pad", "C")},
        "quadratic",
    ),
    "preload": (PRELOAD, ["solve_preload"], set(), "nonsymmetric"),
    "stress_stiffening": (
        {**PRELOAD, "stress_stiffening": {}}, ["solve_preload", "stiffening_term"],
        {("stress_stiffening.disc", "K"), ("stress_stiffening.pad", "K")}, "nonsymmetric",
    ),
}  # fmt: skip
MAKERS = {name for _, makers, _, _ in CASES.values() for name in makers}
PLAIN = {("mass.disc", "M"), ("mass.pad", "M"), ("elastic.disc", "K"), ("elastic.pad", "K"), ("spring.hold", "K"),
         ("spring.guide", "K"),         ("contact.pad", "K")}  # fmt: skip


def forbid(monkeypatch, maker):
    """Let the test fail where a scene's assembly calls this function."""
    [module] = [m for m in (*(sys.modules[e.__module__] for e in EFFECTS), rotating_bodies) if hasattr(m, maker)]
    monkeypatch.setattr(module, maker, lambda *_: pytest.fail(f"{maker} was called"))


def forbid_effect(monkeypatch, effect):
    """Let the test fail where anything of an effect is called but the warning that it is not on."""
    for hook in set(vars(Effect)) & set(vars(effect)):
        if callable(getattr(effect, hook)) and not hook.startswith("_") and hook != "warnings_without":
            text = f"{effect.name}.{hook} was called"
            monkeypatch.setattr(effect, hook, lambda *_, text=text: pytest.fail(text))


def disc_and_pad(effects, **changes):
    """A ring pad on a disc that is held at its hub."""
    disc = annulus("hex2", (1, 12, 1), 0.1, 0.15, 0.01)
    pad = annulus("hex2", (1, 12, 1), 0.1, 0.15, 0.01, bottom=0.01, name="pad")
    tables = {
        "materials": {"steel": STEEL, "lining": {**STEEL, "youngs_modulus": 5e9, "loss_factor": 0.05}},
        "bodies": {"disc": {"material": "steel"}, "pad": {"material": "lining"}},
        "supports": [{"surface": "hub", "fixed": "xyz"}],
        "springs": [
            {"name": name, "surface": "top_pad", "direction": direction, "stiffness": 1e7}
            for name, direction in (("hold", [1.0, 1.0, 0.3]), ("guide", [-1.0, 1.0, 0.0]))
        ],
        "contacts": [CONTACT], "effects": effects,
    }  # fmt: skip
    return make_problem(join(disc, pad), **{**tables, **changes})


@pytest.mark.parametrize("name", some(CASES, lambda name: name not in ("preload", "rotation of a damped body")))
def test_effect_is_there_only_where_it_is_called_for(name, monkeypatch):
    """With the effect its terms exist and the class is as it says; every other effect's code is never called."""
    table, makers, terms, problem_class = CASES[name]
    for other in MAKERS - set(makers) - {"friction_terms"}:
        forbid(monkeypatch, other)
    for effect in EFFECTS:
        if effect.name not in {"friction", *table}:
            forbid_effect(monkeypatch, effect)
    problem = disc_and_pad({"friction": {"mu": 0.3}, **table})
    assert {(t.name, t.slot) for t in problem.terms} == PLAIN | {("friction.pad", "K")} | terms
    assert problem.problem_class == problem_class
    pencil = problem.pencil()
    assert (pencil.C is not None) == any(slot == "C" for _, slot in terms)
    assert np.iscomplexobj(pencil.K.data) == (problem_class == "complex")
    for t in problem.terms:  # declared symmetry is measured symmetry
        scale = abs(t.matrix).max()
        assert (abs(t.matrix - t.matrix.T).max() <= 1e-13 * scale) == t.symmetric, t.name
        assert (abs(t.matrix + t.matrix.T).max() <= 1e-13 * scale) == t.skew, t.name


def test_without_friction_the_class_is_symmetric(monkeypatch):
    for other in MAKERS:
        forbid(monkeypatch, other)
    for effect in EFFECTS:
        forbid_effect(monkeypatch, effect)
    problem = disc_and_pad({})
    assert {(t.name, t.slot) for t in problem.terms} == PLAIN and problem.problem_class == "symmetric"
    assert problem.pencil().C is None


def test_a_problem_that_is_made_anew_has_every_term_once():
    """What is kept between values stays as it is: at each value the terms are those of a problem that begins there."""
    effects = {**PRELOAD, "stress_stiffening": {}, "rotation": {"bodies": ["disc"]}, "rayleigh": {"beta": 1e-7}}
    problem = disc_and_pad({"friction": {"mu": 0.3}, **effects})
    for mu in (0.1, 0.5, 0.2, 0.6, 0.4):
        there, fresh = problem.at({"mu": mu}), disc_and_pad({"friction": {"mu": mu}, **effects})
        assert [(t.name, t.slot) for t in there.terms] == [(t.name, t.slot) for t in fresh.terms]
        for ours, exact in zip(there.terms, fresh.terms, strict=True):
            assert abs(ours.matrix - exact.matrix).max() <= 1e-9 * abs(exact.matrix).max()


@pytest.mark.parametrize(
    "table",
    [
        {"rayleigh": {}}, {"rayleigh": {"alpha": 0.0, "beta": 0.0}},
        {"falling_friction": {"contact_pressure": 1e6, "slope": 0.0}},
    ],
)  # fmt: skip
def test_damping_of_zero_is_no_term(table):
    problem = disc_and_pad({"friction": {"mu": 0.3}, **table})
    assert problem.problem_class == "nonsymmetric"


def test_structural_damping_without_loss_is_no_term():
    problem = disc_and_pad(
        {"friction": {"mu": 0.3}, "structural_damping": {}},
        materials={"steel": STEEL, "lining": {**STEEL, "youngs_modulus": 5e9}},
    )
    assert problem.problem_class == "nonsymmetric"
    assert any("no material of a body has a loss_factor" in w for w in problem.discretisation.warnings)


@pytest.mark.parametrize(
    ("effects", "word"),
    [
        ({"friction_damping": {"contact_pressure": 1e6}}, "friction_damping without friction"),
        ({"falling_friction": {"contact_pressure": 1e6, "slope": 0.1}}, "falling_friction without friction"),
        ({"friction": {"mu": 0.3}, "friction_damping": {}}, "friction_damping without a pressure"),
        ({"friction": {"mu": 0.3}, "falling_friction": {"slope": 0.1}}, "falling_friction without a pressure"),
        (
            {"friction": {"mu": 0.3}, **PRELOAD, "friction_damping": {"contact_pressure": 1e6}},
            "friction_damping.contact_pressure and preload",
        ),
        ({"stress_stiffening": {}}, "stress_stiffening without preload"),
        ({"preload": {}}, "preload without a load"),
        ({"preload": {"pressures": {"nowhere": 1.0}}}, "effects.preload.pressures.nowhere"),
        ({"rotation": {"bodies": ["dics"]}}, 'did you mean "disc"'),
        ({"rotation": {"bodies": ["pad"]}}, "expected axis and speed"),
        ({"rotation": {"bodies": ["disc"], "speed": 21.0}}, "given speed = 21 where contact pad has 20"),
        ({"rotation": {"bodies": ["disc"], "axis": [0.0, 1.0, 0.0]}}, "axis = [0, 1, 0] where contact pad has"),
    ],
)
def test_combinations_that_make_no_sense(effects, word):
    with pytest.raises(InputError, match=word.replace("[", r"\[")):
        disc_and_pad(effects)


@pytest.mark.parametrize("of_contact", [5.0, -5.0])
@pytest.mark.parametrize("axis", [None, (0.0, 0.0, 2.0), (0.0, 0.0, -1.0)])
@pytest.mark.parametrize("speed", [None, 5.0, -5.0])
def test_a_rotation_that_is_given_twice_agrees_with_its_sign(of_contact, axis, speed):
    """A speed counts about the axis as it is written: about the contact's where the rotation has none."""
    motion = SlidingSection(axis=(0.0, 0.0, 1.0), speed=of_contact).motion()
    same = (of_contact if speed is None else speed) * (1.0 if axis is None else np.sign(axis[2])) == of_contact
    if not same:
        with pytest.raises(SceneError, match="where contact c has"):
            motion_of_body("disc", {"c": motion}, axis, None, speed)
    else:
        found = motion_of_body("disc", {"c": motion}, axis, None, speed)
        np.testing.assert_array_equal(found.velocity, [0.0, 0.0, of_contact])


def test_friction_without_contact_is_refused():
    with pytest.raises(SceneError, match="no contact slides"):
        disc_and_pad({"friction": {"mu": 0.3}}, contacts=[])


def test_rotation_of_a_body_that_is_not_one_of_revolution_is_refused():
    block = box("hex2", (2, 2, 1), (0.2, 0.2, 0.02))
    with pytest.raises(SceneError, match="not a body of revolution"):
        make_problem(
            block, effects={"rotation": {"bodies": ["block"], "axis": [0, 0, 1], "centre": [0.1, 0.1, 0], "speed": 1.0}}
        )


def test_rotation_given_again_has_to_agree_and_may():
    again = {"bodies": ["disc"], "axis": [0, 0, 2.0], "centre": [0, 0, 0.7], "speed": 20.0}
    problem = disc_and_pad({"rotation": again})
    plain = disc_and_pad({"rotation": {"bodies": ["disc"]}})
    assert abs(problem.pencil().C - plain.pencil().C).max() == 0


def test_material_that_differs_around_the_axis_cannot_rotate():
    wood = {
        "youngs_modulus": [1e10, 2e9, 1e9], "shear_modulus": [1e9, 1e9, 1e9], "poisson_ratio": [0.3, 0.3, 0.3],
        "density": 600.0,
    }  # fmt: skip
    with pytest.raises(SceneError, match="not the same all around the axis"):
        disc_and_pad({"rotation": {"bodies": ["disc"]}}, materials={"steel": wood, "lining": STEEL})


def test_effects_are_told():
    scene = {"mesh": {"file": "x.msh"}, "materials": {"s": STEEL}, "bodies": {"b": {"material": "s"}}}
    own = {"b": {"material": "s", "rayleigh": {"alpha": 1.0}}}
    assert parse_scene(scene).effect_names == ()
    assert parse_scene({**scene, "bodies": own}).effect_names == ("rayleigh",)
    assert parse_scene({**scene, "effects": {"structural_damping": {}}}).effect_names == ("structural_damping",)


def test_effects_of_many_bodies_are_found_in_one_pass(monkeypatch):
    own = {f"b{i}": {"material": "s", "rayleigh": {"alpha": 1.0}} for i in range(40)}
    scene, asked = parse_scene({"mesh": {"file": "x.msh"}, "materials": {"s": STEEL}, "bodies": own}), []
    monkeypatch.setattr(Rayleigh, "acts", property(lambda table: asked.append(table) or True))
    assert scene.effect_names == ("rayleigh",) and len(asked) == 40
