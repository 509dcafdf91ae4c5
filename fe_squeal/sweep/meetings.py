"""Where stability changes inside an interval of the parameter: found on the matrices of groups of eigenvalues.

The eigenvalues of a group are sampled ever more closely towards points where two of them meet: for a pair the square of
half the difference, D, is smooth there, so that |D/D'| tells how far away such a point may be. Samples lie closer than
that, down to `FINEST` of a step of the sweep. Where the error of the matrix leaves open whether stability changes, the
modes at one more value are asked for.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from .clusters import Cluster, groups
from .nodes import Node

FINEST = 1e-6  # of a step: nearer to each other two changes of stability are not told apart
SETTLED = 1e-5  # of a step: windows that may be hidden below the error of a group are narrower than this
_FIRST = 9  # samples to begin with
_NEAR = 0.5  # times the distance to the next meeting: how far apart samples may lie
_MOST = 4000  # samples of a group
_NODES = 24  # values besides the ends at which modes are asked for in a step
_RIM = 0.9  # of the highest |λ| known: a mode beyond may leave what is known by itself
_ROUNDING = 1e-14  # of the size of a group's matrix


@dataclass(frozen=True)
class Change:
    """A change of stability between two near values.

    Attributes
    ----------
    kind : "meeting" of two eigenvalues θ, "zero" of an undamped eigenvalue θ, "crossing" of the imaginary axis, or
        "parting" of a growing pair λ, λ* into two real ones, or of these into a pair
    gains : int
        By how many the unstable modes become more, for a rising parameter.
    low, high : float
        Values before and behind.
    limits : (float, float)
        Values up to which nothing else changes in the group; the change itself is between them.
    v : complex
        The eigenvalue there, θ or λ.
    right, left : (r,) complex
        On the small problem, approximately.
    group : (r, ·) complex
        Right vectors of the whole group, at both ends of the interval.
    at_start : bool
        Whether the change begins at the first value of the step.
    """

    kind: str
    gains: int
    low: float
    high: float
    limits: tuple[float, float]
    v: complex
    right: np.ndarray
    left: np.ndarray
    group: np.ndarray
    at_start: bool = False


@dataclass(frozen=True)
class Open:
    """Modes of one end that have no counterpart at the other."""

    nodes: tuple[Node, Node]
    members: tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Scan:
    """What was found in a step.

    Attributes
    ----------
    changes : list of Change, by rising value
    open : list of Open
    unsettled : list of (float, float, float)
        Intervals with a frequency, rad/s, where more values were asked for than are allowed.
    width : float
        Windows of instability wider than this would have been seen, in the parameter.
    nodes : int
        Values at which modes were asked for.
    """

    changes: list[Change]
    open: list[Open]
    unsettled: list[tuple[float, float, float]]
    width: float
    nodes: int


class _Asked(Exception):
    """A value at which modes are needed to tell more, as t of the cluster."""

    def __init__(self, t: float) -> None:
        super().__init__()
        self.t = t


def scan(first: Node, second: Node, modes: Callable[[float], Node]) -> Scan:
    """Find what changes between two values.

    Parameters
    ----------
    first, second : Node
        At the ends of a step.
    modes : callable
        Returns the node of a value between.
    """
    step = abs(second.value - first.value)
    result = Scan([], [], [], FINEST * step, 0)
    width, count = FINEST * step, 0
    todo = [(first, second)]
    while todo:
        a, b = todo.pop()
        asked: list[float] = []
        found: list[Change] = []
        opened: list[Open] = []
        scale = abs(b.value - a.value) / step
        doubted = []
        for members in (_without_rim(a, b, *g) for g in groups(a, b)):
            if _is_idle(a, b, members):
                continue
            if len(members[0]) != len(members[1]):
                opened.append(Open((a, b), members))
                continue
            cluster = Cluster((a, b), members)
            if not cluster.is_smooth:
                asked.append(0.5)
                doubted.append(members)
                continue
            try:
                changes, hidden = _Samples(cluster, scale, a is first).changes()
                found += changes
                width = max(width, hidden * abs(b.value - a.value))
            except _Asked as more:
                asked.append(more.t)
                doubted.append(members)
        if asked and count < _NODES and scale > SETTLED:
            t = float(np.clip(sorted(asked)[len(asked) // 2], 0.05, 0.95))
            middle = modes(a.value + t * (b.value - a.value))
            count += 1
            todo += [(middle, b), (a, middle)]
            continue
        for s0, s1 in doubted:
            lam = np.concatenate([a.lam[s0], b.lam[s1]])
            result.unsettled.append((a.value, b.value, float(lam.imag.mean())))
        result.changes.extend(found)
        result.open.extend(opened)
    changes = sorted(result.changes, key=lambda c: (c.low, c.high))
    return Scan(changes, result.open, result.unsettled, width, count)


def _is_idle(a: Node, b: Node, members: tuple[np.ndarray, np.ndarray]) -> bool:
    """Whether there is nothing in a group that could change: symmetric matrices without θ < 0 at either end.

    The lowest θ of symmetric matrices that are linear in the parameter is concave: it lies above its chord.
    """
    v = np.concatenate([a.v[members[0]], b.v[members[1]]])
    return not len(v) or (a.symmetric and b.symmetric and bool((v.real > 0).all()))


def _without_rim(a: Node, b: Node, s0: np.ndarray, s1: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return as many members of a group at both ends: without the highest, which pass the end of what is known."""
    reach = _RIM * min(float(np.abs(n.lam).max(initial=0.0)) for n in (a, b))
    while len(s0) != len(s1):
        more, node = (s0, a) if len(s0) > len(s1) else (s1, b)
        size = np.abs(node.lam[more])
        if size.max() < reach:
            break
        kept = more[size < (1 - 1e-6) * size.max()]  # of mirror images both or none
        s0, s1 = (kept, s1) if more is s0 else (s0, kept)
    return s0, s1


class _Samples:
    """Eigenvalues of a group at values that are as close as its meetings ask for."""

    def __init__(self, cluster: Cluster, scale: float, at_start: bool) -> None:
        self.cluster, self.finest, self.settled = cluster, FINEST / scale, SETTLED / scale
        self._at_start = at_start
        self.theta = cluster.ends[0].C is None
        # −iλ of a gyroscopic system is real or stands beside its conjugate, as θ does without dampers.
        self._turned = cluster.ends[0].conservative
        blur = [n.blur[s] for n, s in zip(cluster.ends, cluster.members, strict=True)]
        size = max(float(np.abs(n.v[s]).max()) for n, s in zip(cluster.ends, cluster.members, strict=True))
        # Next to a double eigenvalue the blur of each end is that of a square root, which the group does not have.
        self.blur = max(float(min(b.min() for b in blur)), _ROUNDING * size)
        self._evaluate()

    def _evaluate(self) -> None:
        t = np.linspace(0.0, 1.0, _FIRST if self.cluster.m > 1 else 5)
        samples = self._at(t)
        while len(t) < _MOST:
            gap = np.diff(t)
            near = np.maximum(samples[2][:-1], samples[2][1:])  # the farther end of two decides
            wide = (gap > _NEAR * near) & (gap > self.finest)
            if not wide.any():
                break
            more = (t[:-1] + gap / 2)[wide]
            added = self._at(more)
            order = np.argsort(np.concatenate([t, more]), kind="stable")
            t = np.concatenate([t, more])[order]
            samples = tuple(np.concatenate([s, a])[order] for s, a in zip(samples, added, strict=True))
        self.t = t
        self.v, self.slope, _, self.W, self.departure = samples

    def _at(self, t: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return eigenvalues, slopes, how far the next meeting may be, eigenvectors, departure from normality."""
        H, dH = self.cluster.matrix(t)
        if self._turned:
            H, dH = -1j * H, -1j * dH
        v, W = np.linalg.eig(H)
        m = v.shape[1]
        if m == 1:
            return v, dH[:, :, 0], np.full(len(t), np.inf), W, np.zeros(len(t))
        with np.errstate(all="ignore"):
            try:
                inverse = np.linalg.inv(W)
            except np.linalg.LinAlgError:
                inverse = np.linalg.pinv(W)
            slope = np.einsum("tij,tjk,tki->ti", inverse, dH, W)
            i, j = np.triu_indices(m, 1)
            apart, drift = np.abs(v[:, i] - v[:, j]), np.abs(slope[:, i] - slope[:, j])
            reach = np.where(drift > 0, apart / (2 * drift), np.inf)
        reach = np.nan_to_num(reach.min(axis=1), nan=0.0, posinf=np.inf)
        centred = H - np.trace(H, axis1=1, axis2=2)[:, None, None] / m * np.eye(m)
        energy = (np.abs(centred) ** 2).sum(axis=(1, 2)) - (np.abs(v - v.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
        return v, slope, reach, W, np.sqrt(np.maximum(energy, 0.0))

    def changes(self) -> tuple[list[Change], float]:
        """Return what changes, and up to which share of the interval a window may have been hidden.

        Raises
        ------
        _Asked
        """
        if self.cluster.ends[0].paired or self._turned:
            return self._meetings()
        return self._crossings()

    # Without dampers: pairs of complex θ, and real θ < 0.

    def _meetings(self) -> tuple[list[Change], float]:
        v, t = self.v, self.t
        # D of a complex pair is −Im²; rounding of H moves D by itself times the departure from normality.
        size = np.abs(v).max(axis=1)
        low = np.sqrt(self.blur**2 + _ROUNDING * size * (self.departure + self.blur))
        self._least = low
        hidden = self._require_settled_pairs(self.cluster.error(t))
        complex_ = v.imag > low[:, None]
        if self._turned:  # without mirror images below the real axis of λ
            complex_ &= v.real >= -low[:, None]
        pairs = complex_.sum(axis=1)
        negative = ((v.real < -self.blur) & (np.abs(v.imag) <= low[:, None]) & (not self._turned)).sum(axis=1)
        for end, at in ((0, 0), (1, -1)):  # at the ends the modes themselves say what they are
            node, s = self.cluster.ends[end], self.cluster.members[end]
            swinging = node.lam[s].imag >= 0 if self._turned else node.lam[s].imag > 0
            pairs[at] = np.count_nonzero(node.unstable[s] & swinging)
            negative[at] = np.count_nonzero(node.unstable[s] & ~swinging)
        jumps = np.flatnonzero((np.diff(pairs) != 0) | (np.diff(negative) != 0))
        found = []
        for n, k in enumerate(jumps):
            limits = (t[jumps[n - 1] + 1] if n else 0.0, t[jumps[n + 1]] if n + 1 < len(jumps) else 1.0)
            found += self._change(int(k), int(pairs[k + 1] - pairs[k]), int(negative[k + 1] - negative[k]), limits)
        return found, hidden

    def _change(self, k: int, pairs: int, negative: int, limits: tuple[float, float]) -> list[Change]:
        gains = pairs + negative
        kind = "meeting" if pairs else "zero"
        many = abs(pairs) if pairs else abs(negative)
        there = k + 1 if pairs > 0 or (not pairs and negative > 0) else k  # the end where there are more of them
        v = self.v[there]
        if pairs:
            upper = np.flatnonzero(v.imag > self._least[there])
            chosen = upper[np.argsort(v[upper].imag)][:many]
        else:
            chosen = np.argsort(np.abs(v))[:many]
        if not len(chosen):  # the modes at the end say more than H: nearest to a double eigenvalue or to zero
            chosen = np.argsort(np.abs(v - v.mean()))[:1]
        each = int(np.sign(gains)) if gains else 0
        if pairs and negative:  # a pair parts on the negative axis, or two of it couple
            each = gains
        return [self._made(kind, each, k, there, int(i), limits) for i in chosen]

    def _made(self, kind: str, gains: int, k: int, there: int, i: int, limits: tuple[float, float]) -> Change:
        c, t = self.cluster, self.t
        W = self.W[there]
        with np.errstate(all="ignore"):
            inverse = np.linalg.pinv(W)
        right, left = c.vectors(t[there], W[:, i], inverse[i].conj())
        start = bool(k == 0 and self._at_start)
        return Change(
            kind, gains, c.value(t[k]), c.value(t[k + 1]), (c.value(limits[0]), c.value(limits[1])),
            complex(self.v[there, i]) * (1j if self._turned else 1), right, left, c.shapes, start,
        )  # fmt: skip

    def _require_settled_pairs(self, error: np.ndarray) -> float:
        """Ask for a value where an error of H could make a pair that stays apart meet, or undo a window."""
        v, t, m = self.v, self.t, self.cluster.m
        hidden = 0.0
        if m == 1:
            near = np.abs(v[:, 0].real) <= error
            if near.any() and np.sign(v[0, 0].real) == np.sign(v[-1, 0].real):
                raise _Asked(float(t[np.argmax(near)]))
            return hidden
        i, j = np.triu_indices(m, 1)
        D = ((v[:, i] - v[:, j]) / 2) ** 2
        doubt = error[:, None] * (2 * np.sqrt(np.abs(D)) + self.departure[:, None]) + error[:, None] ** 2
        drift = np.abs(self.slope[:, i] - self.slope[:, j])
        for pair in range(len(i)):
            # The real part counts of pairs that are both real or conjugate to each other; others do not meet.
            d = D[:, pair].real
            meant = np.abs(D[:, pair].imag) <= 1e-6 * np.abs(D[:, pair]) + self.blur**2
            unsure = meant & (np.abs(d) <= doubt[:, pair]) & (doubt[:, pair] > self._least**2)
            if not unsure.any():
                continue
            # A run of unsure samples between sure ones of different sign is one change, which is there in any case.
            edges = np.flatnonzero(np.diff(np.concatenate([[0], unsure.astype(int), [0]])))
            for begin, end in zip(edges[::2], edges[1::2], strict=True):
                before = np.sign(d[begin - 1]) if begin else 0
                behind = np.sign(d[end]) if end < len(d) else 0
                if before * behind < 0 or (not before and not behind and len(d) == end):
                    continue
                # How wide a window may hide: where |slope| t equals the root of what D may be off.
                best = begin + int(np.argmin(np.abs(d[begin:end])))
                steep = np.median(drift[max(begin - 1, 0) : end + 1, pair])
                width = 4 * np.sqrt(doubt[best, pair]) / steep if steep > 0 else 1.0
                width = min(float(width), float(t[min(end, len(t) - 1)] - t[max(begin - 1, 0)]))
                if width > self.settled:
                    raise _Asked(float(t[best]))
                hidden = max(hidden, width)
        return hidden

    # With dampers or complex stiffness: Re λ of each branch.

    def _growth(self, v: np.ndarray) -> np.ndarray:
        return v.real if not self.theta else np.sqrt(-v + 0j).real * np.where(np.sqrt(-v + 0j).imag < 0, -1.0, 1.0)

    def _crossings(self) -> tuple[list[Change], float]:
        self._follow()
        t, growth, error = self.t, self._growth(self.v), self.cluster.error(self.t)
        if self.theta:
            rate = 2 * np.sqrt(np.abs(self.v).mean())
            blur, error = self.blur / rate, error / rate
        else:
            blur = self.blur
        partings = [] if self.theta else self._partings(growth, blur)
        i, j = np.triu_indices(self.cluster.m, 1)
        apart = np.abs(self.v[:, i] - self.v[:, j]).min(axis=1, initial=np.inf)
        # An eigenvalue moves by the error of H times its condition, and next to a meeting by its square root.
        amplified = error * (1 + self.departure / np.maximum(apart, error + np.finfo(float).tiny))
        worst = np.sqrt(error * (error + self.departure)) + error
        unsure = np.minimum(amplified, worst) if self.cluster.m > 1 else error
        found: list[tuple[int, int, Change]] = []
        for b in range(self.cluster.m):
            g = growth[:, b]
            up = g > blur
            for end, at in ((0, 0), (1, -1)):
                node, s = self.cluster.ends[end], self.cluster.members[end]
                up[at] = node.unstable[s[np.argmin(np.abs(node.v[s] - self.v[at, b]))]]
            jumps = np.flatnonzero(np.diff(up))
            borders = [0, *(int(k) + 1 for k in jumps), len(t)]
            for begin, end in itertools.pairwise(borders):
                inside = slice(begin, end)
                at_end = begin == 0 or end == len(t)  # where the modes themselves are known
                sure = at_end or bool((np.abs(g[inside]) > unsure[inside]).any())
                close = ~up[inside] & (g[inside] > -unsure[inside]) & (unsure[inside] > blur)
                close[[0, -1]] = False
                if not sure or (close[1:-1].any() and not _towards_a_change(close)):
                    best = begin + int(np.argmax(g[inside]))
                    if 0 < best < len(t) - 1:
                        raise _Asked(float(t[best]))
            for n, k in enumerate(jumps):
                limits = (t[jumps[n - 1] + 1] if n else 0.0, t[jumps[n + 1]] if n + 1 < len(jumps) else 1.0)
                gains = 1 if up[k + 1] else -1
                there = int(k + 1 if up[k + 1] else k)
                if self.v[there, b].imag < -1e-6 * abs(self.v[there, b]) - self.blur and not self.theta:
                    continue  # the mirror image of one above the real axis
                found.append((int(k), b, self._made("crossing", gains, int(k), there, b, limits)))
        return [*(c for _, _, c in found), *partings], self.finest

    def _partings(self, growth: np.ndarray, blur: float) -> list[Change]:
        """Return where growing pairs λ, λ* become two real eigenvalues, each of which counts, or the reverse."""
        real = np.abs(self.v.imag) <= 1e-9 * np.abs(self.v) + blur
        single = (real & (growth > blur)).sum(axis=1)
        pairs = (~real & (growth > blur) & (self.v.imag > 0)).sum(axis=1)
        found = []
        jumps = np.flatnonzero((np.diff(pairs) != 0) & (np.diff(single) == -2 * np.diff(pairs)))
        for k in (int(jump) for jump in jumps):
            gains = -int(pairs[k + 1] - pairs[k])
            there = k + 1 if gains < 0 else k  # where they are a pair
            upper = np.flatnonzero(~real[there] & (growth[there] > blur) & (self.v[there].imag > 0))
            for i in upper[np.argsort(self.v[there, upper].imag)][: abs(gains)]:
                limits = (float(self.t[max(k - 1, 0)]), float(self.t[min(k + 2, len(self.t) - 1)]))
                found.append(self._made("parting", int(np.sign(gains)), k, there, int(i), limits))
        return found

    def _follow(self) -> None:
        """Put the eigenvalues of every sample in the order of the sample before; add samples where one could turn."""
        for _ in range(12):
            for k in range(1, len(self.t)):
                h = self.t[k] - self.t[k - 1]
                ahead = self.v[k - 1] + h * self.slope[k - 1] / 2
                back = self.v[k] - h * self.slope[k] / 2
                _, order = linear_sum_assignment(np.abs(ahead[:, None] - back[None, :]))
                self.v[k], self.slope[k], self.W[k] = self.v[k][order], self.slope[k][order], self.W[k][:, order]
            more = self._turning_points()
            if not len(more):
                return
            v, slope, _, W, departure = self._at(more)
            order = np.argsort(np.concatenate([self.t, more]), kind="stable")
            self.t = np.concatenate([self.t, more])[order]
            self.v, self.slope = np.concatenate([self.v, v])[order], np.concatenate([self.slope, slope])[order]
            self.W = np.concatenate([self.W, W])[order]
            self.departure = np.concatenate([self.departure, departure])[order]

    def _turning_points(self) -> np.ndarray:
        """Return where a cubic through two samples of one branch reaches growth between two stable ones, or ends it."""
        growth = self._growth(self.v)
        rate = self.slope.real if not self.theta else -self.slope.imag / (2 * np.sqrt(np.abs(self.v)))
        h = np.diff(self.t)[:, None]
        g0, g1, d0, d1 = growth[:-1], growth[1:], rate[:-1] * h, rate[1:] * h
        s = np.linspace(0, 1, 17)[1:-1, None, None]
        between = (
            g0 * (1 + 2 * s) * (1 - s) ** 2 + d0 * s * (1 - s) ** 2 + g1 * s**2 * (3 - 2 * s) + d1 * s**2 * (s - 1)
        )
        high, low = between.max(axis=0), between.min(axis=0)
        missed = ((g0 < 0) & (g1 < 0) & (high > 0)) | ((g0 > 0) & (g1 > 0) & (low < 0))
        missed &= h > self.finest
        at = np.where((g0 < 0), between.argmax(axis=0), between.argmin(axis=0))
        k, b = np.nonzero(missed)
        return np.unique(self.t[k] + np.diff(self.t)[k] * (at[k, b] + 1) / 16)


def _towards_a_change(close: np.ndarray) -> bool:
    """Whether what is close to zero in a run of stable samples reaches an end of it: it leads to the change there."""
    k = np.flatnonzero(close)
    runs = np.split(k, np.flatnonzero(np.diff(k) > 1) + 1)
    return all(int(run[0]) <= 1 or int(run[-1]) >= len(close) - 2 for run in runs)
