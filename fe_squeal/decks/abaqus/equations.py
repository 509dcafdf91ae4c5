"""*Equation: a node of no solid that follows the mean of solid nodes along one or more axes."""

from __future__ import annotations

import numpy as np

from ...mesh.readers.abaqus.model import Statement
from .content import Content, Reference, TieData, fields
from .holding import number_of

_APART = "ties freedoms in a way that is not read: without it the structure is another one"
_EVEN = 1e-3  # decks round their weights to a few digits
_FEWEST = 3  # nodes that have a mean rotation

Term = tuple[str, int, float]  # node or set, freedom, coefficient


def read_equation(content: Content, statement: Statement) -> None:
    """Take *Equation: those that say u_reference = mean of u over nodes, in one direction, are put together by node."""
    for terms in _equations(content, statement):
        head, *rest = terms
        rows = [content.rows((name, statement.scope)) for name, _, _ in terms]
        freedoms, weights = {f for _, f, _ in terms}, [c for _, _, c in rest]
        members = [name for name, _, _ in rest]
        is_mean = (
            len(freedoms) == 1 and freedoms <= {1, 2, 3} and len(members) >= _FEWEST
            and all(len(r) == 1 for r in rows) and not content.on_solids[rows[0]].any()
            and all(content.on_solids[r].all() for r in rows[1:])
            and max(abs(w * len(weights) + head[2]) for w in weights) <= _EVEN * abs(head[2])
        )  # fmt: skip
        if not is_mean:
            content.draft.find("*Equation", content.where(statement), _APART, "missing")
            continue
        reference: Reference = (head[0], statement.scope)
        same = [t for t in content.ties_to_points if t.reference == reference and t.freedoms is not None]
        wanted = [(name, statement.scope) for name in sorted(members)]
        if same and sorted(same[0].members) == wanted and same[0].freedoms is not None:
            same[0].freedoms |= freedoms
        else:
            place = content.raw.points[np.concatenate(rows[1:])].mean(axis=0)
            where = content.where(statement)
            name = f"mean_{head[0]}"
            content.ties_to_points.append(TieData(name, where, False, reference, wanted, [], freedoms, place))


def _equations(content: Content, statement: Statement) -> list[list[Term]]:
    """Return the terms of each equation: their number on a line, then node, freedom and coefficient, four to a line."""
    found: list[list[Term]] = []
    left = 0
    for line in statement.block.lines:
        parts = [part for part in fields(line) if part]
        if not left:
            left = int(number_of(content, statement, parts[0])) if parts else 0
            found += [[]] if left > 0 else []
            continue
        for i in range(0, len(parts) - 2, 3):
            freedom, coefficient = (number_of(content, statement, text) for text in parts[i + 1 : i + 3])
            found[-1].append((parts[i], int(freedom), coefficient))
            left -= 1
    return [terms for terms in found if terms]
