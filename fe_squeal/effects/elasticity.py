"""Elastic bodies: K_e = ∫ ε(δu):σ(u) and M = ∫ ρ δu·u."""

from __future__ import annotations

import numpy as np

from ..fem.materials import Material, elasticity
from ..fem.row_assembly import elastic_matrices
from ..fem.spaces import DisplacementSpace
from ..problem.terms import Term


def elastic_terms(
    space: DisplacementSpace, body: str, elements: np.ndarray, material: Material, path: str, axes: np.ndarray | None,
    mixed: bool = False,
) -> tuple[Term, Term]:  # fmt: skip
    """Return mass and elastic stiffness of one body.

    Parameters
    ----------
    elements : (e,) int
    path : str
        Path of the material in the scene, with which the parameters' names begin.
    axes : (3, 3) float or None
        Rows: axes of an orthotropic material.
    mixed : bool
        Whether the pressure is one of its own, see `fe_squeal.fem.pressures`; the space then has the bubbles for it.
    """
    if material.is_orthotropic:
        law, powers = elasticity(material, axes), {}
    else:
        unit = material.model_copy(update={"youngs_modulus": 1.0})
        law, powers = elasticity(unit, mixed=mixed), {f"{path}.youngs_modulus": 1}
    K, M = elastic_matrices(space, elements, law.stiffness, 1.0, law.lame)
    mass = Term(f"mass.{body}", "M", M, symmetric=True, powers={f"{path}.density": 1})
    return mass, Term(f"elastic.{body}", "K", K, symmetric=True, powers=powers)
