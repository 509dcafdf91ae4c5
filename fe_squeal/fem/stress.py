"""Stresses of a displacement field."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .element_matrices import ElementShapes, element_shapes
from .materials import Elasticity
from .pressures import projected
from .spaces import DisplacementSpace


def element_stress(
    space: DisplacementSpace, elements: np.ndarray, law: Elasticity, u: np.ndarray
) -> Iterator[tuple[ElementShapes, np.ndarray]]:
    """Yield the stress σ(u) at the quadrature points of elements, (e, 3, 3, q) Pa, with their shape functions.

    Parameters
    ----------
    elements : (e,) int
    law : Elasticity
        The body's law; in the mixed formulation with a pressure of its own, since λ div u means nothing in the limit
        ν = ½.
    u : (n,) float, m
    """
    amplitudes = space.amplitudes(u)
    for shapes in element_shapes(space, elements):
        gradient = np.einsum("ejc,ejdq->ecdq", amplitudes[shapes.nodes], shapes.gradients, optimize=True)
        stress = np.einsum("abcd,ecdq->eabq", law.stiffness, gradient, optimize=True)
        if law.lame:
            strain = projected(np.einsum("eaaq->eq", gradient), shapes.points, shapes.dx, space.order)
            stress = stress + law.lame * strain[:, None, None] * np.eye(3)[None, :, :, None]
        yield shapes, stress


def von_mises(space: DisplacementSpace, elements: np.ndarray, law: Elasticity, u: np.ndarray) -> np.ndarray:
    """Return the mean von Mises stress √(3/2 s:s) of each element, s the deviatoric stress, (e,) Pa.

    Parameters
    ----------
    As of `element_stress`.
    """
    means = []
    for shapes, stress in element_stress(space, elements, law, u):
        pressure = np.einsum("eaaq->eq", stress) / 3
        s = stress - pressure[:, None, None] * np.eye(3)[None, :, :, None]
        size = np.sqrt(1.5 * np.einsum("eabq,eabq->eq", s, s))
        means.append((size * shapes.dx).sum(axis=1) / shapes.dx.sum(axis=1))
    return np.concatenate(means)
