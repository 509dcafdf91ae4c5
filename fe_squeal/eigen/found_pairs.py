"""The eigenpairs that one search after the other has found, of which none is listed twice."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from .free_modes import FreeModes, States
from .multiple import real_span
from .pencil import Modes, Pencil
from .quality import eigenvalue_errors, in_upper_half, modes_from_lambda

_ROUNDING = 1e-12  # what rounding may leave of zero, relative to |λ|
SAME = 1e-7  # of |λ|: eigenvalues of two searches that are closer are one
# Sine s of the angle between the vectors of two equal eigenvalues, which rounding parts by about √ε where the pair is
# defective. What takes both out of a search is off by ε/s²: 2 % here. Below this angle they are not taken out.
_COINCIDING = 1e-7
_REAL = 1e-6  # of its largest entry: a vector with a smaller imaginary part is real
_BLUR = 4  # times the errors by which rounding parts the two images of a defective eigenvalue: closer ones are one


@dataclass
class FoundPairs:
    """Eigenpairs of a pencil in both half planes; those that are given from the start count as exact.

    Attributes
    ----------
    lam : (k,) complex, rad/s
    right, left : (n, k) complex, or None as long as there are none
    """

    pencil: Pencil
    lam: np.ndarray = field(default_factory=lambda: np.zeros(0, complex))
    right: np.ndarray | None = None
    left: np.ndarray | None = None
    _left_in: np.ndarray = field(init=False)  # bool: which were not taken out of the last search
    _errors: np.ndarray = field(init=False)  # of lam, rad/s, as far as rounding moves them; 0 of those that were given

    def __post_init__(self) -> None:
        """Take those that were given as exact."""
        self._errors, self._left_in = np.zeros(len(self.lam)), np.zeros(len(self.lam), bool)

    def __len__(self) -> int:
        """Return the number of eigenpairs."""
        return len(self.lam)

    def add(self, lam: np.ndarray, right: np.ndarray, left: np.ndarray, mixed: bool) -> None:
        """Add eigenpairs that are not known yet.

        Parameters
        ----------
        lam : (m,) complex, rad/s
        right, left : (n, m) complex
        mixed : bool
            Whether known ones may be among them. Where these were taken out, as far as they could be, an equal
            eigenvalue is another copy of it.
        """
        lam = np.where(np.abs(lam.imag) <= _ROUNDING * np.abs(lam), lam.real, lam)
        if not self.pencil.is_complex:
            right, left = (_with_real_vectors(self.pencil, lam, u) for u in (right, left))
        errors = eigenvalue_errors(self.pencil, lam, right, left)
        if self.right is None or self.left is None:
            self.lam, self.right, self.left, self._errors = lam, right, left, errors
            self._left_in = np.zeros(len(lam), bool)
            return
        new = np.ones(len(lam), bool)
        old = np.arange(len(self.lam)) if mixed else np.flatnonzero(self._left_in)
        if len(old) and len(lam):
            # Every known eigenvalue accounts for one of the new ones, so that a multiple one keeps its number.
            apart = np.abs(self.lam[old, None] - lam[None, :])
            blurred = _BLUR * np.minimum(self._errors[old, None], errors)  # two images of one are blurred alike
            near = apart <= np.maximum(SAME * np.abs(lam), blurred)
            i, j = linear_sum_assignment(np.where(near, apart, 1e3 * np.abs(lam).max()))
            new[j[near[i, j]]] = False
        self.lam = np.concatenate([self.lam, lam[new]])
        self._left_in = np.append(self._left_in, np.zeros(np.count_nonzero(new), bool))
        self._errors = np.concatenate([self._errors, errors[new]])
        self.right = np.hstack([self.right, right[:, new]])
        self.left = np.hstack([self.left, left[:, new]])

    def states(self) -> tuple[States, States] | None:
        """Return states that span those of all known modes, of the problem and of the adjoint one.

        Of a real pencil they are real. With a complex K −λ is an eigenvalue, too, if C is zero. Those whose vectors
        coincide are left out: see `_COINCIDING`.
        """
        if self.right is None or self.left is None:
            return None
        self._left_in = self._coincide(self.right) | self._coincide(self.left)
        out = ~self._left_in
        if self.pencil.is_complex:
            if self.pencil.C is not None and self.pencil.C.count_nonzero():
                out &= self.lam != 0  # free motions are taken out anyway
            right, left, lam = self.right[:, out], self.left[:, out], self.lam[out]
            own, other = right * lam, left * lam.conj()
            if self.pencil.C is not None and self.pencil.C.count_nonzero():
                return (right, own), (left, other)
            twice = np.hstack([right, right]), np.hstack([left, left])
            return (twice[0], np.hstack([own, -own])), (twice[1], np.hstack([other, -other]))
        upper = np.flatnonzero((self.lam.imag >= 0) & (self.lam != 0) & out)  # free motions are taken out anyway
        real = self.lam[upper].imag == 0

        def spanned(u: np.ndarray, lam: np.ndarray) -> States:
            # The vector of a real eigenvalue is real but for a factor, see `_with_real_vectors`.
            u = np.where(real, u / u[np.abs(u).argmax(axis=0), np.arange(len(lam))], u)
            velocity = u * lam
            return np.hstack([u.real, u.imag[:, ~real]]), np.hstack([velocity.real, velocity.imag[:, ~real]])

        lam = self.lam[upper]
        return spanned(self.right[:, upper], lam), spanned(self.left[:, upper], lam.conj())

    def _coincide(self, u: np.ndarray) -> np.ndarray:
        """Return (k,) bool, which eigenvalues are equal to another one whose vector in u (n, k) is parallel."""
        found = np.zeros(len(self.lam), bool)
        near = np.abs(self.lam[:, None] - self.lam) < SAME * np.abs(self.lam)[:, None]  # never of λ = 0
        for i, j in np.argwhere(np.triu(near, 1)):
            a, b = (x / np.linalg.norm(x) for x in (u[:, i], u[:, j]))
            found[[i, j]] |= np.linalg.norm(b - a * np.vdot(a, b)) <= _COINCIDING
        return found

    def modes(self, free: FreeModes | None) -> Modes:
        """Return the modes of the upper half plane, with those of free motions among them."""
        n = self.pencil.n
        lam = self.lam
        right, left = (np.zeros((n, 0)) if u is None else u for u in (self.right, self.left))
        upper = in_upper_half(self.pencil, lam)
        lam, right, left = lam[upper], right[:, upper], left[:, upper]
        if free is not None:
            lam, right, left = free.beside(lam, right, left)
        return modes_from_lambda(self.pencil, lam, right, left, "")


def _with_real_vectors(pencil: Pencil, lam: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return vectors u (n, k) of a real pencil, in which those of real eigenvalues lam (k,) are real but for factors.

    Where several eigenvalues are equal, rounding may part two of them into λ ± iε with conjugate vectors. These have
    the same real part; real vectors that span what all of the equal ones do take their place, as far as they differ.
    """
    real = np.flatnonzero((lam.imag == 0) & (lam != 0))
    turned = u[:, real] / u[np.abs(u[:, real]).argmax(axis=0), real]
    mixed = real[np.abs(turned.imag).max(axis=0, initial=0.0) > _REAL]
    u = u.copy() if len(mixed) else u
    for value in np.unique(lam[mixed]):
        same = real[np.abs(lam[real] - value) <= SAME * np.abs(value)]
        span = real_span(pencil, u[:, same])
        if span.shape[1] >= len(same):
            u[:, same] = span[:, : len(same)]
    return u
