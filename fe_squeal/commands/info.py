"""The command info: what the program runs on."""

from __future__ import annotations

import os
import platform

from .shared import make_console


def info() -> int:
    """Print versions, the linear solver and the number of threads."""
    from importlib.metadata import PackageNotFoundError, version

    from rich.table import Table

    from ..eigen.linear.choice import solver_name
    from ..report.terminal import print_table
    from ..version import __version__

    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_row("fe-squeal", __version__)
    table.add_row("Python", platform.python_version())
    for package in ("numpy", "scipy", "scikit-fem", "meshio", "gmsh", "pyvista", "pypardiso"):
        try:
            table.add_row(package, version(package))
        except PackageNotFoundError:
            table.add_row(package, "not installed")
    table.add_row("linear solver", solver_name())
    table.add_row("cores", str(os.cpu_count()))
    for key in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        table.add_row(key, os.environ.get(key, "not set"))
    print_table(table, make_console())
    return 0
