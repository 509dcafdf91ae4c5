"""Stiffness of the static forces on nodes that are tied to a reference: what the stress of the tie would give it.

A rigid body has no strain, and its stress is no material's: it is what holds together the forces f_i on its nodes. In a
rotation they do work in second order, since u_i = θ × r_i + ½ θ × (θ × r_i), r_i from the reference to the node. The
forces keep their direction, so that this is (derived here by virtual work)

    δ²W = Σ f_i · ½ (δθ × (θ × r_i) + θ × (δθ × r_i)) = −δθ·K θ,    K = tr(S) 1 − (S + Sᵀ)/2,    S = Σ f_i r_iᵀ.

A force F that presses a lever of length L softens it by F L. The centrifugal forces of a rigid part that spins give
back what K_Ω takes: with I = ∫ρ x² = ∫ρ y² across the axis S = Ω² diag(I, I, 0) and K = Ω² diag(I, I, 2 I), which is
−K_Ω of its rotations.

An averaged reference spreads what acts on it over its nodes, and hangs on them by a lever as stiff as a rigid body.
Here θ is their mean rotation. As far as they turn with it, forces that are in balance with what is spread do the same
work; that of moments along with deformations of the nodes among themselves, in second order, is left out.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from .materials import Elasticity
from .spaces import DisplacementSpace
from .stress import element_stress
from .ties import Tie


def elastic_forces(
    space: DisplacementSpace, elements: np.ndarray, law: Elasticity, u: np.ndarray, nodes: np.ndarray
) -> np.ndarray:
    """Return the forces −∫ σ_ab ∂_b N_i of the stress of elements on some nodes, (nodes, 3) N; zero on all others.

    Parameters
    ----------
    elements : (e,) int
    law : Elasticity
    u : (n,) float, m
        Static displacements.
    nodes : (m,) int
    """
    forces = np.zeros((space.functions, 3))
    there = elements[np.isin(space.dofs.element_dofs[:, elements], nodes).any(axis=0)]
    for shapes, stress in element_stress(space, there, law, u) if len(there) else ():
        np.add.at(forces, shapes.nodes, -np.einsum("eabq,ejbq,eq->eja", stress, shapes.gradients, shapes.dx))
    found = np.zeros((space.nodes, 3))
    found[nodes] = forces[nodes]
    return found


def rigid_stiffness(space: DisplacementSpace, tie: Tie, forces: np.ndarray) -> sp.csr_array:
    """Return the stiffness of static forces on the nodes of a tie, (n, n), on the unknowns.

    Parameters
    ----------
    tie : Tie
        A rigid or an averaged one.
    forces : (nodes, 3) float, N
        Forces of all that acts on the nodes, but for those of the tie.
    """
    S = forces[tie.nodes].T @ (space.coordinates[tie.nodes] - tie.point)
    K = np.trace(S) * np.eye(3) - (S + S.T) / 2
    rows = space.reference(tie)[3:]
    matrix = sp.csr_array(rows.T @ sp.csr_array(K) @ rows)
    return sp.csr_array((matrix + matrix.T) / 2)
