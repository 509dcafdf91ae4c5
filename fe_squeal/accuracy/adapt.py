"""Choose the number of elements along each line of a parametric mesh so that every error meets a target.

A line is a direction of a part of the geometry along which the number of elements can be chosen, such as the layers of
the disc. The choice starts from what each line adds to the errors now (`line_errors`) and from the power law by which
these errors fall as the line gets more elements.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..assembly.assembly import Assembly
from ..geometry import Block, DiscPad
from ..geometry.base import Line
from .directions import axis_names
from .quantities import Split

# By the order of the elements: the error along a line falls like 1/(number of elements)^rate. In theory the rate is 2
# for order 1 and 4 for order 2 where modes are smooth, and less at the edges of contacts and clamps. The first mesh is
# given the rate between these; once two meshes are known, their errors tell the rate, which is kept within the limits.
_RATES = {1: 1.5, 2: 3.0}
_LIMITS = {1: (0.7, 2.0), 2: (1.0, 4.0)}
_SHARP = 8.0  # power of error/target, summed over all quantities: the larger, the more the worst quantity decides
_FINER, _COARSER = 4.0, 0.5  # times the elements along a line, at most and at least, from one mesh to the next
_AT_ONCE = 3.5  # times the elements of the whole mesh: the next mesh has at most so many
_WIDER = 1.2  # times the target: how it is relaxed, again and again, until _AT_ONCE times the elements suffice
_TRIES = 4000  # steps of the search for counts, at most


@dataclass(frozen=True)
class LineErrors:
    """What each line of a parametric mesh adds to the relative errors of q quantities.

    Attributes
    ----------
    lines : mapping of str to Line
        The lines by their names, with the numbers of elements of the mesh on which the errors were found.
    errors : mapping of str to (q,) float
        By the name of the line: the relative change of each quantity that comes from refinement along this line.
    rates : mapping of str to float
        By the name of the line: r where the errors fall like 1/(number of elements)^r.
    """

    lines: Mapping[str, Line]
    errors: Mapping[str, np.ndarray]
    rates: Mapping[str, float]

    def at(self, counts: Mapping[str, int]) -> np.ndarray:
        """Return the relative errors (q,) that are expected for other numbers of elements, by the names of the lines.

        Errors of opposite sign from different lines cancel now, but may not on the next mesh. So the mean of two sums
        is returned: that with the signs, and that of the absolute values.
        """
        found = np.array(
            [self.errors[key] * (line.elements / counts[key]) ** self.rates[key] for key, line in self.lines.items()]
        )
        return np.asarray((np.abs(found.sum(axis=0)) + np.abs(found).sum(axis=0)) / 2)


def line_errors(split: Split, assembly: Assembly, before: LineErrors | None = None) -> LineErrors:
    """Add up the parts of each change by the lines of the scene's geometry, and find the rates.

    Parameters
    ----------
    split : Split
        The changes of q quantities by refinement, by element and axis.
    assembly : Assembly
        The problem on the mesh of these elements: a parametric mesh of hexahedra.
    before : LineErrors, optional
        The same for the previous mesh of this geometry. Where a line had another number of elements there, the two
        errors give its rate.
    """
    geometry = assembly.scene.mesh.geometry
    assert geometry is not None
    axes = axis_names(assembly)
    order = assembly.space.order
    errors: dict[str, np.ndarray] = {}
    for key, line in geometry.lines.items():
        cells = np.concatenate([np.asarray(assembly.loaded.mesh.subdomains[g]) for g in line.groups])
        along = axes[cells] == line.axis
        errors[key] = np.einsum("qea,ea->q", split.relative[:, cells], along)
    rates = {}
    for key, line in geometry.lines.items():
        rates[key] = _RATES[order]
        if before is None:
            continue
        rates[key] = before.rates[key]
        grown = line.elements / before.lines[key].elements
        worst, was = (np.abs(e[key]).max(initial=0.0) for e in (errors, before.errors))
        if abs(np.log(grown)) > 0.1 and worst > 0 and was > 0:
            seen = float(np.clip(-np.log(worst / was) / np.log(grown), *_LIMITS[order]))
            rates[key] = float(np.sqrt(seen * before.rates[key]))
    return LineErrors(geometry.lines, errors, rates)


def counts_for(errors: LineErrors, geometry: DiscPad | Block, target: float) -> dict[str, int]:
    """Return numbers of elements, by line, with which every error is expected below a target; as few as possible.

    If that takes more than `_AT_ONCE` times the present elements, the rates are not known well enough to foresee such a
    mesh. The target is then relaxed until fewer elements do, and the errors on that mesh give better rates.

    Parameters
    ----------
    errors : LineErrors
        Errors on the present mesh.
    geometry : DiscPad or Block
        The geometry that the present mesh was made from.
    target : float
        For the relative error of every quantity.
    """
    cells = geometry.cells
    while True:
        counts = _fewest(errors, lambda of: geometry.with_counts(of).cells, target)
        if geometry.with_counts(counts).cells <= _AT_ONCE * cells or target >= errors.at(_own(errors)).max(initial=0.0):
            return counts
        target *= _WIDER


def _own(errors: LineErrors) -> dict[str, int]:
    return {key: line.elements for key, line in errors.lines.items()}


def _fewest(errors: LineErrors, size: Callable[[Mapping[str, int]], int], target: float) -> dict[str, int]:
    """Return the counts that meet a target.

    It starts from half as many elements along every line as now. In each step that line gets more elements where they
    reduce the errors most for each element added, until all errors meet the target or no line may have more.

    Parameters
    ----------
    errors : LineErrors
    size : callable
        Gives the number of elements of the whole mesh for counts by line.
    target : float
    """
    lines = errors.lines
    counts = {key: _rounded(line, int(np.ceil(_COARSER * line.elements))) for key, line in lines.items()}
    most = {key: _rounded(line, int(_FINER * line.elements)) for key, line in lines.items()}

    def lack(of: Mapping[str, int]) -> float:
        return float(((errors.at(of) / target) ** _SHARP).sum())

    now = size(counts)
    for _ in range(_TRIES):
        if errors.at(counts).max(initial=0.0) <= target:
            break
        best, choice = 0.0, None
        for key, line in lines.items():
            finer = {**counts, key: _rounded(line, counts[key] + max(line.multiple, counts[key] // 12))}
            if finer[key] > most[key]:
                continue
            cells = size(finer)
            gain = (lack(counts) - lack(finer)) / (cells - now)
            if gain > best:
                best, choice, then = gain, finer, cells
        if choice is None:
            break
        counts, now = choice, then
    return _pruned(errors, counts, size, target)


def _pruned(
    errors: LineErrors, counts: dict[str, int], size: Callable[[Mapping[str, int]], int], target: float
) -> dict[str, int]:
    """Return counts with fewer elements along those lines that no longer need them after others got more."""
    if errors.at(counts).max(initial=0.0) > target:
        return counts
    while True:
        fewer = [{**counts, key: counts[key] - line.multiple} for key, line in errors.lines.items()]
        allowed = [
            c for c, line, key in zip(fewer, errors.lines.values(), errors.lines, strict=True)
            if c[key] >= max(line.least, _COARSER * line.elements) and errors.at(c).max(initial=0.0) <= target
        ]  # fmt: skip
        if not allowed:
            return counts
        counts = min(allowed, key=size)


def _rounded(line: Line, elements: int) -> int:
    """Return the smallest number of elements, from the given one upwards, that the line can have."""
    return max(line.least, -(-elements // line.multiple) * line.multiple)


def told(counts: Mapping[str, int], lines: Mapping[str, Line]) -> str:
    """Return what changes, in words: "disc_layers 1 to 2"."""
    changed: Sequence[str] = [
        f"{key} {line.elements} to {counts[key]}" for key, line in lines.items() if counts[key] != line.elements
    ]
    return ", ".join(changed)
