"""Run the command on damaged inputs of every format, each in a process of its own with limits of memory and time."""

from __future__ import annotations

import contextlib
import gzip
import os
import resource
import shutil
import signal
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import scipy.io
import scipy.sparse as sp

import fe_squeal.report.export
import fe_squeal.run.run
from fe_squeal.cli import main
from fe_squeal.geometry import Block, write_mesh

sys.path.append(str(Path(__file__).parent / "fuzz"))
import test_mesh_fuzz
import test_scene_fuzz

MEMORY, SECONDS = 2**30, 10  # limits: bytes in addition to the program itself, and s of CPU time
_WALL = 120.0  # s after which a process is ended that uses no CPU time and does not end, since it waits for something


@dataclass
class Outcome:
    """What happened with the damaged inputs of a format.

    Attributes
    ----------
    codes : Counter
        How often each exit code occurred.
    faults : list of str
        Promises that were broken, each with the input, which is kept.
    slowest : float, s
        CPU time of the slowest input.
    largest : float, MiB
        Largest peak of memory, without that of the program itself.
    """

    codes: Counter[int] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    slowest: float = 0.0
    largest: float = 0.0


@dataclass(frozen=True)
class Kind:
    """A format: a scene, the file that is damaged, and a function that damages it."""

    name: str
    scene: Path
    target: Path
    spoil: Callable[[bytes, np.random.Generator], bytes]


def kinds(folder: Path) -> list[Kind]:
    """Write a good file of every format that is read, each with a scene, and return them."""
    spoil = test_mesh_fuzz.spoilt
    meshes = folder / "meshes"
    meshes.mkdir(parents=True)
    found = []
    # Fixtures are called as the plain functions that pytest has wrapped.
    factory: Any = type("Factory", (), {"mktemp": lambda self, name: meshes})()
    test_mesh_fuzz.place.__wrapped__(factory)  # type: ignore[attr-defined]
    for name in (*test_mesh_fuzz.FILES, *test_mesh_fuzz.WRITTEN):
        scene = meshes / f"{name}.toml"
        found.append(Kind(name.removeprefix("mesh_"), scene, meshes / name, spoil))
        if name.endswith(".xdmf"):
            h5 = (meshes / name).with_suffix(".h5")
            if h5.exists():
                found.append(Kind(h5.name, scene, h5, spoil))
    (meshes / "part.inc").write_text("1, 1, 2, 3, 4\n")
    text = "*NODE\n1,0.,0.,0.\n2,1.,0.,0.\n3,0.,1.,0.\n4,0.,0.,1.\n5,1.,1.,1.\n*ELEMENT,TYPE=C3D4,ELSET=PAD\n"
    (meshes / "inc.inp").write_text(f"{text}*INCLUDE, INPUT=part.inc\n2, 2, 3, 4, 5\n")
    body = (meshes / "two.vtk.toml").read_text().replace("two.vtk", "inc.inp").split("[bodies")[0]
    (meshes / "inc.toml").write_text(f'{body}[bodies.PAD]\nmaterial = "m"\n[solve]\nmodes = 3\n')
    found += [Kind(n, meshes / "inc.toml", meshes / n, spoil) for n in ("inc.inp", "part.inc")]
    scenes = folder / "scenes"
    scenes.mkdir()
    write_mesh(Block(length=0.08, width=0.04, height=0.02, size=0.08), scenes / "block.msh")
    K = sp.csr_array(sp.diags_array([[3.0, 4, 5, 6], [-1.0] * 3, [-1.0] * 3], offsets=[0, 1, -1]))
    scipy.io.mmwrite(scenes / "K.mtx", K)
    scipy.io.savemat(scenes / "KR.mat", {"KR": np.triu(np.ones((4, 4)), 1)}, do_compression=True)
    sp.save_npz(scenes / "M.npz", sp.eye_array(4, format="csr"))
    for i, text in enumerate(test_scene_fuzz.BASES):
        path = scenes / f"scene_{i}.toml"
        path.write_text(text)
        spoils = lambda base, rng, i=i: test_scene_fuzz.spoilt(rng, i + 4 * int(rng.integers(3)))  # noqa: E731
        found.append(Kind(f"scene {i + 1}", path, path, spoils))
    head = '[[terms]]\nrole = "mass"\nfile = "M.npz"\n[[terms]]\nrole = "stiffness"\nfile = "{}"\n'
    head += '[output]\nshapes = "none"\n'
    (scenes / "K.mtx.gz").write_bytes(gzip.compress((scenes / "K.mtx").read_bytes()))
    sp.save_npz(scenes / "K.npz", K)
    np.save(scenes / "K.npy", K.toarray())
    scipy.io.savemat(scenes / "K.mat", {"K": sp.csc_matrix(K)}, do_compression=True)
    scipy.io.savemat(scenes / "K4.mat", {"K": K.toarray()}, format="4")
    for name in ("K.mtx", "K.mtx.gz", "K.npz", "K.npy", "K.mat", "K4.mat"):
        scene = scenes / f"{name}.toml"
        scene.write_text(head.format(name))
        found.append(Kind(name, scene, scenes / name, packed if name.endswith(".gz") else spoil))
    return found


def packed(base: bytes, rng: np.random.Generator) -> bytes:
    """Return a compressed file whose content is damaged, or the file itself."""
    if rng.integers(2):
        return test_mesh_fuzz.spoilt(base, rng)
    return gzip.compress(test_mesh_fuzz.spoilt(gzip.decompress(base), rng))


def search(folder: Path, count: int, seed: int, tell: Callable[[str], None] = lambda text: None) -> dict[str, Outcome]:
    """Run the command on `count` damaged inputs, and check for each whether the promises of docs/trust.md were kept."""
    # No figures are drawn, since they would take most of the time; other tests draw them.
    with (
        mock.patch.object(fe_squeal.run.run, "write_figures"), mock.patch.object(fe_squeal.run.run, "write_preload"),
        mock.patch.object(fe_squeal.report.export, "draw_shapes"),
    ):  # fmt: skip
        return _search(folder, count, seed, tell)


def _search(folder: Path, count: int, seed: int, tell: Callable[[str], None]) -> dict[str, Outcome]:
    found = kinds(folder)
    for scene in {kind.scene for kind in found}:  # imports everything that is needed before processes are forked
        with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
            main(["run", str(scene), "-o", str(folder / "first")])
        shutil.rmtree(folder / "first")
    outcomes = {}
    for i, kind in enumerate(found):
        outcome = outcomes[kind.name] = Outcome()
        base, rng = kind.target.read_bytes(), np.random.default_rng([seed, i])
        try:
            if _checked(kind, outcome, folder) != 0:
                said = (folder / "stderr").read_text()
                raise AssertionError(f"{kind.name}: the file is bad before it is spoilt: {said}")
            outcome.codes.clear()
            for number in range(count // len(found) + (i < count % len(found))):
                kind.target.write_bytes(kind.spoil(base, rng))
                before = len(outcome.faults)
                _checked(kind, outcome, folder)
                if len(outcome.faults) > before:
                    kept = folder / f"fault_{number}_{kind.target.name}"
                    shutil.copy(kind.target, kept)
                    outcome.faults[-1] += f" ({kept})"
        finally:
            kind.target.write_bytes(base)
        tell(f"{kind.name}: {dict(sorted(outcome.codes.items()))} {outcome.faults or ''}")
    return outcomes


def _checked(kind: Kind, outcome: Outcome, folder: Path) -> int:
    """Run the command in a process of its own, and note its exit code and the promises that it broke."""
    out, said = folder / "out", folder / "stderr"
    shutil.rmtree(out, ignore_errors=True)
    before = _content(kind.scene.parent)
    begun = time.monotonic()
    child = os.fork()
    if not child:
        _child(["run", str(kind.scene), "-o", str(out)], said)
    late = False
    while not (ended := os.wait4(child, os.WNOHANG))[0]:
        if time.monotonic() - begun > _WALL:
            late = True
            os.kill(child, signal.SIGKILL)
        time.sleep(0.002)
    code = os.waitstatus_to_exitcode(ended[1])
    used = ended[2]
    outcome.codes[code] += 1
    outcome.slowest = max(outcome.slowest, used.ru_utime + used.ru_stime)
    text = said.read_text("utf-8", "replace")
    *text_lines, peak = text.rsplit("peak ", 1) if "peak " in text else (text, "0")
    message = text_lines[0]
    outcome.largest = max(outcome.largest, float(peak))
    faults = []
    if late:
        faults.append(f"waits for ever behind {_WALL:g} s")
    elif code not in (0, 2, 3):
        faults.append(f"exit code {code}: {message[-200:]!r}")
    elif message.count("\n") != (code != 0) or "Traceback" in message or not message.replace("\n", "").isprintable():
        faults.append(f"exit code {code} with the message {message[-200:]!r}")
    if code == 2 and out.exists():
        faults.append("a refused run has left a folder")
    if _content(kind.scene.parent) != before:
        faults.append("a file beside the results was changed")
    outcome.faults += faults[:1]
    return code


def _child(arguments: list[str], said: Path) -> None:
    """Run the command and end this process; stderr is written to a file, followed by the peak of memory."""
    code = 1
    try:
        os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        sys.stderr, sys.stdout = open(2, "w", closefd=False), open(1, "w", closefd=False)  # noqa: SIM115
        # The limit is in addition to the memory that the program has mapped, which is far more than it uses.
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
        start = _resident()
        warnings.simplefilter("always")
        code = main(arguments)
        sys.stderr.flush()
        os.write(2, f"peak {_resident() - start:.1f}".encode())
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


def _resident() -> float:
    status = Path("/proc/self/status").read_text()
    return float(status.split("VmHWM:")[1].split()[0]) / 1024


def _content(folder: Path) -> dict[str, tuple[int, int]]:
    return {p.name: (p.stat().st_mtime_ns, p.stat().st_size) for p in folder.iterdir()}
