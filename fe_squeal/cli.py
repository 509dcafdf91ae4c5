"""The command fe-squeal."""

from __future__ import annotations

import json
import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from . import __version__
from .assembly import assemble, read_mesh
from .eigen.linear_solvers import solver_name
from .errors import InputError, MeshError, NotConvergedError, SceneError, SquealError
from .geometry import write_mesh
from .materials import Material
from .mesh.measures import area_of, volume_of
from .report import print_onsets
from .run import INTERRUPTED, run_scene, sweep_scene
from .scene_file import load_scene

app = typer.Typer(
    help="Complex eigenvalue analysis of brake squeal on finite-element meshes.",
    no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None,
)  # fmt: skip
SceneFile = Annotated[Path, typer.Argument(metavar="SCENE.toml", help="The scene.", show_default=False)]
# Typer carries click with it in some versions and imports it in others; its own exception leads to the base either way.
_UsageError: Any = typer.BadParameter.__bases__[0]
Out = Annotated[Path | None, typer.Option("-o", "--out", help="Where the results go.", show_default=False)]


def _version(wanted: bool) -> None:
    if wanted:
        print(f"fe-squeal {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print it.")] = False,
) -> None:
    """Complex eigenvalue analysis of brake squeal on finite-element meshes."""


@app.command()
def run(scene: SceneFile, out: Out = None) -> int:
    """Solve for the complex modes over the sweep and write tables, figures and shapes into a folder."""
    loaded = load_scene(scene)
    return run_scene(loaded, out or Path(f"{scene.stem}_results"), _console())


@app.command()
def check(
    scene: SceneFile,
    groups: Annotated[bool, typer.Option("--groups", help="List the mesh's groups, with size and place.")] = False,
) -> int:
    """Validate scene and mesh without solving."""
    loaded = load_scene(scene)
    if groups:
        try:
            found = read_mesh(loaded)
        except MeshError as error:
            raise MeshError(f"{scene}: {error}") from error
        _console().print(_group_table(found.mesh))
    problem = assemble(loaded)
    model = problem.model
    assert model is not None
    console = _console()
    mesh = model.space.mesh
    table = Table(show_header=False, box=None, pad_edge=False)
    for name, elements in model.bodies.items():
        material = loaded.materials[loaded.bodies[name].material]
        volume, _ = volume_of(mesh, elements)
        corners = mesh.p[:, np.unique(mesh.t[:, elements])]
        extent = ", ".join(f"{a:.4g} to {b:.4g}" for a, b in zip(corners.min(axis=1), corners.max(axis=1), strict=True))
        table.add_row(
            f"body {name}",
            f"{len(elements)} elements of {loaded.bodies[name].material}, {volume:.4g} m3,"
            f" {volume * material.density:.4g} kg; x, y, z in m: {extent}",
        )
        table.add_row("", _values(material))
    for i, support in enumerate(loaded.supports):
        table.add_row(f"support {i + 1}", f"{support.surface} fixed in {', '.join(support.fixed)}")
    for spring in loaded.springs:
        table.add_row(f"spring {spring.name}", f"{spring.surface}{f' to {spring.to}' if spring.to else ''}")
    for name, c in model.contacts.items():
        table.add_row(f"contact {name}", f"{c.area:.4g} m2 closed, {100 * c.coverage:.4g} % of the surface")
    # Sizes and places by --groups.
    table.add_row("volume groups", ", ".join(mesh.subdomains or {}))
    table.add_row("surface groups", ", ".join(mesh.boundaries or {}))
    table.add_row("effects on", ", ".join(loaded.effects.names) or "none")
    table.add_row("problem class", problem.problem_class)
    table.add_row("unknowns", f"{problem.unknowns} (order {model.space.order})")
    pencil = problem.pencil()
    table.add_row("matrix entries", f"{pencil.K.nnz}")
    console.print(table)
    for text in (*model.notes, *(f"warning: {w}" for w in model.warnings)):
        console.print(text, markup=False)
    return 0


@app.command()
def mesh(
    scene: SceneFile,
    out: Annotated[Path | None, typer.Option("-o", "--out", metavar="FILE.msh", show_default=False)] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over a mesh that this command did not write.")] = False,
) -> int:
    """Mesh the scene's parametric geometry."""
    loaded = load_scene(scene)
    if loaded.mesh.geometry is None:
        raise SceneError(f"{scene}: mesh: given no geometry; expected [mesh.disc_pad] or [mesh.block], which is meshed")
    try:
        path = write_mesh(loaded.mesh.geometry, out or loaded.mesh_path or Path(f"{scene.stem}.msh"), not force)
    except MeshError as error:
        key = "disc_pad" if loaded.mesh.disc_pad is not None else "block"
        raise MeshError(f"{scene}: mesh.{key}: {error}") from error
    _console().print(f"wrote {path} ({path.stat().st_size / 1e3:.1f} kB)", markup=False)
    return 0


@app.command()
def onset(scene: SceneFile) -> int:
    """Print the critical values of the sweep parameter alone, to full precision."""
    loaded = load_scene(scene)
    if loaded.sweep is None:
        raise SceneError(f"{scene}: sweep: is missing; expected a table, written [sweep]: the interval to look in")
    console = _console()
    result = sweep_scene(loaded, assemble(loaded), console)
    print_onsets(result.onsets_dataframe(), console)
    for o in result.onsets:
        console.print(f"{o.parameter} = {o.value!r} ± {o.uncertainty:.1g}, {o.frequency_hz!r} Hz", markup=False)
    for doubt in result.doubts:
        console.print(f"warning: {doubt}", markup=False)
    return 0


@app.command()
def compare(
    case: Annotated[str, typer.Argument(help="One case; all of them by default.")] = "all",
) -> int:
    """Hold finite-element models of the lumped systems against the lumped systems themselves."""
    from .compare import compare as compare_cases

    frame = compare_cases(case)
    table = Table(box=SIMPLE_HEAD)
    for column in ("case", "quantity", "lumped", "FE", "difference"):
        table.add_column(column, justify="left" if column in ("case", "quantity") else "right", no_wrap=True)
    previous = ""
    for name, quantity, *values in frame.astype(object).itertuples(index=False, name=None):
        numbers = [f"{x:{form}}" for x, form in zip(values, (".9g", ".9g", ".1e"), strict=True)]
        table.add_row(name if name != previous else "", quantity, *("none" if n == "nan" else n for n in numbers))
        previous = name
    console = _console()
    console.print(table, soft_wrap=True)
    console.print("Of each spectrum the eigenvalue that differs most is shown; differences fall with 1/E.")
    console.print("The block sprung at its top is no mass point: its rotation takes part, and it does not flutter.")
    return 0


@app.command("lumped")
def lumped_models(
    model: Annotated[
        str, typer.Argument(metavar="MODEL", help="oscillator, minimal, two-mass, nine-dof or uncoupled-disc.")
    ],
    study: Annotated[str | None, typer.Option(help="A study by name, or all.", show_default=False)] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE ...", help="Parameters.", show_default=False)
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print eigenvalues and critical friction as JSON.")] = False,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Where a study goes.", show_default=False)] = None,
    more: Annotated[list[str] | None, typer.Argument(metavar="NAME=VALUE", help="Further parameters.")] = None,
) -> int:
    """Evaluate a lumped model, or run its studies."""
    import lumped as models

    given = [*(settings or []), *(more or [])]
    try:
        if study is not None:
            if given or as_json:
                raise SceneError("lumped: --study has its own parameters; expected neither --set nor --json beside it")
            paths = models.run_study(model, study, out or Path(f"lumped_{model}"))
            _console().print("\n".join(f"wrote {p}" for p in paths), markup=False)
            return 0
        result = models.evaluate(model, models.parse_settings(given))
    except ValueError as error:
        raise SceneError(f"lumped: {error}") from error
    if as_json:
        print(json.dumps(result))
        return 0
    console = _console()
    for re, im in result["eigenvalues"]:
        console.print(f"λ = {re:+.12g} {im:+.12g}i rad/s", markup=False)
    shown = ", ".join(f"{mu:.15g}" for mu in result["critical_mu"]) or "none"
    console.print(f"critical μ: {shown}", markup=False)
    console.print(f"studies: {', '.join(models.STUDIES[model])}", markup=False)
    return 0


@app.command()
def info() -> int:
    """Print versions, the linear solver and the number of threads."""
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
    _console().print(table)
    return 0


def main(arguments: list[str] | None = None) -> int:
    """Run the command; never shows a traceback for bad input."""
    try:
        code = app(arguments, standalone_mode=False, prog_name="fe-squeal")
    except SquealError as error:
        text = f"error: {error}" if not isinstance(error, NotConvergedError) else f"not converged: {error}"
        print(text, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except OSError as error:  # a name that the system refuses, a disk that is full
        name = f"{str(error.filename)[:200]}: " if error.filename is not None else ""
        print(f"error: {name}{error.strerror or error}", file=sys.stderr)
        return InputError.exit_code
    except _UsageError as error:  # a wrong option or argument; without any argument the help
        if sys.argv[1:] if arguments is None else arguments:
            print(f"error: {error.format_message()}; see fe-squeal --help", file=sys.stderr)
        else:
            error.show()
        return error.exit_code
    return int(code or 0)


def _values(material: Material) -> str:
    """Return a material's values with their symbols."""
    parts = []
    for value, labels in (
        (material.youngs_modulus, ("E1", "E2", "E3")),
        (material.shear_modulus, ("G23", "G13", "G12")),
        (material.poisson_ratio, ("nu23", "nu13", "nu12")),
    ):
        if isinstance(value, list):
            parts += [f"{label} = {v:g}" for label, v in zip(labels, value, strict=True)]
        elif value is not None:
            parts.append(f"{labels[0].rstrip('0123456789')} = {value:g}")
    return ", ".join([*parts, f"rho = {material.density:g}"]) + " (Pa, kg/m3)"


def _group_table(mesh: Any) -> Table:
    table = Table(box=SIMPLE_HEAD)
    for column in ("group", "kind", "count", "m3 or m2", "centre (m)", "mean normal"):
        table.add_column(column, no_wrap=True)

    def point(x: np.ndarray) -> str:
        return ", ".join(f"{v + 0.0:.4g}" for v in np.where(np.abs(x) < 1e-9, 0.0, x))

    for name, elements in (mesh.subdomains or {}).items():
        size, centre = volume_of(mesh, np.asarray(elements))
        table.add_row(name, "volume", str(len(elements)), f"{size:.4g}", point(centre), "")
    for name, facets in (mesh.boundaries or {}).items():
        size, centre, normal = area_of(mesh, np.asarray(facets))
        table.add_row(name, "surface", str(len(facets)), f"{size:.4g}", point(centre), point(normal))
    return table


def _console() -> Console:
    return Console(highlight=False, soft_wrap=True)
