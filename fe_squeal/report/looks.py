"""Describe in words what a mode looks like, from its row in modes.csv."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from fe_squeal.errors import one_line
from fe_squeal.report.branches import frequency_text

STANDING, RUNNING = 0.2, 0.8  # |travelling|: a shape up to the first is called standing, from the second on running
IN_PLANE = 0.1  # share of the motion along the axis: a shape that has less is called one in the plane
PURE = 0.9  # share of the first number of nodal diameters: from here on the second number is not mentioned


def entry(row: Mapping[Any, Any], name: str) -> Any:
    """Return an entry of a row; None if it is empty or the table has no such column, as older tables."""
    value = row.get(name)
    return None if value is None or pd.isna(value) or value == "" else value


def diameters_text(row: Mapping[Any, Any]) -> str:
    """Return the nodal diameters and circles of a mode, with shares if two numbers are mixed; "" if they are unknown.

    Examples
    --------
    >>> row = {"nodal_diameters": 5, "nodal_circles": 1, "nodal_diameters_share": 0.97}
    >>> diameters_text(row)
    '5 nodal diameters, 1 nodal circle'
    >>> diameters_text({"nodal_diameters": 3, "nodal_diameters_share": 0.6, "other_nodal_diameters": 5,
    ...                 "other_share": 0.3})
    '3 (60 %) and 5 (30 %) nodal diameters'
    """
    count, circles = entry(row, "nodal_diameters"), entry(row, "nodal_circles")
    if count is None:
        return ""
    share, other, rest = (entry(row, n) for n in ("nodal_diameters_share", "other_nodal_diameters", "other_share"))
    text = _counted(int(count), "nodal diameter")
    if share is not None and share < PURE and other is not None and rest is not None:
        text = f"{int(count)} ({100 * share:.0f} %) and {int(other)} ({100 * rest:.0f} %) nodal diameters"
    return f"{text}, {_counted(int(circles), 'nodal circle')}" if circles else text


def short_diameters(row: Mapping[Any, Any]) -> str:
    """Return the nodal diameters for a narrow column; both numbers if two are mixed."""
    count, share, other = (entry(row, n) for n in ("nodal_diameters", "nodal_diameters_share", "other_nodal_diameters"))
    if count is None:
        return "–"
    mixed = share is not None and share < PURE and other is not None
    return f"{int(count)} + {int(other)}" if mixed else f"{int(count)}"


def body_text(row: Mapping[Any, Any]) -> str:
    """Return the body with the most kinetic energy, and its share.

    Examples
    --------
    >>> body_text({"body": "disc", "body_share": 0.834})
    'disc 83 %'
    """
    body, share = entry(row, "body"), entry(row, "body_share")
    return "" if body is None or share is None else f"{one_line(str(body))} {100 * share:.0f} %"


def way_text(row: Mapping[Any, Any]) -> str:
    """Return whether the shape stands or runs around the axis, and in which direction.

    Examples
    --------
    >>> way_text({"nodal_diameters": 5, "travelling": -0.82}), way_text({"nodal_diameters": 0, "travelling": 0.0})
    ('runs against the turning', '')
    """
    count, way = entry(row, "nodal_diameters"), entry(row, "travelling")
    if not count or way is None:
        return ""
    side = "with" if way > 0 else "against"
    if abs(way) < STANDING:
        return "stands"
    return f"runs {side} the turning" if abs(way) > RUNNING else f"runs partly {side} the turning"


def plane_text(row: Mapping[Any, Any]) -> str:
    """Return the shares of the motion along the axis and in the plane across it."""
    share = entry(row, "out_of_plane")
    return "" if share is None else f"{100 * share:.0f} % along the axis, {100 * (1 - share):.0f} % in the plane"


def in_plane_text(row: Mapping[Any, Any]) -> str:
    """Return "in the plane" for a mode that hardly moves along the axis, whose nodal diameters are no bending waves."""
    share = entry(row, "out_of_plane")
    return "in the plane" if share is not None and share < IN_PLANE else ""


def look_text(row: Mapping[Any, Any]) -> str:
    """Return a few words about a mode for a label.

    Examples
    --------
    >>> look_text({"frequency_hz": 4630.0, "nodal_diameters": 5, "body": "disc", "body_share": 0.83})
    '4.63 kHz, 5 nodal diameters, disc 83 %'
    """
    texts = frequency_text(float(row["frequency_hz"])), diameters_text(row), in_plane_text(row), body_text(row)
    return ", ".join(text for text in texts if text)


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" + ("" if count == 1 else "s")
