"""From what refining a mesh once changes to bars that hold the error of every eigenvalue.

Halving the elements leaves 2^-q of an error: q = 4 for smooth modes of order 2, 2 for those of order 1, down to 1 where
stresses are singular (edges of contacts, clamped edges, re-entrant corners). The exact value lies s = 1/(1 − 2^-q)
times the change Δλ away: between 16/15 and 2. Linear elements that are as thick as what they bend are too stiff to be
at their rate yet; for order 1 s goes up to 4, q = 0.4. Four things keep this from being the bar as it stands:

- An error has parts of different q. Where they cancel in the real part of Δλ it vanishes, and the error does not. So
  both parts of a bar have a floor, a `SHARE` of what |Δλ| itself would make.
- Two modes that nearly meet move like m ± √D, and D is what changes linearly. So m and D of each mode and the one next
  to it are extrapolated, over all these s, and the bar holds where this leads to.
- A pair λ, −λ* may be two modes without growth on the refined mesh, with a change each. The larger one counts for both.
- Along the parameter a change passes through zero where errors do not. So a bar is the largest of its own and those of
  the same branch at the neighbouring values.

A mode without growth on either mesh has none by symmetry, and no bar of it, unless an onset is that close (see
`near_onsets`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

# Times the change, by the order: the largest s. That of order 2 is derived. That of order 1 is the smallest of 2, 3 and
# 4 that holds 97 % of the errors, and of those of growing modes, on the scenes `FITTED` of benchmarks/mesh_bars.py.
BARS = {1: 4.0, 2: 2.0}
# Of BARS |Δλ|. Chosen: the scenes `FITTED` do with none, and one of a single layer of linear tetrahedra needed 0.18.
SHARE = 0.25
_STEPS = 16  # of s in which m and D are followed
_APART = 10.0  # times how far two modes move
_TOLD = 1e-6  # of two distances: a difference that tells


def bar_of(change: np.ndarray, bent: np.ndarray, balanced: np.ndarray, order: int) -> np.ndarray:
    """Return bars (k,) complex, of Re λ and Im λ, of modes at one value.

    Parameters
    ----------
    change : (k,) complex, rad/s
    bent : (k,) complex, rad/s
        See `bent_change`.
    balanced : (k,) bool
        Modes whose Re λ is zero on both meshes, by symmetry.
    order : int
        Of the elements.
    """
    factor = BARS[order]
    floor = SHARE * np.abs(change)
    re = np.maximum(factor * np.maximum(np.abs(change.real), floor), bent.real)
    im = np.maximum(factor * np.maximum(np.abs(change.imag), floor), bent.imag)
    return np.where(balanced, 0.0, re) + 1j * im


def bent_change(lam: np.ndarray, refined: np.ndarray, order: int) -> np.ndarray:
    """Return how far, in Re λ and Im λ, extrapolating each mode together with the one next to it leads, (k,) complex.

    With m = (λ_i + λ_j)/2 and D = ((λ_i − λ_j)/2)² on both meshes, λ(s) = m(s) ± √D(s), m(s) = m₀ + s (m₁ − m₀) and D
    likewise; s goes from 1 to that of `BARS`.

    Parameters
    ----------
    lam, refined : (k,) complex, rad/s
        The same modes on the mesh and on the refined one; NaN where a mode is not found again.
    order : int
        Of the elements.
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
    """Return where each mode together with the one next to it leads to at s = factor, (k,) complex, rad/s.

    See `bent_change`: where two modes nearly meet, m and D are extrapolated, not λ, which changes like a square root.
    Where they are `_APART` times as far from each other as they move, λ itself is.

    Parameters
    ----------
    lam, refined : (k,) complex, rad/s
        The same modes on the mesh and on the refined one; NaN where a mode is not found again, and it is NaN then.

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
        # Of both roots the one on the side where the refined mesh has it; if that does not tell, each mode takes one.
        root, side = np.sqrt(D0 + factor * (D1 - D0) + 0j), (refined[i] - refined[j]) / 2
        same, other = abs(root - side), abs(root + side)
        told = abs(same - other) > _TOLD * (same + other)
        found[i] = m0 + factor * (m1 - m0) + (root if (same < other if told else i < j) else -root)
    return np.asarray(found)


def mirrored(bars: np.ndarray, partner: np.ndarray) -> np.ndarray:
    """Return for each bar the larger of its own and that of its mirror image, where both are known.

    Without damping λ and −λ* have the same error. Where the refined mesh takes the two apart, into modes that do not
    grow, each is compared with another of these and sees its change alone.

    Parameters
    ----------
    bars : (k,) complex
    partner : (k,) int
        Positions of the mirror images, or −1.

    Examples
    --------
    >>> mirrored(np.array([1 + 4j, 2 + 3j, 9]), np.array([1, 0, -1]))
    array([2.+4.j, 2.+4.j, 9.+0.j])
    """
    other = np.where(partner >= 0, bars[partner], bars)
    other = np.where(np.isfinite(other), other, bars)
    wide: np.ndarray = np.maximum(bars.real, other.real) + 1j * np.maximum(bars.imag, other.imag)
    return wide


def enveloped(bars: Sequence[np.ndarray], branches: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return for each bar the largest of itself and those of the same branch at the values before and after.

    Parameters
    ----------
    bars : (k,) complex for each value
        NaN where a bar is not known; it stays so, and does not count beside others.
    branches : (k,) int for each value

    Examples
    --------
    >>> enveloped([np.array([1 + 1j]), np.array([0j]), np.array([3j])], [np.array([7])] * 3)
    [array([1.+1.j]), array([1.+3.j]), array([0.+3.j])]
    """
    by_branch = [dict(zip(b.tolist(), bar.tolist(), strict=True)) for b, bar in zip(branches, bars, strict=True)]
    result = []
    for k, (own, names) in enumerate(zip(bars, branches, strict=True)):
        wide = own.astype(complex)
        for at in (k - 1, k + 1):
            if 0 <= at < len(bars):
                beside = np.array([by_branch[at].get(b, np.nan) for b in names.tolist()], dtype=complex)
                known = np.isfinite(beside) & np.isfinite(wide)
                real = np.where(known, np.maximum(wide.real, beside.real), wide.real)
                imag = np.where(known, np.maximum(wide.imag, beside.imag), wide.imag)
                wide = real + 1j * imag
        result.append(wide)
    return result
