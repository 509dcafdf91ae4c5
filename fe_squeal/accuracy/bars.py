"""Error bars: from the change of an eigenvalue when the mesh is refined once to a bound of its error.

Halving the size of the elements multiplies an error by 2^-q. For smooth modes q is 4 with elements of order 2 and 2
with elements of order 1; it falls to 1 where stresses are singular (edges of contacts, clamped edges, re-entrant
corners). With Δλ the change by refining, the exact eigenvalue is λ + sΔλ, s = 1/(1 − 2^-q): between 16/15 and 2. Linear
elements that are as thick as the part that they bend are so stiff that the error does not fall at its rate yet; so s
goes up to 4 for order 1, which is q = 0.4. The bar is the largest s times |Δλ|, separately for the real and the
imaginary part, with four corrections:

- The error is a sum of parts with different q, and so different s. They may cancel in the change without cancelling in
  the error. Where the parts are known, see `spread`, with every s between the limits the error is at most
  (s₁ + s₂)/2 |Δ| + (s₂ − s₁)/2 Σ|parts|. That is the bar of growing modes and of onsets. For other modes, and for
  linear elements, whose parts are wrong in size themselves, the real and the imaginary part of a bar are at least
  `SHARE` times the bar that |Δλ| would give.
- Two modes that nearly meet have λ = m ± √D, and m and D change linearly with the mesh where λ does not. So m and D of
  each mode and the nearest other one are extrapolated for all s in the range, and the bar reaches as far as λ then
  does.
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

import numpy as np

# Times the change, by the order of the elements: the largest s. For order 2 it is derived above. For order 1 it is the
# smallest of 2, 3 and 4 for which the bars contain the true error of at least 97 % of the modes, and of the growing
# modes too, on the scenes `FITTED` of benchmarks/mesh_bars.py.
BARS = {1: 4.0, 2: 2.0}
SMALLEST_FACTOR = {1: 4 / 3, 2: 16 / 15}  # times the change, by the order of the elements: the smallest s
# Times BARS |Δλ|: the least that either part of a bar is. Chosen: the scenes `FITTED` would do without it, and a scene
# with a single layer of linear tetrahedra needed 0.18.
SHARE = 0.25
SMALLEST = 0.1  # of the interval of the sweep: errors of onsets at smaller values are relative to this
_STEPS = 16  # equal steps of s in which m and D are extrapolated, so that the root √D can be followed
_APART = 10.0  # times the change of either mode: modes farther apart than this are extrapolated each by itself
_ROUNDING = 1e-6  # of the sum of two distances: a smaller difference between them is taken for rounding


def bar_of_parts(change: np.ndarray, spread: np.ndarray, order: int) -> np.ndarray:
    """Return the bars (k,) of quantities whose changes have parts that each count with a factor s of their own.

    Parameters
    ----------
    change : (k,) float
        By refining the mesh once.
    spread : (k,) float
        The sum of the sizes of its parts; NaN where it is not known, and |change| is taken.
    order : int
        Of the elements.

    Examples
    --------
    >>> bar_of_parts(np.array([0.0, 1.0]), np.array([15.0, 1.0]), 2)
    array([7., 2.])
    """
    least, most = SMALLEST_FACTOR[order], BARS[order]
    size = np.abs(change)
    return np.asarray((most + least) / 2 * size + (most - least) / 2 * np.fmax(spread, size))


def bar_of(
    change: np.ndarray, bent: np.ndarray, balanced: np.ndarray, order: int, spread: np.ndarray | None = None
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
    spread : (k,) float, 1/s, optional
        The sum of the sizes of the parts of Re Δλ; NaN where it is not known.
    """
    factor = BARS[order]
    floor = SHARE * np.abs(change)
    known = np.full(len(change), np.nan) if spread is None else spread
    parted = np.isfinite(known) & (order > 1)
    least = np.maximum(factor * np.where(parted, 0.0, floor), bent.real)
    re = np.maximum(bar_of_parts(change.real, known, order), least)
    im = np.maximum(factor * np.maximum(np.abs(change.imag), floor), bent.imag)
    return np.where(balanced, 0.0, re) + 1j * im


def bent_change(lam: np.ndarray, refined: np.ndarray, order: int) -> np.ndarray:
    """Return how far each λ moves if it is extrapolated together with the nearest other mode, (k,) complex, rad/s.

    The real part is the largest |Re λ(s) − Re λ| over all s from 1 to `BARS`, the imaginary part that of Im λ. With
    m = (λ_i + λ_j)/2 and D = ((λ_i − λ_j)/2)², index 0 for the mesh and 1 for the refined one, λ(s) = m(s) ± √D(s),
    m(s) = m₀ + s (m₁ − m₀), D(s) = D₀ + s (D₁ − D₀).

    Parameters
    ----------
    lam, refined : (k,) complex, rad/s
        The same modes on the mesh and on the refined one; NaN where a mode is not found again.
    order : int
        Order of the elements.
    """
    found = np.zeros(len(lam), dtype=complex)
    known = np.flatnonzero(np.isfinite(refined) & (lam.imag > 0))
    for i in known.tolist():
        others = known[known != i]
        if not len(others):
            continue
        apart = np.minimum(np.abs(lam[others] - lam[i]), np.abs(refined[others] - refined[i]))
        j = int(others[np.argmin(apart)])
        m, D = ((x[i] + x[j]) / 2 for x in (lam, refined)), (((x[i] - x[j]) / 2) ** 2 for x in (lam, refined))
        (m0, m1), (D0, D1) = m, D
        here, re, im = refined[i], 0.0, 0.0
        for s in np.linspace(1.0, BARS[order], _STEPS + 1):
            root = np.sqrt(D0 + s * (D1 - D0) + 0j)
            ends = m0 + s * (m1 - m0) + np.array([root, -root])
            here = ends[np.argmin(np.abs(ends - here))]
            re, im = max(re, abs(here.real - lam[i].real)), max(im, abs(here.imag - lam[i].imag))
        found[i] = re + 1j * im
    return found


def extrapolated(lam: np.ndarray, refined: np.ndarray, factor: float) -> np.ndarray:
    """Return the eigenvalues extrapolated to s = factor, (k,) complex, rad/s.

    Where two modes nearly meet, λ changes like a square root, so m and D of `bent_change` are extrapolated instead of
    λ. A mode whose distance from all others is more than `_APART` times its change is extrapolated by itself:
    λ + factor (refined − λ).

    Parameters
    ----------
    lam, refined : (k,) complex, rad/s
        The same modes on the mesh and on the refined one. `refined` is NaN where a mode is not found again; the result
        is NaN there too.
    factor : float
        s: 1 gives the eigenvalues on the refined mesh.

    Examples
    --------
    >>> extrapolated(np.array([10j, 99j]), np.array([9j, 99j]), 1.5).round(6)
    array([0. +8.5j, 0.+99.j ])
    >>> extrapolated(np.array([10j, 10.1j]), np.array([-0.1 + 10j, 0.1 + 10j]), 1.5).round(3)  # D: -0.0025, 0.01
    array([-0.127+9.975j,  0.127+9.975j])
    """
    found = lam + factor * (refined - lam)
    known = np.flatnonzero(np.isfinite(refined) & (lam.imag > 0))
    for i in known.tolist():
        others = known[known != i]
        if not len(others):
            continue
        apart = np.minimum(np.abs(lam[others] - lam[i]), np.abs(refined[others] - refined[i]))
        j = int(others[np.argmin(apart)])
        if apart.min() > _APART * np.abs(refined - lam)[[i, j]].max():
            continue
        (m0, m1), (D0, D1) = (
            [(x[i] + x[j]) / 2 for x in (lam, refined)], [((x[i] - x[j]) / 2) ** 2 for x in (lam, refined)]
        )  # fmt: skip
        # Mode i takes that of the roots ±√D which lies on its side of m on the refined mesh. If both are equally near,
        # the mode with the lower number takes +√D and the other one −√D, so that the two still differ.
        root, side = np.sqrt(D0 + factor * (D1 - D0) + 0j), (refined[i] - refined[j]) / 2
        same, other = abs(root - side), abs(root + side)
        is_clear = abs(same - other) > _ROUNDING * (same + other)
        is_positive = same < other if is_clear else i < j
        found[i] = m0 + factor * (m1 - m0) + (root if is_positive else -root)
    return np.asarray(found)


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
