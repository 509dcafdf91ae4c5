"""Harmonics of displacements around an axis: how many nodal diameters and circles a shape has, and where it travels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from ..eigen.threads import one_openblas_thread

ORDERS = 16  # highest number of nodal diameters that is told apart; brake discs squeal with 2 to about 12
_DEGREE = 5  # degree of the polynomials along the radius: up to four nodal circles
_ACROSS = 2  # polynomials through the thickness: a mean, and a slope that bending has in the plane
_MOST_POINTS = 6000  # nodes that the harmonics are fitted to; more tell no more of so few unknowns
_DEPENDENT = 0.1  # part of a function's norm: if less lies outside the lower functions, the mesh is too coarse for it
_SEED = 20261122
_VISIBLE = 0.08  # part of the largest displacement along the radius: below it a change of sign is no nodal circle
_RADII = np.linspace(-1.0, 1.0, 81)


@dataclass(frozen=True)
class Harmonics:
    """A fit of displacements by R_p(r) Z_q(z) times cos(mθ) and sin(mθ), to nodes with weights.

    Attributes
    ----------
    nodes : (s,) int
        The nodes at which the displacements are fitted.
    frame : (s, 3, 3) float
        Rows at each node: along the radius, around the axis (right-handed), along the axis.
    weights : (s,) float, m^3
    fit : (b, s) float
        Amplitudes of the b functions from values at the nodes.
    order : (b,) int
        m of each function.
    sine : (b,) bool
    radial : (b,) int
        p of each function, with q: p + (degree + 1) q.
    gram : (g, g) float, m^3
        Weighted products of R_p Z_q with each other.
    """

    nodes: np.ndarray
    frame: np.ndarray
    weights: np.ndarray
    fit: np.ndarray
    order: np.ndarray
    sine: np.ndarray
    radial: np.ndarray
    gram: np.ndarray

    def spectrum(self, u: np.ndarray) -> np.ndarray:
        """Return the amplitudes (b, 3, ...) of displacements (s, 3, ...) at the nodes, along the rows of the frame."""
        local = np.einsum("sij,sj...->si...", self.frame, u)
        return np.asarray(np.tensordot(self.fit, local, axes=1))

    def table(self, spectrum: np.ndarray) -> np.ndarray:
        """Return the amplitudes (orders, 2, g, 3, k) by order, cosine and sine, and function of r and z.

        Parameters
        ----------
        spectrum : (b, 3, k)
            Amplitudes of k displacements.
        """
        count = int(self.order.max(initial=0)) + 1
        table = np.zeros((count, 2, len(self.gram), *spectrum.shape[1:]), dtype=spectrum.dtype)
        table[self.order, self.sine.astype(int), self.radial] = spectrum
        return table

    def energies(self, table: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what each order has of ∫|u|²: (orders, 2, k) of waves that run with θ and against it, and (orders, k).

        With u = a cos mθ + b sin mθ in a motion Re(u e^{iωt}), (a + ib)/2 is the amplitude of e^{−imθ}, which runs with
        θ, and (a − ib)/2 that of e^{imθ}, which runs against it.
        """
        a, b = table[:, 0], table[:, 1]
        waves = np.stack([(a + 1j * b) / 2, (a - 1j * b) / 2], axis=1)
        found = self._squared(waves).sum(axis=2)
        found[0] *= 2  # m = 0 has no sine: both halves are the one motion
        return found, np.asarray(found.sum(axis=1))

    def circles(self, table: np.ndarray, order: np.ndarray) -> np.ndarray:
        """Return how often the displacement of one order changes its sign along the radius: the nodal circles.

        Parameters
        ----------
        table : (orders, 2, g, 3, k) complex
            Coefficients of cosine and sine of every order, for g functions of the cross section and three components.
        order : (k,) int
            Which order it is for each of k displacements.
        """
        k = np.arange(len(order))
        a = np.moveaxis(table, -1, 0)[k, order]  # (k, 2, g, 3)
        component = np.argmax(self._squared(np.moveaxis(a, 0, -1)).sum(axis=0), axis=0)
        # The mean over the thickness, (k, 2, radii): the shapes along the radius of cosine and sine.
        along = a[k, :, : _DEGREE + 1, component] @ _legendre(_RADII, _DEGREE).T
        main = np.linalg.svd(along, full_matrices=False)[2][:, 0]
        profile = (main * np.exp(-0.5j * np.angle(np.sum(main**2, axis=1)))[:, None]).real
        found = np.zeros(len(order), dtype=int)
        for i, x in enumerate(profile):
            seen = x[np.abs(x) > _VISIBLE * np.abs(x).max()]
            found[i] = np.count_nonzero(np.diff(np.sign(seen)))
        return found

    def _squared(self, amplitudes: np.ndarray) -> np.ndarray:
        """Return ∫|u|² over the cross section (..., 3, k) of amplitudes (..., g, 3, k)."""
        weighted = np.einsum("gh,...hck->...gck", self.gram, amplitudes)
        return np.asarray(np.einsum("...gck,...gck->...ck", amplitudes.conj(), weighted).real)


@one_openblas_thread()
def fit_harmonics(points: np.ndarray, weights: np.ndarray, axis: np.ndarray, centre: np.ndarray) -> Harmonics | None:
    """Return the fit for a body around an axis; None where no node lies off the axis.

    Functions that the mesh is too coarse for, such as cos 12θ on 16 nodes around, are left out, highest orders first.

    Parameters
    ----------
    points : (n, 3) float, m
        The body's nodes.
    weights : (n,) float, m^3
        Volume that each stands for.
    axis : (3,) float
        Direction; θ turns about it by the right hand.
    centre : (3,) float, m
    """
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    nodes = np.arange(len(points))
    if len(nodes) > _MOST_POINTS:
        nodes = np.sort(np.random.default_rng(_SEED).choice(nodes, _MOST_POINTS, replace=False))
    x = points[nodes] - centre
    z = x @ axis
    flat = x - z[:, None] * axis
    r = np.linalg.norm(flat, axis=1)
    off = r > 1e-9 * max(float(r.max(initial=0.0)), np.finfo(float).tiny)
    nodes, z, flat, r = nodes[off], z[off], flat[off], r[off]
    if not len(nodes):
        return None
    w = weights[nodes]
    radial = flat / r[:, None]
    around = np.cross(axis, radial)
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    theta = np.arctan2(radial @ np.cross(axis, first), radial @ first)
    shape = np.hstack([
        _legendre(_to_unit(r), _DEGREE) * across[:, None] for across in _legendre(_to_unit(z), _ACROSS - 1).T
    ])  # (s, g)
    blocks: list[np.ndarray] = []
    order: list[int] = []
    sine: list[bool] = []
    function: list[int] = []
    for m in range(ORDERS + 1):
        for is_sine, wave in ((False, np.cos(m * theta)), (True, np.sin(m * theta))):
            if m or not is_sine:
                blocks.append(shape * wave[:, None])
                order += [m] * shape.shape[1]
                sine += [is_sine] * shape.shape[1]
                function += range(shape.shape[1])
    basis = np.hstack(blocks)
    scaled = np.sqrt(w)[:, None] * basis
    kept, Q = _independent(scaled, np.array(order))
    fit = la.solve(Q.T @ scaled[:, kept], Q.T) * np.sqrt(w)
    frame = np.stack([radial, around, np.broadcast_to(axis, radial.shape)], axis=1)
    gram = shape.T @ (w[:, None] * shape)
    return Harmonics(
        nodes, frame, w, fit, np.array(order)[kept], np.array(sine)[kept], np.array(function)[kept], gram
    )


def _legendre(x: np.ndarray, degree: int) -> np.ndarray:
    return np.asarray(np.polynomial.legendre.legvander(x, degree))


def _to_unit(x: np.ndarray) -> np.ndarray:
    """Return numbers on [−1, 1]; zeros where they are all one."""
    low, high = x.min(), x.max()
    return np.zeros_like(x) if high - low <= 1e-12 * max(abs(low), abs(high)) else 2 * (x - low) / (high - low) - 1


def _independent(A: np.ndarray, blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the columns (k,) int that are far from combinations of earlier blocks and of each other, and their span.

    The span is given by orthonormal columns (n, k).
    """
    size = np.linalg.norm(A, axis=0)
    Q, kept = np.zeros((len(A), 0)), []
    for block in np.unique(blocks):
        columns = np.flatnonzero((blocks == block) & (size > 1e-9 * size.max(initial=0.0)))
        rest = A[:, columns] / size[columns]
        for _ in range(2):  # twice, since rounding leaves something the first time
            rest = rest - Q @ (Q.T @ rest)
        q, r, order = la.qr(rest, mode="economic", pivoting=True)
        count = int(np.count_nonzero(np.abs(np.diag(r)) > _DEPENDENT))
        kept.append(np.sort(columns[order[:count]]))
        Q = np.hstack([Q, q[:, :count]])
    return np.concatenate(kept), Q
