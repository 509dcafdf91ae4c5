"""The command info: what the program runs on."""

from __future__ import annotations

import os
import platform

from .shared import make_console

_PACKAGES = (
    "numpy", "scipy", "scikit-fem", "meshio", "gmsh", "pyvista", "pypardiso", "petsc4py", "mpi4py", "distributed",
)  # fmt: skip


def info() -> int:
    """Print versions, the linear solvers that are there and the number of threads."""
    from importlib.metadata import PackageNotFoundError, version

    from rich.table import Table

    from ..eigen.linear.choice import found_solvers, solver_name
    from ..report.terminal import print_table
    from ..version import __version__

    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_row("fe-squeal", __version__)
    table.add_row("Python", platform.python_version())
    for package in _PACKAGES:
        try:
            table.add_row(package, version(package))
        except PackageNotFoundError:
            table.add_row(package, "not installed")
    table.add_row("linear solver", f"{solver_name()} by linear_solver = \"auto\"")
    for word, is_there in found_solvers().items():
        table.add_row(f'  "{word}"', "found" if is_there else "not found")
    table.add_row("cores", str(os.cpu_count()))
    for key in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        table.add_row(key, os.environ.get(key, "not set"))
    print_table(table, make_console())
    return 0
