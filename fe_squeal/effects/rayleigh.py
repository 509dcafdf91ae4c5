"""Rayleigh damping of elastic bodies: C = α M + β K."""

from __future__ import annotations

from ..problem.terms import Term
from ..schema.section import NonNegative, Section


class Rayleigh(Section):
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

    alpha: NonNegative = 0.0
    beta: NonNegative = 0.0


def rayleigh_terms(rayleigh: Rayleigh, path: str, body: str, mass: Term, elastic: Term) -> list[Term]:
    """Return the damping terms of one body, only those that are not zero.

    Parameters
    ----------
    path : str
        Of the table, for the parameters' names.
    mass, elastic : Term
        Of the body.
    """
    parts = ((rayleigh.alpha, "alpha", mass), (rayleigh.beta, "beta", elastic))
    return [
        Term(f"rayleigh.{body}", "C", of.matrix, symmetric=True, powers={f"{path}.{key}": 1, **of.powers})
        for size, key, of in parts
        if size
    ]
