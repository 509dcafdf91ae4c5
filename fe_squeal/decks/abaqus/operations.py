"""OP=NEW of *Boundary and of loads: whether it takes away what earlier steps have."""

from __future__ import annotations

from ...errors import MeshError
from ...mesh.readers.abaqus.model import Statement
from .content import Content, spoken


def takes_away(content: Content, statement: Statement) -> bool:
    """Return whether a statement takes away what stands under its keyword before its step.

    OP=NEW does not touch what its own step has: preprocessors repeat it on every block of a keyword, or write it on a
    first one without data alone (Abaqus Analysis User's Guide, Applying loads; CalculiX User's Manual, *BOUNDARY).

    Raises
    ------
    MeshError
        OP is neither MOD nor NEW, or it is NEW behind a block of the same step and keyword that has MOD.
    """
    block = statement.block
    what = f"{content.source}: {block.where}: *{spoken(block.keyword)}"
    given = block.value("OP").upper() or "MOD"
    if given not in ("MOD", "NEW"):
        raise MeshError(f"{what} has OP={block.shown(given)}; expected OP=MOD or OP=NEW")
    first = content.operations.get(block.keyword)
    content.operations.setdefault(block.keyword, given)
    if given == "NEW" and first == "MOD":
        raise MeshError(f"{what} has OP=NEW, and one before it in the same step OP=MOD; expected OP=NEW on both")
    return given == "NEW" and first is None
