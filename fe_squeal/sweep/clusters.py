"""Eigenvalues that may meet between two values of the parameter: a group, and its matrix H(p), which stays smooth.

Of a group of m eigenvalues that no other one comes near, right and left vectors R, L with LᴴBR = 1 give the matrix
H = LᴴAR with these eigenvalues, the group matrix. It is analytic in the parameter p even where eigenvalues meet and
themselves have branch points.
With bases that are carried along so that LᴴBR' = 0, its derivative is LᴴA'R − LᴴB'RH. (Kato, Perturbation Theory for
Linear Operators, II §4: analytic bases of a group, and the transformation between the bases of two values.)
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

_REACH = 2.0  # times how much nearer their slopes would bring two eigenvalues: if their distance is less, they may meet
_ALIKE = 0.1  # MAC from which two modes at different values belong to one group
_SAME = 0.5  # MAC from which the only two modes of a group continue each other
_DEFECTIVE = 10.0  # condition from which the slope of a single eigenvalue says little
_TURNED = 0.5  # how far a group may have turned over an interval, as |LᴴBR·LᴴBR − 1|


def groups(first: Node, second: Node) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the groups: positions, at both values, of eigenvalues that may meet between them or have changed places.

    Eigenvalues whose stability cannot change between the two values are left out.
    """
    k = len(first)
    links = np.zeros((k + len(second),) * 2, bool)
    width = abs(second.value - first.value)
    links[:k, :k], links[k:, k:] = _may_meet(first, width), _may_meet(second, width)
    alike = np.maximum(_likeness(first, second, "right"), _likeness(first, second, "left"))
    links[:k, k:] = alike > _ALIKE
    found = _components(links, k)
    if len(first) == len(second) and any(len(s0) != len(s1) for s0, s1 in found):
        # Nothing has come or gone, so shapes have misled: modes near to being one are like many others.
        _link_across(links, first, second, found)
        found = _components(links, k)
    single = [len(s0) == len(s1) == 1 and _is_idle(first, s0[0], second, s1[0], alike) for s0, s1 in found]
    found = [members for members, idle in zip(found, single, strict=True) if not idle]
    # Groups below the real axis are the mirror images of others above.
    return [(s0, s1) for s0, s1 in found if (first.lam[s0].imag >= 0).any() or (second.lam[s1].imag >= 0).any()]


def _components(links: np.ndarray, k: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the connected groups of linked eigenvalues, the first k of one value and the others of the other."""
    count, label = connected_components(links, directed=False)
    return [(np.flatnonzero(label[:k] == i), np.flatnonzero(label[k:] == i)) for i in range(count)]


def _link_across(
    links: np.ndarray, first: Node, second: Node, found: list[tuple[np.ndarray, np.ndarray]]
) -> None:  # fmt: skip
    """Link the eigenvalues of groups with more members at one value than at the other, so that they move least."""
    odd = [(s0, s1) for s0, s1 in found if len(s0) != len(s1)]
    s0, s1 = (np.concatenate(side) for side in zip(*odd, strict=True))
    rows, columns = linear_sum_assignment(np.abs(first.v[s0][:, None] - second.v[s1][None, :]))
    links[s0[rows], len(first) + s1[columns]] = True


def _is_idle(a: Node, i: int, b: Node, j: int, alike: np.ndarray) -> bool:
    """Whether an eigenvalue that meets no other one stays on its side of zero (θ), or of the imaginary axis (λ)."""
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
    # A cubic with these slopes at the ends leaves the straight line by at most 4/27 of each slope times the width.
    overshoot = 2 * 4 / 27 * width * np.abs(slopes.real).sum() + a.blur[i] + b.blur[j]
    return bool(np.abs(distance).min() > overshoot and distance[0] * distance[1] > 0)


def _lengths(node: Node, side: str) -> np.ndarray:
    u = node.right if side == "right" else node.left
    return np.sqrt(np.maximum(np.einsum("ij,ij->j", u.conj(), node.M @ u).real, np.finfo(float).tiny))


def _likeness(a: Node, b: Node, side: str) -> np.ndarray:
    u, w = (n.right if side == "right" else n.left for n in (a, b))
    size = np.outer(_lengths(a, side), _lengths(b, side))
    alike = np.asarray(np.abs(u.conj().T @ a.M @ w) / size) ** 2
    if a.C is None:
        return alike
    # States (φ, λφ) tell the two eigenvalues of an overdamped mode, or a mode and its mirror image, from each other.
    v, x = np.abs(a.v)[:, None], np.abs(b.v)[None, :]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        turn = np.conj(a.v / np.abs(a.v))[:, None] * (b.v / np.abs(b.v))[None, :]
        same = np.abs(1 + turn) ** 2 / (2 + v / x + x / v)
    return np.where((v > 0) & (x > 0), alike * same, alike)


def _may_meet(node: Node, width: float) -> np.ndarray:
    """Return which pairs of eigenvalues may meet within a width, by gap, slopes and coupling of each pair alone."""
    if not len(node):
        return np.zeros((0, 0), bool)
    rate = np.ones(len(node)) if node.C is None else 2 * np.maximum(np.abs(node.v), np.finfo(float).tiny)
    right, left, modes = _lengths(node, "right"), _lengths(node, "left"), node.all()
    push, own, slope = node.push(modes), node.cross(modes, modes).diagonal(), node.rates
    plain = np.abs(push) / np.outer(left, right) / rate
    size = np.abs(own)
    with np.errstate(divide="ignore", invalid="ignore"):
        condition = left * right * rate / size
    sure = condition < _DEFECTIVE
    moves = plain.diagonal()
    with np.errstate(invalid="ignore"):
        apart = np.abs(slope[:, None] - slope[None, :])
    approach = np.where(np.outer(sure, sure), apart, moves[:, None] + moves[None, :])
    reach = _REACH * width * (approach + 2 * np.sqrt(plain * plain.T))
    blur = node.blur[:, None] + node.blur[None, :]
    near = np.abs(node.v[:, None] - node.v[None, :]) <= reach + blur
    if node.paired or node.conservative:  # a growing mode and its decaying mirror image part and meet together
        v = node.v if node.paired else -1j * node.v
        mirrored = np.abs(v[:, None] - v[None, :].conj()) <= 4 * blur + 1e-9 * np.abs(v)[:, None]
        near |= mirrored & (np.abs(v.imag) > 0)[:, None]
    return np.asarray(near)


@dataclass(frozen=True)
class Cluster:
    """A group over an interval of x, t = 0 … 1: H(t) is the cubic with the values and slopes at its ends.

    Attributes
    ----------
    ends : (Node, Node)
    members : (m,) int each
        Positions of the group at both ends.
    scale : Scale
        Whether x is the parameter or its logarithm.
    """

    ends: tuple[Node, Node]
    members: tuple[np.ndarray, np.ndarray]
    scale: Scale = LINEAR

    @property
    def m(self) -> int:
        """Number of eigenvalues."""
        return len(self.members[0])

    @property
    def width(self) -> float:
        """Of the interval, in x."""
        return self.scale.x(self.ends[1].value) - self.scale.x(self.ends[0].value)

    @cached_property
    def _bases(self) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray], list[np.ndarray], float]:
        """Return H, dH/dt, right and left bases at both ends, and how far the space of the group turns between them."""
        bases = []
        for node, s in self._both():
            basis = node.basis(s)
            # Orthonormal combinations, since eigenvectors next to a meeting are nearly dependent.
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
        w, W = la.eig(turned)
        root = W @ np.diag(1 / np.sqrt(w)) @ la.inv(W)
        into, out = root @ there, again @ root
        H[1], slopes[1] = into @ H[1] @ out, into @ slopes[1] @ out
        right[1], left[1] = right[1] @ out, left[1] @ into.conj().T
        return H, slopes, right, left, float(la.norm(turned - np.eye(self.m), 2))

    def _both(self) -> list[tuple[Node, np.ndarray]]:
        return list(zip(self.ends, self.members, strict=True))

    @cached_property
    def is_smooth(self) -> bool:
        """Whether both ends have as many eigenvalues, in spaces so close that a cubic can join their matrices."""
        if len(self.members[0]) != len(self.members[1]):
            return False
        with warnings.catch_warnings():
            warnings.simplefilter("error", la.LinAlgWarning)
            try:
                return self._bases[4] <= _TURNED
            except (la.LinAlgError, la.LinAlgWarning, ValueError):  # modes that rounding makes one
                return False

    def matrix(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return H and dH/dt (len(t), m, m)."""
        (a, b), (da, db) = self._bases[:2]
        t = np.asarray(t, float)[:, None, None]
        H = a * (1 + 2 * t) * (1 - t) ** 2 + da * t * (1 - t) ** 2 + b * t**2 * (3 - 2 * t) + db * t**2 * (t - 1)
        dH = 6 * t * (1 - t) * (b - a) + da * (1 - t) * (1 - 3 * t) + db * t * (3 * t - 2)
        return H, dH

    def error(self, t: np.ndarray) -> np.ndarray:
        """Return how far the cubic may be from H: its difference from a parabola, and what turned bases leave open."""
        (a, b), (da, db), *_, turned = self._bases
        rest = la.norm(b - a - (da + db) / 2, 2) + turned * la.norm(b - a, 2)
        return np.asarray(16 * rest * (t * (1 - t)) ** 2)

    def remainder(self, t: np.ndarray) -> np.ndarray:
        """Return the difference of the cubic from a parabola (len(t), m, m)."""
        (a, b), (da, db), *_ = self._bases
        return np.asarray(16 * (t * (1 - t))[:, None, None] ** 2 * (b - a - (da + db) / 2))

    @property
    def shapes(self) -> np.ndarray:
        """Right vectors (r, 2m) of the group at both ends."""
        return np.hstack([n.right[:, s] for n, s in self._both()])

    def vectors(self, t: float, right: np.ndarray, left: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return right and left vectors (r, ·) of the step model from those of H."""
        _, _, R, L, _ = self._bases
        return ((1 - t) * R[0] + t * R[1]) @ right, ((1 - t) * L[0] + t * L[1]) @ left

    def value(self, t: float) -> float:
        """Return the parameter at t."""
        return self.scale.p(self.scale.x(self.ends[0].value) + t * self.width)

    def extent(self, share: float) -> float:
        """Return how far such a share of the interval reaches in the parameter, at most."""
        return share * self.width * self.scale.slope(self.ends[1].value)


def cluster_of(ends: tuple[Node, Node], members: tuple[np.ndarray, np.ndarray], scale: Scale) -> Cluster:
    """Return a group along p, or on a logarithmic scale along ln p where its cubic has the smaller error there.

    Where the group is most of what p acts on, H is nearly linear in p; where p stiffens what holds it from one limit to
    another, H changes evenly with ln p.
    """
    plain = Cluster(ends, members)
    if not scale.logarithmic or not plain.is_smooth:
        return plain
    other, middle = Cluster(ends, members, scale), np.array([0.5])
    return min((plain, other), key=lambda c: float(c.error(middle)[0]))


def _states(u: np.ndarray, H: np.ndarray, node: Node) -> np.ndarray:
    """Return the states of vectors (r, m): u alone, or with dampers u above uH, the velocities, in units of |λ|."""
    u = node.weighted(u)
    if node.C is None:
        return u
    return np.vstack([u, u @ H / max(float(np.abs(H.diagonal()).max()), np.finfo(float).tiny)])
