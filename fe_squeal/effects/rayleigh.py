"""Rayleigh damping of elastic bodies: C = α M + β K."""

from __future__ import annotations

from typing import ClassVar

from ..problem.terms import Term
from ..schema.section import NonNegative
from .context import BodyPart, Context
from .effect import Effect


class Rayleigh(Effect):
    """Rayleigh damping C = α M + β K, of a mode of frequency ω the damping ratio ζ = (α/ω + βω)/2.

    K is the bodies' elastic stiffness alone: contact, friction and springs are not damped by it. A body's own table
    replaces that of the whole model. (Rayleigh, The Theory of Sound, 1877, § 97.)

    Attributes
    ----------
    alpha : float, 1/s
        Proportional to the mass.
    beta : float, s
        Proportional to the elastic stiffness.
    """

    name: ClassVar[str] = "rayleigh"
    summary: ClassVar[str] = "Rayleigh damping of all bodies."
    own_of_body: ClassVar[str] = "Rayleigh damping of this body, instead of that of the whole model."

    alpha: NonNegative = 0.0
    beta: NonNegative = 0.0

    @property
    def acts(self) -> bool:
        """Whether anything is damped."""
        return bool(self.alpha or self.beta)

    def body_terms(self, context: Context, body: BodyPart, path: str) -> list[Term]:
        """Return the damping of a body."""
        return rayleigh_terms(self, path, body.name, body.mass, body.elastic)


def rayleigh_terms(rayleigh: Rayleigh, path: str, body: str, mass: Term, elastic: Term) -> list[Term]:
    """Return the damping terms of one body, only those that are not zero.

    Parameters
    ----------
    path : str
        Path of the table in the scene, with which the parameters' names begin.
    mass, elastic : Term
        Mass and elastic stiffness of the body.
    """
    parts = ((rayleigh.alpha, "alpha", mass), (rayleigh.beta, "beta", elastic))
    return [
        Term(f"rayleigh.{body}", "C", of.matrix, symmetric=True, powers={f"{path}.{key}": 1, **of.powers})
        for size, key, of in parts
        if size
    ]
