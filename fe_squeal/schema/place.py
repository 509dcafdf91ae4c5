"""Where something acts: on a surface group, or at the nodes of a set."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from .section import Section

Kind = Literal["surface", "nodes"]


class Placed(Section):
    """A table that acts on a surface group or on a node set, one of the two.

    Attributes
    ----------
    surface : str
        Surface group of the mesh.
    nodes : str
        Node set of the mesh, instead of `surface`, or nodes by their numbers in the file, with commas between: "12" or
        "PAD-1.12, PAD-1.13".
    """

    surface: str | None = None
    nodes: str | None = None

    @model_validator(mode="after")
    def _somewhere(self) -> Placed:
        given = [key for key, value in (("surface", self.surface), ("nodes", self.nodes)) if value is not None]
        if len(given) != 1:
            raise ValueError(f"given {' and '.join(given) or 'neither surface nor nodes'}; expected one of them")
        return self

    @property
    def kind(self) -> Kind:
        """Which of the two keys is given."""
        return "surface" if self.surface is not None else "nodes"

    @property
    def group(self) -> str:
        """The name of the surface group or node set."""
        name = self.surface if self.surface is not None else self.nodes
        assert name is not None
        return name
