"""How many elements along each line of a parametric mesh an error needs, from where the error comes from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..assembly.assembly import Assembly
from ..geometry import Block, DiscPad
from ..geometry.base import Line
from .directions import axis_names
from .quantities import Split

# Error along a line falls as its number of elements to this power: 4 and 2 where modes are smooth, by the order of the
# elements; less towards edges of contacts and clamps. Two meshes tell which it is, between the limits.
_RATES = {1: 1.5, 2: 3.0}
_LIMITS = {1: (0.7, 2.0), 2: (1.0, 4.0)}
_SHARP = 8.0  # power with which the quantities that miss the target most count most
_FINER, _COARSER = 4.0, 0.5  # times the elements along a line, at most and at least, from one mesh to the next
_AT_ONCE, _WIDER = 3.5, 1.2  # times the elements in all, at most; times the target where these do not suffice
_TRIES = 4000


@dataclass(frozen=True)
class LineErrors:
    """What each line of a parametric mesh adds to the relative errors of quantities.

    Attributes
    ----------
    lines : mapping of str to Line
    errors : mapping of str to (q,) float
        Changes by refinement, relative.
    rates : mapping of str to float
        With which these fall.
    """

    lines: Mapping[str, Line]
    errors: Mapping[str, np.ndarray]
    rates: Mapping[str, float]

    def at(self, counts: Mapping[str, int]) -> np.ndarray:
        """Return the changes (q,) that other numbers of elements would leave.

        Parts of opposite sign cancel, and do so less reliably than they add up: the mean of both sums is taken.
        """
        found = np.array(
            [self.errors[key] * (line.elements / counts[key]) ** self.rates[key] for key, line in self.lines.items()]
        )
        return np.asarray((np.abs(found.sum(axis=0)) + np.abs(found).sum(axis=0)) / 2)


def line_errors(split: Split, assembly: Assembly, before: LineErrors | None = None) -> LineErrors:
    """Sum the parts of changes by the lines of the scene's geometry.

    Parameters
    ----------
    split : Split
    assembly : Assembly
        Of a parametric mesh of hexahedra.
    before : LineErrors, optional
        Of another mesh of the same geometry, which tells the rates.
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
    """Return the numbers of elements with which every error is expected below a target, for few elements in all.

    Where that takes many times as many elements as there are, rates are not known well enough to go there at once: a
    wider target is then taken, whose mesh tells them.
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
    """Return the counts of a target.

    From half as many elements on, the line is cut finer whose elements buy most, until all errors are small enough or
    no line may be cut finer.
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
    """Return counts without the elements that turned out not to be needed when other lines were cut finer."""
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
    """Return the next number of elements that the line can have."""
    return max(line.least, -(-elements // line.multiple) * line.multiple)


def told(counts: Mapping[str, int], lines: Mapping[str, Line]) -> str:
    """Return what changes, in words: "disc_layers 1 to 2"."""
    changed: Sequence[str] = [
        f"{key} {line.elements} to {counts[key]}" for key, line in lines.items() if counts[key] != line.elements
    ]
    return ", ".join(changed)
