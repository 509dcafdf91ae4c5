"""Figures that notebooks display, with any backend of Matplotlib."""

from __future__ import annotations

import io

from matplotlib.figure import Figure

from fe_squeal.process.signals import signals_deferred


class NotebookFigure(Figure):
    """A Matplotlib figure that a notebook displays as a picture."""

    @signals_deferred()
    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=100)
        return buffer.getvalue()
