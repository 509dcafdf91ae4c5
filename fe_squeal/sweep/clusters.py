"""Groups of eigenvalues that may meet between two values of the parameter, and the matrix H(p) of a group.

Let A φ = θ B φ and let no other eigenvalue come near a group of m eigenvalues. With right and left bases R, L of the
group, scaled so that LᴴBR = 1, the group matrix H = LᴴAR (m, m) has these eigenvalues. It is analytic in the parameter
p, also where eigenvalues of the group meet and are not differentiable themselves. If the bases change with p so that
LᴴBR' = 0, its derivative is LᴴA'R − LᴴB'RH. (T. Kato, Perturbation Theory for Linear Operators, II §4: analytic bases
of a group, and the transformation between the bases at two values.)
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la
from scipy.optimize import linear_sum_assignment
from scipy.sparse.csgraph import connected_components

from .nodes import Node
from .scale import LINEAR, Scale

_REACH = 2.0  # times the distance that two eigenvalues move, by their slopes: if they are closer, they may meet
_ALIKE = 0.1  # likeness (1: the same): two modes at different values with a larger one belong to the same group
_SAME = 0.5  # likeness: if a group has one mode at either value and theirs is larger, they are the same mode
_DEFECTIVE = 10.0  # condition of an eigenvalue: more of it in a slope says little about where the eigenvalue moves
_TURNED = 0.5  # the space of a group may turn by so much over an interval, measured as |L₀ᴴBR₁·L₁ᴴBR₀ − 1|


def groups(first: Node, second: Node) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the groups of eigenvalues that may meet, or exchange places, between two values.

    A group is given by the positions of its eigenvalues at the first value and at the second. An eigenvalue that stays
    alone and cannot change its stability between the two values is left out.
    """
    k = len(first)
    links = np.zeros((k + len(second),) * 2, bool)
    width = abs(second.value - first.value)
    links[:k, :k], links[k:, k:] = _may_meet(first, width), _may_meet(second, width)
    alike = _likeness(first, second)
    links[:k, k:] = alike > _ALIKE
    found = _components(links, k)
    if len(first) == len(second) and any(len(s0) != len(s1) for s0, s1 in found):
        # Both values have equally many eigenvalues, so no mode has come or gone, and the likeness of shapes must have
        # misled: the shapes of nearly defective modes resemble those of many others.
        _link_across(links, first, second, found)
        found = _components(links, k)
    idle = [
        (len(s0) == len(s1) == 1 and _is_idle(first, s0[0], second, s1[0], alike))
        or (len(s0) == len(s1) == 2 and _stays_a_pair(first, s0, second, s1, alike))
        for s0, s1 in found
    ]
    found = [members for members, rests in zip(found, idle, strict=True) if not rests]
    # A group with Im λ < 0 throughout is the mirror image of one with Im λ > 0, and not looked at.
    return [(s0, s1) for s0, s1 in found if (first.lam[s0].imag >= 0).any() or (second.lam[s1].imag >= 0).any()]


def _components(links: np.ndarray, k: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the groups of eigenvalues that links connect; the first k rows of `links` are those of the first value."""
    count, label = connected_components(links, directed=False)
    return [(np.flatnonzero(label[:k] == i), np.flatnonzero(label[k:] == i)) for i in range(count)]


def _link_across(
    links: np.ndarray, first: Node, second: Node, found: list[tuple[np.ndarray, np.ndarray]]
) -> None:  # fmt: skip
    """Add links between groups that have more members at one value than at the other.

    All eigenvalues of such groups at the first value are paired with those at the second so that they move least.
    """
    odd = [(s0, s1) for s0, s1 in found if len(s0) != len(s1)]
    s0, s1 = (np.concatenate(side) for side in zip(*odd, strict=True))
    rows, columns = linear_sum_assignment(np.abs(first.v[s0][:, None] - second.v[s1][None, :]))
    links[s0[rows], len(first) + s1[columns]] = True


def _is_idle(a: Node, i: int, b: Node, j: int, alike: np.ndarray) -> bool:
    """Return whether an eigenvalue that meets no other one keeps its stability between two values.

    Without dampers a real θ has to stay on its side of zero, with dampers λ on its side of the imaginary axis.
    """
    if alike[i, j] < _SAME:
        return False
    width = abs(b.value - a.value)
    v, slopes = np.array([a.v[i], b.v[j]]), np.array([a.rates[i], b.rates[j]])
    if a.paired:
        distance = v.real
    elif a.C is None:
        distance, slopes = v.imag, 1j * slopes
    else:
        distance = -v.real
    # A cubic with these values and slopes at its ends differs from the straight line between its ends by at most 4/27
    # of each slope times the width. Twice that is allowed for.
    overshoot = 2 * 4 / 27 * width * np.abs(slopes.real).sum() + a.blur[i] + b.blur[j]
    return bool(np.abs(distance).min() > overshoot and distance[0] * distance[1] > 0)


def _stays_a_pair(a: Node, s0: np.ndarray, b: Node, s1: np.ndarray, alike: np.ndarray) -> bool:
    """Return whether a complex pair v, v* of real matrices, which meets no other eigenvalue, stays one between values.

    D = ((v − v*)/2)² = −(Im v)² is smooth where a pair becomes two real eigenvalues. It is judged as in `_is_idle`.
    """
    i, j = (int(s[np.argmax(n.v[s].imag)]) for n, s in ((a, s0), (b, s1)))
    conjugate = all(n.v[s].sum().imag == 0 for n, s in ((a, s0), (b, s1)))
    if not a.paired or not conjugate or alike[i, j] < _SAME:
        return False
    width, parts = abs(b.value - a.value), np.array([a.v[i].imag, b.v[j].imag])
    slopes = 2 * parts * np.array([a.rates[i].imag, b.rates[j].imag])
    blur = 2 * parts * np.array([a.blur[i], b.blur[j]])
    return bool((parts**2).min() > 2 * 4 / 27 * width * np.abs(slopes).sum() + blur.sum())


def _likeness(a: Node, b: Node) -> np.ndarray:
    """Return how much of each mode (k) at one value is in each mode (l) at another, as a MAC: 1 if they are the same.

    A mode at b is Σ c_i φ_i of the modes at a with c_i = ψ_iᴴBφ / ψ_iᴴBφ_i. The product of this share and that of φ_i
    in the modes at b is taken. Different modes at one value have zero, although their right vectors may be alike.
    """
    here, there = a.all(), b.all()
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        shares = a.cross(here, there) * a.cross(there, here).T / np.outer(a.own[1], b.own[1])
    return np.nan_to_num(np.abs(shares), nan=1.0)


def _may_meet(node: Node, width: float) -> np.ndarray:
    """Return which pairs of eigenvalues (k, k) bool may meet within a width of the parameter.

    Each pair is judged by itself: by its gap, by its slopes, and by how strongly the parameter couples the two.
    """
    if not len(node):
        return np.zeros((0, 0), bool)
    rate = np.ones(len(node)) if node.C is None else 2 * np.maximum(np.abs(node.v), np.finfo(float).tiny)
    (right, left), pushes = node.lengths, node.own[0]
    slope = node.rates
    plain = np.abs(pushes) / np.outer(left, right) / rate
    moves = plain.diagonal()  # the slope of an eigenvalue is this times its condition
    with np.errstate(invalid="ignore"):
        apart = np.abs(slope[:, None] - slope[None, :])
    approach = np.fmin(apart, _DEFECTIVE * (moves[:, None] + moves[None, :]))
    reach = _REACH * width * (approach + 2 * np.sqrt(plain * plain.T))
    blur = node.blur[:, None] + node.blur[None, :]
    near = np.abs(node.v[:, None] - node.v[None, :]) <= reach + blur
    if node.paired or node.conservative:  # a growing mode and its decaying mirror image belong to the same group
        v = node.v if node.paired else -1j * node.v
        mirrored = np.abs(v[:, None] - v[None, :].conj()) <= 4 * blur + 1e-9 * np.abs(v)[:, None]
        near |= mirrored & (np.abs(v.imag) > 0)[:, None]
    return np.asarray(near)


@dataclass(frozen=True)
class Cluster:
    """A group of eigenvalues over an interval, and the cubic H(t) that interpolates its matrix.

    The interval is that of the coordinate x, the parameter or its logarithm; t goes from 0 to 1 over it. The cubic has
    the group matrix and its derivative at both ends.

    Attributes
    ----------
    ends : (Node, Node)
        The modes at both ends of the interval.
    members : ((m,) int, (m,) int)
        Positions of the group's eigenvalues among these modes.
    scale : Scale
        Whether x is the parameter or its logarithm.
    """

    ends: tuple[Node, Node]
    members: tuple[np.ndarray, np.ndarray]
    scale: Scale = LINEAR

    @property
    def m(self) -> int:
        """Number of eigenvalues of the group."""
        return len(self.members[0])

    @property
    def width(self) -> float:
        """Length of the interval in x."""
        return self.scale.x(self.ends[1].value) - self.scale.x(self.ends[0].value)

    @cached_property
    def _bases(self) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray], list[np.ndarray], float]:
        """H, dH/dt, right and left bases, each at both ends, and how far the group's space turns between them."""
        bases = []
        for node, s in self._both():
            basis = node.basis(s).real() if node.paired else node.basis(s)
            # The bases are made orthonormal, since eigenvectors close to a meeting are nearly parallel.
            S, T = (la.qr(_states(u, H, node), mode="r")[0][: len(s)] for u, H in
                    ((basis.right, basis.H), (basis.left, basis.HL.conj().T)))  # fmt: skip
            bases.append(basis.changed(S, T))

        def cross(i: int, j: int) -> np.ndarray:
            return self.ends[i].cross(bases[i], bases[j])

        own = [la.inv(cross(i, i)) for i in (0, 1)]
        H = [b.H for b in bases]
        rates = [self.width * self.scale.slope(node.value) for node in self.ends]
        slopes = [rates[i] * own[i] @ self.ends[i].push(bases[i]) for i in (0, 1)]
        right, left = [b.right for b in bases], [b.left @ o.conj().T for b, o in zip(bases, own, strict=True)]
        there, again = own[0] @ cross(0, 1), own[1] @ cross(1, 0)
        turned = there @ again
        angle = float(la.norm(turned - np.eye(self.m), 2))
        if angle > _TURNED:  # the group is not followed over this interval, and a mode may have turned altogether
            return H, slopes, right, left, angle
        w, W = la.eig(turned)
        root = W / np.sqrt(w) @ la.inv(W)
        if not np.iscomplexobj(turned):
            root = root.real
        into, out = root @ there, again @ root
        H[1], slopes[1] = into @ H[1] @ out, into @ slopes[1] @ out
        right[1], left[1] = right[1] @ out, left[1] @ into.conj().T
        return H, slopes, right, left, angle

    def _both(self) -> list[tuple[Node, np.ndarray]]:
        return list(zip(self.ends, self.members, strict=True))

    @cached_property
    def is_smooth(self) -> bool:
        """Whether the cubic can be used: both ends have as many eigenvalues, and their spaces are close (`_TURNED`)."""
        if len(self.members[0]) != len(self.members[1]):
            return False
        with warnings.catch_warnings():
            warnings.simplefilter("error", la.LinAlgWarning)
            try:
                return self._bases[4] <= _TURNED
            except (la.LinAlgError, la.LinAlgWarning, ValueError):  # two modes are the same up to rounding
                return False

    def matrix(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return H and dH/dt, both (s, m, m) complex, at t (s,)."""
        (a, b), (da, db) = self._bases[:2]
        t = np.asarray(t, float)[:, None, None]
        H = a * (1 + 2 * t) * (1 - t) ** 2 + da * t * (1 - t) ** 2 + b * t**2 * (3 - 2 * t) + db * t**2 * (t - 1)
        dH = 6 * t * (1 - t) * (b - a) + da * (1 - t) * (1 - 3 * t) + db * t * (3 * t - 2)
        return H, dH

    def error(self, t: np.ndarray) -> np.ndarray:
        """Return how far the cubic may be from the true group matrix at t (s,).

        It is estimated by the difference of the cubic from a parabola, and by how far the bases turn over the interval.
        """
        (a, b), (da, db), *_, turned = self._bases
        rest = la.norm(b - a - (da + db) / 2, 2) + turned * la.norm(b - a, 2)
        return np.asarray(16 * rest * (t * (1 - t)) ** 2)

    def remainder(self, t: np.ndarray) -> np.ndarray:
        """Return the difference (s, m, m) of the cubic from a parabola at t (s,)."""
        (a, b), (da, db), *_ = self._bases
        return np.asarray(16 * (t * (1 - t))[:, None, None] ** 2 * (b - a - (da + db) / 2))

    @property
    def shapes(self) -> np.ndarray:
        """Right vectors (r, 2m) of the group, those at both ends beside each other."""
        return np.hstack([n.right[:, s] for n, s in self._both()])

    def vectors(self, t: float, right: np.ndarray, left: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return right and left vectors (r,) or (r, k) of the step model from vectors (m,) or (m, k) of H at t."""
        _, _, R, L, _ = self._bases
        return ((1 - t) * R[0] + t * R[1]) @ right, ((1 - t) * L[0] + t * L[1]) @ left

    def value(self, t: float) -> float:
        """Return the value of the parameter at t."""
        return self.scale.p(self.scale.x(self.ends[0].value) + t * self.width)

    def extent(self, share: float) -> float:
        """Return the largest length, in the parameter, of a part of the interval that has the length `share` in t."""
        return share * self.width * self.scale.slope(self.ends[1].value)


def cluster_of(ends: tuple[Node, Node], members: tuple[np.ndarray, np.ndarray], scale: Scale) -> Cluster:
    """Return the group with its cubic along p; where the scale is logarithmic, along ln p if the error is smaller so.

    If p is a stiffness that most of the group's energy is in, H is nearly linear in p. If p is the stiffness of a
    support that goes from nearly free to nearly fixed, H changes evenly with ln p.

    Parameters
    ----------
    ends : (Node, Node)
        The modes at both ends of the interval.
    members : ((m,) int, (m,) int)
        Positions of the group's eigenvalues among these modes.
    scale : Scale
        Scale of the sweep.
    """
    plain = Cluster(ends, members)
    if not scale.logarithmic or not plain.is_smooth:
        return plain
    other, middle = Cluster(ends, members, scale), np.array([0.5])
    return min((plain, other), key=lambda c: float(c.error(middle)[0]))


def _states(u: np.ndarray, H: np.ndarray, node: Node) -> np.ndarray:
    """Return the states of vectors u (r, m): u itself, or with dampers (2r, m), below u the velocities uH over |λ|."""
    u = node.weighted(u)
    if node.C is None:
        return u
    return np.vstack([u, u @ H / max(float(np.abs(H.diagonal()).max()), np.finfo(float).tiny)])
