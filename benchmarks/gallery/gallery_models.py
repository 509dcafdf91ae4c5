"""The gallery: models of different kinds, none of which is an example of the program.

A model is made by a function of the size of its elements, in two or three sizes, and has a sweep.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

if TYPE_CHECKING:
    from fe_squeal.problem.problem import Problem

Scene = dict[str, Any]
IRON = {"youngs_modulus": 1.1e11, "poisson_ratio": 0.26, "density": 7100.0}
STEEL = {"youngs_modulus": 2.05e11, "poisson_ratio": 0.29, "density": 7800.0}
LINING = {"youngs_modulus": 3.5e9, "poisson_ratio": 0.2, "density": 2400.0}
AXIS = {"axis": [0, 0, 1]}


@dataclass(frozen=True)
class Model:
    """A kind of brake, and the sweep that is solved.

    Attributes
    ----------
    build : callable of float
        Returns the assembled problem for a size of the elements, m.
    sizes : tuple of float, m
        Sizes with 3 000 to 7 000 unknowns, about 20 000, and for some models about 100 000.
    start, stop : float
        First and last value of `parameter`.
    modes : int
        Number of modes that are solved for.
    damped : bool
        Whether anything damps or rotates.
    """

    name: str
    about: str
    build: Callable[[float], Problem]
    sizes: tuple[float, ...]
    start: float = 0.0
    stop: float = 1.0
    parameter: str = "mu"
    modes: int = 50
    damped: bool = False


def disc(
    size: float, *, angle: float = 62.0, thickness: float = 0.016, stiffness: float = 4.0e11, **mesh: Any
) -> Scene:
    """Return the scene of a disc with pads and back plates."""
    pads = mesh.get("pads", 2)
    scene: Scene = {
        "mesh": {"disc_pad": {
            "inner_radius": 0.06, "outer_radius": 0.118, "thickness": thickness, "pad_inner_radius": 0.076,
            "pad_outer_radius": 0.115, "pad_angle_deg": angle, "pad_thickness": 0.012, "back_plate_thickness": 0.006,
            "size": size, **mesh,
        }},
        "materials": {"iron": IRON, "steel": STEEL, "lining": LINING},
        "bodies": {
            "disc": {"material": "iron"},
            "linings": {"material": "lining", "groups": [f"pad_{i}" for i in range(1, pads + 1)]},
            "plates": {"material": "steel", "groups": [f"back_plate_{i}" for i in range(1, pads + 1)]},
        },
        "supports": [{"surface": "hub", "fixed": "xyz"}],
        "springs": [],
        "contacts": [],
        "effects": {"friction": {"mu": 0.3}},
    }  # fmt: skip
    for i in range(1, pads + 1):
        scene["springs"] += [
            {"name": f"piston_{i}", "surface": f"pad_back_{i}", "direction": [0, 0, 1], "stiffness": 8.0e7},
            {"name": f"abutment_{i}", "surface": f"pad_back_{i}", "direction": [0, 1, 0], "stiffness": 6.0e7},
            {"name": f"guide_{i}", "surface": f"pad_back_{i}", "direction": [1, 0, 0], "stiffness": 2.0e7},
        ]
        scene["contacts"].append({
            "name": f"pad_{i}", "surface": f"pad_face_{i}", "counterface": f"disc_face_{i}",
            "normal_stiffness": stiffness, "sliding": {**AXIS, "speed": 8.0},
        })  # fmt: skip
    return scene


def blocks(size: float, *, count: int, belt: float, stiffness: float = 3.0e11) -> Scene:
    """Return the scene of blocks in a row, on a belt or on a rigid counterface."""
    names = [f"_{i}" for i in range(1, count + 1)] if count > 1 else [""]
    several = {"count": count, "spacing": 0.01} if count > 1 else {}
    under = {"belt_thickness": belt, "belt_margin_x": 0.01, "belt_margin_y": 0.01} if belt else {}
    scene: Scene = {
        "mesh": {"block": {"length": 0.07, "width": 0.03, "height": 0.02, "size": size, **several, **under}},
        "materials": {"lining": LINING, "belt": {**IRON, "youngs_modulus": 4.0e10}},
        "bodies": {"blocks": {"material": "lining", "groups": [f"block{n}" for n in names]}},
        "supports": [], "springs": [], "contacts": [], "effects": {"friction": {"mu": 0.3}},
    }  # fmt: skip
    if belt:
        scene["bodies"]["belt"] = {"material": "belt"}
        scene["supports"] = [{"surface": "belt_bottom", "fixed": "z"}, {"surface": "belt_left", "fixed": "xyz"}]
    for k, n in enumerate(names):
        scene["springs"] += [
            {"name": f"press{n}", "surface": f"top{n}", "direction": [0, 0, 1], "stiffness": 2.0e7 * (1 + 0.02 * k)},
            {"name": f"hold{n}", "surface": f"right{n}", "direction": [1, 0, 0], "stiffness": 4.0e7},
            {"name": f"side{n}", "surface": f"right{n}", "direction": [0, 1, 0], "stiffness": 1.0e7},
        ]
        scene["contacts"].append({
            "name": f"on_belt{n}", "surface": f"bottom{n}", "counterface": "belt_top" if belt else "rigid",
            "normal_stiffness": stiffness, "sliding": {"direction": [1, 0, 0], "speed": 2.0},
        })  # fmt: skip
    return scene


def assembled(scene: Scene) -> Problem:
    """Return the problem of a scene."""
    from fe_squeal import assemble, parse_scene

    return assemble(parse_scene(copy.deepcopy(scene)))


def strong(size: float, element: str = "tet") -> Scene:
    """Return a soft disc with long pads and stiff contacts, where many modes couple."""
    scene = disc(size, angle=84.0, thickness=0.02, stiffness=3.0e12, element=element)
    scene["materials"] = {**scene["materials"], "lining": {**LINING, "youngs_modulus": 9.0e9}}
    return scene


def with_effects(scene: Scene, **effects: Any) -> Scene:
    """Return a scene with further effects."""
    return {**scene, "effects": {**scene["effects"], **effects}}


def lossy(size: float) -> Scene:
    """Return the disc whose linings and plates have loss factors."""
    scene = with_effects(disc(size), structural_damping={})
    losses = {"lining": 0.06, "steel": 0.004, "iron": 0.002}
    scene["materials"] = {k: {**m, "loss_factor": losses[k]} for k, m in scene["materials"].items()}
    return scene


def overdamped(size: float) -> Scene:
    """Return free pads with so much damping in the contacts that most of the low modes are overdamped."""
    scene = disc(size, stiffness=2.0e10, angle=70.0)
    scene["contacts"] = [{**c, "normal_damping": 4.0e7} for c in scene["contacts"]]
    scene["materials"] = {**scene["materials"], "lining": {**LINING, "youngs_modulus": 2.0e7, "density": 2400.0}}
    return with_effects(scene, friction_damping={"contact_pressure": 4.0e8})


def rotating(size: float, speed: float = 420.0, **mesh: Any) -> Scene:
    """Return a disc that turns so fast that the frequencies of its doublets differ by about 5 %."""
    scene = with_effects(disc(size, pads=1, **mesh), rotation={"bodies": ["disc"]})
    scene["contacts"] = [{**c, "sliding": {**AXIS, "speed": speed}} for c in scene["contacts"]]
    return scene


def pressed(size: float) -> Scene:
    """Return pads pressed on a part of their backs, so that contacts open, and the state depends on friction."""
    scene = disc(size, angle=80.0, stiffness=5.0e10)
    return with_effects(scene, preload={"pressures": {"pad_back_1": 2.0e6, "pad_back_2": 1.2e6}})


def mixed(size: float) -> Scene:
    """Return linings of nearly incompressible material, in the mixed formulation."""
    scene = disc(size)
    scene["materials"] = {**scene["materials"], "lining": {**LINING, "youngs_modulus": 6.0e8, "poisson_ratio": 0.4995}}
    scene["bodies"]["linings"]["formulation"] = "mixed"
    return scene


def free_pads(size: float) -> Scene:
    """Return pads that only the contact holds."""
    return {**disc(size, pads=2), "springs": []}


def matrices(size: float) -> tuple[Problem, float]:
    """Return a rotating, overdamped brake as matrices without a mesh, and its speed Ω, rad/s.

    As another program would write them, there are K + Ω²K_Ω, the gyroscopic matrix with the factor Ω, and friction
    damping with the factor 1/Ω.
    """
    from fe_squeal.problem.problem import Problem

    scene = with_effects(overdamped(size), rotation={"bodies": ["disc"]})
    whole = assembled(scene)
    powers = {"rotation": {"C": 1, "K": 2}, "friction_damping": {"C": -1}}
    speed = 8.0
    terms = []
    for term in whole.terms:
        effect = next((e for e in powers if e in term.name), None)
        power = powers[effect].get(term.slot, 0) if effect else 0
        fixed = np.prod([whole.parameters[p] ** k for p, k in term.powers.items() if p != "speed"])
        terms.append(replace(term, matrix=sp.csr_array(term.matrix * fixed), powers={"omega": power} if power else {}))
    return Problem(tuple(terms), {"omega": speed}), speed


def swept_matrices(size: float) -> Problem:
    """Return the problem of `matrices`."""
    return matrices(size)[0]


MODELS = (
    Model("weak", "disc, one pad, hexahedra",
          lambda h: assembled(disc(h, pads=1, stiffness=6e10)), (0.02, 0.0075, 0.0046)),
    Model("strong", "disc, two long pads, tetrahedra", lambda h: assembled(strong(h)), (0.03, 0.0115, 0.0058)),
    Model("strong hexahedra", "the same, hexahedra", lambda h: assembled(strong(h, "hex")), (0.02, 0.0095, 0.0055)),
    Model("thin", "thin disc, short pads", lambda h: assembled(disc(h, thickness=0.005, angle=30.0)), (0.015, 0.0075)),
    Model("row", "six blocks on a belt", lambda h: assembled(blocks(h, count=6, belt=0.012)), (0.02, 0.0068)),
    Model("block", "one block on a rigid counterface",
          lambda h: assembled(blocks(h, count=1, belt=0.0)), (0.008, 0.0028)),
    Model("free pads", "pads held by the contact alone", lambda h: assembled(free_pads(h)), (0.02, 0.0095)),
    Model("mixed", "linings of Poisson's ratio 0.4995", lambda h: assembled(mixed(h)), (0.02, 0.0098)),
    Model("Rayleigh", "strong coupling, Rayleigh damping", lambda h: assembled(
        with_effects(strong(h, "hex"), rayleigh={"alpha": 15.0, "beta": 1.5e-7})), (0.02, 0.0095, 0.0055), damped=True),
    Model("loss", "loss factors of all materials", lambda h: assembled(lossy(h)), (0.02, 0.0095), damped=True),
    Model("overdamped", "contacts that overdamp most modes", lambda h: assembled(overdamped(h)), (0.02, 0.0095),
          damped=True),
    Model("rotating", "doublets apart by 5 %", lambda h: assembled(rotating(h)), (0.02, 0.0078), damped=True),
    Model("falling", "falling friction, contact pressure", lambda h: assembled(with_effects(
        disc(h), falling_friction={"slope": -0.02}, friction_damping={"contact_pressure": 1e6},
        rayleigh={"alpha": 5.0, "beta": 5e-8})), (0.02, 0.0095), damped=True),
    Model("preload", "pads that lift off", lambda h: assembled(pressed(h)), (0.02, 0.0095)),
    Model("matrices", "matrices with powers 1, 2 and -1 of the speed", swept_matrices, (0.02, 0.0095),
          start=4.0, stop=60.0, parameter="omega", damped=True),
)  # fmt: skip
