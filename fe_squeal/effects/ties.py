"""Rigid bodies and averaged reference points: their tables, and the mass and springs at the reference."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated

import numpy as np
import scipy.sparse as sp
from pydantic import Field, field_validator, model_validator

from ..fem.spaces import DisplacementSpace
from ..fem.ties import FREEDOMS, Tie
from ..problem.terms import Slot, Term
from ..schema.place import Placed
from ..schema.section import Direction, Name, NonNegative, Section, Vector

_WORDS = re.compile(r"(?:r?[xyz]|[\s,])*")


class ReferenceSpring(Section):
    """A spring between a reference point and the ground, K = k δu_d u_d or k δθ_d θ_d.

    Attributes
    ----------
    direction : vector
        Along which it acts, of any length.
    axis : vector
        About which it acts, instead of `direction`.
    stiffness : float, N/m
        About an axis in N m/rad; stiffness or damping above 0.
    damping : float, N s/m
        About an axis in N m s/rad.
    """

    direction: Direction | None = None
    axis: Direction | None = None
    stiffness: NonNegative = 0.0
    damping: NonNegative = 0.0

    @model_validator(mode="after")
    def _acts(self) -> ReferenceSpring:
        if (self.direction is None) == (self.axis is None):
            raise ValueError("expected either direction or axis")
        if self.stiffness == 0 and self.damping == 0:
            raise ValueError("has neither stiffness nor damping; expected at least one of them > 0")
        return self


class Rigid(Placed):
    """Nodes, or a surface, that move as a rigid body with a reference point; eliminated exactly.

    u_i = U + θ × (x_i − x_r) with the six freedoms U, θ of the reference. Nodes in one place have U alone.

    Attributes
    ----------
    name : str
        Name in messages and results; no two ties have the same.
    reference : vector, m
        The point that mass, held freedoms and springs are at (default: the middle of the nodes); in metres always.
    mass : float, kg
        Mass of the body at its reference point, added to that of the elements.
    inertia : six numbers, kg m^2
        Ixx, Iyy, Izz, Ixy, Ixz, Iyz of the tensor ∫ρ(|x|² 1 − x x) dV about the reference.
    fixed : str
        Freedoms of the reference that are held: any of x, y, z and the rotations rx, ry, rz, such as "xyz rz".
    springs : list of tables
        Springs from the reference to the ground.
    """

    name: Name
    reference: Vector | None = None
    mass: NonNegative = 0.0
    inertia: Annotated[list[float], Field(min_length=6, max_length=6)] | None = None
    fixed: str = ""
    springs: list[ReferenceSpring] = []

    @field_validator("fixed")
    @classmethod
    def _freedoms(cls, value: str) -> str:
        found = re.findall(r"r?[xyz]", value)
        if not _WORDS.fullmatch(value) or len(set(found)) < len(found):
            raise ValueError('expected any of x, y, z, rx, ry and rz, each once, such as "xyz" or "xyz rx ry rz"')
        return value

    @field_validator("inertia")
    @classmethod
    def _possible(cls, value: list[float] | None) -> list[float] | None:
        if value is not None and np.linalg.eigvalsh(inertia_tensor(value)).min() < -1e-9 * max(map(abs, value)):
            raise ValueError("this tensor has a negative moment of inertia; expected Ixx, Iyy, Izz, Ixy, Ixz, Iyz")
        return value

    @property
    def held(self) -> np.ndarray:
        """(6,) bool: which freedoms of the reference are held."""
        found = re.findall(r"r?[xyz]", self.fixed)
        return np.array([freedom in found for freedom in FREEDOMS])

    @property
    def is_loaded(self) -> bool:
        """Whether something acts on the reference: mass, inertia, a spring or what holds it."""
        return bool(self.mass or any(self.inertia or ()) or self.springs or self.fixed)


class Averaged(Rigid):
    """A reference point that follows the mean motion of a surface or node set (distributing coupling, RBE3).

    It takes the rigid motion that is nearest to the nodes' in the mean, and leaves them free to deform otherwise; what
    acts on it is spread over them. Eliminated exactly.
    """


def inertia_tensor(numbers: Sequence[float]) -> np.ndarray:
    """Return the tensor (3, 3) of Ixx, Iyy, Izz, Ixy, Ixz, Iyz."""
    xx, yy, zz, xy, xz, yz = numbers
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def idle_at_reference(table: Rigid) -> list[str]:
    """Return the keys of mass, inertia and springs at a reference that act on nothing but freedoms that are held.

    Inertia about an axis that is held acts on the others where the body rotates.
    """
    shift, turn = ~table.held[:3], ~table.held[3:]
    idle = ["mass"] if table.mass and not shift.any() else []
    idle += ["inertia"] if any(table.inertia or ()) and not turn.any() else []
    for i, spring in enumerate(table.springs):
        way, free = (spring.direction, shift) if spring.direction is not None else (spring.axis, turn)
        if not np.array(way)[free].any():
            idle.append(f"springs[{i}]")
    return idle


def tie_terms(space: DisplacementSpace, tie: Tie, table: Rigid, path: str) -> list[Term]:
    """Return mass and springs at a tie's reference point, only those that are not zero.

    Parameters
    ----------
    path : str
        Path of the table in the scene.
    """
    motion = space.reference(tie)
    terms = []
    if table.mass:
        U = motion[:3]
        terms.append(_term(f"{tie.name}.mass", "M", U, np.eye(3), {f"{path}.mass": 1}))
    if table.inertia is not None and any(table.inertia):
        terms.append(_term(f"{tie.name}.inertia", "M", motion[3:], inertia_tensor(table.inertia), {}))
    for i, spring in enumerate(table.springs):
        way = spring.direction or spring.axis
        assert way is not None
        d = np.array(way) / np.linalg.norm(way)
        rows = motion[:3] if spring.direction is not None else motion[3:]
        slots: list[tuple[Slot, str, float]] = [("K", "stiffness", spring.stiffness), ("C", "damping", spring.damping)]
        for slot, key, size in slots:
            if size:
                powers = {f"{path}.springs.{i}.{key}": 1}
                terms.append(_term(f"{tie.name}.springs.{i}", slot, rows, np.outer(d, d), powers))
    return terms


def _term(name: str, slot: Slot, rows: sp.csr_array, A: np.ndarray, powers: dict[str, int]) -> Term:
    matrix = sp.csr_array(rows.T @ sp.csr_array(A) @ rows)
    return Term(f"reference.{name}", slot, sp.csr_array((matrix + matrix.T) / 2), symmetric=True, powers=powers)
