"""The commands mesh, onset and info, wrong command lines, and what reaches the terminal from a process of its own."""

from __future__ import annotations

import platform
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from interrupted import stop_at
from scene_texts import CONTACTS, CRITICAL_MU, HEAD, SCENE, SPRINGS, environment, replaced, without, write_scene
from selection import some

import fe_squeal.cli
import fe_squeal.run.run
from fe_squeal.cli import main
from fe_squeal.errors import NotConvergedError
from fe_squeal.mesh import load_mesh


def run_process(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "fe_squeal", *arguments]
    return subprocess.run(command, capture_output=True, encoding="utf-8", env=environment(), cwd=cwd, timeout=60)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["rnu", "a.toml"], "error: No such command 'rnu'."),
        (["run"], "error: Missing argument 'SCENE.toml'; see fe-squeal --help"),
        (["run", "a.toml", "b.toml"], "error: Got unexpected extra argument(s) (b.toml); see fe-squeal --help"),
        (["run", "a.toml", "--ouput", "b"], "error: No such option: --ouput"),
        (["run", "a.toml", "-o"], "error: Option '-o' requires an argument; see fe-squeal --help"),
    ],
)
def test_wrong_command_lines(capsys: pytest.CaptureFixture[str], arguments: list[str], message: str) -> None:
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith(message)
    assert captured.err.count("\n") == 1
    assert captured.out == ""


def test_without_a_command_there_is_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) in (0, 2)  # older versions of Click take it for a wish for help
    captured = capsys.readouterr()
    assert "Usage: fe-squeal" in captured.out + captured.err
    assert main(["--help"]) == 0
    assert "Usage: fe-squeal" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    some([
        (("run", "none.toml"), "error: none.toml: no such file; expected a scene in TOML"),
        (("check", "spoilt.toml"), 'error: spoilt.toml: mesh.flie: unknown key; did you mean "file"?'),
        (("onset", "group.toml"),
         'error: group.toml: contacts[0].surface: no surface group "botom" in block.msh; did you mean "bottom"?'),
        (("run", "block.toml", "-o", "block.toml/out"),
         "error: block.toml/out: cannot write results here: Not a directory; expected a folder that can be written,"
         " given by -o"),
        (("frobnicate",), "error: No such command 'frobnicate'; see fe-squeal --help"),
    ], lambda arguments, message: "group.toml" in arguments),
)  # fmt: skip
def test_process(tmp_path: Path, arguments: tuple[str, ...], message: str) -> None:
    """The whole of stderr is the one message; nothing on stdout; exit code 2."""
    write_scene(tmp_path)
    write_scene(tmp_path, replaced("file =", "flie ="), "spoilt.toml")
    write_scene(tmp_path, replaced('"bottom"', '"botom"'), "group.toml")
    done = run_process(*arguments, cwd=tmp_path)
    assert (done.returncode, done.stderr, done.stdout) == (2, message + "\n", "")


@pytest.mark.parametrize("out", ["file", "file/out"])
def test_output_folder_is_tried_before_anything_is_solved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, out: str
) -> None:
    (tmp_path / "file").write_text("mine")
    monkeypatch.setattr(fe_squeal.run.run, "sweep_scene", lambda *_: pytest.fail("solved before the folder was tried"))
    assert main(["run", str(write_scene(tmp_path)), "-o", str(tmp_path / out)]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith(f"error: {tmp_path / out}: cannot write results here: ")
    assert captured.err.endswith("expected a folder that can be written, given by -o\n")
    assert (tmp_path / "file").read_text() == "mine"


def test_system_errors_are_messages(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(scene: object) -> None:
        raise OSError(28, "No space left on device", "somewhere")

    monkeypatch.setattr(fe_squeal.assembly.assembly, "assemble", fail)
    assert main(["check", str(write_scene(tmp_path))]) == 2
    assert capsys.readouterr().err == "error: somewhere: No space left on device\n"


def test_mesh_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """4 x 2 x 1 hexahedra; the file is where `file` says, or where -o says."""
    path = write_scene(tmp_path, replaced("block.msh", "fresh.msh"))
    assert main(["mesh", str(path)]) == 0
    assert re.fullmatch(rf"wrote {tmp_path / 'fresh.msh'} \(\d+\.\d kB\)\n", capsys.readouterr().out)
    mesh = load_mesh(tmp_path / "fresh.msh").mesh
    assert (mesh.nelements, mesh.nvertices) == (8, 30)
    assert np.ptp(mesh.p, axis=1) == pytest.approx([0.08, 0.04, 0.02], rel=1e-12)
    assert set(mesh.boundaries or {}) == {"left", "right", "front", "back", "bottom", "top"}
    assert main(["mesh", str(path), "-o", str(tmp_path / "other.msh")]) == 0
    assert (tmp_path / "other.msh").read_bytes() == (tmp_path / "fresh.msh").read_bytes()


@pytest.mark.parametrize(
    ("text", "out", "message"),
    [
        (without(r"\[mesh.block\].*?(?=\[materials)"), "a.msh",
         "{scene}: mesh: given no geometry; expected [mesh.disc_pad] or [mesh.block], which is meshed"),
        (replaced("size = 0.02", "size = 1e-9"), "a.msh", "{scene}: mesh.block: size = 1e-09 makes about"),
        (SCENE, "a.vtk", "{out}: a mesh is written as a gmsh file; expected a name that ends in .msh"),
        (SCENE, "none/a.msh", "{out}: there is no folder"),
    ],
)  # fmt: skip
def test_bad_mesh_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, out: str, message: str
) -> None:
    scene = write_scene(tmp_path, text)
    assert main(["mesh", str(scene), "-o", str(tmp_path / out)]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("error: " + message.format(scene=scene, out=tmp_path / out))
    assert captured.err.count("\n") == 1
    assert not (tmp_path / out).exists()


def test_onset_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The rigid block flutters at μ = 0.4; the elastic one, whose pitch friction excites as well, within 1 % of it."""
    assert main(["onset", str(write_scene(tmp_path))]) == 0
    found = re.findall(r"^mu = (\S+) ± (\S+), (\S+) Hz$", capsys.readouterr().out, flags=re.MULTILINE)
    assert len(found) == 1
    value, uncertainty, frequency = (float(text) for text in found[0])
    assert value == pytest.approx(CRITICAL_MU, rel=0.01)
    assert 0 < uncertainty < 1e-6
    assert len(found[0][0]) > 12  # to full precision
    assert frequency == pytest.approx(np.sqrt(1e7 / (7800.0 * 0.08 * 0.04 * 0.02)) / (2 * np.pi), rel=0.01)


def test_onset_needs_a_sweep(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_scene(tmp_path, HEAD + SPRINGS + CONTACTS)
    assert main(["onset", str(path)]) == 2
    assert capsys.readouterr().err.startswith(f"error: {path}: sweep: is missing; expected a table, written [sweep]")


def test_info_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info"]) == 0
    rows = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines() if len(line.split()) > 1)
    assert rows["Python"].strip() == platform.python_version()
    for package in ("numpy", "scipy", "scikit-fem", "meshio"):
        assert rows[package].strip() == version(package)
    assert "linear solver" in " ".join(f"{key} {text}" for key, text in rows.items())


@pytest.mark.parametrize(("error", "code", "said"), [
    (KeyboardInterrupt, 130, "interrupted: the onsets are those up to mu = 0.6"),
    (NotConvergedError, 3, "not converged: mu = 0.8: the end; the onsets are those up to mu = 0.6"),
])  # fmt: skip
def test_onsets_that_were_found_before_the_end_are_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, error: type[BaseException],
    code: int, said: str,
) -> None:  # fmt: skip
    """The last of five values is not reached; the onset lies below."""
    stop_at(5, monkeypatch, error)
    assert main(["onset", str(write_scene(tmp_path))]) == code
    captured = capsys.readouterr()
    [value] = re.findall(r"^mu = (\S+) ± ", captured.out, flags=re.MULTILINE)
    assert float(value) == pytest.approx(CRITICAL_MU, rel=0.01)
    assert captured.err == f"{said}\n"


@pytest.mark.parametrize(("error", "code"), [(KeyboardInterrupt, 130), (NotConvergedError, 3)])
def test_nothing_is_printed_of_onsets_where_no_value_was_solved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, error: type[BaseException],
    code: int,
) -> None:  # fmt: skip
    stop_at(1, monkeypatch, error)
    assert main(["onset", str(write_scene(tmp_path))]) == code
    captured = capsys.readouterr()
    assert "nset" not in captured.out + captured.err and captured.err.count("\n") == 1


@pytest.mark.parametrize(("parameter", "low"), [
    ("contacts.belt.sliding.speed", -5.0), ("springs.along_1.direction.0", -1.0),
])  # fmt: skip
def test_a_value_in_the_middle_of_a_sweep_that_the_scene_does_not_allow(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], parameter: str, low: float
) -> None:
    """No slip damping at rest, and no spring without a direction: each command says it before it solves anything."""
    text = replaced('parameter = "mu"\nfrom = 0.0\nto = 0.8', f'parameter = "{parameter}"\nfrom = {low}\nto = {-low}')
    text = replaced("[sweep]", "[effects.friction_damping]\ncontact_pressure = 1.0e6\n[sweep]", text)
    path = write_scene(tmp_path, text)
    said = set()
    for command in (["check"], ["onset"], ["run", "-o", str(tmp_path / "out")]):
        assert main([command[0], str(path), *command[1:]]) == 2
        said.add(capsys.readouterr().err)
    assert len(said) == 1 and said.pop().startswith(f"error: {path}: {parameter} = 0: ")
