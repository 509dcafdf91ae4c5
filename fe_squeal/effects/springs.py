"""Springs with dampers, spread over a surface or between the mean motions of two."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from pydantic import model_validator

from ..fem.spaces import DisplacementSpace
from ..fem.surfaces import Patch
from ..problem.terms import Slot, Term
from ..schema.place import Placed
from ..schema.section import Direction, Name, NonNegative


class Spring(Placed):
    """A spring along one direction.

    On one surface of area A it is a foundation, K = ∫ (k/A) δu_d u_d dA, and at N nodes a spring of k/N at each; with
    `to` it acts on the difference of the mean motions of two surfaces or node sets, K = k δr r with
    r = mean(u_d) − mean'(u_d).

    Attributes
    ----------
    name : str
        Name in messages and results; no two springs have the same.
    direction : vector
        Direction in which it acts, in global coordinates, of any length.
    stiffness : float, N/m
        Total stiffness, over the whole surface or all nodes; stiffness or damping above 0.
    damping : float, N s/m
        Total damping, over the whole surface or all nodes.
    to : str
        A second surface group, or with `nodes` a second node set.
    """

    name: Name
    direction: Direction
    stiffness: NonNegative = 0.0
    damping: NonNegative = 0.0
    to: str | None = None

    @model_validator(mode="after")
    def _acts(self) -> Spring:
        if self.stiffness == 0 and self.damping == 0:
            raise ValueError("has neither stiffness nor damping; expected at least one of them > 0")
        return self


def spring_terms(
    space: DisplacementSpace, spring: Spring, patch: Patch, means: tuple[sp.csr_array, sp.csr_array] | None
) -> list[Term]:
    """Return the stiffness and damping terms of a spring, only those that are not zero.

    Parameters
    ----------
    means : two (3, n) sparse, or None
        Mean displacements of the two ends of a spring that has `to`.
    """
    direction = np.array(spring.direction) / np.linalg.norm(spring.direction)
    if means is None:
        motion = space.along(patch.values, direction)
        shape = motion.T @ sp.diags_array(patch.weights / patch.area) @ motion
    else:
        one, other = means
        motion = sp.csr_array(direction[None, :]) @ (one - other)
        shape = motion.T @ motion
    shape = sp.csr_array((shape + shape.T) / 2)
    slots: list[tuple[Slot, str, float]] = [("K", "stiffness", spring.stiffness), ("C", "damping", spring.damping)]
    name, path = f"spring.{spring.name}", f"springs.{spring.name}"
    return [Term(name, slot, shape, symmetric=True, powers={f"{path}.{key}": 1}) for slot, key, size in slots if size]
