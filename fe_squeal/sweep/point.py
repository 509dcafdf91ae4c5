"""The modes at one value of a sweep, and their shapes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..eigen.blocks import lift
from ..eigen.columns import Columns
from ..eigen.pencil import Modes


class LiftedShapes(Mapping[int, np.ndarray]):
    """Shapes u = Vy (n,) by the position of the mode; each is made from its coordinates y when it is asked for.

    Parameters
    ----------
    coordinates : mapping of int to (r,) complex
        y, by the position of the mode.
    V : (n, r) float
        The basis of the reduced model.
    """

    def __init__(self, coordinates: Mapping[int, np.ndarray], V: Columns) -> None:
        self.coordinates, self._V = coordinates, V

    def __getitem__(self, i: int) -> np.ndarray:
        return lift(self._V, self.coordinates[i])

    def __iter__(self) -> Iterator[int]:
        return iter(self.coordinates)

    def __len__(self) -> int:
        return len(self.coordinates)


@dataclass(frozen=True)
class SweepPoint:
    """The modes at one value of the parameter.

    Attributes
    ----------
    value : float
        Value of the parameter.
    modes : Modes
        The k modes, by rising Im λ, without their shapes: `modes.lam` (k,) complex, rad/s, and what is known of each.
    branches : (k,) int
        The branch of each mode.
    shapes : mapping of int to (n,) complex
        By the position of the mode, displacements of all n unknowns: of the unstable modes, or of all modes if the
        sweep was asked to keep them.
    sensitivities : mapping of int to {str: (float, complex)}
        By the position of an unstable mode and the path of a number in the scene: this number, and ∂λ/∂number.
    pressed : mapping of str to {str: float}
        By the name of a contact: pressed area, force and the like in the static state under preload, see
        `contact_summary`.
    discretisation : (k,) complex or None, rad/s
        Errors of Re λ and of Im λ by the mesh, where they are estimated.
    extrapolated : (k,) complex or None, rad/s
        Likely λ for an infinitely fine mesh, where that is estimated; NaN for a mode that the refined mesh does not
        have.
    extrapolated_discretisation : (k,) complex or None, rad/s
        Errors of the real and the imaginary part of `extrapolated`.
    above : tuple of complex, rad/s
        Unstable λ above the modes that were asked for, if the solver happened to find any.
    between : bool
        Whether this is not a value of the sweep but the middle of a window of instability between two values.
    description : mapping of str to (k,) entries
        What the modes look like, by the column of modes.csv, see `fe_squeal.problem.description`; empty if the problem
        has no describer.
    """

    value: float
    modes: Modes
    branches: np.ndarray
    shapes: Mapping[int, np.ndarray]
    sensitivities: Mapping[int, Mapping[str, tuple[float, complex]]] = field(default_factory=dict)
    pressed: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    discretisation: np.ndarray | None = None
    extrapolated: np.ndarray | None = None
    extrapolated_discretisation: np.ndarray | None = None
    above: tuple[complex, ...] = ()
    between: bool = False
    description: Mapping[str, Sequence[object]] = field(default_factory=dict)
