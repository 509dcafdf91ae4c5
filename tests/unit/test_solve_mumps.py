"""The table [solve.mumps]: what it may hold, where it belongs, and that it is said where it has no effect."""

from __future__ import annotations

import tomllib

import pytest
from scene_texts import replaced, write_scene

from fe_squeal import parse_scene
from fe_squeal.cli import main
from fe_squeal.eigen.linear import choice
from fe_squeal.eigen.linear.mumps import Mumps, MumpsOptions, has_mumps
from fe_squeal.scene.solver import solver_of

FAULTS = {
    "unknown": ('[solve.mumps]\nout_of_cor = true', 'solve.mumps.out_of_cor: unknown key; did you mean "out_of_core"?'),
    "type": ("[solve.mumps]\nout_of_core = 1", "solve.mumps.out_of_core: given 1; expected"),
    "rough": ("[solve.mumps]\nlow_rank = 1.0", "solve.mumps.low_rank: given 1.0; expected a number < 1"),
    "sign": ("[solve.mumps]\nlow_rank = 0.0", "solve.mumps.low_rank: given 0.0; expected a number > 0"),
    "percent": ("[solve.mumps]\nmemory_relaxation = -1", "solve.mumps.memory_relaxation: given -1; expected"),
    "no files": ('[solve.mumps]\nfolder = "/tmp"',
                 "solve.mumps: given folder, but factors stay in memory; expected out_of"),
    "other solver": ('linear_solver = "superlu"\n[solve.mumps]\nout_of_core = true',
                     'solve: given the table mumps with linear_solver = "superlu"'),
}  # fmt: skip


def with_table(lines: str) -> str:
    return replaced("modes = 8", f"modes = 8\n{lines}")


@pytest.mark.parametrize("kind", FAULTS)
def test_faults_are_one_message_with_file_and_key(tmp_path, capsys, kind):
    lines, message = FAULTS[kind]
    path = write_scene(tmp_path, with_table(lines))
    assert main(["check", str(path)]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"error: {path}: ") and message in said and said.count("\n") == 1


@pytest.mark.slow
def test_it_is_said_where_another_solver_factorises(tmp_path, capsys):
    """ "auto" is MUMPS on several processes alone; the scene runs without them, too."""
    path = write_scene(tmp_path, with_table("[solve.mumps]\nout_of_core = true"))
    assert main(["check", str(path)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "solve.mumps has no effect:" in said
    assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 0
    assert "note: solve.mumps has no effect:" in capsys.readouterr().out


def test_options_reach_the_solver(tmp_path, monkeypatch):
    """A folder is relative to the scene file; without the table nothing is asked for."""
    monkeypatch.setattr(choice, "has_mumps", lambda: True)
    table = 'out_of_core = true\nfolder = "files"\nlow_rank = 1e-9\nmemory_relaxation = 50'
    scene = parse_scene(tomllib.loads(with_table(f'linear_solver = "mumps"\n[solve.mumps]\n{table}')))
    expected = MumpsOptions(True, str(tmp_path / "files"), 1e-9, 50)
    monkeypatch.chdir(tmp_path)
    assert solver_of(scene) == Mumps(expected)
    assert solver_of(parse_scene(tomllib.loads(with_table('linear_solver = "mumps"')))) == Mumps()


@pytest.mark.skipif(has_mumps(), reason="with petsc4py")
def test_without_mumps_it_is_that_which_is_missing(tmp_path, capsys):
    path = write_scene(tmp_path, with_table('linear_solver = "mumps"\n[solve.mumps]\nlow_rank = 1e-9'))
    assert main(["check", str(path)]) == 2
    assert "MUMPS cannot be loaded on this machine" in capsys.readouterr().err
