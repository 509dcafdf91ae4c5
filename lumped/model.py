"""What all lumped models share: the equation (λ² M + λ C + K0 + μ F) u = 0 and what follows from it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .critical_points import CriticalPoint, Search, search_critical_points
from .parameters import check_parameters
from .response import solve_response
from .spectrum import Complexes, Spectrum, solve_eigenvalues, solve_spectrum
from .springs import Floats


@dataclass(frozen=True)
class LumpedModel(ABC):
    """Base of the lumped models; the parameters are checked when one is made.

    Attributes
    ----------
    name : str
        As in the command line.
    coordinates : tuple of str
        Names of the degrees of freedom, in order.
    default_mu : float
        The friction coefficient at which the model is evaluated unless another is given.
    """

    name: ClassVar[str] = ""
    coordinates: ClassVar[tuple[str, ...]] = ()
    default_mu: ClassVar[float] = 0.5

    def __post_init__(self) -> None:
        check_parameters(self.name, self)

    @property
    @abstractmethod
    def M(self) -> Floats:
        """Mass matrix, diagonal, kg."""

    @property
    def C(self) -> Floats:
        """Damping matrix, N s/m."""
        return np.zeros_like(self.M)

    @property
    @abstractmethod
    def K0(self) -> Floats:
        """Stiffness matrix without friction, symmetric, N/m."""

    @property
    @abstractmethod
    def friction_matrix(self) -> Floats:
        """F in K(μ) = K0 + μ F, N/m."""

    def K(self, mu: ArrayLike) -> Floats:
        """Return K(μ) = K0 + μ F, (..., n, n), for one μ or an array of them; a negative one reverses the belt."""
        return np.asarray(self.K0 + np.asarray(mu, dtype=float)[..., None, None] * self.friction_matrix)

    def eigenvalues(self, mu: ArrayLike) -> Complexes:
        """Return all λ, (..., 2n), rad/s, ascending by Im λ and Re λ.

        Examples
        --------
        >>> from lumped import Minimal
        >>> Minimal(k2=20).eigenvalues([0.0, 0.4])[:, -1].round(6).tolist()
        [5j, (0.25723+4.479528j)]
        """
        return solve_eigenvalues(self.M, self.C, self.K(mu))

    def spectrum(self, mu: ArrayLike) -> Spectrum:
        """Return all λ with their uncertainty, and the stability that follows."""
        return solve_spectrum(self.M, self.C, self.K(mu))

    def search_critical_points(self, lower: float = 0.0, upper: float = np.inf) -> Search:
        """Find every flutter, Hopf point and divergence with lower < μ < upper, and what rounding hides.

        Examples
        --------
        >>> from lumped import TwoMass
        >>> found = TwoMass().search_critical_points()
        >>> len(found.points), found.low, found.high, found.doubts
        (1, 0.0, 1000000.0, ())
        """
        return search_critical_points(self.M, self.C, self.K0, self.friction_matrix, lower, upper)

    def critical_points(self, lower: float = 0.0, upper: float = np.inf) -> list[CriticalPoint]:
        """Return every flutter, Hopf point and divergence with lower < μ < upper, up to ±1e6."""
        return list(self.search_critical_points(lower, upper).points)

    def critical_mu(self) -> list[float]:
        """Return the μ > 0, up to 1e6, at which a flutter begins as μ rises, ascending.

        Examples
        --------
        >>> from lumped import NineDof
        >>> [round(mu, 6) for mu in NineDof().critical_mu()][:2]
        [0.858154, 2.738331]
        """
        return self.search_critical_points().onsets

    def response(self, x0: ArrayLike, v0: ArrayLike, times: ArrayLike, mu: float) -> Floats:
        """Return the free motion q(t), (k, n), m, from displacements x0 and velocities v0.

        Examples
        --------
        >>> from lumped import Oscillator
        >>> Oscillator().response([1, 0], [0, 0], [0.0, 1.0], mu=0.2).shape
        (2, 2)
        """
        return solve_response(self.M, self.C, self.K(mu), x0, v0, times)
