"""Read test shapes from universal files: points (data sets 2411 and 15), shapes (55) and frequency responses (58)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..errors import SceneError


def read_universal(path: Path, frequency_hz: float | None, key: str) -> tuple[np.ndarray, np.ndarray]:
    """Return points (p, 3), in the file's unit, and displacements (p, 3) complex, NaN where they were not measured.

    Parameters
    ----------
    path : Path
    frequency_hz : float, Hz, optional
        If the file has several shapes, the one nearest to this is taken; without it the file must have a single shape.
    key : str
        The key of the scene that names the file, for messages.

    Raises
    ------
    SceneError
        The file cannot be read, has no points or no shapes, or has several shapes and no frequency is given.
    """
    try:
        import pyuff
    except ImportError as error:
        raise SceneError(
            f'{key}: {path} needs the package pyuff, which is not installed; pip install "fe-squeal[measured]"'
        ) from error
    try:
        sets = pyuff.UFF(str(path)).read_sets()
        sets = sets if isinstance(sets, list) else [sets]
        places = _places(sets)
    except Exception as error:  # the reader stops at damaged files with almost any exception, or leaves parts out
        raise SceneError(f"{key}: {path} cannot be read ({error}); expected a universal file") from error
    shapes = [s for s in sets if s.get("type") == 55]
    responses = [s for s in sets if s.get("type") == 58]
    if not places or not (shapes or responses):
        kinds = ", ".join(sorted({str(s.get("type")) for s in sets})) or "none"
        raise SceneError(
            f"{key}: {path} has the data sets {kinds}; expected points (2411 or 15) and shapes (55) or responses (58)"
        )
    try:
        found = _shape(shapes, frequency_hz, path, key) if shapes else _lines(responses, frequency_hz, path, key)
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise SceneError(f"{key}: {path} has shapes that are not whole ({error}); save it again") from error
    lost = [node for node in found if node not in places]
    if lost:
        raise SceneError(f"{key}: {path} has displacements at node {lost[0]:g}, and no point of that number")
    points = np.array([places[node] for node in found])
    if not np.isfinite(points).all():
        raise SceneError(f"{key}: {path} has points without coordinates; expected a number for each of x, y, z")
    return points, np.array(list(found.values()))


def _places(sets: list[dict[str, Any]]) -> dict[int, np.ndarray]:
    return {
        int(node): np.array([x, y, z], dtype=float)
        for s in sets
        if s.get("type") in (15, 2411)
        for node, x, y, z in zip(s["node_nums"], s["x"], s["y"], s["z"], strict=True)
    }


def _shape(shapes: list[dict[str, Any]], frequency_hz: float | None, path: Path, key: str) -> dict[int, np.ndarray]:
    hz = [_hertz(s) for s in shapes]
    if len(shapes) > 1 and (frequency_hz is None or np.isnan(hz).any()):
        known = ", ".join(f"{f:.5g}" for f in hz)
        found = f"{path} has {len(shapes)} shapes, at {known} Hz"
        raise SceneError(f"{key}: {found}; expected frequency_hz beside the file, to choose by")
    s = shapes[0 if len(shapes) == 1 or frequency_hz is None else int(np.argmin(np.abs(np.array(hz) - frequency_hz)))]
    u = np.stack([np.asarray(s[name], dtype=complex) for name in ("r1", "r2", "r3")], axis=1)
    return {int(node): row for node, row in zip(s["node_nums"], u, strict=True)}


def _hertz(s: dict[str, Any]) -> float:
    """Return the frequency of a data set 55, Hz: as it is written for a real mode, |Im λ|/2π for a complex one."""
    if s.get("freq") is not None:
        return float(np.real(s["freq"]))
    return float(abs(np.imag(s["eig"])) / (2 * np.pi)) if s.get("eig") is not None else np.nan


def _lines(responses: list[dict[str, Any]], frequency_hz: float | None, path: Path, key: str) -> dict[int, np.ndarray]:
    if frequency_hz is None:
        raise SceneError(f"{key}: {path} has frequency responses; expected frequency_hz beside the file, to read at")
    found: dict[int, np.ndarray] = {}
    for s in responses:
        axis, sign = abs(int(s["rsp_dir"])) - 1, np.sign(int(s["rsp_dir"]))
        if axis not in (0, 1, 2):  # rotations and scalars are not used
            continue
        line = int(np.argmin(np.abs(np.asarray(s["x"], dtype=float) - frequency_hz)))
        row = found.setdefault(int(s["rsp_node"]), np.full(3, np.nan + 0j))
        row[axis] = sign * complex(np.asarray(s["data"])[line])
    if not found:
        raise SceneError(f"{key}: {path} has no response along x, y or z")
    return found
