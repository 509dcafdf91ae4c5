"""Hundreds of spoilt mesh files of every kind that is read: results or one message, soon, and in little memory."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import meshio
import numpy as np
import pytest
from mutations import growth_of_memory, mutated_bytes, needs_timer, outcome
from selection import amount

import fe_squeal.run.run
from fe_squeal.eigen.memory import peak_memory_mib
from fe_squeal.mesh import load_mesh

pytestmark = needs_timer
DATA = Path(__file__).parents[1] / "data"
FILES = sorted(p.name for p in DATA.glob("mesh_*"))
WRITTEN = ("two.vtk", "two.med", "two.xdmf")  # the last with its arrays in an .h5 file
COUNT = amount(20, 60)  # of each kind
MOST_MIB = 500.0
NUMBER = re.compile(rb"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
NUMBERS = [
    b"nan", b"inf", b"-inf", b"1e400", b"0", b"-1", b"1", b"2", b"1e-320", b"1e300", b"99999999", b"2147483648",
    b"9223372036854775807", b"18446744073709551616", b"1" * 500, b"0.5", b"-0.0", b"x", b"", b"1e9", b"1000000000",
]  # fmt: skip
WORDS = [np.float64(x).tobytes() for x in (np.nan, np.inf, 1e300, 0.0, -1.0)] + [
    np.int32(x).tobytes() for x in (-1, 0, 1, 2**31 - 1, 10**9)
] + [np.int64(x).tobytes() for x in (-1, 0, 10**9, 2**62, 2**63 - 1)]  # fmt: skip


def spoilt(base: bytes, rng: np.random.Generator) -> bytes:
    """Return the file with numbers in text or in binary exchanged, with each other or for odd ones, or bytes spoilt."""
    kind = rng.integers(4)
    found = list(NUMBER.finditer(base))
    if kind == 0 or (kind == 1 and not found):
        return mutated_bytes(base, rng)
    data = base
    for _ in range(rng.choice([1, 1, 2, 5])):
        if kind == 1:
            old = found[rng.integers(len(found))]
            data = data[: old.start()] + NUMBERS[rng.integers(len(NUMBERS))] + data[old.end() :]
        elif kind == 2 and found:  # nodes that lie on each other, that nothing uses, that are used twice
            old, other = (found[i] for i in rng.integers(len(found), size=2))
            data = data[: old.start()] + other[0] + data[old.end() :]
        else:
            word, at = WORDS[rng.integers(len(WORDS))], int(rng.integers(len(data)))
            data = data[:at] + word + data[at + len(word) :]
        found = list(NUMBER.finditer(data)) or found[:0]
        if not found:
            break
    return data


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with good files of all kinds, each with a scene."""
    folder = tmp_path_factory.mktemp("meshes")
    for name in FILES:
        shutil.copy(DATA / name, folder / name)
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1.0]])
    cells = [("tetra", np.array([[0, 1, 2, 3], [1, 2, 3, 4]]))]
    mesh = meshio.Mesh(points, cells, cell_data={"part": [np.array([1, 1])]})
    meshio.write(folder / "two.vtk", mesh)
    meshio.write(folder / "two.xdmf", mesh)
    tagged = meshio.Mesh(points, cells, cell_data={"cell_tags": [np.array([-1, -1])]})
    tagged.cell_tags = {-1: ["pad"]}
    meshio.write(folder / "two.med", tagged)
    for name in (*FILES, *WRITTEN):
        mesh = load_mesh(folder / name).mesh
        left, bodies = np.ones(mesh.nelements, bool), []
        for group, elements in (mesh.subdomains or {}).items():
            if left[elements].all():
                left[elements] = False
                bodies.append(group)
        assert not left.any()
        text = f'[mesh]\nfile = "{name}"\norder = 1\n[materials.m]\nyoungs_modulus = 1e9\npoisson_ratio = 0.3\n'
        text += "density = 1000.0\n" + "".join(f'[bodies."{b}"]\nmaterial = "m"\n' for b in bodies)
        if mesh.boundaries:
            text += f'[[springs]]\nname = "s"\nsurface = "{next(iter(mesh.boundaries))}"\ndirection = [0, 0, 1]\n'
            text += 'stiffness = 1e6\n'
        (folder / f"{name}.toml").write_text(text + '[solve]\nmodes = 3\n[output]\nshapes = "none"\n')
    return folder


@pytest.fixture(autouse=True)
def _no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fe_squeal.run.run, "write_figures", lambda *_: None)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*FILES, *WRITTEN])
def test_spoilt_meshes(place: Path, name: str, other_seed: int, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(sum(name.encode()) + 10_000 * other_seed)
    scene, out = place / f"{name}.toml", place / "out"
    target = (place / name).with_suffix(".h5") if name == "two.xdmf" else place / name
    base = target.read_bytes()
    assert outcome(["run", str(scene), "-o", str(out)], out, capsys)[0] == 0
    shutil.rmtree(out)
    before, codes = peak_memory_mib(), []
    try:
        for number in range(COUNT):
            target.write_bytes(spoilt(base, rng))
            try:
                codes.append(outcome(["run", str(scene), "-o", str(out)], out, capsys)[0])
            except BaseException:
                kept = place / f"failed_{number}_{target.name}"
                shutil.copy(target, kept)
                print(f"number {number}: {kept}")
                raise
            shutil.rmtree(out, ignore_errors=True)
    finally:
        target.write_bytes(base)
    assert codes.count(2) > COUNT // 10
    assert growth_of_memory(peak_memory_mib, before) < MOST_MIB
