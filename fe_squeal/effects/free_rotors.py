"""Rotors, of one body or of several, that nothing holds against turning or tilting but their own inertia."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.sparse.csgraph import connected_components

from ..problem.terms import Term
from .context import Context
from .rotating_bodies import nodes_of_body, turn_alike

# Against a rigid motion that is held by more than this times −K_Ω, the stiffness of the centrifugal stress is small.
_HELD = 10.0
_MOVES = 1e-2  # of the largest amplitude in a motion of length 1: a body that turns by less stays at rest
_WORDS = ("turn about the axis", "tilt")


def free_rotors(
    context: Context, terms: Sequence[Term], convection: Mapping[str, Term], parameters: Mapping[str, float]
) -> dict[tuple[str, ...], list[str]]:
    """Return which rigid motions of which bodies, each alone or several together, nothing holds.

    Bodies that share nodes, or are glued or tied to each other, turn and tilt as one; one of them alone strains. So all
    that turn alike get one turn θ_b each about the axis, or one tilt about each direction across it, with the shifts
    that let a body tilt about another point than its middle. In these coordinates K is the stiffness of everything, and
    K_Ω, negative, that of the convected inertia. A motion with K < −10 K_Ω is free. Each positive eigenvalue of −10 K_Ω
    − K is one such motion; a shift that is free has zero.

    Against the negative K_Ω the rotor has the stiffness of the centrifugal stress alone: with it one that is turned
    stays where it is, and one that is tilted wobbles with 2Ω. Without it the turned one has λ = ±Ω.

    Parameters
    ----------
    terms : sequence of Term
        Terms of all bodies, springs and contacts.
    convection : mapping of body to Term
        K_Ω of each body that rotates.
    parameters : mapping of str to float

    Returns
    -------
    dict
        The words for these motions, by the bodies that take part.
    """
    found: dict[tuple[str, ...], list[str]] = {}
    stiff = [t for t in terms if t.slot == "K" and t.symmetric and not t.imaginary]
    for names in _turning_alike(context):
        for word in _WORDS:
            rotations, shifts = _motions(context, names, word)
            V = np.concatenate([rotations, shifts]).T
            K, convected = (
                sum((V.T @ (t.matrix @ V)) * t.coefficient(parameters) for t in some)
                for some in (stiff, [convection[name] for name in names])
            )
            for group in _free(-_HELD * convected - K, len(names), len(rotations)):
                found.setdefault(tuple(names[b] for b in group), []).append(word)
    return found


def _turning_alike(context: Context) -> list[list[str]]:
    """Return the names of bodies that rotate, those that turn alike together."""
    groups: list[list[str]] = []
    for name, motion in context.motions.items():
        group = next((g for g in groups if turn_alike(context.motions[g[0]], motion)), None)
        if group is None:
            groups.append([name])
        else:
            group.append(name)
    return groups


def _motions(context: Context, names: list[str], word: str) -> tuple[np.ndarray, np.ndarray]:
    """Return rotations (k, n) and shifts (l, n), of one body after the other for each direction.

    Nodes that several bodies share move with the mean of theirs, so that all together are one rigid motion.
    """
    space, motion = context.space, context.motions[names[0]]
    axis = motion.velocity / np.linalg.norm(motion.velocity)
    first = np.cross(axis, np.eye(3)[np.argmin(axis**2)])
    first /= np.linalg.norm(first)
    across = np.stack([first, np.cross(axis, first)])
    inside = np.zeros((len(names), space.nodes))
    for b, name in enumerate(names):
        inside[b, nodes_of_body(context, name)] = 1.0
    shares = inside / np.maximum(inside.sum(axis=0), 1.0)
    x = space.coordinates - motion.centre
    x = x - axis * (x[inside.any(axis=0)] @ axis).mean()
    size = np.linalg.norm(x[inside.any(axis=0)], axis=1).max()

    def fields(all_of_them: list[np.ndarray]) -> np.ndarray:
        rows = [space.gather(share[:, None] * u) for u in all_of_them for share in shares]
        return np.array(rows).reshape(len(rows), space.unknowns)

    if word == "tilt":
        return fields([np.cross(e, x) / size for e in across]), fields([np.tile(e, (len(x), 1)) for e in across])
    return fields([np.cross(axis, x) / size]), fields([])


def _free(excess: np.ndarray, bodies: int, rotations: int) -> list[list[int]]:
    """Return the groups of bodies, by number, that turn in eigenvectors of positive eigenvalues.

    Parameters
    ----------
    excess : (k, k) float
        −10 K_Ω − K of rotations, which come first, and shifts.
    bodies, rotations : int
        Numbers of bodies and of rotations, one body after the other for each direction.
    """
    values, vectors = np.linalg.eigh(excess)
    # Rounding may leave more than zero for a shift that is free.
    turns = vectors[:rotations, (values > 0) & (np.linalg.norm(vectors[:rotations], axis=0) > _MOVES)]
    if not turns.size:
        return []
    turns = turns.reshape(-1, bodies, turns.shape[1])
    # Of motions that are equally free any combination is an eigenvector; what they span is not, nor its projector.
    together = np.einsum("dbk,dck->bc", turns, turns)
    size = np.sqrt(np.diag(together))
    moving = np.flatnonzero(size > _MOVES * size.max())
    linked = np.abs(together) > _MOVES * np.outer(size, size)
    count, label = connected_components(linked[np.ix_(moving, moving)], directed=False)
    return [moving[label == i].tolist() for i in range(count)]
