"""Blocks of nearly incompressible material, with known spectra, for the tests of the mixed formulation."""

from __future__ import annotations

from itertools import product

import numpy as np

from fe_squeal.fem.element_matrices import assemble_elasticity
from fe_squeal.fem.materials import Material, elasticity
from fe_squeal.fem.spaces import make_space
from meshes import make_problem, modes_of

SIZE = (1.0, 0.83, 0.71)
WALLS = [
    {"surface": s, "fixed": c} for c, pair in zip("xyz", ("left right", "front back", "bottom top"), strict=True)
    for s in pair.split()
]  # fmt: skip
SCHEMES = [("hex1", 1), ("tet1", 1), ("hex1", 2), ("tet1", 2)]


def lining(nu):
    """Return a material with Young's modulus 1 and density 1; relative errors of elements do not depend on these."""
    return {"youngs_modulus": 1.0, "poisson_ratio": nu, "density": 1.0}


def formulated(name, formulation="mixed"):
    return {name: {"material": "lining", "formulation": formulation}}


def matrices(mesh, order, nu, mixed=True, held=()):
    """Return the space and K, M of one body of unit modulus and density."""
    elements = np.arange(mesh.nelements)
    space = make_space(mesh, order, list(held), [elements] if mixed else [])
    law = elasticity(Material(**lining(nu)), mixed=mixed)
    return space, *assemble_elasticity(space, elements, law.stiffness, 1.0, law.lame)


def between_walls(nu, count, size=SIZE):
    """Return the lowest ω, with multiplicities, of a block with u·n = 0 and no shear stress on all faces.

    Modes are u_i = A_i sin(k_i x_i) Π_{j≠i} cos(k_j x_j), k = π(l/Lx, m/Ly, n/Lz). A ∥ k gives a pressure wave with
    ω = c_p|k|, and A ⊥ k shear waves with ω = c_s|k|: one fewer than k has components that are not zero.
    """
    c_s = np.sqrt(1 / (2 * (1 + nu)))
    c_p = c_s * np.sqrt((2 - 2 * nu) / (1 - 2 * nu))
    found = []
    for lmn in product(range(7), repeat=3):
        k = np.pi * np.linalg.norm(np.array(lmn) / np.array(size))
        found += [c_p * k] * bool(k > 0) + [c_s * k] * (np.count_nonzero(lmn) - 1)
    return np.sort(found)[:count]


def modes_between_walls(mesh, order, nu, count, formulation="mixed"):
    """Return the lowest modes of a block between frictionless walls."""
    problem = make_problem(
        mesh, order=order, supports=WALLS, materials={"lining": lining(nu)}, bodies=formulated("block", formulation)
    )
    return modes_of(problem, count)


def relative_errors(mesh, order, nu, count, formulation="mixed"):
    """Return the relative errors of the lowest ω² between walls."""
    theta = modes_between_walls(mesh, order, nu, count, formulation).lam.imag[:count] ** 2
    return theta / between_walls(nu, count) ** 2 - 1
