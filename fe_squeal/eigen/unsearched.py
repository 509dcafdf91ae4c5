"""What a direct solve has not looked for, which an answer must not be silent about."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

FAST_FLUTTER = "modes of flutter that grow fast"
GROWTH = "real eigenvalues that grow"


@dataclass(frozen=True)
class Unsearched:
    """What a search has not looked for, or not everywhere; false where that is nothing.

    Attributes
    ----------
    kinds : tuple of str
        Kinds of modes, in words, that were not looked for everywhere.
    low : float, rad/s
        Frequency below which modes may be missing; 0 where there is none.
    rate : float or None, 1/s
        Real eigenvalues that grow faster were not looked for; None where they were.
    damped : bool
        Whether modes with light damping were not looked for everywhere. What grows was, so that those left out decay.
    """

    kinds: tuple[str, ...] = ()
    low: float = 0.0
    rate: float | None = None
    damped: bool = False

    def __bool__(self) -> bool:
        return self.may_grow or self.damped

    @property
    def may_grow(self) -> bool:
        """Whether any of it may grow."""
        return bool(self.kinds) or bool(self.low > 0) or self.rate is not None

    def parts(self) -> list[Unsearched]:
        """Return what may grow and what decays, without those of the two that are nothing."""
        return [part for part in (replace(self, damped=False), Unsearched(damped=self.damped)) if part]

    def joined(self, other: Unsearched) -> Unsearched:
        """Return what one of two searches has not looked for."""
        rates = [r for r in (self.rate, other.rate) if r is not None]
        kinds = tuple(dict.fromkeys([*self.kinds, *other.kinds]))
        return Unsearched(kinds, max(self.low, other.low), min(rates, default=None), self.damped or other.damped)

    def __str__(self) -> str:
        parts = list(self.kinds)
        parts += [f"real eigenvalues that grow faster than {self.rate:.3g} 1/s"] if self.rate is not None else []
        parts += [f"modes below {self.low / (2 * np.pi):.3g} Hz"] if self.low else []
        parts += ["modes with light damping"] if self.damped else []
        return ", and ".join(parts)


ALL_SEARCHED = Unsearched()
