"""Read an Abaqus input file."""

from __future__ import annotations

from ...raw import RawMesh
from ..sources import Sources
from .assembly import place_model
from .deck import parse_model


def read_abaqus(sources: Sources) -> RawMesh:
    """Read an Abaqus input file.

    A set or surface of the assembly keeps its name. One of a part has two names: "INSTANCE.NAME" for each instance, and
    plain NAME for all instances of the part together. The plain name is left out if two parts use it. Every instance is
    a volume group.

    Raises
    ------
    MeshError
        Numbers cannot be read, sets or references are wrong, or a keyword generates nodes or elements.
    """
    return place_model(parse_model(sources), sources.path.name)[0]
