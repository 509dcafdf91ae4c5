"""What the search through spoilt inputs spoils: good files of every format, and in folders that commands go on from.

This file is longer than others, since it is a list of kinds.
"""

from __future__ import annotations

import contextlib
import gzip
import hashlib
import json
import os
import sys
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import scipy.io
import scipy.sparse as sp
from interrupted import sweep_text
from scene_texts import replaced, write_scene

from fe_squeal.accuracy import choose
from fe_squeal.cli import main
from fe_squeal.geometry import Block, write_mesh
from fe_squeal.mesh import load_mesh
from fe_squeal.study import engine
from fe_squeal.sweep.running import RunningSweep

sys.path.append(str(Path(__file__).parent / "fuzz"))
sys.path.append(str(Path(__file__).parent / "unit"))
import test_deck_fuzz
import test_measured
import test_mesh_fuzz
import test_mesh_unv
import test_scene_fuzz
from clamped_block import BLOCK
from mutations import dump, mutated_bytes, mutated_data
from test_decks_ansys_brake import brake

Spoil = Callable[[bytes, np.random.Generator], bytes]
RUN = ("run", "{scene}", "-o", "{out}")
STUDY = """
[study]
samples = 16
[study.parameters]
mu = { uniform = { low = 0.1, high = 0.5 } }
"springs.across.stiffness" = { uniform = { low = 1e7, high = 2e7 } }
"""
MAP = """
[study.x]
parameter = "mu"
from = 0.0
to = 1.0
points = 3
[study.y]
parameter = "omega"
from = 5.0
to = 10.0
points = 3
"""
COARSE = BLOCK.format(element="hex", order=2).replace("\nsize = 0.02", "\nsize = 0.04")
MEASURED = '[[measured]]\nfile = "{}"\nfrequency_hz = 712.0\n'


@dataclass(frozen=True)
class Kind:
    """A format: the command that reads the file, the file that is spoilt, and how.

    Attributes
    ----------
    name : str
    folder : Path
        In which the command's inputs are; none of them may change.
    target : Path
        Beside the inputs, or relative to a folder of results.
    results : Path, optional
        The folder of results that the target is in; a copy of it is `{out}` in the command.
    """

    name: str
    folder: Path
    target: Path
    spoil: Spoil
    command: tuple[str, ...]
    results: Path | None = None

    def base(self) -> bytes:
        """Return the good file."""
        return (self.target if self.results is None else self.results / self.target).read_bytes()


def kinds(folder: Path) -> list[Kind]:
    """Write a good file of every format that is read, and folders of results, and return them."""
    parts = (_meshes, _decks, _scenes, _matrices, _measured, _studies, _results, _stopped)
    found = []
    for part in parts:
        place = folder / part.__name__.strip("_")
        place.mkdir(parents=True)
        found += list(part(place))
    return found


def _of(scene: Path, target: Path, spoil: Spoil, name: str = "", command: tuple[str, ...] = RUN) -> Kind:
    arguments = tuple(part.replace("{scene}", str(scene)) for part in command)
    return Kind(name or target.name, scene.parent, target, spoil, arguments)


def _meshes(folder: Path) -> Iterator[Kind]:
    spoil = test_mesh_fuzz.spoilt
    # The fixtures are plain functions underneath.
    factory: Any = type("Factory", (), {"mktemp": lambda self, name: folder})()
    test_mesh_fuzz.place.__wrapped__(factory)  # type: ignore[attr-defined]
    (folder / "tet.unv").write_text(test_mesh_unv.tetrahedron())
    (folder / "brake.cdb").write_text(brake())
    for name in ("tet.unv", "brake.cdb"):
        _write_scene_of(folder / name, "mm")
    for name in (*test_mesh_fuzz.FILES, *test_mesh_fuzz.WRITTEN, "tet.unv", "brake.cdb"):
        scene = folder / f"{name}.toml"
        yield _of(scene, folder / name, spoil, name.removeprefix("mesh_"))
        h5 = (folder / name).with_suffix(".h5")
        if name.endswith(".xdmf") and h5.exists():
            yield _of(scene, h5, spoil)
    (folder / "part.inc").write_text("1, 1, 2, 3, 4\n")
    text = "*NODE\n1,0.,0.,0.\n2,1.,0.,0.\n3,0.,1.,0.\n4,0.,0.,1.\n5,1.,1.,1.\n*ELEMENT,TYPE=C3D4,ELSET=PAD\n"
    (folder / "inc.inp").write_text(f"{text}*INCLUDE, INPUT=part.inc\n2, 2, 3, 4, 5\n")
    _write_scene_of(folder / "inc.inp", "m")
    for name in ("inc.inp", "part.inc"):
        yield _of(folder / "inc.inp.toml", folder / name, spoil)


def _write_scene_of(mesh: Path, unit: str) -> None:
    """Write a scene with all elements of a mesh, in the bodies that its groups make."""
    loaded = load_mesh(mesh, unit).mesh
    left, bodies = np.ones(loaded.nelements, bool), []
    for group, elements in (loaded.subdomains or {}).items():
        if left[elements].all():
            left[elements] = False
            bodies.append(group)
    text = f'[mesh]\nfile = "{mesh.name}"\nlength_unit = "{unit}"\norder = 1\n[materials.m]\nyoungs_modulus = 1e9\n'
    text += "poisson_ratio = 0.3\ndensity = 1000.0\n" + "".join(f'[bodies."{b}"]\nmaterial = "m"\n' for b in bodies)
    mesh.with_name(f"{mesh.name}.toml").write_text(f'{text}[solve]\nmodes = 3\n[output]\nshapes = "none"\n')


def _decks(folder: Path) -> Iterator[Kind]:
    """Decks that run as they are, and those that `new` makes a scene of."""
    good = test_deck_fuzz.decks.__wrapped__()  # type: ignore[attr-defined]
    good["brake.cdb"] = brake().encode()
    for name, command in {
        "tied.inp": RUN, "free.bdf": RUN, "brake.inp": ("new", "{scene}", "-o", "{out}"),
        "large.bdf": ("new", "{scene}", "-o", "{out}"), "brake.cdb": ("new", "{scene}", "-o", "{out}"),
    }.items():  # fmt: skip
        (folder / name).write_bytes(good[name])
        spoil = _either(test_deck_fuzz.physics_spoilt, test_mesh_fuzz.spoilt)
        yield _of(folder / name, folder / name, spoil, f"deck {name}", command)


def _scenes(folder: Path) -> Iterator[Kind]:
    write_mesh(Block(length=0.08, width=0.04, height=0.02, size=0.08), folder / "block.msh")
    _write_matrices(folder)
    for i, text in enumerate(test_scene_fuzz.BASES):
        path = folder / f"scene_{i}.toml"
        path.write_text(text)
        yield _of(path, path, _scene_spoilt, f"scene {i + 1}")
    for name, text, study in (
        ("scatter", test_scene_fuzz.SHORT, STUDY), ("map", test_scene_fuzz.MATRICES, MAP),
    ):  # fmt: skip
        path = folder / f"{name}.toml"
        path.write_text(text + study)
        yield _of(path, path, _scene_spoilt, f"scene of a {name}", ("study", *RUN[1:]))


def _write_matrices(folder: Path) -> sp.csr_array:
    K = sp.csr_array(sp.diags_array([[3.0, 4, 5, 6], [-1.0] * 3, [-1.0] * 3], offsets=[0, 1, -1]))
    scipy.io.mmwrite(folder / "K.mtx", K)
    scipy.io.savemat(folder / "KR.mat", {"KR": np.triu(np.ones((4, 4)), 1)}, do_compression=True)
    sp.save_npz(folder / "M.npz", sp.eye_array(4, format="csr"))
    return K


def _matrices(folder: Path) -> Iterator[Kind]:
    head = '[[terms]]\nrole = "mass"\nfile = "M.npz"\n[[terms]]\nrole = "stiffness"\nfile = "{}"\n'
    head += '[output]\nshapes = "none"\n'
    K = _write_matrices(folder)
    (folder / "K.mtx.gz").write_bytes(gzip.compress((folder / "K.mtx").read_bytes()))
    sp.save_npz(folder / "K.npz", K)
    np.save(folder / "K.npy", K.toarray())
    scipy.io.savemat(folder / "K.mat", {"K": sp.csc_matrix(K)}, do_compression=True)
    scipy.io.savemat(folder / "K4.mat", {"K": K.toarray()}, format="4")
    for name in ("K.mtx", "K.mtx.gz", "K.npz", "K.npy", "K.mat", "K4.mat"):
        scene = folder / f"{name}.toml"
        scene.write_text(head.format(name))
        yield _of(scene, folder / name, _packed if name.endswith(".gz") else test_mesh_fuzz.spoilt)


def _measured(folder: Path) -> Iterator[Kind]:
    """Frequencies and shapes of a test, beside a small scene."""
    write_mesh(Block(length=0.08, width=0.04, height=0.02, size=0.08), folder / "block.msh")
    points = load_mesh(folder / "block.msh").mesh.p.T
    u = np.random.default_rng(0).normal(size=points.shape) + 0j
    (folder / "squeal.csv").write_text("frequency_hz,level_db,label\n650,88.5,stop 2\n9000,,\n")
    rows = [",".join(map(repr, (*x.tolist(), *v.real.tolist()))) for x, v in zip(points, u, strict=True)]
    (folder / "shape.csv").write_text("\n".join(["x,y,z,ux_re,uy_re,uz_re", *rows]))
    for kind in ("55", "58"):
        test_measured.universal(folder / f"shape_{kind}.unv", (points, u, 1), kind)
    for name in ("squeal.csv", "shape.csv", "shape_55.unv", "shape_58.unv"):
        scene = folder / f"{name}.toml"
        keys = test_measured.KEYS if name.endswith(".unv") else ""
        measured = MEASURED.format(name) if name != "squeal.csv" else MEASURED.format(name).split("frequency")[0]
        scene.write_text(test_scene_fuzz.SHORT + measured + keys)
        yield _of(scene, folder / name, test_mesh_fuzz.spoilt, f"measured {name}")


def _studies(folder: Path) -> Iterator[Kind]:
    """Finished parts of a scatter that was stopped in its second chunk."""
    scene, out = folder / "study.toml", folder / "out"
    study = STUDY.replace("16", "96").replace("[study.p", "indices = false\n[study.p")
    write_scene(folder, sweep_text(2) + study, scene.name)
    with _stopping(engine, "solve_chunk", 2):
        _run(["study", str(scene), "-o", str(out)], 130)
    command = ("study", str(scene), "-o", "{out}", "--resume")
    yield from _results_of(out, command, "parts/inputs.json", "parts/samples_00000.npz")


def _results(folder: Path) -> Iterator[Kind]:
    """What commands read of a finished run and a finished study."""
    scene, out, study = folder / "block.toml", folder / "out", folder / "study"
    text = replaced("points = 5", "points = 2").replace('shapes = "none"', 'shapes = "unstable"')
    write_scene(folder, text + STUDY)
    _run(["run", str(scene), "-o", str(out)])
    _run(["study", str(scene), "-o", str(study)])
    shape = next((out / "shapes").glob("*.vtu")).relative_to(out).as_posix()
    yield from _results_of(out, ("run", str(scene), "-o", "{out}"), "manifest.sha256")
    yield from _results_of(out, ("run", str(scene), "-o", "{out}", "--resume"), "modes.csv", "run.json")
    yield from _results_of(out, ("report", "{out}"), "modes.csv", "run.json", shape)
    yield from _results_of(study, ("report", "{out}"), "samples.csv", "study.json")
    yield from _results_of(out, ("diff", str(out), "{out}", "-o", "{more}"), "modes.csv", "run.json", shape)
    yield from _results_of(out, ("animate", "{out}"), "run.json", shape)


def _stopped(folder: Path) -> Iterator[Kind]:
    """What runs go on from: the checkpoint of a sweep, and the search for a mesh."""
    scene, out = folder / "reduced.toml", folder / "out"
    write_scene(folder, sweep_text(6, "reduced"), scene.name)
    with _stopping(RunningSweep, "advance", 4):
        _run(["run", str(scene), "-o", str(out)], 130)
    names = (f"checkpoint/{name}" for name in ("inputs.json", "model.npz", "first.npz", "point_00000.npz", "state.npz"))
    yield from _results_of(out, ("run", str(scene), "-o", "{out}", "--resume"), *names)
    coarse, search = folder / "coarse.toml", folder / "search"
    coarse.write_text(COARSE)
    with _stopping(choose, "_swept", 2):
        _run(["run", str(coarse), "-o", str(search), "--accuracy", "0.05"], 130)
    command = ("run", str(coarse), "-o", "{out}", "--accuracy", "0.05", "--resume")
    yield from _results_of(search, command, "checkpoint/search.json", "checkpoint/next_1.npz")


def _results_of(results: Path, command: tuple[str, ...], *names: str) -> Iterator[Kind]:
    for name in names:
        spoil = _json_spoilt if name.endswith(".json") else test_mesh_fuzz.spoilt
        short = "a shape" if name.startswith("shapes/") else Path(name).name
        options = "".join(f" {part}" for part in command if part.startswith("--"))
        yield Kind(f"{command[0]}{options}: {short}", results.parent, Path(name), spoil, command, results)


def _run(arguments: list[str], code: int = 0) -> None:
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere), contextlib.redirect_stderr(nowhere):
        assert main(arguments) == code, arguments


def _stopping(owner: Any, name: str, call: int) -> Any:
    """Interrupt a function at its nth call."""
    original, calls = getattr(owner, name), []

    def stopping(*arguments: Any, **options: Any) -> Any:
        calls.append(1)
        if len(calls) == call:
            raise KeyboardInterrupt
        return original(*arguments, **options)

    return mock.patch.object(owner, name, stopping)


def _either(one: Spoil, other: Spoil) -> Spoil:
    return lambda base, rng: (one if rng.integers(2) else other)(base, rng)


def _packed(base: bytes, rng: np.random.Generator) -> bytes:
    """Spoil what is inside, or the archive itself."""
    if rng.integers(2):
        return test_mesh_fuzz.spoilt(base, rng)
    return gzip.compress(test_mesh_fuzz.spoilt(gzip.decompress(base), rng))


def _scene_spoilt(base: bytes, rng: np.random.Generator) -> bytes:
    if rng.integers(3) == 0:
        return mutated_bytes(base, rng)
    return dump(mutated_data(tomllib.loads(base.decode()), rng)).encode("utf-8", "surrogatepass")


def _json_spoilt(base: bytes, rng: np.random.Generator) -> bytes:
    """Spoil the text, or what it holds."""
    if rng.integers(3) == 0:
        return test_mesh_fuzz.spoilt(base, rng)
    return json.dumps(mutated_data(json.loads(base), rng), default=str).encode("utf-8", "surrogatepass")


def list_again(out: Path, name: str) -> None:
    """Have the manifest say that a file is as it was written; what reads it has to see by itself that it is not."""
    manifest = out / "manifest.sha256"
    digest = hashlib.sha256((out / name).read_bytes()).hexdigest()
    lines = [line for line in manifest.read_text("utf-8").splitlines() if not line.endswith(f"  {name}")]
    manifest.write_text("\n".join([*lines, f"{digest}  {name}", ""]), encoding="utf-8")
