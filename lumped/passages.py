"""What became of a motion that was followed past the limit of stability: it crossed it, touched it, or is not known."""

from __future__ import annotations

from dataclasses import dataclass, replace

_SAME = 2e-3  # of a frequency: motions farther apart are different ones
_VAGUE = 0.1  # of μ


@dataclass(frozen=True)
class Sign:
    """Whether a motion grows (1), does not (−1), or cannot be told to within rounding (0), at a μ with its λ."""

    value: int
    mu: float
    lam: complex


@dataclass(frozen=True)
class Passage:
    """A motion at a root of its measure, and at the nearest μ on both sides where its sign is sure.

    Attributes
    ----------
    mu : float
    lam : complex, rad/s
        Its eigenvalue, or the mean of the two that meet.
    left, right : Sign
    """

    mu: float
    lam: complex
    left: Sign
    right: Sign

    @property
    def is_crossing(self) -> bool:
        """Whether the motion begins to grow there or ceases to; else it touches, or rounding hides what it does."""
        return self.left.value * self.right.value < 0

    @property
    def uncertainty(self) -> float:
        """How far from `mu` the sign is not known."""
        return float(max(self.mu - self.left.mu, self.right.mu - self.mu))

    @property
    def is_vague(self) -> bool:
        """Whether little more is known of a root than that it is between its sides."""
        return self.uncertainty > _VAGUE * abs(self.mu)

    def turned(self) -> Passage:
        """Return the passage of a motion whose growth has the other sign."""
        left, right = (replace(end, value=-end.value) for end in (self.left, self.right))
        return replace(self, left=left, right=right)

    @property
    def gain(self) -> int:
        """How many more eigenvalues grow on the right."""
        return (1 if self.lam.imag == 0 else 2) * (self.right.value - self.left.value) // 2 if self.is_crossing else 0

    @property
    def is_sure(self) -> bool:
        """Whether the signs on both sides are known."""
        return self.left.value != 0 and self.right.value != 0

    def has_frequency(self, omega: float) -> bool:
        """Return whether the motion has this frequency, rad/s, between its sides."""
        own = [abs(lam.imag) for lam in (self.lam, self.left.lam, self.right.lam)]
        return min(own) * (1 - _SAME) <= omega <= max(own) * (1 + _SAME)

    def hides(self, mu: float) -> bool:
        """Return whether rounding hides the sign of the motion at μ, which is known nearby on both sides."""
        return self.is_sure and not self.is_vague and self.left.mu < mu < self.right.mu

    def is_same(self, other: Passage) -> bool:
        """Return whether two crossings are one, found twice."""
        overlap = max(self.left.mu, other.left.mu) <= min(self.right.mu, other.right.mu)
        alike = self.has_frequency(abs(other.lam.imag)) or other.has_frequency(abs(self.lam.imag))
        return self.gain == other.gain != 0 and overlap and alike

    def covers(self, mu: float, lam: complex) -> bool:
        """Return whether a root at μ is that of the same motion."""
        return self.has_frequency(abs(lam.imag)) and self.is_sure and self.left.mu <= mu <= self.right.mu
