"""Numbers of a problem from Python: how they are given, and the one sentence that says so where they are not."""

from __future__ import annotations

import copy
import pickle
import re
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import fe_squeal
from fe_squeal import Problem, SceneError
from fe_squeal.decks.template import draft_template
from fe_squeal.problem.parameters import values_by_path
from fe_squeal.problem.sensitivity import sensitivities
from fe_squeal.problem.terms import Term
from fe_squeal.scene.numbers import plain
from meshes import BELT, box, join, make_problem, modes_of

PISTON = "springs.piston.stiffness"


@pytest.fixture(scope="module")
def problem() -> Problem:
    """One hexahedron with a spring on a belt."""
    contact = {"surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e12, "sliding": BELT}
    spring = {"name": "piston", "surface": "top", "direction": [0.0, 0.0, 1.0], "stiffness": 1e7}
    return make_problem(
        box("hex1", (1, 1, 1)), order=1, contacts=[contact], springs=[spring], effects={"friction": {"mu": 0.3}}
    )


def test_a_mapping_and_keywords_say_the_same(problem: Problem) -> None:
    together = problem.at({PISTON: 2e7, "mu": 0.4})
    assert (together.value(PISTON), together.value("mu")) == (2e7, 0.4)
    for other in (problem.at({PISTON: 2e7}, mu=0.4), problem.at(mu=0.4).at({PISTON: np.float64(2e7)})):
        assert abs(other.pencil().K - together.pencil().K).max() == 0
    assert abs(problem.pencil({PISTON: 2e7}, mu=0.4).K - together.pencil().K).max() == 0
    assert abs(together.pencil().K - problem.pencil().K).max() > 0


def test_a_derivative_is_taken_at_the_values_given(problem: Problem) -> None:
    """∂K/∂k of a contact with friction is K_c/k + μK_f/k: it moves with μ."""
    path = "contacts.contact_1.normal_stiffness"
    at_rest, sliding = (problem.derivative(path, "K", {"mu": mu}) for mu in (0.0, 0.7))
    friction = problem.derivative("mu", "K") / problem.value(path)
    assert abs(sliding - at_rest - 0.7 * friction).max() <= 1e-14 * abs(sliding).max()


@pytest.mark.parametrize(("given", "said"), [
    (0.3, 'given 0.3; expected parameters with their values, as in problem.at({"mu": 0.3})'),
    ("mu", "given 'mu'; expected parameters with their values, as in problem.at({\"mu\": 0.3})"),
    ({"mu": "0.3"}, "mu: given '0.3'; expected a finite number, as in problem.at({\"mu\": 0.3})"),
    ({"mu": True}, 'mu: given True; expected a finite number, as in problem.at({"mu": 0.3})'),
    ({"mu": float("nan")}, 'mu: given nan; expected a finite number, as in problem.at({"mu": 0.3})'),
    ({0.3: "mu"}, 'given 0.3 as the name of a parameter; expected a text, as in problem.at({"mu": 0.3})'),
    ({"springs.piston.stifness": 1.0},
     f'given "springs.piston.stifness"; expected the path of a number of the scene; did you mean "{PISTON}"?'),
    ({"muu": 0.3}, 'given "muu"; expected the path of a number of the scene; did you mean "mu"?'),
    ({"title": 1.0}, 'given "title", which is no number'),
    ({"mesh.order": 2}, 'given "mesh.order"; expected a number of the physics, or another scene to be assembled'),
    ({"materials.steel.poisson_ratio": 0.6}, "materials.steel.poisson_ratio: given 0.6; expected a number with"
     " -1 < nu < 0.5, outside which the stiffness is not positive"),
])  # fmt: skip
@pytest.mark.parametrize("method", ["at", "pencil"])
def test_what_is_given_wrongly_ends_in_one_sentence(problem: Problem, given: object, said: str, method: str) -> None:
    with pytest.raises(SceneError) as caught:
        getattr(problem, method)(given)
    said = said.replace("problem.at(", f"problem.{method}(")
    assert str(caught.value).endswith(said) and "\n" not in str(caught.value)


NO_MATRIX = 'as the matrix; expected "M", "C" or "K", as in problem.derivative("mu", "K")'


@pytest.mark.parametrize(("wrong", "said"), [
    (lambda p: p.at("mu", 0.4), "given 'mu', 0.4; expected parameters with their values, "
     'as in problem.at({"mu": 0.4})'),
    (lambda p: p.at(PISTON, 2), f'as in problem.at({{"{PISTON}": 2}})'),
    (lambda p: p.at({"mu": 0.4}, {PISTON: 2.0}), 'as in problem.at({"mu": 0.3})'),
    (lambda p: p.at(np.eye(9)), 'as in problem.at({"mu": 0.3})'),
    (lambda p: p.pencil("mu", 0.4), 'as in problem.pencil({"mu": 0.4})'),
    (lambda p: p.derivative("mu"), f"given None {NO_MATRIX}"),
    (lambda p: p.derivative("mu", 0.4), f"given 0.4 {NO_MATRIX}"),
    (lambda p: p.derivative("mu", "K", 0.4), 'given 0.4; expected parameters with their values, '
     'as in problem.derivative("mu", "K", {"mu": 0.3})'),
    (lambda p: p.derivative("mu", "K", "mu", 0.4), 'as in problem.derivative("mu", "K", {"mu": 0.4})'),
    (lambda p: p.derivative(0.4, "K"), 'given 0.4 as the name of a parameter; expected a text, as "mu"'),
])  # fmt: skip
def test_calls_as_one_might_guess_them_end_in_the_right_form(problem: Problem, wrong: object, said: str) -> None:
    with pytest.raises(SceneError) as caught:
        wrong(problem)  # type: ignore[operator]
    assert str(caught.value).endswith(said) and "\n" not in str(caught.value)


def test_the_right_form_that_is_shown_is_right(problem: Problem) -> None:
    """What a message ends with, run as it stands."""
    with pytest.raises(SceneError) as caught:
        problem.derivative("mu", "K", "mu", 0.4)  # type: ignore[call-arg]
    shown = str(caught.value).rpartition("as in ")[2]
    found = eval(shown, {"problem": problem})
    assert abs(found - problem.derivative("mu", "K")).max() == 0 and abs(found).max() > 0


def test_without_a_scene_the_message_has_a_parameter_of_the_problem() -> None:
    one = sp.csr_array(np.eye(2))
    problem = Problem((Term("m", "M", one, True), Term("k", "K", one, True, {"omega": -1})), {"omega": 2.0})
    with pytest.raises(SceneError, match=r'as in problem\.at\(\{"omega": 0\.3\}\)$'):
        problem.at(5.0)  # type: ignore[arg-type]
    with pytest.raises(SceneError, match=r"^omega: given 0; expected another number"):
        problem.at(omega=0)
    assert problem.pencil({"omega": 4.0}).K[0, 0] == 0.25


def test_several_paths_get_one_value() -> None:
    assert values_by_path({"a.b, c": 2}) == {"a.b": 2.0, "c": 2.0}


LONG, RATIO = "effects.friction.mu", "contacts.contact_1.friction_ratio"


@pytest.mark.parametrize(
    "steps",
    [
        ({"mu": 0.25}, {LONG: 0.4}), ({LONG: 0.25}, {"mu": 0.4}), ({"mu": 0.25}, {f"{LONG}, {RATIO}": 0.4}),
        ({"mu": 0.25}, {LONG: 0.5}, {"mu": 0.4}, {"materials.steel.poisson_ratio": 0.31}),
    ],
    ids=["short, long", "long, short", "long with another", "before terms are made anew"],
)  # fmt: skip
def test_the_short_and_the_long_name_are_one_parameter(problem: Problem, steps: tuple[dict[str, float], ...]) -> None:
    """The last value counts, also the nominal one after another, and matrices are those of one call."""
    found, named = problem, {"mu"}
    for step in steps:
        found = found.at(step)
        named |= {path for key in step for path in key.split(", ")} - {LONG}
    assert found.value("mu") == found.value(LONG) == found.parameters["mu"] == 0.4 and LONG not in found.changed
    together = problem.at({path: found.value(path) for path in named})
    assert abs(found.pencil().K - together.pencil().K).max() == 0
    nominal = found.at({LONG: 0.3})
    assert nominal.value("mu") == nominal.value(LONG) == 0.3


def test_derivatives_and_sweeps_by_the_long_name(problem: Problem) -> None:
    """Along "a, b" an eigenvalue moves by the sum of what it moves by along a and b."""
    assert abs(problem.derivative(LONG, "K") - problem.derivative("mu", "K")).max() == 0
    both = f"{LONG}, {RATIO}"
    result = fe_squeal.sweep(problem, [0.0, 0.3], parameter=both, modes=2)
    assert result.parameter == f"mu, {RATIO}"
    modes = modes_of(problem, 8)  # of which three are free
    by = sensitivities(problem, modes, np.flatnonzero(modes.lam), [LONG, RATIO, both])
    assert by[both] == pytest.approx(by[LONG] + by[RATIO], rel=1e-12)
    assert np.abs(by[LONG]).max() > 0


def test_one_path_has_one_value_and_stands_once(problem: Problem) -> None:
    with pytest.raises(SceneError, match=r"^mu: given 0\.2 and 0\.3; expected one value$"):
        problem.at({"mu": 0.2, LONG: 0.3})
    with pytest.raises(SceneError, match=r'^given "mu" twice; expected every path once$'):
        problem.derivative(f"mu, {LONG}", "K")
    scene = problem.source.scene.model_dump(by_alias=True, exclude_unset=True)  # type: ignore[union-attr]
    for given in ([LONG, "mu"], f"mu, {LONG}"):
        with pytest.raises(SceneError, match=r'^scene: sweep\.parameter: .*given "mu" twice; expected every path'):
            fe_squeal.parse_scene({**plain(scene), "sweep": {"parameter": given, "values": [0.0, 0.3]}})


@pytest.mark.parametrize("value", [Fraction(1, 3), 10**17 + 1, np.longdouble("0.3")])
def test_numbers_that_are_rounded_are_values(value: Any) -> None:
    assert values_by_path({"mu": value, "a, b": value}) == dict.fromkeys(("mu", "a", "b"), float(value))


def test_an_integer_beyond_all_numbers_is_refused() -> None:
    with pytest.raises(SceneError, match=r"^mu: given 10+\.\.\.; expected a finite number"):
        values_by_path({"mu": 10**400})


def test_terms_by_hand_have_powers_of_names_as_they_are_known() -> None:
    one = sp.csr_array(np.eye(2))
    problem = Problem((Term("m", "M", one, True), Term("k", "K", one, True, {LONG: 1})), {LONG: 2.0})
    with pytest.raises(SceneError, match=f'^term k: given a power of "{LONG}", which means "mu"; expected that$'):
        fe_squeal.sweep(problem, [1.0], parameter=LONG)


def test_a_volume_group_with_a_comma_is_a_body_by_another_name() -> None:
    """So that its numbers have paths; `fe-squeal new` writes such a name."""
    group = "block, left"
    mesh = join(box("hex1", (1, 1, 1), name=group), box("hex1", (1, 1, 1), corner=(2.0, 0.0, 0.0), name="other"))
    bodies = {"block": {"material": "steel", "groups": [group], "rayleigh": {"beta": 1e-8}},
              "other": {"material": "steel"}}  # fmt: skip
    problem, path = make_problem(mesh, order=1, bodies=bodies), "bodies.block.rayleigh.beta"
    assert problem.at({path: 3e-8}).value(path) == 3e-8
    with pytest.raises(SceneError, match=r'add \[bodies\.NAME\] with groups = \["block, left"\] and material = '):
        make_problem(mesh, order=1, bodies={"other": {"material": "steel"}})
    assert '[bodies.block_left]\nmaterial = "of_block_left"\ngroups = ["block, left"]\n' in draft_template(
        fe_squeal.from_skfem(mesh), "a.msh"
    ).text()


@pytest.mark.parametrize("table", ["scene", "effect", "material"])
def test_a_scene_is_not_changed_in_place(problem: Problem, table: str) -> None:
    """The sentence says what to do instead; what cannot be set keeps its value."""
    scene = problem.source.scene  # type: ignore[union-attr]
    where, name, value = {
        "scene": (scene, "title", "other"),
        "effect": (scene.effects.friction, "mu", 0.7),
        "material": (scene.materials["steel"], "youngs_modulu", 1e9),
    }[table]
    before = scene.model_dump()
    with pytest.raises(SceneError, match=rf"^{name}: a scene does not change.*problem\.at\(\{{.*parse_scene$"):
        setattr(where, name, value)
    with pytest.raises(SceneError, match=rf"^{name}: a scene does not change"):
        delattr(where, name)
    assert scene.model_dump() == before


@pytest.mark.parametrize(
    "change",
    [
        lambda scene: scene.contacts.append({"surface": "top"}), lambda scene: scene.supports.extend([1]),
        lambda scene: scene.springs.__setitem__(0, None), lambda scene: scene.contacts.clear(),
        lambda scene: scene.materials.update(other=1), lambda scene: scene.bodies.pop("block"),
        lambda scene: scene.materials.__setitem__("steel", 3),
    ],
)  # fmt: skip
def test_lists_and_tables_of_a_scene_are_not_changed_either(problem: Problem, change: Callable[[Any], Any]) -> None:
    """What is put into a list is not checked; an empty list that the scene does not mention is one as well."""
    scene = problem.source.scene  # type: ignore[union-attr]
    before = scene.model_dump()
    with pytest.raises(SceneError, match=r"of the scene: a scene does not change.*problem\.at\(\{.*parse_scene$"):
        change(scene)
    assert scene.model_dump() == before and pickle.loads(pickle.dumps(scene)) == copy.deepcopy(scene) == scene


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda _: fe_squeal.assemble("brake.toml"), r"assemble: given 'brake\.toml'; expected a scene, as in .*"),
        (lambda p: fe_squeal.scatter(p, {"mu": 0.4}), r"scatter: mu: given 0\.4; expected a distribution, as \{.*"),
        (lambda p: fe_squeal.stability_map(p, "mu", PISTON), r"stability_map: x: given 'mu'; expected an axis.*"),
        (lambda p: fe_squeal.export_shapes(p, "out", which="stable"), r"export_shapes: given which = 'stable'; .*"),
    ],
    ids=["path for a scene", "number for a distribution", "path for an axis", "unknown choice"],
)
def test_a_wrong_kind_of_argument_ends_in_one_sentence_that_says_how(
    problem: Problem, call: Callable[[Any], Any], sentence: str
) -> None:
    with pytest.raises(fe_squeal.SquealError) as caught:
        call(problem)
    assert re.fullmatch(sentence, str(caught.value))


@pytest.mark.parametrize(("given", "told"), [
    ({"modes": 0}, "modes: given 0; expected a whole number above 0"),
    ({"modes": "x"}, "modes: given 'x'; expected a whole number above 0"),
    ({"max_frequency": -1.0}, "max_frequency: given -1.0; expected a frequency in Hz above 0"),
    ({"tolerance": -1.0}, "tolerance: given -1.0; expected a relative backward error between 0 and 1"),
    ({"method": "fast"}, "method: given 'fast'; expected auto, direct, reduced or modal"),
    ({"modes": 2, "max_frequency": 9.0}, "sweep: given modes and max_frequency; expected one of them"),
    ({"values": ["a"]}, "sweep: given the values ['a']; expected real numbers that increase"),
    ({"values": [1j, 2.0]}, "sweep: given the values [1j, 2.0]; expected real numbers that increase"),
])  # fmt: skip
def test_what_a_sweep_cannot_be_asked_for(given, told):
    one = sp.eye_array(2, format="csr")
    terms = Term("inertia", "M", one, symmetric=True), Term("springs", "K", one, symmetric=True, powers={"mu": 1})
    with pytest.raises(SceneError) as caught:
        fe_squeal.sweep(Problem(terms, {"mu": 1.0}), **{"values": [1.0, 2.0], **given})
    assert str(caught.value) == told


def test_one_value_is_of_a_parameter_that_there_is(problem: Problem) -> None:
    """As several are; without friction one value of mu changes nothing, and is taken: θ = 1 and 2 here."""
    with pytest.raises(SceneError, match=rf'given "springs\.piston\.stifness"; .* did you mean "{PISTON}"\?'):
        fe_squeal.sweep(problem, [2e7], parameter="springs.piston.stifness", modes=2)
    one, two = sp.eye_array(2, format="csr"), sp.csr_array(np.diag([1.0, 2.0]))
    plain = Problem((Term("inertia", "M", one, True), Term("springs", "K", two, True)), {})
    for name in ("k", "mu, k"):
        with pytest.raises(SceneError, match=r"^the problem has no parameter"):
            fe_squeal.sweep(plain, [0.3], parameter=name, modes=2)
    (point,) = fe_squeal.sweep(plain, [0.3], modes=2).points
    assert point.modes.lam.imag**2 == pytest.approx([1.0, 2.0], rel=1e-12)


@pytest.mark.parametrize(
    "values", [(v / 2 for v in range(3)), range(2), (0, 1), np.array([0, 1]), [np.float32(0.0), 1]]
)
def test_values_of_a_sweep_of_any_kind(values):
    one = sp.eye_array(2, format="csr")
    push = sp.csr_array(np.array([[0.0, 1.0], [-1.0, 0.0]]))
    terms = (Term("inertia", "M", one, True), Term("springs", "K", sp.csr_array(np.diag([1.0, 2.0])), True),
             Term("push", "K", push, False, {"mu": 1}))  # fmt: skip
    (onset,) = fe_squeal.find_onsets(Problem(terms, {"mu": 0.0}), values, max_frequency=1.0)
    assert onset.value == pytest.approx(0.5, rel=1e-9)
