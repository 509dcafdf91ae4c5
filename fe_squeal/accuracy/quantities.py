"""What refining the mesh changes in frequencies, growth rates and onsets, split by where it comes from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..eigen.pencil import Modes
from ..sweep.onset import Onset
from ..sweep.result import Sweep
from .bars import onset_scale
from .corrections import Correction, right_corrections
from .rates import by_eigenvalue, onset_factor
from .refined import Refined

KINDS = ("frequencies", "growth", "onsets")
_ROUNDED = 1e-6  # of a frequency: a mode above the highest one by less than this is the same mode, up to rounding
SLOW = 0.02  # of the fastest growth rate: growth slower than this is not a quantity whose change is asked for


@dataclass(frozen=True)
class Split:
    """The changes of q quantities of a sweep by refining the mesh, split by element and axis.

    Attributes
    ----------
    names : tuple of str
        What each quantity is, such as "growth of 2705 Hz at mu = 0.7"; no two have the same name.
    kinds : tuple of str
        One of `KINDS` for each quantity.
    scales : (q,) float
        What the change of each quantity is relative to, see `estimated_error`: |λ| (rad/s), the largest growth rate
        (1/s), or the critical value (in the unit of the parameter).
    parts : (q, m, a) float
        What element j adds along its axis i to the change of each quantity, in the unit of its scale. Hexahedra have
        three axes; tetrahedra have a = 1, since they have no axes to tell apart.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    scales: np.ndarray
    parts: np.ndarray

    @property
    def changes(self) -> np.ndarray:
        """The change (q,) of each quantity by refinement, to first order: the sum of its parts."""
        return np.asarray(self.parts.sum(axis=(1, 2)))

    @property
    def relative(self) -> np.ndarray:
        """The parts (q, m, a) over the scales of their quantities."""
        return np.asarray(self.parts / self.scales[:, None, None])

    def of(self, kinds: Sequence[str]) -> Split:
        """Return the same for the quantities of some kinds alone."""
        keep = [i for i, kind in enumerate(self.kinds) if kind in kinds]
        pick = tuple(self.names[i] for i in keep), tuple(self.kinds[i] for i in keep)
        return Split(*pick, self.scales[keep], self.parts[keep])


@dataclass(frozen=True)
class _Asked:
    """One quantity: its change is Re(factor ρᴴz), with ρ and z of `shares` at `column` of the blocks that hold them."""

    name: str
    kind: str
    scale: float
    column: int
    factor: complex


def split_changes(
    result: Sweep, refined: Refined, corrections: Mapping[float, Correction] | None = None
) -> Split:  # fmt: skip
    """Return the first-order changes of frequencies and growth at both ends of the sweep, and of onsets, by parts.

    Parameters
    ----------
    result : Sweep
        Result on the mesh itself.
    refined : Refined
        The problem of this sweep on the refined mesh, see `refine_problem`.
    corrections : mapping of float to Correction, optional
        What `right_corrections` returns for them.

    Raises
    ------
    NotConvergedError
        The conjugate gradients on the refined mesh do not settle.
    """
    corrections = right_corrections(result, refined) if corrections is None else corrections
    asked: list[_Asked] = []
    rho: list[np.ndarray] = []
    z: list[np.ndarray] = []
    for value, own in corrections.items():
        onsets = [o for o in result.onsets if o.value == value and len(refined.values) > 1]
        here = _asked(result, refined, value, own.modes, onsets)
        first = sum(x.shape[1] for x in z)
        wanted = np.unique([a.column for a in here]).astype(int)
        asked += [replace(a, column=first + int(np.searchsorted(wanted, a.column))) for a in here]
        rho.append(np.take(own.left_residuals, wanted, axis=1))
        z.append(np.take(own.right, wanted, axis=1))
    if not asked:
        return Split((), (), np.zeros(0), np.zeros((0, refined.coarse.space.mesh.nelements, 1)))
    sizes = refined.hierarchy.shares(np.hstack(rho), np.hstack(z))
    parts = np.stack([np.real(a.factor * sizes[a.column]) for a in asked])
    kinds, scales = (tuple(getattr(a, key) for a in asked) for key in ("kind", "scale"))
    return Split(_told_apart([a.name for a in asked]), kinds, np.array(scales), parts)


def _told_apart(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names, with a number where one occurs again, as of two modes of equal frequency.

    Examples
    --------
    >>> _told_apart(["frequency 100 Hz", "frequency 200 Hz", "frequency 100 Hz"])
    ('frequency 100 Hz', 'frequency 200 Hz', 'frequency 100 Hz (2)')
    """
    known: Counter[str] = Counter()
    found = []
    for name in names:
        known[name] += 1
        found.append(name if known[name] == 1 else f"{name} ({known[name]})")
    return tuple(found)


def _asked(result: Sweep, refined: Refined, value: float, modes: Modes, onsets: Sequence[Onset]) -> list[_Asked]:
    """Return the quantities that modes at one value give: frequencies and growth at an end of the sweep, and onsets."""
    fastest = max(float(p.modes.lam.real[p.modes.stability == "unstable"].max(initial=0.0)) for p in result.points)
    width = float(np.ptp(refined.values))
    turn, unstable = by_eigenvalue(refined, value, modes), modes.stability == "unstable"
    name = f" at {result.parameter} = {value:.6g}" if width else ""
    asked: list[_Asked] = []
    for i, point in ((0, result.points[0]), (-1, result.points[-1])):
        if value != refined.values[i] or (asked and not width):
            continue
        highest = float(point.modes.lam.imag.max(initial=0.0))
        for k, lam in enumerate(modes.lam.tolist()):
            if lam.imag > (1 + _ROUNDED) * highest:
                continue
            told = f"{lam.imag / (2 * np.pi):.5g} Hz{name}" if lam.imag else f"a divergence{name}"
            if lam.imag > 0:
                asked.append(_Asked(f"frequency {told}", "frequencies", abs(lam), k, -1j / turn[k]))
            if fastest and unstable[k] and lam.real > SLOW * fastest:
                asked.append(_Asked(f"growth of {told}", "growth", fastest, k, 1 / turn[k]))
    for onset in onsets:
        if (found := onset_factor(refined, onset, modes)) is None:
            continue
        k, factor = found
        told = f"onset{name}, {onset.frequency_hz:.5g} Hz"
        asked.append(_Asked(told, "onsets", onset_scale(onset.value, refined.values), k, factor))
    return asked
