"""Motions that no stiffness holds: their eigenvalues are known in advance, so they are split off, not searched for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from .kernel import Ground, amplitudes, find_kernel, null_columns
from .linear.factor import LinearSolver
from .multiple import ROUNDING
from .pencil import FreeMotions, Pencil

_CANCELLED = 64 * ROUNDING  # a sum this small beside the sizes of its parts is zero but for rounding
_WITHOUT_MASS = 1e-12  # times the largest mass of a motion: a motion with less counts as one without mass
# Of the sizes of the parts of WᴴC Z: where less is left, it may be damping of other motions, a little of which rounding
# has mixed into Z.
_UNCLEAR = 1e-6
_SEED = 20261129
_TOGETHER = 1e-9  # relative distance of eigenvalues that count as one
_DEFECTIVE = 1e6  # condition of eigenvectors beyond which their matrix counts as defective

States = tuple[np.ndarray, np.ndarray]  # (n, s) displacements u and (n, s) velocities λu


@dataclass(frozen=True)
class FreeModes:
    """What follows at once from the motions Z with K Z = 0.

    Every z is a mode of λ = 0. Without damping that is all. With it, z is also a mode of every ν with (νM + C)z = 0, so
    of ν = −α for mass-proportional damping, and where damping does not hold z either, λ = 0 is a double eigenvalue with
    the Jordan chain (z, 0), (u, z), K u = −C z, in the states (displacement, velocity).

    Attributes
    ----------
    lam : (m,) complex, rad/s
        k zeros for the k motions, and the ν with Im ν ≥ 0.
    right, left : (n, m)
        Their modes, not scaled; with damping the left ones of a double λ = 0 are zero, since ψᴴCφ = 0.
    states, adjoint_states : pairs of (n, s)
        Columns that span the invariant states of all these eigenvalues, of the problem and of the adjoint one.
    closed : (n, c)
        Motions of unit mass on which C acts as M times a matrix: they move by themselves, nothing else drives them.
    drift : (c, c), rad/s
        That matrix D: C Z = M Z D.
    zeros : int
        Multiplicity of λ = 0 in the states that `closed` does not account for.
    """

    lam: np.ndarray
    right: np.ndarray
    left: np.ndarray
    states: States
    adjoint_states: States
    closed: np.ndarray
    drift: np.ndarray
    zeros: int

    def beside(
        self, values: np.ndarray, right: np.ndarray, left: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return other eigenpairs with those of the free motions in front.

        Parameters
        ----------
        values : (k,) float or complex
            λ, or θ without damping. Those of the free motions are zero then, for λ and θ alike.
        right, left : (n, k) float or complex
            The vectors of these eigenpairs.
        """
        own = self.lam if np.iscomplexobj(values) else self.lam.real
        return np.append(own, values), np.hstack([self.right, right]), np.hstack([self.left, left])


def split_off(pencil: Pencil, linear_solver: LinearSolver | str = "auto") -> FreeModes | None:
    """Return the eigenpairs of the motions that nothing holds; None where there are none.

    Raises
    ------
    NotConvergedError
        If the stiffness of the other motions cannot be factorised.
    """
    known = pencil.free
    if known is None:
        Z = find_kernel(pencil, linear_solver)
        known = FreeMotions(Z)
    if not known.motions.shape[1]:
        return None
    T, massive = _by_mass(pencil, known.motions)
    T = T[:, :massive] if pencil.C is None else T
    if not T.shape[1]:
        return None
    Z = known.motions @ T
    CZ = (
        None
        if pencil.C is None
        else (_without_rounding(pencil.C, Z, pencil.units[0]) if known.damping is None else known.damping @ T)
    )
    units = pencil.units[0][:, None]
    ground = Ground(pencil.K, Z / units, pencil.symmetric, linear_solver)
    W = Z if pencil.symmetric else _orthonormal(ground.followed(adjoint=True), units)
    k, nothing = Z.shape[1], np.zeros_like(Z)
    if pencil.C is None or CZ is None:
        free = np.zeros((0, 0))
        return FreeModes(np.zeros(k, complex), Z, W, (Z, nothing), (W, 0 * W), Z, free, 0)
    d = pencil.units[0]
    sizes = abs(pencil.C) @ amplitudes(Z, d)  # of what may cancel in C Z
    rounding = _CANCELLED * float(la.norm(amplitudes(Z[:, :massive], d).T @ sizes))
    own = _closed(pencil, Z[:, :massive], CZ[:, :massive])
    closed, drift, nu, x, y = _own_decay(pencil, *own, rounding, linear_solver)
    # Motions that damping does not hold either, from both sides: each begins a Jordan chain.
    gram, whole = W.conj().T @ CZ, float(la.norm(amplitudes(W, d).T @ sizes))
    rounding = _CANCELLED * whole
    held = la.svdvals(gram)
    if ((held > rounding) & (held < _UNCLEAR * whole)).any():
        rounding += _blur(pencil, ground, Z, W)
    loose, loose_left = null_columns(gram, rounding), null_columns(gram.conj().T, rounding)
    forces, forces_left = CZ @ loose, _without_rounding(pencil.C.T, W @ loose_left, d)
    pushed, pushed_left = ground.pushed(-forces), ground.pushed(-forces_left, adjoint=True)
    states = _side_by_side([(Z, nothing), (pushed, Z @ loose), *_real_span(x, nu)])
    adjoint = _side_by_side([(W, 0 * W), (pushed_left, W @ loose_left), *_real_span(y, nu.conj())])
    upper = nu.imag >= 0
    lam = np.concatenate([np.zeros(k), nu[upper]])
    last, last_left = (_last(U, N) for U, N in ((Z, loose), (W, loose_left)))
    last_left[:, k - loose.shape[1] :] = 0.0  # rounding in ψᴴCφ, which is zero, would scale them
    right, left = np.hstack([last, x[:, upper]]), np.hstack([last_left, y[:, upper]])
    accounted = 2 * closed.shape[1] - len(nu)  # each closed motion is a mode of 0 and one of some ν, or twice of 0
    return FreeModes(lam, right, left, states, adjoint, closed, drift, k + loose.shape[1] - accounted)


def _last(U: np.ndarray, N: np.ndarray) -> np.ndarray:
    """Return columns that span what U (n, k) does, the last m of them what U N does, N (k, m) orthonormal."""
    if N.shape[1] in (0, len(N)):
        return U.copy()
    return np.hstack([U @ la.null_space(N.conj().T), U @ N])


def _blur(pencil: Pencil, ground: Ground, Z: np.ndarray, W: np.ndarray) -> float:
    """Return how far WᴴC Z may be off because Z and W are known only as far as rounding in K Z and WᴴK allows.

    Forces of the size of that rounding, with random signs, move the soft motions of K: by that much Z may be off.
    """
    assert pencil.C is not None
    rng, moved = np.random.default_rng(_SEED), []
    for U, adjoint in ((Z, False), (W, True)):
        forces = abs(pencil.K) @ np.abs(U) * rng.choice([-1.0, 1.0], U.shape)
        moved.append(ground.pushed(_CANCELLED * forces, adjoint))
    right, left = moved
    return float(la.norm(W.conj().T @ (pencil.C @ right)) + la.norm(left.conj().T @ (pencil.C @ Z)))


def _without_rounding(C: sp.csr_array, Z: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Return C Z, zero in columns where all of it is rounding of what cancels."""
    CZ = C @ Z
    sizes = np.linalg.norm(abs(C) @ amplitudes(Z, d), axis=0)
    return np.asarray(np.where(np.linalg.norm(CZ, axis=0) > _CANCELLED * sizes, CZ, 0.0))


def _by_mass(pencil: Pencil, Z: np.ndarray) -> tuple[np.ndarray, int]:
    """Return T such that Z T is of unit mass and orthogonal by it, then of no mass, and how many columns have mass."""
    R = la.qr(Z / pencil.units[0][:, None], mode="r")[0][: Z.shape[1]]
    T = la.solve_triangular(R, np.eye(Z.shape[1]))
    mass, turn = la.eigh(T.T @ (Z.T @ (pencil.M @ Z)) @ T)
    heavy = mass > _WITHOUT_MASS * max(mass.max(), 0.0)
    return T @ np.hstack([turn[:, heavy] / np.sqrt(mass[heavy]), turn[:, ~heavy]]), int(heavy.sum())


def _closed(pencil: Pencil, Z: np.ndarray, CZ: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the largest part of Z, of unit mass, with C Z = M Z D inside itself, and D."""
    assert pencil.C is not None
    MZ = pencil.M @ Z
    D = Z.T @ CZ
    moved = amplitudes(Z, pencil.units[0])
    size = float(la.norm(abs(pencil.C) @ moved) + la.norm(abs(pencil.M) @ moved) * la.norm(D))
    N = null_columns(CZ - MZ @ D, _CANCELLED * size)
    while N.shape[1]:
        leaving = D @ N - N @ (N.T @ D @ N)
        kept = null_columns(leaving, _CANCELLED * max(float(la.norm(D)), size / float(la.norm(MZ))))
        if kept.shape[1] == N.shape[1]:
            break
        N = N @ kept
    return Z @ N, N.T @ D @ N


def _own_decay(
    pencil: Pencil, Z: np.ndarray, D: np.ndarray, rounding: float, linear_solver: LinearSolver | str
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return Z, D and the ν ≠ 0 with (νM + C)x = 0 of closed motions, with their modes; nothing of a defective D.

    Parameters
    ----------
    rounding : float, rad/s
        What of D is zero.
    """
    vectors = np.zeros((len(Z), 0))
    nothing = vectors, np.zeros((0, 0)), np.zeros(0, complex), vectors, vectors
    if not len(D):
        return nothing
    assert pencil.C is not None
    symmetric = la.norm(D - D.T) <= _CANCELLED * la.norm(D)
    values, Y = la.eigh((D + D.T) / 2) if symmetric else la.eig(D)
    if np.linalg.cond(Y) > _DEFECTIVE:
        return nothing
    moves = np.abs(values) > rounding
    nu, x = -values[moves].astype(complex), Z @ Y[:, moves]
    y, done = np.zeros(x.shape, x.dtype if pencil.symmetric else complex), np.zeros(len(nu), bool)
    for i in range(len(nu)):
        if not done[i]:
            same = np.flatnonzero(~done & (np.abs(nu - nu[i]) <= _TOGETHER * np.abs(nu[i])))
            nu[same], done[same] = nu[same].mean(), True
            y[:, same] = _left_modes(pencil, complex(nu[i]), x[:, same], linear_solver)
    return Z, D, nu, x, y


def _left_modes(pencil: Pencil, nu: complex, x: np.ndarray, linear_solver: LinearSolver | str) -> np.ndarray:
    """Return the left modes of an eigenvalue whose right modes are x: x or x* where Q(ν) is Hermitian or symmetric."""
    assert pencil.C is not None
    value = nu.real if nu.imag == 0 else nu
    Q = sp.csr_array(value**2 * pencil.M + value * pencil.C + pencil.K)
    lam = np.full(x.shape[1], nu)
    for y in (x, x.conj()):
        if la.norm(Q.conj().T @ y) <= _CANCELLED * la.norm(pencil.magnitude(lam, amplitudes(y, pencil.units[0]))):
            return y
    units = pencil.units[0][:, None]
    return _orthonormal(Ground(Q, x / units, False, linear_solver).followed(adjoint=True), units)


def _orthonormal(W: np.ndarray, units: np.ndarray) -> np.ndarray:
    return np.asarray(units * la.qr(W / units, mode="economic")[0])


def _real_span(x: np.ndarray, nu: np.ndarray) -> list[States]:
    """Return the states (x, νx); of complex pairs the real and imaginary parts of one of the two."""
    real = nu.imag == 0
    plain, turning = x[:, real], x[:, nu.imag > 0]
    moving = nu[nu.imag > 0] * turning
    plain = plain.real if not plain.imag.any() else plain
    return [(plain, nu[real].real * plain), (turning.real, moving.real), (turning.imag, moving.imag)]


def _side_by_side(parts: list[States]) -> States:
    u, v = (np.hstack([p[i] for p in parts]) for i in (0, 1))
    return u, v
