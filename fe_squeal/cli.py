"""The command fe-squeal.

Each command imports what it needs when it is called, so that `fe-squeal --help` is there at once and `check` loads no
Matplotlib. All commands stand in one file: their options, messages and exit codes are read side by side.
"""

from __future__ import annotations

import json
import os
import platform
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .errors import (
    INTERRUPTED,
    InputError,
    MeshError,
    NotConvergedError,
    OutputError,
    SceneError,
    SquealError,
    one_line,
)
from .isolation import import_matplotlib
from .streams import lasting_streams

if TYPE_CHECKING:
    from rich.console import Console

    from .scene import MatrixScene, Scene

app = typer.Typer(
    help="Complex eigenvalue analysis of brake squeal on finite-element meshes.",
    no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None,
)  # fmt: skip
SceneFile = Annotated[Path, typer.Argument(metavar="SCENE.toml", help="The scene.", show_default=False)]
SceneOrDeck = Annotated[
    Path, typer.Argument(metavar="SCENE.toml|DECK", help="The scene, or a deck that has all of it.", show_default=False)
]
# Some versions of Typer carry click inside them, others import it. Either way click's base of usage errors is among the
# bases of Typer's own exception.
_UsageError: Any = typer.BadParameter.__bases__[0]
Out = Annotated[Path | None, typer.Option("-o", "--out", help="Where the results go.", show_default=False)]


def _version(wanted: bool) -> None:
    if wanted:
        from .version import __version__

        print(f"fe-squeal {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print it.")] = False,
) -> None:
    """Complex eigenvalue analysis of brake squeal on finite-element meshes."""


@app.command()
def run(
    scene: SceneOrDeck,
    out: Out = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from what an interrupted run left there.")] = False,
    estimate: Annotated[bool, typer.Option("--estimate", help="Estimate the error of the mesh, too.")] = False,
    accuracy: Annotated[
        float | None,
        typer.Option(metavar="TARGET", help="Choose the mesh for this relative error.", show_default=False),
    ] = None,
) -> int:
    """Solve for the complex modes over the sweep and write tables, figures and shapes into a folder."""
    loaded = _load(scene)
    folder = out or Path(f"{scene.stem}_results")
    if accuracy is not None:
        if resume:
            raise SceneError("--accuracy: given with --resume; expected one of them")
        from .run.accuracy import run_to_accuracy

        return run_to_accuracy(loaded, folder, _console(), accuracy)
    from .run.run import run_scene

    return run_scene(loaded, folder, _console(), resume, estimate)


@app.command()
def check(
    scene: Annotated[
        Path, typer.Argument(metavar="SCENE.toml|DECK", help="The scene, a deck, or a mesh.", show_default=False)
    ],
    groups: Annotated[
        bool, typer.Option("--groups", help="List the groups of its mesh, or of a mesh file, with size and place.")
    ] = False,
) -> int:
    """Validate scene and mesh without solving."""
    from .assembly.assembly import assemble
    from .assembly.discretisation import discretisation_of
    from .assembly.forces import balance_warnings, force_balance
    from .report.terminal import print_table
    from .report.warnings import told_once
    from .run.check import describe
    from .run.forces import balance_table
    from .run.free import free_motion_warnings
    from .run.groups import groups_of_file, groups_of_scene
    from .scene import Scene

    console, bare = _console(), groups and scene.suffix.lower() != ".toml"
    loaded = None if bare else _load(scene)
    if groups and (loaded is None or isinstance(loaded, Scene)):
        table, fault = groups_of_file(scene) if loaded is None else groups_of_scene(loaded)
        print_table(table, console)
        if fault is not None:
            raise fault
    if loaded is None:
        return 0
    problem = assemble(loaded)
    print_table(describe(loaded, problem), console)
    found = discretisation_of(problem)
    notes, warnings = ((), ()) if found is None else (found.notes, found.warnings)
    parts = force_balance(problem)
    balance = balance_table(parts)
    if balance is not None:
        print_table(balance, console)
    warnings = (*warnings, *balance_warnings(parts), *free_motion_warnings(problem))
    for text in (*notes, *(f"warning: {w}" for w in told_once(warnings))):
        console.print(text, markup=False)
    return 0


@app.command()
def mesh(
    scene: SceneFile,
    out: Annotated[Path | None, typer.Option("-o", "--out", metavar="FILE.msh", show_default=False)] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over a mesh that this command did not write.")] = False,
) -> int:
    """Mesh the scene's parametric geometry."""
    from .geometry import write_mesh
    from .scene import MatrixScene, Scene
    from .scene.file import load_scene

    loaded = load_scene(scene)
    if not isinstance(loaded, Scene) or loaded.mesh.geometry is None:
        if isinstance(loaded, MatrixScene):
            raise SceneError(f"{scene}: terms: a scene of matrices has no mesh; expected one with [mesh]")
        raise SceneError(f"{scene}: mesh: given no geometry; expected [mesh.disc_pad] or [mesh.block], which is meshed")
    try:
        path = write_mesh(loaded.mesh.geometry, out or loaded.mesh_path or Path(f"{scene.stem}.msh"), not force)
    except MeshError as error:
        key = "disc_pad" if loaded.mesh.disc_pad is not None else "block"
        raise MeshError(f"{scene}: mesh.{key}: {error}") from error
    _console().print(f"wrote {path} ({path.stat().st_size / 1e3:.1f} kB)", markup=False)
    return 0


@app.command()
def new(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A deck or a mesh.", show_default=False)],
    out: Annotated[Path | None, typer.Option("-o", "--out", metavar="SCENE.toml", show_default=False)] = None,
) -> int:
    """Write a scene from a deck (all of it that a scene can say) or a mesh (its groups, with questions)."""
    from .decks.scene import draft_of

    target = out or Path(f"{file.stem}.toml")
    if target.exists():
        raise SceneError(f"{target}: exists already; expected a new name, with -o SCENE.toml")
    draft = draft_of(file, target)
    try:
        with target.open("x", encoding="utf-8") as written:
            written.write(draft.text())
    except OSError as error:
        raise OutputError(f"{target}: cannot be written ({error.strerror or error})") from error
    console = _console()
    for text in draft.told:
        console.print(text, markup=False)
    console.print(f"wrote {target}", markup=False)
    if draft.missing:
        console.print(f"to be given there before it runs: {len(draft.missing)}", markup=False)
        for text in draft.missing:
            console.print(f"  {text}", markup=False)
    return 0


@app.command()
def onset(scene: SceneOrDeck) -> int:
    """Print the critical values of the sweep parameter alone, to full precision."""
    from .assembly.assembly import assemble
    from .report.tables import print_onsets
    from .report.warnings import told_once
    from .run.covered import covered_text, frequency_range
    from .run.run import sweep_scene

    loaded = _load(scene)
    if loaded.sweep is None:
        raise SceneError(f"{scene}: sweep: is missing; expected a table, written [sweep]: the interval to look in")
    console = _console()
    result = sweep_scene(loaded, assemble(loaded), console, precise=True)
    print_onsets(result.onsets_dataframe(), console, covered_text(frequency_range(loaded, result)))
    for o in result.onsets:
        console.print(f"{o.parameter} = {o.value!r} ± {o.uncertainty:.1g}, {o.frequency_hz!r} Hz", markup=False)
    for doubt in told_once(result.doubts):
        console.print(f"warning: {doubt}", markup=False)
    return 0


@app.command()
def compare(
    case: Annotated[str, typer.Argument(help="One case; all of them by default.")] = "all",
) -> int:
    """Hold finite-element models of the lumped systems against the lumped systems themselves."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from .compare import compare as compare_cases
    from .report.terminal import print_table

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
    print_table(table, console)
    console.print("Of each spectrum the eigenvalue that differs most is shown; differences fall with 1/E.")
    console.print("The block sprung at its top is no mass point: its rotation takes part, and it does not flutter.")
    return 0


@app.command()
def accuracy(
    scene: SceneOrDeck,
    out: Out = None,
    budget: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Spend at most so long.", show_default=False)
    ] = None,
) -> int:
    """Show what accuracy costs: error against time over mesh size, order, number of modes and method."""
    from .run.accuracy import study_scene

    return study_scene(_load(scene), out or Path(f"{scene.stem}_accuracy"), _console(), budget)


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
            from .run.lumped import study_model

            paths = study_model(model, study, out or Path(f"lumped_{model}"))
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
    from importlib.metadata import PackageNotFoundError, version

    from rich.table import Table

    from .eigen.linear.choice import solver_name
    from .report.terminal import print_table
    from .version import __version__

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
    print_table(table, _console())
    return 0


def main(arguments: list[str] | None = None) -> int:
    """Run the command; never shows a traceback for bad input."""
    with lasting_streams() as (out, err):
        with _stopped_by_signals():
            code = _main(arguments)
        if code == INTERRUPTED and not err.used:  # Typer, too, takes up what no command does, and says nothing
            print("interrupted", file=sys.stderr)
        out.flush()
        if out.failure is not None:
            why = one_line(str(out.failure.strerror or out.failure))
            print(f"error: standard output: {why}; what belongs into files is written", file=sys.stderr)
            return code or InputError.exit_code
    return code


def _main(arguments: list[str] | None) -> int:
    try:
        import_matplotlib()
        code = app(arguments, standalone_mode=False, prog_name="fe-squeal")
    except KeyboardInterrupt:
        return INTERRUPTED
    except SquealError as error:
        text = f"error: {error}" if not isinstance(error, NotConvergedError) else f"not converged: {error}"
        print(one_line(text), file=sys.stderr)
        return error.exit_code
    except OSError as error:  # a name that the system refuses, a disk that is full
        name = f"{str(error.filename)[:200]}: " if error.filename is not None else ""
        print(one_line(f"error: {name}{error.strerror or error}"), file=sys.stderr)
        return InputError.exit_code
    except MemoryError:
        from .eigen.memory import available_memory, memory_text

        print(f"error: more memory is needed than the {memory_text(available_memory())} that are free", file=sys.stderr)
        return InputError.exit_code
    except _UsageError as error:  # a wrong option or argument; without any argument the help
        if sys.argv[1:] if arguments is None else arguments:
            print(f"error: {error.format_message()}; see fe-squeal --help", file=sys.stderr)
        else:
            error.show()
        return error.exit_code
    return int(code or 0)


@contextmanager
def _stopped_by_signals() -> Iterator[None]:
    """Let every signal that asks for the end do what Ctrl-C does: what is finished is kept, children are ended."""
    before = {}
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows knows no SIGHUP
        if number is None or signal.getsignal(number) in (signal.SIG_IGN, None):
            continue
        with suppress(ValueError):  # not in the main thread
            before[number] = signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _load(path: Path) -> Scene | MatrixScene:
    """Return the scene of a scene file or a deck, and say what of a deck is not taken over."""
    from .decks.scene import scene_of

    scene, draft = scene_of(path)
    for text in () if draft is None else draft.told:
        _console().print(text, markup=False)
    return scene


def _console() -> Console:
    from rich.console import Console

    return Console(highlight=False, soft_wrap=True)
