"""Elastic bodies: K_e = ∫ ε(δu):C:ε(u) and M = ∫ ρ δu·u."""

from __future__ import annotations

import numpy as np

from ..materials import Material, stiffness_tensor
from ..spaces import DisplacementSpace, assemble_elasticity
from ..terms import Term


def elastic_terms(
    space: DisplacementSpace, body: str, elements: np.ndarray, material: Material, path: str, axes: np.ndarray | None
) -> tuple[Term, Term]:
    """Return mass and elastic stiffness of one body.

    Parameters
    ----------
    elements : (e,) int
    path : str
        Of the material, for the parameters' names.
    axes : (3, 3) float or None
        Rows: axes of an orthotropic material.
    """
    if material.is_orthotropic:
        stiffness, powers = stiffness_tensor(material, axes), {}
    else:
        unit = material.model_copy(update={"youngs_modulus": 1.0})
        stiffness, powers = stiffness_tensor(unit), {f"{path}.youngs_modulus": 1}
    K, M = assemble_elasticity(space, elements, stiffness, 1.0)
    mass = Term(f"mass.{body}", "M", M, symmetric=True, powers={f"{path}.density": 1})
    return mass, Term(f"elastic.{body}", "K", K, symmetric=True, powers=powers)
