"""Warn of bodies that nothing holds, and say how they can move, before anything is solved."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from ..assembly.discretisation import Discretisation, discretisation_of
from ..fem.rigid_motions import firm_parts
from ..problem.problem import Problem

_RANK = 1e-6  # rounding of motions whose size is about one
_NAMES = ("moves along x", "moves along y", "moves along z", "turns about x", "turns about y", "turns about z")


def free_motion_warnings(problem: Problem) -> list[str]:
    """Return sentences on which parts of the mesh nothing holds, and how they can move; none if everything is held.

    Each such motion is an eigenvector of K for the eigenvalue 0, and a mode with the frequency 0.
    """
    discretisation = discretisation_of(problem)
    Z = problem.free_motions().motions
    if not Z.shape[1]:
        return []
    moving = "" if discretisation is None else f": {'; '.join(_moving_parts(discretisation, Z))}"
    count = "1 motion" if Z.shape[1] == 1 else f"{Z.shape[1]} motions"
    text = f"nothing holds {count}, modes of frequency 0{moving}"
    if discretisation is not None:
        text += "; expected [[supports]] or [[springs]] there, unless bodies are meant to be free"
    return [text]


def _moving_parts(discretisation: Discretisation, Z: np.ndarray) -> list[str]:
    """Return words for each part of the mesh, connected by facets, that can move, from the k free motions Z (n, k)."""
    space = discretisation.space
    nodal = np.stack([space.expand(z) for z in Z.T], axis=2)  # (nodes, 3, k)
    node, part, of_element = firm_parts(space)
    owners: dict[int, list[str]] = {}
    for name, elements in discretisation.bodies.items():
        for i in np.unique(of_element[elements]).tolist():
            owners.setdefault(i, []).append(name)
    found = []
    for i, names in sorted(owners.items()):
        nodes = node[part == i]
        motions = _describe(rigid_part(space.coordinates[nodes], nodal[nodes]))
        if motions:
            label = f"body {names[0]}" if len(names) == 1 else f"bodies {' and '.join(names)}, which share nodes,"
            if sum(other == names for other in owners.values()) > 1:
                at = ", ".join(f"{c:.3g}" for c in space.coordinates[nodes].mean(axis=0))
                label += f" (its part around {at} m)"
            found.append(f"{label} {', '.join(motions)}")
    return found


def rigid_part(x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the rigid motions (6, k) nearest to some displacements: along x, y, z, and about axes through the centre.

    Rotations are multiplied by the radius of the body, so that all six numbers are displacements.

    Parameters
    ----------
    x : (p, 3) float, m
        Points of the body.
    u : (p, 3, k) float
        Displacements of these points in k motions.

    Examples
    --------
    >>> x = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, -1.0, 0]])
    >>> turned = np.cross([0.0, 0.0, 1.0], x)
    >>> rigid_part(x, turned[:, :, None]).ravel().round(6).tolist()
    [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    """
    x = x - x.mean(axis=0)
    x = x / np.sqrt(np.mean(np.sum(x**2, axis=1)))
    columns = [np.tile(e, (len(x), 1)) for e in np.eye(3)] + [np.cross(e, x) for e in np.eye(3)]
    R = np.stack([c.ravel() for c in columns], axis=1)
    return np.asarray(la.lstsq(R, u.reshape(-1, u.shape[2]))[0])


def _describe(T: np.ndarray) -> list[str]:
    """Return words for the span of rigid motions T (6, k).

    The motions along and about the axes that the span contains come first, then the number of all others.
    """
    U, s, _ = la.svd(T, full_matrices=False)
    Q = U[:, s > _RANK * max(1.0, s[0] if len(s) else 0.0)]
    words, left = [], Q
    for i, name in enumerate(_NAMES):
        e = np.eye(6)[i]
        if la.norm(e - Q @ (Q.T @ e)) < np.sqrt(_RANK):
            words.append(name)
            left = left - np.outer(e, e @ left)
    U, s, _ = la.svd(left, full_matrices=False) if left.size else (left, np.zeros(0), None)
    for v in U[:, s > np.sqrt(_RANK)].T:
        turn, shift = v[3:], v[:3]
        axis, word = (turn, "turns about") if la.norm(turn) > np.sqrt(_RANK) else (shift, "moves along")
        a = axis / la.norm(axis)
        a = a * np.sign(a[np.argmax(np.abs(a))])
        words.append(f"{word} ({', '.join(f'{c + 0.0:.3g}' for c in np.where(np.abs(a) < 1e-6, 0, a))})")
    return words
