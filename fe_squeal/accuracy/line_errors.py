"""What each line of a parametric mesh adds to errors, and what these are on meshes with other numbers of elements.

A line is a direction of a part of the geometry along which the number of elements can be chosen, such as the layers of
the disc, and on some lines their grading, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ..assembly.assembly import Assembly
from ..geometry.base import Line
from .bars import Parts, bar_of_parts
from .directions import axis_names
from .groups import element_groups, singular_groups
from .quantities import Split

# By the order of the elements: the error along a line falls like 1/(number of elements)^rate. In theory the rate is 2
# for order 1, 4 for order 2 and 6 for order 3 where modes are smooth, and less at the edges of contacts and clamps. The
# first mesh is given a rate between these; once two meshes are known, their errors tell the rate, which is kept within
# the limits. Order 3 has the rate of order 2, since what is left of its errors is mostly at such edges: with 3.5 the
# second mesh of examples/disc_pad.toml missed its target.
_RATES = {1: 1.5, 2: 2.5, 3: 2.5}
_LIMITS = {1: (0.7, 2.0), 2: (1.0, 4.0), 3: (1.0, 6.0)}
# Where stresses are singular errors fall to this power alone: 1.4 in theory at a clamped edge of steel; 1.4 and 1.7
# seen at the hub of a disc, with order 2. Where a support holds the end of a graded line, the error sits in the element
# there and falls with its length.
_HELD = 1.4
_TRIED = 31  # rates between the limits that an observed error is compared with
_TOLD = 0.3  # of the logarithm of an error, between both limits: two meshes that are more alike do not tell the rate


@dataclass(frozen=True)
class LineErrors:
    """What each line of a parametric mesh adds to the relative errors of q quantities, in p parts.

    Attributes
    ----------
    lines : mapping of str to Line
        The lines by their names, with the numbers of elements of the mesh on which the errors were found.
    rates : mapping of str to float
        By the name of the line: r where the errors fall like 1/(number of elements)^r.
    parts : (p, q) float
        Relative changes of the quantities that come from refinement.
    along : (p,) str
        The line of each part.
    layers : (p,) int
        For a line with `places`, which element along it, from 0; else 0 for all of them.
    groups : (p,) int
        Parts of one group, see `element_groups`, fall alike, so that opposite ones cancel. Others may not.
    singular : (p,) bool
        Parts of elements where stresses are singular, see `edges`.
    order : int
        Of the elements.
    """

    lines: Mapping[str, Line]
    rates: Mapping[str, float]
    parts: np.ndarray
    along: np.ndarray
    layers: np.ndarray
    groups: np.ndarray
    singular: np.ndarray
    order: int = 2

    def at(self, lines: Mapping[str, Line]) -> np.ndarray:
        """Return the relative bars (q,), to first order, that are expected with other lines of these names."""
        falls = np.ones(len(self.parts))
        for key in self.lines:
            falls[self.along == key] = self.falls(key, lines[key], self.rates[key])
        found = np.zeros((1 + int(self.groups.max(initial=0)), self.parts.shape[1]))
        np.add.at(found, self.groups, falls[:, None] * self.parts)
        singular = np.zeros(len(found), bool)
        singular[self.groups] = self.singular  # the same for all parts of a group
        return bar_of_parts(found.sum(axis=0), Parts.of(found, singular), self.order)

    def falls(self, key: str, then: Line, rate: float) -> np.ndarray:
        """Return what the parts of a line are multiplied by if it gets other elements."""
        now, own = self.lines[key], self.along == key
        layers = self.layers[own]
        slow = layer_factors(now, then, min(rate, _HELD))[layers]
        found = np.where(self.singular[own], slow, layer_factors(now, then, rate)[layers])
        if now.places:
            for end, layer in ((0, 0), (-1, now.elements - 1)):
                shorter = np.diff(then.places)[end] / np.diff(now.places)[end]
                found[self.singular[own] & (layers == layer)] = shorter**_HELD
        return found

    def largest(self, key: str) -> float:
        """Return the largest relative change of any quantity that a line adds."""
        return float(np.abs(self.parts[self.along == key].sum(axis=0)).max(initial=0.0))


def layer_factors(now: Line, then: Line, rate: float) -> np.ndarray:
    """Return what the errors are multiplied by if a line gets other elements: of its layers, or (1,) of the whole line.

    The error of a layer is spread evenly over its length, and falls everywhere as (length of the element there)^rate.

    Examples
    --------
    >>> layer_factors(Line(("disc",), "axial", 1), Line(("disc",), "axial", 2), 3.0)
    array([0.125])
    >>> now, then = (Line(("disc",), "radial", len(p) - 1, places=p) for p in ((0.0, 1.0), (0.0, 0.2, 1.0)))
    >>> layer_factors(now, then, 1.0).round(6)  # 0.2 of it falls to 0.2, 0.8 of it to 0.8
    array([0.68])
    """
    if not now.places:
        return np.array([(now.elements / then.elements) ** rate])
    old, new = np.array(now.places), np.array(then.places)
    found = np.zeros(now.elements)
    for k, (a, b) in enumerate(pairwise(old.tolist())):
        overlap = np.clip(np.minimum(b, new[1:]) - np.maximum(a, new[:-1]), 0.0, None)
        found[k] = (overlap / (b - a) * (np.diff(new) / (b - a)) ** rate).sum()
    return found


def line_errors(split: Split, assembly: Assembly, before: LineErrors | None = None) -> LineErrors:
    """Add up the parts of each change by the lines of the scene's geometry, and find the rates.

    Parameters
    ----------
    split : Split
        The changes of q quantities by refinement, by element and axis.
    assembly : Assembly
        The problem on the mesh of these elements: a parametric mesh of hexahedra.
    before : LineErrors, optional
        The same for the previous mesh of this geometry. Where a line had other elements there, the two errors give its
        rate.
    """
    geometry = assembly.scene.mesh.geometry
    assert geometry is not None
    lines, axes, order = geometry.lines, axis_names(assembly), assembly.space.order
    names, groups = element_groups(assembly)
    singular = singular_groups(names)
    group = groups.tocsc().indices.reshape(axes.shape)  # each axis of an element is in one group
    parts, along, layers, of_group = [], [], [], []
    for key, line in lines.items():
        cells = np.concatenate([np.asarray(assembly.loaded.mesh.subdomains[g]) for g in line.groups])
        element, axis = np.nonzero(axes[cells] == line.axis)
        element = cells[element]
        layer = _layers(line, assembly, element)
        label, place = np.unique(np.stack([layer, group[element, axis]]), axis=1, return_inverse=True)
        own = np.zeros((label.shape[1], len(split.names)))
        np.add.at(own, place.ravel(), split.relative[:, element, axis].T)
        parts.append(own)
        along += [key] * len(own)
        layers.append(label[0])
        of_group.append(label[1])
    found = LineErrors(
        lines, dict.fromkeys(lines, _RATES[order]), np.vstack(parts), np.array(along), np.concatenate(layers),
        (of := np.concatenate(of_group)), singular[of], order,
    )  # fmt: skip
    if before is None:
        return found
    rates = {key: _observed(before, key, line, found.largest(key)) for key, line in lines.items()}
    return replace(found, rates=rates)


def _layers(line: Line, assembly: Assembly, elements: np.ndarray) -> np.ndarray:
    """Return which element along a line each of some elements is; 0 for all where these are equally long.

    The only lines with such elements run along the radius about the z axis.
    """
    if not line.places:
        return np.zeros(len(elements), int)
    mesh = assembly.loaded.mesh
    corners = mesh.p[:2, mesh.t[:, elements]]
    radius = np.hypot(*corners)  # (8, k)
    inner, outer = radius.min(), radius.max()
    middle = (radius.min(axis=0) + radius.max(axis=0)) / 2
    return np.searchsorted(np.array(line.places[1:-1]), (middle - inner) / (outer - inner))


def _observed(before: LineErrors, key: str, line: Line, now: float) -> float:
    """Return the rate of a line: the mean of the one expected before, and of that which its errors have fallen at."""
    rate, own = before.rates[key], before.along == key
    if before.lines[key] == line or not (now > 0 and before.largest(key) > 0):
        return rate
    tried = np.linspace(*_LIMITS[before.order], _TRIED)
    expected = np.array([np.abs(before.falls(key, line, r) @ before.parts[own]).max() for r in tried])
    if not np.ptp(np.log(expected)) > _TOLD:
        return rate
    seen = float(tried[np.abs(np.log(expected / now)).argmin()])
    return float(np.sqrt(seen * rate))
