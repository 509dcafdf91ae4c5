"""Freedoms of a reference that its tie releases: what acts on these alone does not act on the part."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from .draft import Value

FREEDOMS = ("x", "y", "z", "rx", "ry", "rz")
_ACTS = 1e-12  # of entries of unit vectors
_SIX = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # entries of a tensor as `inertia` has them


def drop_released(values: dict[str, Value], tied: Collection[int]) -> tuple[list[str], list[str]]:
    """Take out of a table [[rigid]] or [[averaged]] what acts on released freedoms of its reference alone.

    Parameters
    ----------
    values : dict
        The table, with `fixed` as words with spaces between; it is changed.
    tied : collection of int
        Which of the freedoms 1 to 6, along and about x, y and z, follow the nodes; the others are released.

    Returns
    -------
    dropped, both : list of str
        Keys of what was taken out in part or as a whole, and of what acts on tied and released freedoms at once, which
        the scene has no word for, and which is left.

    Examples
    --------
    >>> values = {"fixed": "x rz", "springs": [{"axis": [1.0, 0.0, 0.0], "stiffness": 2.0}], "mass": 3.0}
    >>> drop_released(values, {1, 2, 3}), values
    ((['fixed', 'springs'], []), {'fixed': 'x', 'mass': 3.0})
    """
    follows = np.array([freedom in tied for freedom in range(1, 7)])
    dropped, both = list[str](), list[str]()
    held = str(values.get("fixed", "")).split()
    left = [word for word in held if follows[FREEDOMS.index(word)]]
    _put(values, "fixed", " ".join(left), len(left) < len(held), dropped)
    if "mass" in values and not follows[:3].all():
        both.append("mass")
    _drop_inertia(values, follows[3:], dropped, both)
    springs: list[Value] = list(values.get("springs", []))  # type: ignore[arg-type]
    kept = list[Value]()
    for spring in springs:
        assert isinstance(spring, dict)
        inside = follows[3:] if "axis" in spring else follows[:3]
        way = np.array(spring.get("axis", spring.get("direction")), float)
        acts = np.abs(way) > _ACTS * np.linalg.norm(way)
        if acts[inside].any():
            kept.append(spring)
            if acts[~inside].any() and "springs" not in both:
                both.append("springs")
    _put(values, "springs", kept, len(kept) < len(springs), dropped)
    return dropped, both


def said_of_both(tied: Collection[int], node: str, both: Sequence[str]) -> str:
    """Return what is said of keys that act on tied and released freedoms of a node at once."""
    return f"ties {sorted(tied)} of {node} alone; what acts on its other freedoms as well: {' and '.join(both)}"


def said_of_dropped(tied: Collection[int], node: str, dropped: Sequence[str]) -> str:
    """Return what is said of keys that were taken out."""
    return f"ties {sorted(tied)} of {node} alone: {' and '.join(dropped)} of its other freedoms do not act on the part"


def _drop_inertia(values: dict[str, Value], follows: np.ndarray, dropped: list[str], both: list[str]) -> None:
    """Take the moments of inertia about released axes out, where none couples these with the others."""
    if "inertia" not in values:
        return
    six = [float(number) for number in values["inertia"]]  # type: ignore[union-attr, arg-type]
    if any(number and follows[i] != follows[j] for number, (i, j) in zip(six, _SIX, strict=True)):
        both.append("inertia")
        return
    left = [number if follows[i] else 0.0 for number, (i, _) in zip(six, _SIX, strict=True)]
    _put(values, "inertia", left if any(left) else [], left != six, dropped)


def _put(values: dict[str, Value], key: str, left: Value, is_less: bool, dropped: list[str]) -> None:
    """Give a key what is left of it, none where this is nothing."""
    if not is_less:
        return
    dropped.append(key)
    if left:
        values[key] = left
    else:
        del values[key]
