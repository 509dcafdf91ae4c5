"""Stresses of a displacement field."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .spaces import DisplacementSpace, ElementShapes, element_shapes


def element_stress(
    space: DisplacementSpace, elements: np.ndarray, stiffness: np.ndarray, u: np.ndarray
) -> Iterator[tuple[ElementShapes, np.ndarray]]:
    """Yield the stress σ = C:ε(u) at the quadrature points of elements, (e, 3, 3, q) Pa, with their shape functions.

    Parameters
    ----------
    elements : (e,) int
    stiffness : (3, 3, 3, 3) float, Pa
    u : (n,) float, m
    """
    nodal = space.expand(u)
    for shapes in element_shapes(space, elements):
        gradient = np.einsum("ejc,ejdq->ecdq", nodal[shapes.nodes], shapes.gradients, optimize=True)
        yield shapes, np.einsum("abcd,ecdq->eabq", stiffness, gradient, optimize=True)


def von_mises(space: DisplacementSpace, elements: np.ndarray, stiffness: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the mean von Mises stress √(3/2 s:s) of each element, s the deviatoric stress, (e,) Pa.

    Parameters
    ----------
    As of `element_stress`.
    """
    means = []
    for shapes, stress in element_stress(space, elements, stiffness, u):
        pressure = np.einsum("eaaq->eq", stress) / 3
        s = stress - pressure[:, None, None] * np.eye(3)[None, :, :, None]
        size = np.sqrt(1.5 * np.einsum("eabq,eabq->eq", s, s))
        means.append((size * shapes.dx).sum(axis=1) / shapes.dx.sum(axis=1))
    return np.concatenate(means)
