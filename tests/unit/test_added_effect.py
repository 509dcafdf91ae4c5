"""An effect that the program does not have, from its keys in TOML to the results folder, without touching the program.

Three effects are defined here: a mass spread over a surface, with which a bar has a closed form; dampers to the ground,
whose virtual work is known; and a drag that a body may have of its own, of which Re λ is known.
"""

from __future__ import annotations

import json
import pickle
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import scipy.sparse as sp
from scene_texts import HEAD, read_rows, write_scene
from scipy.optimize import brentq

from fe_squeal import assemble, load_scene, sweep
from fe_squeal.cli import main
from fe_squeal.effects import EFFECTS, Effect, added_effect, known_effects
from fe_squeal.effects.context import BodyPart, Context
from fe_squeal.errors import SceneError
from fe_squeal.problem.terms import Term
from fe_squeal.scene.reference import reference
from fe_squeal.schema.section import NonNegative

LENGTH, AREA, DENSITY = 0.08, 0.04 * 0.02, 7800.0  # of the block
SPEED = np.sqrt(2.0e11 / DENSITY)  # of waves along it, m/s
MASSES = (0.0, 312.0, 624.0)  # kg/m^2


class AddedMass(Effect):
    """A mass spread over a surface, M = ∫ m δu·u dA.

    Attributes
    ----------
    surface : str
        Surface group of the mesh.
    mass_per_area : float, kg/m^2
        m.
    """

    name: ClassVar[str] = "added_mass"
    summary: ClassVar[str] = "A mass spread over a surface."

    surface: str
    mass_per_area: NonNegative

    def terms(self, context: Context) -> list[Term]:
        """Return the mass matrix."""
        matrix = context.cache.get("added_mass", self.surface, lambda: along_all(context, self.surface))
        return [Term("added_mass", "M", matrix, symmetric=True, powers={"effects.added_mass.mass_per_area": 1})]

    def warnings(self, context: Context, others: Sequence[Term], parameters: Mapping[str, float]) -> list[str]:
        """Return a sentence for a mass of zero."""
        return [] if self.mass_per_area else ["effects.added_mass has no effect: mass_per_area is 0"]


class GroundedDampers(Effect):
    """Dampers from a surface to the ground, C = ∫ c δu·u̇ dA.

    Attributes
    ----------
    surface : str
        Surface group of the mesh.
    damping : float, N s/m per m^2
        c.
    """

    name: ClassVar[str] = "grounded_dampers"
    summary: ClassVar[str] = "Dampers to the ground."
    needs: ClassVar[Mapping[str, str]] = {"added_mass": "; expected [effects.added_mass]"}

    surface: str
    damping: NonNegative

    def terms(self, context: Context) -> list[Term]:
        """Return the damping matrix."""
        matrix = along_all(context, self.surface)
        powers = {"effects.grounded_dampers.damping": 1}
        return [Term("grounded_dampers", "C", matrix, symmetric=True, powers=powers)]


class Drag(Effect):
    """Drag in proportion to the mass of bodies, C = r M, so that Re λ = −r/2.

    Attributes
    ----------
    rate : float, 1/s
        r.
    """

    name: ClassVar[str] = "drag"
    summary: ClassVar[str] = "Drag in proportion to the mass."
    own_of_body: ClassVar[str] = "Drag of this body."

    rate: NonNegative

    def body_terms(self, context: Context, body: BodyPart, path: str) -> list[Term]:
        """Return the damping matrix of a body."""
        powers = {f"{path}.rate": 1, **body.mass.powers}
        return [Term(f"drag.{body.name}", "C", body.mass.matrix, symmetric=True, powers=powers)]


def along_all(context: Context, group: str) -> sp.csr_array:
    """Return ∫ δu·u dA over a surface group, (n, n)."""
    surface = context.surface(group, "effects")
    total = sp.csr_array((context.space.unknowns,) * 2)
    for direction in np.eye(3):
        u = context.space.along(surface.values, direction)
        total = total + u.T @ sp.diags_array(surface.weights) @ u
    return sp.csr_array((total + total.T) / 2)


# A bar along x, held at its left end and across.
BAR = (
    HEAD.replace("poisson_ratio = 0.3", "poisson_ratio = 0.0").replace("order = 1", "order = 2")
    + '[[supports]]\nsurface = "left"\nfixed = "x"\n'
    + "".join(f'[[supports]]\nsurface = "{side}"\nfixed = "y"\n' for side in ("front", "back"))
    + "".join(f'[[supports]]\nsurface = "{side}"\nfixed = "z"\n' for side in ("bottom", "top"))
)
MASS = '[effects.added_mass]\nsurface = "right"\nmass_per_area = 624.0\n'
TAIL = f"""\
[sweep]
parameter = "effects.added_mass.mass_per_area"
values = {list(MASSES)}
[solve]
modes = 1
[output]
shapes = "none"
"""


@pytest.fixture
def effects() -> Iterator[None]:
    with added_effect(AddedMass), added_effect(GroundedDampers):
        yield
    assert known_effects() == EFFECTS


def bar_frequency(mass: float) -> float:
    """Return the lowest frequency of a bar held at one end with a mass at the other, Hz: β tan β = ρL/m, β = ωL/c."""
    ratio = mass / (DENSITY * LENGTH)
    beta = brentq(lambda b: np.cos(b) - ratio * b * np.sin(b), 1e-3, np.pi / 2 + 1e-9)
    return float(beta * SPEED / LENGTH / (2 * np.pi))


@pytest.mark.slow
@pytest.mark.usefixtures("effects")
def test_effect_goes_through_a_whole_run(tmp_path: Path) -> None:
    """A bar with a mass at its end, at three masses; four quadratic elements along it leave 1e-4 of a frequency."""
    out = tmp_path / "out"
    assert main(["run", str(write_scene(tmp_path, BAR + MASS + TAIL)), "-o", str(out)]) == 0
    record = json.loads((out / "run.json").read_text("utf-8"))
    assert record["effects"] == ["added_mass"]
    assert {"name": "added_mass", "slot": "M", "powers": {"effects.added_mass.mass_per_area": 1}} in record["terms"]
    found = {float(r["value"]): float(r["frequency_hz"]) for r in read_rows(out / "modes.csv")}
    assert found == pytest.approx({mass: bar_frequency(mass) for mass in MASSES}, rel=1e-4)


@pytest.mark.usefixtures("effects")
def test_virtual_work_of_a_rigid_motion(tmp_path: Path) -> None:
    """With all of the surface moving by 1, 2 and 3 along x, y and z, u·M u is m A (1 + 4 + 9), and as much of C."""
    free = BAR.partition("[[supports]]")[0]
    text = free + MASS + '[effects.grounded_dampers]\nsurface = "right"\ndamping = 5.0\n'
    problem = assemble(load_scene(write_scene(tmp_path, text)))
    u = problem.discretisation.space.gather(np.tile([1.0, 2.0, 3.0], (problem.discretisation.space.nodes, 1)))
    size = {t.name: float(u @ t.matrix @ u) * t.coefficient(problem.parameters) for t in problem.terms}
    assert size["added_mass"] == pytest.approx(624.0 * AREA * 14, rel=1e-12)
    assert size["grounded_dampers"] == pytest.approx(5.0 * AREA * 14, rel=1e-12)
    assert problem.problem_class == "quadratic"


def test_scene_keeps_its_effects_after_they_are_taken_away(tmp_path: Path) -> None:
    path = write_scene(tmp_path, BAR + MASS.replace("624.0", "0.0"))
    with added_effect(AddedMass):
        scene = load_scene(path)
    again = pickle.loads(pickle.dumps(scene))  # as for a process of its own
    assert again == scene and again.source == path
    for kept in (scene, again):
        problem = assemble(kept)
        assert problem.discretisation.warnings == ("effects.added_mass has no effect: mass_per_area is 0",)
        modes = sweep(problem, [312.0], parameter="effects.added_mass.mass_per_area", modes=1).points[0].modes
        assert modes.frequency_hz[0] == pytest.approx(bar_frequency(312.0), rel=1e-4)
    with pytest.raises(SceneError, match=r"effects\.added_mass: unknown key"):
        load_scene(path)


@pytest.mark.slow
@pytest.mark.parametrize("table", ["effects.drag", "bodies.block.drag"])
def test_body_may_have_a_table_of_its_own(tmp_path: Path, table: str) -> None:
    with added_effect(Drag):
        scene = load_scene(write_scene(tmp_path, BAR + f"[{table}]\nrate = 30.0\n"))
    problem = assemble(scene)
    assert scene.effect_names == ("drag",) and problem.parameters[f"{table}.rate"] == 30.0
    lam = sweep(problem, [10.0, 30.0], parameter=f"{table}.rate", modes=1).points
    assert [float(p.modes.lam[0].real) for p in lam] == pytest.approx([-5.0, -15.0], rel=1e-6)


@pytest.mark.usefixtures("effects")
@pytest.mark.parametrize(
    ("text", "message"),
    [
        (MASS.replace("surface", "surfaec"), 'effects.added_mass.surfaec: unknown key; did you mean "surface"?'),
        (MASS.replace("added_mass", "aded_mass"), 'effects.aded_mass: unknown key; did you mean "added_mass"?'),
        (MASS.replace("624.0", "-1.0"), "effects.added_mass.mass_per_area: given -1.0; expected a number ≥ 0"),
        (
            '[effects.grounded_dampers]\nsurface = "right"\ndamping = 1.0\n',
            "given grounded_dampers without added_mass; expected [effects.added_mass]",
        ),
    ],
)
def test_mistakes_in_its_table_are_told_as_those_in_others(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(SceneError) as error:
        load_scene(write_scene(tmp_path, BAR + text))
    assert message in str(error.value)


@pytest.mark.usefixtures("effects")
def test_reference_of_keys_has_it() -> None:
    page = reference()
    assert "| `added_mass` | table |  | none | A mass spread over a surface. |" in page
    assert "## `[effects.added_mass]`\n\nA mass spread over a surface, M = ∫ m δu·u dA." in page
    assert "| `mass_per_area` | number, ≥ 0 | kg/m^2 | required | m. |" in page


def test_a_name_that_is_taken_is_refused() -> None:
    with added_effect(AddedMass), pytest.raises(ValueError, match='"added_mass", which there is'):  # noqa: SIM117
        with added_effect(AddedMass):
            pass
