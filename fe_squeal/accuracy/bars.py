"""Error bars: from the change of an eigenvalue when the mesh is refined once to a bound of its error.

Halving the size of the elements multiplies an error by 2^-q. For smooth modes q is 2 with elements of order 1, 4 with
those of order 2 and 6 with those of order 3; it falls to 1 where stresses are singular, see `edges`. With Δλ the change
by refining, the exact eigenvalue is λ + sΔλ, s = 1/(1 − 2^-q): between 16/15 (order 3: 64/63) and 2. Linear elements
that are as thick as the part that they bend are so stiff that the error does not fall at its rate yet; so s goes up to
4 for order 1, which is q = 0.4.
The bar is the largest s times |Δλ|, separately for the real and the imaginary part, with four corrections:

- The error is a sum of parts with different q, and so different s. They may cancel in the change without cancelling in
  the error. Where the parts are known, see `spread`, a part of elements at singular edges has s from 16/15 to 2, and
  any other one s up to 4/3: half the rate of smooth modes is allowed for elements that are too coarse for it. What the
  parts, which are those of first order, leave of the change counts as singular. With every s between its limits s₁ and
  s₂ the error is at most |Σ (s₁ + s₂)/2 part| + Σ (s₂ − s₁)/2 |part|. That is the bar of growing modes and of onsets.
  An extrapolated value takes one likely s for each part. An onset is off by more where the parts p of single elements
  nearly cancel within a group, since the s of these elements are not quite equal. So √Σ p² times the half width of s,
  their deviations being taken as independent of each other, is added to the bar of its extrapolated value, but at most
  `SCATTERED` times what is extrapolated: around an axis parts cancel by symmetry, and their s are equal.
  For other modes, and for linear elements, whose parts are wrong in size themselves, the real and the imaginary part of
  a bar are at least `SHARE` times the bar that |Δλ| would give.
- Two modes that nearly meet have λ = m ± √D, and m and D change linearly with the mesh where λ does not. So m and D of
  each mode and the nearest other one are extrapolated for all s in the range, see `pairs`, and the bar reaches as far
  as λ then does. Without damping the parts of a growth rate are taken for parts of its square. A mode whose frequency
  falls to zero meets its own λ* there, and may diverge where friction or compression can make it.
- A pair λ, −λ* may become two modes without growth on the refined mesh, each with a change of its own. The larger of
  the two changes counts for both.
- Along the parameter the change may pass through zero at a value where the error does not. So a bar is the largest of
  its own and those of the same branch at the neighbouring values of the parameter; that of Re λ of a growing mode
  takes part where the branch grows, too.

Where Re λ is zero by symmetry on both meshes it has no error and its bar is zero, unless an onset is so near that the
mode may lie on the other side of it (see `near_onsets`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..sweep.scale import Scale

# Times the change, by the order of the elements: the largest s. For order 2 it is derived above. For order 1 it is the
# smallest of 2, 3 and 4 for which the bars contain the true error of at least 97 % of the modes, and of the growing
# modes too, on the scenes `FITTED` of benchmarks/mesh_bars.py.
BARS = {1: 4.0, 2: 2.0, 3: 2.0}
# By the order of the elements: the smallest s, the one that values are extrapolated with, and the largest s, of regular
# parts and of singular ones. For order 1 there is no difference, and the largest s is seldom reached.
LIMITS = {
    1: ((4 / 3, 1.4, BARS[1]), (4 / 3, 1.4, BARS[1])),
    2: ((16 / 15, 1.2, 4 / 3), (16 / 15, 23 / 15, BARS[2])),
    3: ((64 / 63, 1.2, 4 / 3), (64 / 63, 23 / 15, BARS[3])),
}
# Where what holds a surface ends in a notch, see `edges`, q may be as small as 0.5 instead of 1: times all bars.
NOTCHED = (1 - 2**-1.0) / (1 - 2**-0.5)
# Times the change of a mode whose parts are not known: what its value is extrapolated with, between the s of regular
# and of singular parts.
EXTRAPOLATED = 1.4
# Times BARS |Δλ|: the least that either part of a bar is. Chosen: the scenes `FITTED` would do without it, and a scene
# with a single layer of linear tetrahedra needed 0.18.
SHARE = 0.25
# Chosen on the scenes 0 to 11 of each kind in benchmarks/onset_bars.py: of 63 extrapolated onsets six were farther off
# than the parts of groups say, and three are with it.
SCATTERED = 0.5
_SMALLEST = 0.1  # of the interval of the sweep: errors of onsets at smaller values are relative to this


@dataclass(frozen=True)
class Parts:
    """Parts of the changes of k quantities: those of regular elements first, then those of elements at singular edges.

    Attributes
    ----------
    sums : (2, k) float
        Σ parts; NaN of quantities whose parts are not known.
    sizes : (2, k) float
        Σ |parts|.
    scatter : (2, k) float
        √Σ p² over the parts p of single elements; zero where these are not known.
    """

    sums: np.ndarray
    sizes: np.ndarray
    scatter: np.ndarray

    @classmethod
    def of(cls, parts: np.ndarray, singular: np.ndarray, squares: np.ndarray | None = None) -> Parts:
        """Return the sums of the parts (g, k) of g groups of elements, some of which, (g,) bool, are singular.

        `squares` (g, k) are the sums of the squares of the parts of the single elements of each group.
        """
        kinds = np.stack([~singular, singular]).astype(float)
        squares = np.zeros_like(parts) if squares is None else squares
        return cls(kinds @ parts, kinds @ np.abs(parts), np.sqrt(kinds @ squares))

    @classmethod
    def unknown(cls, count: int) -> Parts:
        """Return those of quantities whose parts are not known."""
        return cls(*np.full((3, 2, count), np.nan))

    def times(self, factor: np.ndarray) -> Parts:
        """Return those of the quantities multiplied by a factor (k,) each."""
        size = np.abs(factor)
        return Parts(factor * self.sums, size * self.sizes, size * self.scatter)

    @property
    def known(self) -> np.ndarray:
        """Which parts are known, (k,) bool."""
        return np.asarray(np.isfinite(self.sizes).all(axis=0))

    def at(self, positions: np.ndarray) -> Parts:
        """Return those of some of the quantities, (p,) int."""
        return Parts(self.sums[:, positions], self.sizes[:, positions], self.scatter[:, positions])

    def where(self, own: np.ndarray, other: Parts) -> Parts:
        """Return those of the quantities of `own`, (k,) bool, and of `other` for the rest."""
        every = ((self.sums, other.sums), (self.sizes, other.sizes), (self.scatter, other.scatter))
        return Parts(*(np.where(own, a, b) for a, b in every))


def onset_scale(value: float, values: np.ndarray) -> float:
    """Return what the error of an onset is relative to: its value, or a tenth of the interval if that is larger.

    Over decades, where small values matter as much as large ones, the value alone.

    Parameters
    ----------
    value : float
        Of the onset.
    values : (m,) float
        Of the sweep.

    Examples
    --------
    >>> [onset_scale(0.02, np.array(v)) for v in ([0.0, 0.5], [0.01, 1.0])]
    [0.05, 0.02]
    """
    least = 0.0 if Scale.of(values).logarithmic else _SMALLEST * float(np.ptp(values))
    return max(abs(value), least)


def bar_of_parts(change: np.ndarray, parts: Parts, order: int) -> np.ndarray:
    """Return the bars (k,) of quantities whose changes have parts that each count with a factor s of their own.

    Parameters
    ----------
    change : (k,) float
        By refining the mesh once.
    parts : Parts
        Of these changes. Where they are not known, the whole change counts as singular.
    order : int
        Of the elements.

    Examples
    --------
    >>> parts = Parts.of(np.array([[7.5, 1.0], [-7.5, 0.0]]), np.array([False, False]))
    >>> bar_of_parts(np.array([0.0, 1.0]), parts, 2)  # 15 regular and -15 regular; 1 regular
    array([2.        , 1.33333333])
    >>> bar_of_parts(np.array([1.0]), Parts.unknown(1), 2)
    array([2.])
    """
    least, _, most = np.array(LIMITS[order]).T
    sums, sizes, rest = _with_rest(change, parts)
    middle, half = (most + least) / 2, (most - least) / 2
    return np.asarray(np.abs(middle @ sums + middle[1] * rest) + half @ sizes + half[1] * np.abs(rest))


def beyond(change: np.ndarray, parts: Parts, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Return how far the likely exact values lie from those of the mesh (k,), and the bars (k,) of these likely values.

    Parameters are those of `bar_of_parts`. Where parts are not known, the values lie `EXTRAPOLATED` changes away.

    Examples
    --------
    >>> group, regular = np.array([[1.0]]), np.array([False])
    >>> [x.round(3).tolist() for x in beyond(np.array([1.0]), Parts.of(group, regular), 2)]
    [[1.2], [0.133]]
    """
    least, likely, most = np.array(LIMITS[order]).T
    sums, sizes, rest = _with_rest(change, parts)
    width = np.maximum(most - likely, likely - least)
    furthest = max(most[1] - EXTRAPOLATED, EXTRAPOLATED - least[1])
    shift = np.where(parts.known, likely @ sums + likely[1] * rest, EXTRAPOLATED * change)
    return shift, np.where(parts.known, width @ sizes + width[1] * np.abs(rest), furthest * np.abs(change))


def scattered(shift: np.ndarray, parts: Parts, order: int) -> np.ndarray:
    """Return by how much the bars (k,) of values extrapolated by `shift` (k,) are wider as single elements deviate.

    Examples
    --------
    >>> parts = Parts.of(np.array([[1.0]]), np.array([False]), np.array([[4.0**2 + 3.0**2]]))  # two elements: 4 and -3
    >>> scattered(np.array([1.2]), parts, 2).round(3), scattered(np.array([12.0]), parts, 2).round(3)
    (array([0.6]), array([0.667]))
    """
    least, likely, most = np.array(LIMITS[order]).T
    own = np.maximum(most - likely, likely - least) @ np.where(parts.known, parts.scatter, 0.0)
    return np.asarray(np.minimum(own, SCATTERED * np.abs(np.nan_to_num(shift))))


def factors_of(change: np.ndarray, parts: Parts, order: int) -> np.ndarray:
    """Return the smallest, the likely and the largest s (3, k) of quantities as wholes: means over the sizes of parts.

    Where the parts are not known, these are the limits of singular parts, and `EXTRAPOLATED`.
    """
    _, sizes, rest = _with_rest(change, parts)
    weights = sizes + np.stack([np.zeros(len(rest)), np.abs(rest)])
    whole = weights.sum(axis=0)
    share = np.divide(weights, whole, out=np.full(weights.shape, 0.5), where=whole > 0)
    found = np.array(LIMITS[order]).T @ share
    none = np.array([LIMITS[order][1][0], EXTRAPOLATED, BARS[order]])
    return np.where(parts.known & np.isfinite(change), found, none[:, None])


def _with_rest(change: np.ndarray, parts: Parts) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return `sums` and `sizes` (2, k), zero where not known, and what they leave of the change, (k,)."""
    sums, sizes = (np.where(parts.known, x, 0.0) for x in (parts.sums, parts.sizes))
    return sums, sizes, change - sums.sum(axis=0)


def bar_of(
    change: np.ndarray, bent: np.ndarray, balanced: np.ndarray, order: int, growth: np.ndarray | None = None
) -> np.ndarray:
    """Return the bars (k,) complex, rad/s, of the modes at one value: that of Re λ plus i times that of Im λ.

    Parameters
    ----------
    change : (k,) complex, rad/s
        Δλ by refining the mesh once; NaN where it is not known, and the bar is NaN then.
    bent : (k,) complex, rad/s
        How far the extrapolation of pairs leads, see `bent_change`.
    balanced : (k,) bool
        Modes whose Re λ is zero on both meshes, by symmetry.
    order : int
        Of the elements.
    growth : (k,) float, 1/s, optional
        The bars of Re λ by its parts, see `pairs.growth_beyond`; NaN where the parts are not known.
    """
    factor = BARS[order]
    floor = SHARE * np.abs(change)
    known = np.full(len(change), np.nan) if growth is None else growth
    parted = np.isfinite(known)
    least = np.maximum(factor * np.where(parted & (order > 1), 0.0, floor), bent.real)
    re = np.maximum(np.where(parted, known, factor * np.abs(change.real)), least)
    im = np.maximum(factor * np.maximum(np.abs(change.imag), floor), bent.imag)
    return np.where(balanced, 0.0, re) + 1j * im


def mirrored(bars: np.ndarray, partner: np.ndarray) -> np.ndarray:
    """Return for each mode the larger bar of λ and its mirror image −λ*, where both are known.

    Without damping both have the same error. Where the pair becomes two modes without growth on the refined mesh, λ is
    compared with one of these and −λ* with the other, so that each of the two bars comes from one change alone.

    Parameters
    ----------
    bars : (k,) complex, rad/s
        Error bars of Re λ (real parts) and of Im λ (imaginary parts).
    partner : (k,) int
        Positions of the mirror images; −1 for a mode that has none.

    Examples
    --------
    >>> mirrored(np.array([1 + 4j, 2 + 3j, 9]), np.array([1, 0, -1]))
    array([2.+4.j, 2.+4.j, 9.+0.j])
    """
    other = np.where(partner >= 0, bars[partner], bars)
    other = np.where(np.isfinite(other), other, bars)
    wide: np.ndarray = np.maximum(bars.real, other.real) + 1j * np.maximum(bars.imag, other.imag)
    return wide


def enveloped(
    bars: Sequence[np.ndarray], branches: Sequence[np.ndarray], growing: Sequence[np.ndarray] | None = None
) -> list[np.ndarray]:
    """Return each bar, made at least as large as those of the same branch at the values before and after.

    Parameters
    ----------
    bars : (k,) complex for each value, rad/s
        NaN where a bar is not known. It stays NaN, and bars at the neighbouring values are compared without it.
    branches : (k,) int for each value
        Numbers of the branches that the bars belong to.
    growing : (k,) bool for each value, optional
        Modes that grow. Bars of Re λ are compared among these, and among the others.

    Examples
    --------
    >>> enveloped([np.array([1 + 1j]), np.array([0j]), np.array([3j])], [np.array([7])] * 3)
    [array([1.+1.j]), array([1.+3.j]), array([0.+3.j])]
    """
    grows = [np.zeros(len(b), dtype=bool) for b in branches] if growing is None else growing
    by_branch = [
        dict(zip(b.tolist(), zip(bar.tolist(), g.tolist(), strict=True), strict=True))
        for b, bar, g in zip(branches, bars, grows, strict=True)
    ]
    result = []
    for k, (own, names, grown) in enumerate(zip(bars, branches, grows, strict=True)):
        wide = own.astype(complex)
        for at in (k - 1, k + 1):
            if 0 <= at < len(bars):
                found = [by_branch[at].get(b, (np.nan, False)) for b in names.tolist()]
                beside, alike = np.array([x for x, _ in found], complex), np.array([g for _, g in found], bool) == grown
                known = np.isfinite(beside) & np.isfinite(wide)
                real = np.where(known & alike, np.maximum(wide.real, beside.real), wide.real)
                imag = np.where(known, np.maximum(wide.imag, beside.imag), wide.imag)
                wide = real + 1j * imag
        result.append(wide)
    return result
