"""Read test shapes from universal files: points (data sets 2411 and 15), shapes (55) and frequency responses (58)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import SceneError
from .universal_responses import Lines, read_lines
from .universal_systems import place_nodes, read_nodes

_FAR = 0.02  # of the frequency that was asked for: a line or a shape farther off is told


@dataclass(frozen=True)
class UniversalShape:
    """A shape of a universal file, in the axes of the file.

    Attributes
    ----------
    points : (p, 3) float
        In the file's unit.
    u : (p, 3) complex
        Displacements; NaN where they were not measured.
    axes : (p, 3, 3) float
        The directions of the displacements of each point, as rows.
    hz : float or None, Hz
        Its frequency, if it is known.
    notes, warnings : tuple of str
        What was chosen, and what looks doubtful.
    """

    points: np.ndarray
    u: np.ndarray
    axes: np.ndarray
    hz: float | None
    notes: tuple[str, ...]
    warnings: tuple[str, ...]


def read_universal(path: Path, frequency_hz: float | None, reference: str | None, key: str) -> UniversalShape:
    """Read one shape of a universal file.

    Parameters
    ----------
    path : Path
    frequency_hz : float, Hz, optional
        If the file has several shapes, the one nearest to this is taken; without it the file must have a single shape.
    reference : str, optional
        Node and direction of the reference of frequency responses, such as "5z".
    key : str
        The key of the scene that names the file, for messages.

    Raises
    ------
    SceneError
        The file cannot be read, has no points or no shapes, several shapes or references and nothing to choose by,
        none near the frequency, or nodes in coordinate systems that it does not define.
    """
    where = f"{key}: {path}"
    try:
        import pyuff
    except ImportError as error:
        raise SceneError(
            f'{where} needs the package pyuff, which is not installed; pip install "fe-squeal[measured]"'
        ) from error
    try:
        sets = pyuff.UFF(str(path)).read_sets()
        sets = sets if isinstance(sets, list) else [sets]
        nodes = read_nodes(sets)
    except Exception as error:  # the reader stops at damaged files with almost any exception, or leaves parts out
        raise SceneError(f"{where} cannot be read ({error}); expected a universal file") from error
    shapes = [s for s in sets if s.get("type") == 55]
    responses = [s for s in sets if s.get("type") == 58]
    if not nodes or not (shapes or responses):
        kinds = ", ".join(sorted({str(s.get("type")) for s in sets})) or "none"
        raise SceneError(
            f"{where} has the data sets {kinds}; expected points (2411 or 15) and shapes (55) or responses (58)"
        )
    if shapes and reference is not None:
        raise SceneError(f'{where} has shapes; given reference = "{reference}", which belongs to frequency responses')
    try:
        found = _shape(shapes, frequency_hz, where) if shapes else read_lines(responses, frequency_hz, reference, where)
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise SceneError(f"{where} has shapes that are not whole ({error}); save it again") from error
    warnings = _distance(found, frequency_hz, "shape" if shapes else "line", where)
    lost = [node for node in found.rows if node not in nodes]
    if lost:
        raise SceneError(f"{where} has displacements at node {lost[0]:g}, and no point of that number")
    own = [nodes[node] for node in found.rows]
    if not np.isfinite([node.written for node in own]).all():
        raise SceneError(f"{where} has points without coordinates; expected a number for each of x, y, z")
    try:
        points, axes, notes = place_nodes(own, sets)
    except ValueError as error:
        raise SceneError(f"{where} has {error}") from error
    except (ArithmeticError, LookupError, TypeError) as error:
        raise SceneError(f"{where} has coordinate systems that are not whole ({error}); save it again") from error
    hz = None if np.isnan(found.hz) else found.hz
    return UniversalShape(points, np.array(list(found.rows.values())), axes, hz, (*found.notes, *notes), warnings)


def _distance(found: Lines, frequency_hz: float | None, what: str, where: str) -> tuple[str, ...]:
    """Return a warning if what was found is far from the frequency that was asked for; refuse one out of range."""
    if frequency_hz is None or np.isnan(found.hz):
        return ()
    low, high = found.limits
    if not (1 - _FAR) * low <= frequency_hz <= (1 + _FAR) * high:
        known = f"{what}s from {low:.5g} to {high:.5g} Hz" if low < high else f"no {what} but that at {low:.5g} Hz"
        raise SceneError(f"{where} has {known}; given frequency_hz = {frequency_hz:g}, expected one that was measured")
    far = abs(found.hz - frequency_hz) / frequency_hz
    if far <= _FAR:
        return ()
    return (f"the {what} nearest to {frequency_hz:.5g} Hz is at {found.hz:.5g} Hz, {100 * far:.2g} % away",)


def _shape(shapes: list[dict[str, Any]], frequency_hz: float | None, where: str) -> Lines:
    hz = np.array([_hertz(s) for s in shapes])
    known = hz[np.isfinite(hz)]
    if len(shapes) > 1 and not len(known):
        raise SceneError(
            f"{where} has {len(shapes)} shapes, none with its frequency; expected frequencies above 0, or one shape"
        )
    if len(shapes) > 1 and frequency_hz is None:
        listed = ", ".join(f"{f:.5g}" for f in hz)
        found = f"{where} has {len(shapes)} shapes, at {listed} Hz"
        raise SceneError(f"{found}; expected frequency_hz beside the file, to choose by")
    i = 0 if len(shapes) == 1 or frequency_hz is None else int(np.nanargmin(np.abs(hz - frequency_hz)))
    s = shapes[i]
    u = np.stack([np.asarray(s[name], dtype=complex) for name in ("r1", "r2", "r3")], axis=1)
    notes = []
    if 0 < len(known) < len(shapes):
        notes.append(f"shapes of the file without a frequency: {len(shapes) - len(known)}; they are left out")
    unused = np.flatnonzero(~u.any(axis=0))
    if 0 < len(unused) < 3:  # the format has three components in any case, "with unused values = 0"
        u[:, unused] = np.nan
        which = " and ".join("xyz"[a] for a in unused)
        notes.append(f"it is 0 along {which} at all nodes, which is taken as not measured")
    if np.imag(s.get("eig") or 0.0) < 0:  # the motion is Re u e^(λt), which is that of u* and λ*
        u = u.conj()
        notes.append("the file has it for an eigenvalue with Im λ < 0, so its conjugate is taken")
    rows = {int(node): row for node, row in zip(s["node_nums"], u, strict=True)}
    return Lines(rows, float(hz[i]), (float(known.min(initial=np.inf)), float(known.max(initial=0.0))), notes)


def _hertz(s: dict[str, Any]) -> float:
    """Return the frequency of a data set 55, Hz: as it is written for a real mode, |Im λ|/2π for a complex one.

    It is NaN where none is written, for which programs also write 0.
    """
    hz = np.nan
    if s.get("freq") is not None:
        hz = float(np.real(s["freq"]))
    elif s.get("eig") is not None:
        hz = float(abs(np.imag(s["eig"])) / (2 * np.pi))
    return hz if hz > 0 else np.nan
