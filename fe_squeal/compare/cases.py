"""The lumped systems as finite-element scenes: stiff bodies on springs in the lumped models' directions.

A body rotates, which a lumped mass does not. Springs act on both end faces together, whose centroid is the centre of
mass, so that no spring ties a rotation to a translation; contact lies below it, but friction of a contact that is
centred under the mass turns a body without anything coming back from the rotation. Rotations are modes of their own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import lumped

from ..assembly.assembly import assemble
from ..assembly.discretisation import discretisation_of
from ..mesh import LoadedMesh
from ..problem.problem import Problem
from ..scene.file import parse_scene
from .blocks import Body, brick, mesh_of_bodies

Field = Callable[[np.ndarray], np.ndarray]  # positions (n, 3) to displacements (n, 3)
ALONG: tuple[float, ...] = (1.0, 0.0, 0.0)
NORMAL: tuple[float, ...] = (0.0, 0.0, 1.0)
BELT = {"direction": ALONG, "speed": 1.0}


@dataclass(frozen=True)
class Case:
    """A lumped model and its finite-element counterpart.

    Attributes
    ----------
    name : str
    model : lumped.LumpedModel
    scene : dict
        As in a scene file.
    mesh : LoadedMesh
    motions : tuple of (bodies, field)
        The rigid motion of each lumped coordinate: the field on the volume groups, zero elsewhere.
    """

    name: str
    model: lumped.LumpedModel
    scene: dict[str, Any]
    mesh: LoadedMesh
    motions: tuple[tuple[tuple[str, ...], Field], ...]

    def problem(self, modulus: float) -> Problem:
        """Return the assembled problem with bodies of a given Young's modulus, Pa."""
        materials = {name: {**m, "youngs_modulus": modulus} for name, m in self.scene["materials"].items()}
        return assemble(parse_scene({**self.scene, "materials": materials}), self.mesh)

    def rigid_motions(self, problem: Problem) -> np.ndarray:
        """Return the (n, coordinates) displacements of the unknowns for a unit of each lumped coordinate."""
        discretisation = discretisation_of(problem)
        assert discretisation is not None
        space = discretisation.space
        columns = []
        for bodies, field in self.motions:
            u = np.zeros((space.nodes, 3))
            for body in bodies:
                nodes = np.unique(space.dofs.element_dofs[:, self.mesh.mesh.subdomains[body]])
                u[nodes] = field(space.coordinates[nodes])
            columns.append(space.gather(u))
        return np.column_stack(columns)


def shift(direction: tuple[float, ...]) -> Field:
    """Return a translation."""
    return lambda x: np.broadcast_to(np.array(direction), x.shape)


def minimal(model: lumped.Minimal | None = None, springs_on: str = "ends") -> Case:
    """Return one block on a rigid belt: the minimal model with friction from the contact spring."""
    model = replace(model or lumped.Minimal(k2=20.0), friction="contact")
    springs = [
        _spring(f"k{i}", f"block.{springs_on}", (np.sin(t), 0.0, -np.cos(t)), k, c)
        for i, (t, k, c) in enumerate(
            [(np.radians(model.theta1), model.k1, model.c1), (np.radians(model.theta2), model.k2, model.c2)], 1
        )
    ]  # fmt: skip
    scene = _scene(
        {"block": model.m}, springs, [_contact("block.bottom", "rigid", model.k3, model.c3, 1.0)],
        [{"surface": "block.sides", "fixed": "y"}],
    )  # fmt: skip
    mesh = mesh_of_bodies([brick("block", (0.0, 0.0, 0.5), (1.0, 1.0, 1.0))], {})
    return Case("minimal", model, scene, mesh, ((("block",), shift(ALONG)), (("block",), shift(NORMAL))))


def two_mass(model: lumped.TwoMass | None = None) -> Case:
    """Return two blocks behind each other, the second on a rigid belt."""
    model = replace(model or lumped.TwoMass(), friction="contact")
    t = np.radians(model.theta1)
    springs = [
        _spring("k1x", "one.ends", ALONG, model.k1x, model.c1x),
        _spring("k2x", "one.ends", ALONG, model.k2x, model.c2x, to="two.ends"),
        _spring("k", "one.ends", (np.cos(t), 0.0, -np.sin(t)), model.k, 0.0, to="two.ends"),
    ]
    supports = [{"surface": "one.sides", "fixed": "yz"}, {"surface": "two.sides", "fixed": "y"}]
    contacts = [_contact("two.bottom", "rigid", model.ky, model.cy, 1.0)]
    scene = _scene({"one": model.m1, "two": model.m2}, springs, contacts, supports)
    mesh = mesh_of_bodies([brick(n, (x, 0.0, 0.5), (1.0, 1.0, 1.0)) for n, x in (("one", -2.0), ("two", 0.0))], {})
    motions = ((("one",), shift(ALONG)), (("two",), shift(ALONG)), (("two",), shift(NORMAL)))
    return Case("two-mass", model, scene, mesh, motions)


def nine_dof(model: lumped.NineDof | None = None) -> Case:
    """Return three blocks and a movable belt.

    The plane of contact goes through the belt's centre of mass, so that friction does not turn the belt: the pads stand
    in two notches of half its thickness. Pads are narrow against the lever, and the belt's densities are those
    that give its mass and inertia and put the centre on the plane.
    """
    model = model or lumped.NineDof()
    width, thickness, lever = 0.01, 1.2, 2.0
    belt, densities = _belt(width, thickness, lever, model.mb, model.jb)
    pads = [
        brick(name, (x, 0.0, z), (width, 1.0, 0.4))
        for name, x, z in (("pad_1", -lever, 0.2), ("pad_2", lever, 0.2), ("pad_3", 0.0, 1.2))
    ]
    patches = {
        f"{name}_{i}": ("belt", (side * lever - reach, side * lever + reach), z)
        for i, side in ((1, -1), (2, 1))
        for name, reach, z in (("face", 0.2, 0.0), ("under", width / 2, -thickness))
    }
    patches["plane"] = ("belt", (-lever - 0.2, lever + 0.2), 0.0)  # both notches: where a turning belt has no u_x
    mesh = mesh_of_bodies([belt, *pads], patches)

    def inclined(degrees: float) -> tuple[float, ...]:
        return float(np.sin(np.radians(degrees))), 0.0, -float(np.cos(np.radians(degrees)))

    springs = [
        *(_spring(f"k{i}", f"pad_{i}.ends", ALONG, k, 0.0) for i, k in ((1, model.k1), (2, model.k2))),
        _spring("k3", "pad_1.ends", ALONG, model.k3, 0.0, to="pad_2.ends"),
        _spring("k4", "pad_1.ends", ALONG, model.k4, 0.0, to="pad_3.ends"),
        *(_spring(f"k{4 + i}", f"pad_{i}.ends", NORMAL, k, 0.0)
          for i, k in enumerate((model.k5, model.k6, model.k7), 1)),
        *(_spring(f"k{7 + i}", f"pad_{i}.ends", inclined(a), k, 0.0)
          for i, (k, a) in enumerate(
              ((model.k8, model.theta1), (model.k9, model.theta2), (model.k10, model.theta3)), 1)),
        _spring("k11", "plane", ALONG, model.k11, 0.0),
        _spring("k12", "under_1", NORMAL, model.k12, 0.0),
        _spring("k13", "under_2", NORMAL, model.k13, 0.0),
    ]  # fmt: skip
    contacts = [
        _contact(f"pad_{i}.bottom", f"face_{i}", k, 0.0, width) for i, k in ((1, model.kc1), (2, model.kc2))
    ]
    supports = [{"surface": f"{b}.sides", "fixed": "y"} for b in ("belt", "pad_1", "pad_2", "pad_3")]
    masses = {"pad_1": model.m1, "pad_2": model.m2, "pad_3": model.m3}
    scene = _scene({}, springs, contacts, supports)
    volume = width * 0.4
    scene["materials"] |= {n: _material(m / volume) for n, m in masses.items()}
    scene["materials"] |= {n: _material(d) for n, d in densities.items()}
    scene["bodies"] = {n: {"material": n} for n in scene["materials"]}
    whole = tuple(densities)
    motions: list[tuple[tuple[str, ...], Field]] = []
    for pad in ("pad_1", "pad_2", "pad_3"):
        motions += [((pad,), shift(ALONG)), ((pad,), shift(NORMAL))]
    motions += [(whole, shift(ALONG)), (whole, shift(NORMAL))]
    motions.append((whole, lambda x: np.stack([-x[:, 2], np.zeros(len(x)), x[:, 0]], axis=1)))
    return Case("nine-dof", model, scene, mesh, tuple(motions))


def uncoupled_disc(model: lumped.UncoupledDisc | None = None) -> Case:
    """Return a disc between two pads, without a spring that ties tangential to normal motion."""
    model = model or lumped.UncoupledDisc()
    bodies = {"pad_1": (1.0, model.mp), "pad_2": (-1.0, model.mp), "disc": (0.0, model.md)}
    springs = []
    for name in bodies:
        normal, along = (model.kdn, model.kdt) if name == "disc" else (model.kpn, model.kpt)
        springs += [_spring(f"{name}.n", f"{name}.ends", NORMAL, normal, 0.0)]
        springs += [_spring(f"{name}.t", f"{name}.ends", ALONG, along, 0.0)]
    contacts = [
        _contact("pad_1.bottom", "disc.top", model.kc, 0.0, 1.0),
        _contact("pad_2.top", "disc.bottom", model.kc, 0.0, 1.0),
    ]
    supports = [{"surface": f"{name}.sides", "fixed": "y"} for name in bodies]
    scene = _scene({name: mass for name, (_, mass) in bodies.items()}, springs, contacts, supports)
    mesh = mesh_of_bodies([brick(name, (0.0, 0.0, z), (1.0, 1.0, 1.0)) for name, (z, _) in bodies.items()], {})
    motions = tuple(((name,), shift(d)) for d in (NORMAL, ALONG) for name in bodies)
    return Case("uncoupled-disc", model, scene, mesh, motions)


def _belt(width: float, thickness: float, lever: float, mass: float, inertia: float) -> tuple[Body, dict[str, float]]:
    """Return the notched belt and the densities of its regions.

    The notches are light; the core's lower and upper half and the arms carry what makes mass and moment of inertia
    right and the first moment about the plane of contact zero: three equations for three densities.
    """
    x = (-3.0, -2.2, -lever - width / 2, -lever + width / 2, -1.8, -0.6, 0.6, 1.8, lever - width / 2,
         lever + width / 2, 2.2, 3.0)  # fmt: skip
    z = (-thickness, 0.0, thickness)
    middle = (np.array(x[1:]) + np.array(x[:-1])) / 2
    notch, core = (np.abs(middle) > 1.8) & (np.abs(middle) < 2.2), np.abs(middle) < 0.6
    lower, upper = np.array([True, False]), np.array([False, True])

    def cells(columns: np.ndarray, layers: np.ndarray) -> np.ndarray:
        return np.asarray(columns[:, None, None] & layers[None, None, :])

    regions = {
        "belt_core_lower": cells(core, lower), "belt_core_upper": cells(core, upper),
        "belt_arms": cells(~core & ~notch, lower | upper), "belt_notches": cells(notch, lower),
    }  # fmt: skip
    dx, dz = np.diff(x)[:, None], np.diff(z)[None, :]
    volume = dx * dz
    xm, zm = middle[:, None], (np.array(z[1:]) + np.array(z[:-1]))[None, :] / 2
    turning = volume * (xm**2 + dx**2 / 12 + zm**2 + dz**2 / 12)
    moments = {n: [float((q * r[:, 0, :]).sum()) for q in (volume, volume * zm, turning)] for n, r in regions.items()}
    light = 0.02 * mass / volume.sum()
    solved = ["belt_core_lower", "belt_core_upper", "belt_arms"]
    right = np.array([mass, 0.0, inertia]) - light * np.array(moments["belt_notches"])
    values = np.linalg.solve(np.array([moments[n] for n in solved]).T, right)
    body = Body("belt", x, (-0.5, 0.5), z, regions)
    return body, {**dict(zip(solved, map(float, values), strict=True)), "belt_notches": light}


def _scene(
    masses: dict[str, float], springs: list[dict[str, Any]], contacts: list[dict[str, Any]],
    supports: list[dict[str, str]],
) -> dict[str, Any]:  # fmt: skip
    """Return a scene of bodies of unit volume."""
    return {
        "mesh": {"file": "stiff_bodies.msh", "order": 1},
        "materials": {name: _material(mass) for name, mass in masses.items()},
        "bodies": {name: {"material": name} for name in masses},
        "supports": supports,
        "springs": [s for s in springs if "stiffness" in s or "damping" in s],
        "contacts": contacts,
        "effects": {"friction": {"mu": 0.3}},
    }


def _material(density: float) -> dict[str, float]:
    # Without Poisson's effect a body that is pressed does not spread along the belt.
    return {"youngs_modulus": 1.0, "poisson_ratio": 0.0, "density": density}


def _spring(
    name: str, surface: str, direction: tuple[float, ...], stiffness: float, damping: float, to: str | None = None
) -> dict[str, Any]:
    sizes = {k: float(v) for k, v in (("stiffness", stiffness), ("damping", damping)) if v}
    other = {"to": to} if to is not None else {}
    return {"name": name, "surface": surface, "direction": [float(d) for d in direction], **sizes, **other}


def _contact(surface: str, counterface: str, stiffness: float, damping: float, area: float) -> dict[str, Any]:
    return {
        "name": surface, "surface": surface, "counterface": counterface, "normal_stiffness": stiffness / area,
        "normal_damping": damping / area, "sliding": BELT,
    }  # fmt: skip
