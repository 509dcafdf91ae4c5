"""What every scene has, whether its matrices come from a mesh or from files."""

from __future__ import annotations

from pathlib import Path

from pydantic import PrivateAttr

from ..schema.section import Section


class BaseScene(Section):
    """A scene that knows the file it was read from."""

    _source: Path | None = PrivateAttr(default=None)

    @property
    def source(self) -> Path | None:
        """The file the scene was read from."""
        return self._source

    @property
    def folder(self) -> Path:
        """The folder that file names in the scene are relative to."""
        return self._source.parent if self._source is not None else Path()

    def names_in(self, path: str) -> list[str] | None:
        """Return the names of the entries of a list in the scene; None where they are numbered."""
        return None
