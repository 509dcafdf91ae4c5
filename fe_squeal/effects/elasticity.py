"""Elastic bodies: K_e = ∫ ε(δu):C:ε(u) and M = ∫ ρ δu·u."""

from __future__ import annotations

import numpy as np

from ..materials import Material, stiffness_tensor
from ..spaces import DisplacementSpace, assemble_elasticity
from ..terms import Term


def elastic_terms(
    space: DisplacementSpace, body: str, elements: np.ndarray, material: Material, axes: np.ndarray | None
) -> list[Term]:
    """Return mass and elastic stiffness of one body.

    Parameters
    ----------
    elements : (e,) int
    axes : (3, 3) float or None
        Rows: axes of an orthotropic material.
    """
    K, M = assemble_elasticity(space, elements, stiffness_tensor(material, axes), material.density)
    return [Term(f"mass.{body}", "M", M, symmetric=True), Term(f"elastic.{body}", "K", K, symmetric=True)]
