"""Commands without their figures, which take most of the time of small runs; tests of the figures have them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from unittest import mock

import fe_squeal.report.difference_figure
import fe_squeal.report.export
import fe_squeal.report.mac
import fe_squeal.report.mesh_error
import fe_squeal.run.animate
import fe_squeal.run.mapped
import fe_squeal.run.run
import fe_squeal.run.scattered

_FIGURES = (
    (fe_squeal.run.run, "write_figures"), (fe_squeal.run.run, "write_preload"),
    (fe_squeal.report.export, "drawing_shapes"),
    (fe_squeal.run.scattered, "plot_probability"), (fe_squeal.run.scattered, "plot_scatter"),
    (fe_squeal.run.scattered, "plot_indices"), (fe_squeal.run.mapped, "plot_map"),
    (fe_squeal.report.mesh_error, "plot_mesh_error"), (fe_squeal.report.mesh_error, "plot_mesh_shares"),
    (fe_squeal.report.mac, "plot_mac"), (fe_squeal.report.difference_figure, "plot_differences"),
    (fe_squeal.run.animate, "_write"),
)  # fmt: skip


@contextlib.contextmanager
def without_figures() -> Iterator[None]:
    """Leave out the figures of every command that runs in this process, or in one that parts from it."""
    with contextlib.ExitStack() as stack:
        for module, name in _FIGURES:
            stack.enter_context(mock.patch.object(module, name))
        yield
