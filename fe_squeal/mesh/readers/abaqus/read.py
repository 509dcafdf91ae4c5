"""Read an Abaqus input file."""

from __future__ import annotations

from ...raw import RawMesh
from ..sources import Sources
from .assembly import place_model
from .deck import parse_model


def read_abaqus(sources: Sources) -> RawMesh:
    """Read an Abaqus input file.

    An assembly's set or surface keeps its name. A part's has its plain name (the union, if the part has several
    instances) and "INSTANCE.NAME"; where two parts use one name, only the latter. Every instance is a volume group.

    Raises
    ------
    MeshError
        Bad numbers, sets, references, or a keyword that generates nodes or elements.
    """
    return place_model(parse_model(sources), sources.path.name)[0]
