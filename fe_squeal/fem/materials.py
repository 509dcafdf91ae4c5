"""Linear elastic materials: isotropic and orthotropic stiffness tensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field, field_validator, model_validator

from ..schema.section import NonNegative, Positive, Section

# Voigt's order of index pairs; shear entries are engineering strains.
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


class Material(Section):
    """A linear elastic material, isotropic (numbers) or orthotropic (lists of three).

    Attributes
    ----------
    youngs_modulus : float or [E1, E2, E3], Pa
        Young's modulus; orthotropic: along the material axes 1, 2 and 3.
    poisson_ratio : float or [nu23, nu13, nu12]
        nu_ij = −strain_j/strain_i under a stress along i alone; above −1 and below 0.5 for an isotropic material. Where
        it comes near 0.5 the body wants formulation = "mixed"; 0.4999 then stands for an incompressible material.
    density : float, kg/m^3
        Mass per volume.
    shear_modulus : [G23, G13, G12], Pa
        Shear moduli in the planes 2-3, 1-3 and 1-2; with an orthotropic material only.
    loss_factor : float
        Structural damping eta of K(1 + i eta); read by `[effects.structural_damping]`, no effect without it.

    Examples
    --------
    >>> steel = Material(youngs_modulus=2e11, poisson_ratio=0.3, density=7800.0)
    >>> steel.is_orthotropic
    False
    """

    youngs_modulus: Positive | list[Positive]
    poisson_ratio: float | list[float]
    density: Positive
    shear_modulus: Annotated[list[Positive], Field(min_length=3, max_length=3)] | None = None
    loss_factor: NonNegative = 0.0

    @property
    def is_orthotropic(self) -> bool:
        """Whether the material has its own axes."""
        return isinstance(self.youngs_modulus, list)

    @field_validator("youngs_modulus", "poisson_ratio")
    @classmethod
    def _three(cls, value: float | list[float]) -> float | list[float]:
        if isinstance(value, list) and len(value) != 3:
            raise ValueError(f"expected a number, or a list of three for an orthotropic material; got {len(value)}")
        return value

    @field_validator("poisson_ratio")
    @classmethod
    def _stable_poisson(cls, value: float | list[float]) -> float | list[float]:
        if not isinstance(value, list) and not -1.0 < value < 0.5:
            raise ValueError("expected a number with -1 < nu < 0.5, outside which the stiffness is not positive")
        return value

    @model_validator(mode="after")
    def _consistent(self) -> Material:
        lists = [isinstance(v, list) for v in (self.youngs_modulus, self.poisson_ratio)] + [
            self.shear_modulus is not None
        ]
        if any(lists) and not all(lists):
            raise ValueError(
                "an orthotropic material needs youngs_modulus = [E1, E2, E3], shear_modulus = [G23, G13, G12] and"
                " poisson_ratio = [nu23, nu13, nu12]; an isotropic one youngs_modulus and poisson_ratio as numbers"
            )
        if self.is_orthotropic and np.linalg.eigvalsh(_orthotropic_compliance(self)).min() <= 0:
            raise ValueError(
                "these moduli and Poisson ratios have no positive definite compliance; expected"
                " |nu_ij| < sqrt(E_i/E_j) and 1 - nu12 nu21 - nu23 nu32 - nu13 nu31 - 2 nu21 nu32 nu13 > 0"
            )
        return self


def stiffness_tensor(material: Material, axes: np.ndarray | None = None) -> np.ndarray:
    """Return the stiffness tensor C of stress_ij = C_ijkl strain_kl.

    Parameters
    ----------
    material : Material
    axes : (3, 3) float, optional
        Rows are the orthonormal material axes 1, 2, 3 in global coordinates (default: global axes).

    Returns
    -------
    (3, 3, 3, 3) float, Pa

    Examples
    --------
    >>> steel = Material(youngs_modulus=2e11, poisson_ratio=0.25, density=7800.0)
    >>> float(stiffness_tensor(steel)[0, 1, 0, 1]) / 1e9    # the shear modulus, GPa
    80.0
    """
    if material.is_orthotropic:
        voigt = np.linalg.inv(_orthotropic_compliance(material))
    else:
        E, nu = float(material.youngs_modulus), float(material.poisson_ratio)  # type: ignore[arg-type]
        shear = E / (2 * (1 + nu))
        voigt = np.diag([2 * shear] * 3 + [shear] * 3)
        voigt[:3, :3] += lame_lambda(material)
    tensor = np.zeros((3, 3, 3, 3))
    for a, (i, j) in enumerate(VOIGT):
        for b, (k, l) in enumerate(VOIGT):
            for p, q in {(i, j), (j, i)}:
                for r, s in {(k, l), (l, k)}:
                    tensor[p, q, r, s] = voigt[a, b]
    if axes is None:
        return tensor
    R = np.asarray(axes)
    return np.einsum("pi,qj,rk,sl,pqrs->ijkl", R, R, R, R, tensor, optimize=True)


@dataclass(frozen=True)
class Elasticity:
    """The law of a body, σ = C:ε(u) + λ Π(div u) 1, with Π of `fe_squeal.fem.pressures`.

    Attributes
    ----------
    stiffness : (3, 3, 3, 3) float, Pa
        C; of the mixed formulation without Lamé's λ.
    lame : float, Pa
        Lamé's λ of the mixed formulation, else 0.
    """

    stiffness: np.ndarray
    lame: float = 0.0


def elasticity(material: Material, axes: np.ndarray | None = None, mixed: bool = False) -> Elasticity:
    """Return the law of a material in the standard or in the mixed formulation.

    Parameters
    ----------
    material : Material
        Isotropic for the mixed formulation.
    axes : as of `stiffness_tensor`

    Examples
    --------
    >>> rubber = Material(youngs_modulus=3e6, poisson_ratio=0.499, density=1100.0)
    >>> law = elasticity(rubber, mixed=True)
    >>> round(law.lame / 1e6), round(float(law.stiffness[0, 0, 1, 1]), 3)
    (499, 0.0)
    """
    if not mixed:
        return Elasticity(stiffness_tensor(material, axes))
    E, nu = float(material.youngs_modulus), float(material.poisson_ratio)  # type: ignore[arg-type]
    shear = E / (1 + nu) * (np.einsum("ik,jl", np.eye(3), np.eye(3)) + np.einsum("il,jk", np.eye(3), np.eye(3))) / 2
    return Elasticity(shear, lame_lambda(material))


def lame_lambda(material: Material) -> float:
    """Return Lamé's λ = E ν/((1 + ν)(1 − 2ν)) of an isotropic material, Pa."""
    E, nu = float(material.youngs_modulus), float(material.poisson_ratio)  # type: ignore[arg-type]
    return E * nu / ((1 + nu) * (1 - 2 * nu))


def isotropic_shear(material: Material) -> float:
    """Return G12 of an orthotropic material that is isotropic in the plane 1-2, E1/(2(1 + nu12)), Pa."""
    E1, nu12 = material.youngs_modulus[0], material.poisson_ratio[2]  # type: ignore[index]
    return E1 / (2 * (1 + nu12))


def material_axes(first: tuple[float, ...], second: tuple[float, ...]) -> np.ndarray:
    """Return orthonormal material axes as rows from axis 1 and a vector in the plane of axes 1 and 2.

    Raises
    ------
    ValueError
        If the two are parallel or zero.

    Examples
    --------
    >>> material_axes((0, 2, 0), (0, 1, 1))[1].tolist()
    [0.0, 0.0, 1.0]
    """
    a, b = np.array(first, float), np.array(second, float)
    normal = np.cross(a, b)
    if np.linalg.norm(normal) <= 1e-6 * np.linalg.norm(a) * np.linalg.norm(b) or not normal.any():
        raise ValueError("axes 1 and 2 are parallel or zero")
    a /= np.linalg.norm(a)
    normal /= np.linalg.norm(normal)
    return np.array([a, np.cross(normal, a), normal])


def _orthotropic_compliance(material: Material) -> np.ndarray:
    E1, E2, E3 = material.youngs_modulus  # type: ignore[misc]
    nu23, nu13, nu12 = material.poisson_ratio  # type: ignore[misc]
    compliance = np.diag([1 / E1, 1 / E2, 1 / E3, *(1 / g for g in material.shear_modulus or ())])
    for i, j, value in ((1, 2, -nu23 / E2), (0, 2, -nu13 / E1), (0, 1, -nu12 / E1)):
        compliance[i, j] = compliance[j, i] = value
    return compliance
