"""Choose the elements along each line of a parametric mesh so that every error meets a target.

The choice starts from what each line adds to the errors now, see `line_errors`, and from the power law by which these
errors fall as elements become shorter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from ..geometry import Block, DiscPad
from ..geometry.base import Line
from .line_errors import LineErrors

_SHARP = 8.0  # power of error/target, summed over all quantities: the larger, the more the worst quantity decides
_FINER = 4.0  # times the elements along a line, at most, from one mesh to the next
_AT_ONCE = 5.0  # times the elements of the whole mesh: the next mesh has at most so many
_BEYOND = 3.0  # times as many as that: meshes that are looked at, since elements that prove needless are taken back
_WIDER = 1.1  # times the target: how it is relaxed, again and again, until _AT_ONCE times the elements suffice

_Counts = dict[str, int]
_Finer = Callable[[Mapping[str, int]], DiscPad | Block]


def finer_geometry(errors: LineErrors, geometry: DiscPad | Block, target: float) -> DiscPad | Block:
    """Return the geometry with such elements that every error is expected below a target; with as few as possible.

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
    most, widest = _AT_ONCE * geometry.cells, float(errors.at(errors.lines).max(initial=0.0))
    if not math.isfinite(widest):
        return geometry
    paths = [(placed.with_counts, _path(errors, placed.with_counts, _BEYOND * most)) for placed in geometry.placements]
    while True:
        first = [(finer, next((c for c, error in path if error <= target), None)) for finer, path in paths]
        found = [_pruned(errors, counts, finer, target) for finer, counts in first if counts is not None]
        best = min(found, key=lambda of: of.cells, default=None)
        if best is not None and (best.cells <= most or target >= widest):
            return best
        target *= _WIDER


def _path(errors: LineErrors, finer: _Finer, cells: float) -> list[tuple[_Counts, float]]:
    """Return counts, more and more of them, each with the largest error that is expected.

    They start from the elements along every line as they are: where a line errs little, that does not tell by how much
    more it would with longer elements. In each step that line gets more elements where they reduce the errors most for
    each element added (or add least to them: parts of opposite sign may have cancelled), until no line may have more.

    Parameters
    ----------
    errors : LineErrors
    finer : callable
        Makes the geometry from counts by line.
    cells : float
        The whole mesh has at most so many elements.
    """
    counts = {key: line.elements for key, line in errors.lines.items()}
    most = {key: _rounded(line, int(_FINER * line.elements)) for key, line in errors.lines.items()}
    geometry = finer(counts)
    expected = errors.at(geometry.lines)
    path = []
    while True:
        worst = float(expected.max(initial=0.0))
        path.append((counts, worst))
        lack, steps = float(((expected / worst) ** _SHARP).sum()) if worst else 0.0, []
        for key, line in errors.lines.items():
            more = {**counts, key: _rounded(line, counts[key] + max(line.multiple, counts[key] // 12))}
            tried = finer(more)
            if worst and more[key] <= most[key] and tried.cells <= cells:
                then = errors.at(tried.lines)
                gain = (lack - float(((then / worst) ** _SHARP).sum())) / (tried.cells - geometry.cells)
                steps.append((gain, more, tried, then))
        if not steps:
            return path
        _, counts, geometry, expected = max(steps, key=lambda step: step[0])


def _pruned(errors: LineErrors, counts: _Counts, finer: _Finer, target: float) -> DiscPad | Block:
    """Return the geometry with fewer elements along those lines that no longer need them after others got more."""
    while True:
        allowed = []
        for key, line in errors.lines.items():
            fewer = {**counts, key: counts[key] - line.multiple}
            if fewer[key] >= line.elements:
                tried = finer(fewer)
                if errors.at(tried.lines).max(initial=0.0) <= target:
                    allowed.append((tried.cells, fewer))
        if not allowed:
            return finer(counts)
        counts = min(allowed, key=lambda a: a[0])[1]


def _rounded(line: Line, elements: int) -> int:
    """Return the smallest number of elements, from the given one upwards, that the line can have."""
    return max(line.least, -(-elements // line.multiple) * line.multiple)


def told(then: DiscPad | Block, now: DiscPad | Block) -> str:
    """Return what changes, in words: "disc_layers 1 to 2"."""
    changed = [
        f"{key} {line.elements} to {then.lines[key].elements}"
        for key, line in now.lines.items() if then.lines[key].elements != line.elements
    ]  # fmt: skip
    return ", ".join([*changed, *(key for key in then.placing if key not in now.placing)])
