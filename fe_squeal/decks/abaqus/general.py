"""General contact: pairs that *Contact Inclusions names, with the interactions of *Contact Property Assignment."""

from __future__ import annotations

from dataclasses import replace

from ...mesh.readers.abaqus.model import Statement
from .content import Content, Pair, fields


def read_inclusions(content: Content, statement: Statement) -> None:
    """Take *Contact Inclusions: a pair on each data line that names two surfaces; the others are asked for."""
    where = content.where(statement)
    rows = [fields(line) for line in statement.block.lines]
    pairs = [row[:2] for row in rows if len(row) > 1 and row[0] and row[1] and row[0].upper() != row[1].upper()]
    content.general += [Pair(first, second, "", "", where) for first, second in pairs]
    if len(pairs) < max(len(rows), 1):
        text = (
            "surfaces of general contact that touch are not searched for: give a [[contacts]] for each pair, with"
            " surface, counterface, normal_stiffness and sliding"
        )
        content.draft.find("*Contact Inclusions", where, text, "missing")


def read_exclusions(content: Content, statement: Statement) -> None:
    """Keep *Contact Exclusions: the pairs of its data lines are none, wherever *Contact Inclusions names them.

    A first surface that is left out stands for all surfaces, a second one for the first (Abaqus Keywords Guide).
    """
    for line in statement.block.lines:
        first, second = [*fields(line), ""][:2]
        if second and first.upper() != second.upper():
            content.excluded.append((first, second, content.where(statement)))


def read_assignment(content: Content, statement: Statement) -> None:
    """Take *Contact Property Assignment: of several that fit a pair the last one counts.

    A first surface that is left out stands for all surfaces, a second one for the first (Abaqus Keywords Guide).
    """
    for line in statement.block.lines:
        first, second, name = (fields(line) + [""] * 3)[:3]
        if first and second.upper() in ("", first.upper()):
            text = f"{name} of {first} with itself is passed over: contact of a surface with itself is not simulated"
            content.draft.find("*Contact Property Assignment", content.where(statement), text)
            continue
        wanted = {part.upper() for part in (first, second) if part}
        for i, pair in enumerate(content.general):
            if name and wanted <= {pair.first.upper(), pair.second.upper()}:
                content.general[i] = replace(pair, interaction=name)


def add_general_pairs(content: Content) -> None:
    """Add the pairs of general contact to the contact pairs; for a pair without an interaction the user is asked."""
    named = [{pair.first.upper(), pair.second.upper()} for pair in content.general]
    excluded = [{part.upper() for part in pair if part} for *pair, _ in content.excluded]
    for (first, second, where), both in zip(content.excluded, excluded, strict=True):
        if named and not any(both <= pair for pair in named):
            other = first or "any other"
            text = f"{other} and {second} are no pair that is named: where they are part of one, it is in contact here"
            content.draft.find("*Contact Exclusions", where, text)
    for pair, both in zip(content.general, named, strict=True):
        if any(parts <= both for parts in excluded):
            continue
        if pair.interaction:
            content.pairs.append(pair)
        else:
            text = f"{pair.first} on {pair.second} has no *Contact Property Assignment: give friction in [[contacts]]"
            content.draft.find("*Contact Inclusions", pair.where, text, "missing")
