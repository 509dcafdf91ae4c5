"""What is loaded before anything is asked for, in a fresh interpreter."""

from __future__ import annotations

import pydoc
import subprocess
import sys
from importlib.resources import files

import pytest
from scene_texts import write_scene

import fe_squeal

PLOTTING, TABLES, MESHING = ("matplotlib", "pyvista", "vtk"), ("pandas",), ("gmsh", "meshio", "h5py", "skfem")
SOLVING = ("scipy", "pypardiso", "psutil", "pydantic")


def loaded_by(code: str, *packages: str) -> list[str]:
    """Return which of some packages are loaded behind a piece of code."""
    shown = f"{code}\nimport sys\nprint(*(p for p in {packages!r} if p in sys.modules), file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", shown], capture_output=True, encoding="utf-8", timeout=60, check=True)
    return done.stderr.split()


def test_the_package_loads_neither_plotting_nor_tables_nor_meshers():
    assert loaded_by("import fe_squeal", *PLOTTING, *TABLES, *MESHING, *SOLVING) == []


def test_nothing_else_is_loose_beside_the_rooms():
    root = files("fe_squeal")
    loose = {p.name for p in root.iterdir() if p.name.endswith(".py")}
    assert loose == {"__init__.py", "__main__.py", "cli.py", "errors.py", "version.py"}


def test_help_of_the_command_loads_no_more():
    code = "from fe_squeal.cli import main\nassert main(['--help']) == 0"
    assert loaded_by(code, *PLOTTING, *TABLES, *MESHING, *SOLVING) == []


def test_a_sweep_of_plain_matrices_needs_neither_mesh_nor_tables():
    code = """
import numpy as np, scipy.sparse as sp, fe_squeal
from fe_squeal.problem.terms import Term
one = sp.csr_array(np.eye(2))
terms = (Term("m", "M", one, True), Term("k", "K", sp.csr_array(np.diag([1.0, 4.0])), True))
assert len(fe_squeal.sweep(fe_squeal.Problem(terms, {}), [0.0], modes=2).points[0].modes) == 2
"""
    assert loaded_by(code, *PLOTTING, *TABLES, *MESHING, "pydantic") == []


@pytest.mark.slow
@pytest.mark.parametrize("command", ["check", "onset"])
def test_commands_that_draw_nothing_load_no_plotting(command, tmp_path):
    scene = write_scene(tmp_path)
    code = f"from fe_squeal.cli import main\nassert main(['{command}', {str(scene)!r}]) == 0"
    assert loaded_by(code, *PLOTTING) == []


def test_names_are_there_and_sweep_is_the_function():
    """Also where rooms were imported before: one of them is called like the function."""
    import fe_squeal.sweep.result

    errors = ("InputError", "MeshError", "NotConvergedError", "OutputError", "SceneError")
    names = {*fe_squeal.__all__, *errors, "LoadedMesh", "Scene", "__version__"}
    assert all(getattr(fe_squeal, name) is not None for name in names)
    assert callable(fe_squeal.sweep) and names <= set(dir(fe_squeal))
    with pytest.raises(AttributeError, match="has no attribute 'swep'"):
        fe_squeal.swep  # noqa: B018


def test_types_are_published():
    assert files("fe_squeal").joinpath("py.typed").is_file() and files("lumped").joinpath("py.typed").is_file()


def test_help_begins_with_what_a_user_needs():
    """Every name that it documents stands on its first page, in a sentence or in the example, which doctest runs."""
    shown = pydoc.plain(pydoc.render_doc(fe_squeal))
    first, _, rest = shown.partition("PACKAGE CONTENTS")
    assert len(first.splitlines()) < 60 and len(fe_squeal.__all__) <= 14
    for name in fe_squeal.__all__:
        assert name in first and (f"class {name}(" in rest or f"    {name}(" in rest), name
    assert ">>> result = fe_squeal.sweep(" in first and "flutter at mu" in first
