"""Commands before anything is solved: new, check, mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..errors import MeshError, SceneError
from .shared import SceneFile, load_scene_or_deck, make_console


def new(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A deck or a mesh.", show_default=False)],
    out: Annotated[Path | None, typer.Option("-o", "--out", metavar="SCENE.toml", show_default=False)] = None,
) -> int:
    """Write a scene from a deck (all of it that a scene can say) or a mesh (its groups, with questions)."""
    from ..decks.scene import draft_of
    from ..report.files import write_new

    target = out or Path(f"{file.stem}.toml")
    if target.exists():
        raise SceneError(f"{target}: exists already; expected a new name, with -o SCENE.toml")
    draft = draft_of(file, target)
    write_new(draft.text(), target)
    console = make_console()
    for text in draft.told:
        console.print(text, markup=False)
    console.print(f"wrote {target}", markup=False)
    if draft.missing:
        console.print(f"to be given there before it runs: {len(draft.missing)}", markup=False)
        for text in draft.missing:
            console.print(f"  {text}", markup=False)
    return 0


def check(
    scene: Annotated[
        Path, typer.Argument(metavar="SCENE.toml", help="The scene, a deck, or a mesh.", show_default=False)
    ],
    groups: Annotated[
        bool, typer.Option("--groups", help="List the groups of its mesh, or of a mesh file, with size and place.")
    ] = False,
    processes: Annotated[
        int | None, typer.Option("--processes", metavar="P", min=1, help="What each of P processes would take.",
                                 show_default=False)
    ] = None,
    memory_per_process: Annotated[
        float | None, typer.Option("--memory-per-process", metavar="GIB", help="And whether that fits.",
                                   show_default=False)
    ] = None,
) -> int:
    """Validate scene and mesh without solving, and forecast memory."""
    from ..assembly.assembly import assemble
    from ..assembly.discretisation import discretisation_of
    from ..assembly.forces import force_balance
    from ..report.terminal import print_table
    from ..report.warnings import told_once
    from ..run.check import describe
    from ..run.fits import machines_of
    from ..run.forces import balance_table, scene_warnings
    from ..run.free import free_motion_warnings
    from ..run.groups import groups_of_file, groups_of_scene
    from ..run.measured import read_measured
    from ..scene import Scene

    machines = machines_of(processes, memory_per_process)
    console, bare = make_console(), groups and scene.suffix.lower() != ".toml"
    loaded = None if bare else load_scene_or_deck(scene)
    if groups and (loaded is None or isinstance(loaded, Scene)):
        table, fault = groups_of_file(scene) if loaded is None else groups_of_scene(loaded)
        print_table(table, console)
        if fault is not None:
            raise fault
    if loaded is None:
        return 0
    problem = assemble(loaded)
    measured = read_measured(loaded)  # raises SceneError as a run would
    print_table(describe(loaded, problem, machines), console)
    found = discretisation_of(problem)
    notes = () if found is None else found.notes
    parts = force_balance(problem)
    balance = balance_table(parts, problem)
    if balance is not None:
        print_table(balance, console)
    warnings = (*scene_warnings(problem, parts), *free_motion_warnings(problem), *measured.warnings)
    for text in (*notes, *measured.notes, *(f"warning: {w}" for w in told_once(warnings))):
        console.print(text, markup=False)
    return 0


def mesh(
    scene: SceneFile,
    out: Annotated[Path | None, typer.Option("-o", "--out", metavar="FILE.msh", show_default=False)] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over a mesh that this command did not write.")] = False,
) -> int:
    """Mesh the scene's parametric geometry."""
    from ..geometry import write_mesh
    from ..scene import MatrixScene, Scene
    from ..scene.file import load_scene

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
    make_console().print(f"wrote {path} ({path.stat().st_size / 1e3:.1f} kB)", markup=False)
    return 0
