"""The eigenvalues of a group over an interval of the parameter, with samples closer together where two of them meet."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from .changes import FINEST, SETTLED, Change
from .clusters import Cluster

_FIRST = 9  # samples at the start
_NEAR = 0.5  # of the estimated distance to the next meeting: samples are at most so far apart
_MOST = 4000  # samples of a group, at most
# Of how far a number falls or rises between two samples: it is sampled where it turns if it turns so near to zero,
# since what is known of it between them is a cubic.
NEAR_ZERO = 0.1
_TWINS = 4.0  # times what two eigenvalues may be off by rounding: nearer ones are equal
FARTHEST = 1e-8  # of the size of a group's eigenvalues: those farther apart are not taken for equal, however unsure
_WORST = 1e6  # condition: with a larger one two eigenvalues are not told from a double one
_ROUNDING = 1e-14  # of the size of a group's matrix: the rounding of its entries


class Samples:
    """Eigenvalues of a group at samples of the interval, which are closer together where two eigenvalues may meet.

    D = ((v_i − v_j)/2)² of two eigenvalues is smooth where they meet (D = 0), and so |D/D'| estimates the distance to
    the next meeting. Samples are closer together than that, down to `FINEST` of a step of the sweep.

    Parameters
    ----------
    cluster, at_start
        See `cluster` and `starts`.
    scale : float
        Length of the interval, as a part of the step.
    apart : float
        How far eigenvalues of copies may be apart, relatively, by more than rounding.

    Attributes
    ----------
    cluster : Cluster
        The group and its matrix H(t).
    starts : bool
        Whether the interval begins at the first value of the step.
    finest, settled : float
        `FINEST` and `SETTLED` as lengths in t.
    theta : bool
        Whether the eigenvalues v are θ = −λ².
    turned : bool
        Whether v is −iλ, in gyroscopic systems. These are real or come in conjugate pairs, as θ do.
    blur : float
        How far eigenvalues may be off by rounding.
    t : (s,) float
        The samples, from 0 to 1 over the interval.
    v, slope : (s, m) complex
        Eigenvalues, and dv/dt.
    W : (s, m, m) complex
        Eigenvectors of H.
    departure : (s,) float
        Departure of H from normality: √(‖H‖² − Σ|v|²), both after subtracting the mean eigenvalue.
    condition : (s, m) float
        Condition number of each eigenvalue of H; infinite at a double one.
    cut, cut_at : float
        Width of the widest interval that has too few samples, since there are too many in all, and its middle; 0 where
        there is none.
    copied : bool
        Whether the group is made of copies that nothing couples, see `twins`.
    """

    def __init__(self, cluster: Cluster, scale: float, at_start: bool, apart: float = 0.0) -> None:
        self.cluster, self.finest, self.settled = cluster, FINEST / scale, SETTLED / scale
        self.starts = at_start
        self.theta = cluster.ends[0].C is None
        # In a gyroscopic system −iλ is real or has its conjugate beside it, as θ has without dampers.
        self.turned = cluster.ends[0].conservative
        blur = [n.blur[s] for n, s in zip(cluster.ends, cluster.members, strict=True)]
        size = max(float(np.abs(n.v[s]).max()) for n, s in zip(cluster.ends, cluster.members, strict=True))
        # The smallest blur of the group is taken. Close to a double eigenvalue the blur of a mode is the square root of
        # the rounding, but H does not have such an error.
        self.blur = max(float(min(b.min() for b in blur)), _ROUNDING * size)
        known = _TWINS * max(float(max(b.max() for b in blur)), _ROUNDING * size)
        equal = max(known, apart * size)
        if all(_come_in_sets(n.v[s], equal) for n, s in zip(cluster.ends, cluster.members, strict=True)):
            equal = FARTHEST * size  # what parts them between the ends is then the error of the slopes there
        self._equal = min(equal, FARTHEST * size)
        self.copied: bool | None = None  # not known before the first samples
        self._evaluate()

    def _evaluate(self) -> None:
        t = np.linspace(0.0, 1.0, _FIRST if self.cluster.m > 1 else 5)
        rounds = [(t, *self.at(t))]
        v, _, reach, _, departure, _ = rounds[0][1:]
        index = np.arange(len(t))  # of the samples by rising t in the order in which they were taken
        while True:
            gap = np.diff(t)
            near = np.maximum(reach[:-1], reach[1:])  # of two samples that farther from a meeting decides
            wide = ((gap > _NEAR * near) | self._is_change(v, departure)) & (gap > self.finest)
            if not wide.any() or len(t) >= _MOST:
                break
            more = (t[:-1] + gap / 2)[wide]
            rounds.append((more, *self.at(more)))
            index = np.append(index, len(index) + np.arange(len(more)))
            order = np.argsort(np.append(t, more), kind="stable")
            index = index[order]
            t, v, reach, departure = (
                np.concatenate([old, rounds[-1][k]])[order] for old, k in ((t, 0), (v, 1), (reach, 3), (departure, 5))
            )
        self.t, self.v, self.departure = t, v, departure
        cut = np.where(wide, gap, 0.0)  # of the intervals that the limit of samples has left
        self.cut, self.cut_at = float(cut.max()), float(t[:-1][cut.argmax()] + gap[cut.argmax()] / 2)
        # Only now, since these are large.
        self.slope, self.W, self.condition = (np.concatenate([r[k] for r in rounds])[index] for k in (2, 4, 6))

    def _is_change(self, v: np.ndarray, departure: np.ndarray) -> np.ndarray:
        """Return (s − 1,) bool, whether the number of complex pairs changes between each sample and the next."""
        if not (self.cluster.ends[0].paired or self.turned):
            return np.zeros(len(v) - 1, bool)
        pairs = (v.imag > self._parted(v, departure)[:, None]).sum(axis=1)
        return np.asarray(np.diff(pairs) != 0)

    def at(self, t: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return v, slope, the estimated distance to the next meeting, W, departure and condition at t (s,)."""
        H, dH = self.cluster.matrix(t)
        if self.turned:
            H, dH = -1j * H, -1j * dH
        v, W = np.linalg.eig(H)
        v = v.astype(complex)
        if self.turned:
            v = _real_or_paired(v)
        m = v.shape[1]
        if m == 1:
            return v, dH[:, :, 0], np.full(len(t), np.inf), W, np.zeros(len(t)), np.ones((len(t), 1))
        with np.errstate(all="ignore"):
            try:
                inverse = np.linalg.inv(W)
            except np.linalg.LinAlgError:
                inverse = np.linalg.pinv(W)
            coupling = inverse @ dH @ W
            slope = np.einsum("sii->si", coupling)
            condition = np.nan_to_num(np.linalg.norm(W, axis=1) * np.linalg.norm(inverse, axis=2), nan=np.inf)
            twins = self.twins(v, condition)
            if self.copied:
                v, slope = (_averaged(x, twins) for x in (v, slope))
            i, j = np.triu_indices(m, 1)
            # With H linear in t, ((v_i − v_j)/2)² changes by (drift/2)² + C_ij C_ji, C the coupling, times the square
            # of the distance: two equal eigenvalues may part by this alone.
            apart, drift = np.abs(v[:, i] - v[:, j]), np.abs(slope[:, i] - slope[:, j])
            drift = np.fmax(drift, 2 * np.sqrt(np.abs(coupling[:, i, j] * coupling[:, j, i])))
            reach = np.where((drift > 0) & ~twins[:, i, j], apart / (2 * drift), np.inf)
        reach = np.nan_to_num(reach.min(axis=1), nan=0.0, posinf=np.inf)
        centred = H - np.trace(H, axis1=1, axis2=2)[:, None, None] / m * np.eye(m)
        energy = (np.abs(centred) ** 2).sum(axis=(1, 2)) - (np.abs(v - v.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
        return v, slope, reach, W, np.sqrt(np.maximum(energy, 0.0)), condition

    def twins(self, v: np.ndarray, condition: np.ndarray) -> np.ndarray:
        """Return which pairs (s, m, m) of eigenvalues are those of copies, such as of equal pads on a belt.

        Of copies that nothing couples every eigenvalue has as many equals as all others, at all values: what their
        difference does is rounding, times the condition of the eigenvalue where others of the group are near. Groups of
        which that does not hold at half of the first samples, and single samples where numbers differ, have none.

        Parameters
        ----------
        v, condition : (s, m)
            Eigenvalues and their condition numbers.
        """
        known = np.clip(np.fmin(condition[:, :, None], condition[:, None, :]), 1.0, _WORST)
        apart = np.abs(v[:, :, None] - v[:, None, :])
        equal = apart <= self._equal * known
        count = equal.sum(axis=2)
        copied = (count[:, 0] > 1) & (count == count[:, :1]).all(axis=1)
        # Two modes about to meet are ill-conditioned, too; copies by themselves are not.
        copied &= (count[:, 0] < v.shape[1]) | (apart <= self._equal).all(axis=(1, 2))
        if self.copied is None:
            self.copied = bool(copied.mean() >= 0.5)
        return np.asarray(equal & copied[:, None, None] & self.copied)

    def insert(self, more: np.ndarray) -> None:
        """Add samples at further t (k,), ascending."""
        v, slope, _, W, departure, condition = self.at(more)
        order = np.argsort(np.concatenate([self.t, more]), kind="stable")
        self.t = np.concatenate([self.t, more])[order]
        added = {"v": v, "slope": slope, "W": W, "departure": departure, "condition": condition}
        for name, more_of_it in added.items():
            setattr(self, name, np.concatenate([getattr(self, name), more_of_it])[order])

    def order(self, k: int) -> np.ndarray:
        """Return (m,) int, which eigenvalue of sample k continues each one of the sample before."""
        h = self.t[k] - self.t[k - 1]
        ahead = self.v[k - 1] + h * self.slope[k - 1] / 2
        back = self.v[k] - h * self.slope[k] / 2
        return np.asarray(linear_sum_assignment(np.abs(ahead[:, None] - back[None, :]))[1])

    def made(
        self, kind: str, gains: int, k: int, there: int, i: int, limits: tuple[float, float], among: np.ndarray
    ) -> Change:  # fmt: skip
        """Return a change of eigenvalue i between samples k and k + 1.

        Parameters
        ----------
        kind, gains
            As in `Change`.
        k, i : int
        there : int
            The sample whose eigenvalue and vectors are taken, k or k + 1.
        limits : (float, float)
            As in `Change`, but in t.
        among : (c,) int
            All eigenvalues that change in the same way there, i among them.
        """
        c, t = self.cluster, self.t
        W = self.W[there]
        with np.errstate(all="ignore"):
            inverse = np.linalg.pinv(W)
        right, left = c.vectors(t[there], W[:, i], inverse[i].conj())
        v = complex(self.v[there, i])
        copies = int(np.count_nonzero(np.abs(self.v[there, among] - v) <= 2 * self.rounding[there]))
        start = bool(self.starts and (k == 0 or self._is_double(k, v.real, copies)))
        return Change(
            kind, gains, c.value(t[k]), c.value(t[k + 1]), (c.value(limits[0]), c.value(limits[1])),
            v * (1j if self.turned else 1), right, left, c.shapes, start, copies,
        )  # fmt: skip

    def _is_double(self, k: int, near: float, copies: int) -> bool:
        """Return whether the eigenvalues nearest to a number, two of each copy, are equal at all samples up to k.

        They are equal up to rounding. Two alone would be one mode of two copies, which are equal at all values.
        """
        v, low = self.v[: k + 1], self.rounding[: k + 1]
        nearest = np.take_along_axis(v, np.argsort(np.abs(v - near), axis=1)[:, : 2 * copies], axis=1)
        equal = np.abs(nearest - nearest[:, :1]) <= 2 * low[:, None]
        return bool(nearest.shape[1] == 2 * copies and equal.all())

    def blurred(self, i: np.ndarray, j: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Return how far (s, pairs) errors of H (s,) may move D = ((v_i − v_j)/2)² of pairs i, j.

        If H changes by E, given in the basis of its eigenvectors, D becomes ((v_i − v_j + E_ii − E_jj)/2)² + E_ij E_ji,
        and |E_ij| is at most the error times the root of the product of both conditions. At a double eigenvalue these
        are infinite; there the departure of the group from normality gives the bound.
        """
        half, error = np.abs(self.v[:, i] - self.v[:, j]) / 2, error[:, None]
        whole = error * (2 * half + self.departure[:, None]) + error**2
        with np.errstate(invalid="ignore", over="ignore"):
            k, l = self.condition[:, i], self.condition[:, j]
            own = error * (k + l) * half + error**2 * ((k + l) ** 2 / 4 + k * l)
        return np.fmin(whole, own)

    @property
    def rounding(self) -> np.ndarray:
        """√|D| (s,) that a double eigenvalue may have by rounding, which moves D by rounding times the departure."""
        return self._parted(self.v, self.departure)

    def _parted(self, v: np.ndarray, departure: np.ndarray) -> np.ndarray:
        size = np.abs(v).max(axis=1)
        return np.asarray(np.sqrt(self.blur**2 + _ROUNDING * size * (departure + self.blur)))


def between(g: tuple[np.ndarray, np.ndarray], rate: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return a cubic at 1/16, 2/16 … 15/16 of an interval (15, ...) from its values and slopes at both ends.

    Examples
    --------
    >>> between((np.array(0.0), np.array(16.0)), (np.array(0.0), np.array(32.0)))[[3, 7]].tolist()
    [1.0, 4.0]
    """
    s = np.linspace(0, 1, 17)[1:-1].reshape(-1, *np.ones(np.ndim(g[0]), int))
    values = g[0] * (1 + 2 * s) * (1 - s) ** 2 + g[1] * s**2 * (3 - 2 * s)
    return np.asarray(values + rate[0] * s * (1 - s) ** 2 + rate[1] * s**2 * (s - 1))


def _come_in_sets(v: np.ndarray, equal: float) -> bool:
    """Return whether every one of some eigenvalues (m,) has as many equals as all others, and at least one."""
    count = np.count_nonzero(np.abs(v[:, None] - v[None, :]) <= equal, axis=1)
    return bool(count.min() > 1 and (count == count[0]).all())


def _averaged(x: np.ndarray, equal: np.ndarray) -> np.ndarray:
    """Return what belongs to eigenvalues (s, m) as the mean over those that are `equal` (s, m, m) to each of them."""
    count = np.maximum(equal.sum(axis=2), 1)
    return np.where(equal.any(axis=2), np.einsum("sij,sj->si", equal, x) / count, x)


def diagonals(left: np.ndarray, A: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the diagonals (s, m) of the products of three stacks of matrices (s, m, m)."""
    return np.asarray(np.einsum("sij,sji->si", left @ A, right))


def _real_or_paired(v: np.ndarray) -> np.ndarray:
    """Return eigenvalues (s, m) that are exactly real or in conjugate pairs, from v (s, m) which are only nearly so.

    −iλ of a gyroscopic group has this symmetry, but the cubic between two of its matrices does not keep it exactly.
    Those above the real axis and those below it are paired so that they are nearest to the conjugates of one another:
    each of two copies of a pair may be nearest to the other one's. They are a pair if this distance is smaller than
    their distances from the real axis; others do not compete, or real ones that are far apart could part a good pair.
    """
    paired = v.real.astype(complex)
    for old, new in zip(v, paired, strict=True):
        upper, lower = np.flatnonzero(old.imag > 0), np.flatnonzero(old.imag < 0)
        distance = np.abs(old[upper][:, None] - old[lower].conj()[None, :])
        near = distance < np.minimum(old[upper].imag[:, None], -old[lower].imag[None, :])
        rows, columns = linear_sum_assignment(np.where(near, distance, 2 * np.abs(old).max()))
        kept = near[rows, columns]
        i, j = upper[rows[kept]], lower[columns[kept]]
        new[i] = (old[i] + old[j].conj()) / 2
        new[j] = new[i].conj()
    return paired
