"""Which onset on one mesh is which on another one: by kind, branches, value, frequency and shape."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..eigen.dense import solve_dense
from ..eigen.pencil import Modes
from ..sweep.onset import Onset
from ..sweep.scale import Scale
from ..sweep.tracking import modal_assurance
from .corrected import CorrectedModel
from .refined import Refined

# An onset on one mesh and one on the other are paired where the sum of these costs is least: the move of the value over
# _FAR times the interval, the move of the frequency over _FAR times the frequency, 1 if the branches are others, and
# the difference of the crossing speeds over their sum. From a cost of _LOST without the last on they are taken for
# different onsets.
_FAR = 0.2
_LOST = 2.0
_ALIKE = 0.5  # MAC: onsets of other branches with shapes less like each other than this are different ones
_ABOVE = 1.1  # times the frequency of an onset: modes up to this frequency are asked for its shape


def branches_of(onset: Onset) -> set[int]:
    """Return the branches that take part in an onset."""
    return {b for b in (onset.branch_a, onset.branch_b) if b is not None}


def pair_onsets(
    onsets: Sequence[Onset], found: Sequence[Onset], same: Mapping[int, int], values: np.ndarray,
    alike: Callable[[int, int], bool] = lambda i, j: True,
) -> list[int | None]:  # fmt: skip
    """Return for each onset the position in `found` of the same onset, or None.

    Parameters
    ----------
    onsets, found : sequence of Onset
        Onsets on two meshes.
    same : mapping of int to int
        The position of each mode at the first value of the sweep among those on the other mesh. Branches are numbered
        by the modes at the first value, from 1 on.
    values : (m,) float
        Values of the sweep; over decades moves of onsets are those of the parameter's logarithm.
    alike : callable of (int, int)
        Whether the shapes of two onsets, by their positions, may be the same. It is asked where branches differ, which
        may have been followed differently on the two meshes.
    """
    scale = Scale.of(values)
    width = scale.x(float(values[-1])) - scale.x(float(values[0]))

    def unlike(a: Onset, b: Onset) -> float:
        if (a.kind, a.direction) != (b.kind, b.direction):
            return np.inf
        moved = abs(scale.x(a.value) - scale.x(b.value)) / width
        moved += abs(a.frequency_hz - b.frequency_hz) / max(a.frequency_hz, 1e-300)
        return moved / _FAR + (0.0 if have_same_branches(a, b) else 1.0)

    def have_same_branches(a: Onset, b: Onset) -> bool:
        return {same[x - 1] + 1 for x in branches_of(a) if x - 1 in same} == branches_of(b)

    result: list[int | None] = [None] * len(onsets)
    pairs = [(unlike(a, b), i, j) for i, a in enumerate(onsets) for j, b in enumerate(found)]
    near = [(cost + unlike_speeds(onsets[i], found[j]), i, j) for cost, i, j in pairs if cost < _LOST]
    taken: set[int] = set()
    for _, i, j in sorted(near):
        if result[i] is not None or j in taken:
            continue
        if have_same_branches(onsets[i], found[j]) or alike(i, j):
            result[i] = j
            taken.add(j)
    return result


def unlike_speeds(a: Onset, b: Onset) -> float:
    """Return how unlike the crossing speeds of two onsets are: 0 if they are equal or not known, 1 if one is zero.

    Two modes that meet grow at a rate of their own behind that: it tells onsets apart that lie close together.

    Examples
    --------
    >>> speeds = [Onset("mu", 0.3, 2e3, "flutter", "into", c, 1, 2, 0.0) for c in (300.0, 900.0, np.nan)]
    >>> [unlike_speeds(speeds[0], b) for b in speeds]
    [0.0, 0.5, 0.0]
    """
    one, other = abs(a.crossing_speed), abs(b.crossing_speed)
    if not (np.isfinite(one) and np.isfinite(other) and one + other):
        return 0.0
    return abs(one - other) / (one + other)


class Likeness:
    """The shapes of onsets on a mesh and on the refined one.

    Parameters
    ----------
    refined : Refined
    corrected : CorrectedModel
        Of `refined`.
    onsets, found : sequence of Onset
        Those of the mesh, and those of `corrected.projected`.
    """

    def __init__(
        self, refined: Refined, corrected: CorrectedModel, onsets: Sequence[Onset], found: Sequence[Onset]
    ) -> None:
        self._refined, self._corrected, self._onsets, self._found = refined, corrected, onsets, found
        self._shapes: dict[tuple[bool, int], np.ndarray | None] = {}

    def alike(self, i: int, j: int) -> bool:
        """Return whether the shapes of an onset i and of one j on the refined mesh may be the same.

        A divergence has no mode of its frequency to compare; then they may.
        """
        one, other = self._shape(False, i), self._shape(True, j)
        if one is None or other is None:
            return True
        return bool(modal_assurance(one, other, self._corrected.projected.mass)[0, 0] >= _ALIKE)

    def _shape(self, is_refined: bool, k: int) -> np.ndarray | None:
        """Return the shape (r, 1) of an onset, in the coordinates of the corrected model."""
        if (is_refined, k) not in self._shapes:
            onset = (self._found if is_refined else self._onsets)[k]
            self._shapes[is_refined, k] = self._solved(onset, is_refined)
        return self._shapes[is_refined, k]

    def _solved(self, onset: Onset, is_refined: bool) -> np.ndarray | None:
        omega = 2 * np.pi * onset.frequency_hz
        if not omega:
            return None
        modes: Modes
        if is_refined:
            pencil = self._corrected.projected.pencil({self._refined.parameter: onset.value})
            modes = solve_dense(pencil, _ABOVE * omega)
        else:
            modes = self._refined.model.modes(onset.value)
        if not len(modes):
            return None
        nearest = int(np.argmin(np.abs(modes.lam - 1j * omega)))
        shape = modes.right[:, [nearest]]
        return shape if is_refined else self._corrected.coordinates(shape)
