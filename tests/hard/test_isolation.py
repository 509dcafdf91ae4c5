"""Nothing of a stranger's is run: files of the working folder that are called like Python's own modules."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from accuracy_cases import belt_scene
from scene_texts import environment, replaced, write_scene

import fe_squeal
from fe_squeal.accuracy.measure import measure_apart
from fe_squeal.accuracy.settings import Setting
from fe_squeal.errors import MeshError
from fe_squeal.process import ranks
from fe_squeal.process.isolation import isolated_children, isolated_environment
from fe_squeal.study.pools import Processes, pool_of

MODULES = ("json", "queue", "pickle", "socket", "numpy", "selectors", "sitecustomize", "fe_squeal", "fe_squeal_start")


@pytest.fixture
def strange(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A working folder with such files; each leaves a mark when it is imported, and is of no use."""
    monkeypatch.chdir(tmp_path)
    for name in MODULES:
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'executed')!r}, 'a').write('{name} ')\n")
    yield tmp_path
    mark = tmp_path / "executed"
    assert not mark.exists(), mark.read_text()


@pytest.mark.parametrize("path", ["", ".", ":", "relative"])
def test_such_files_are_dangerous_and_children_do_not_see_them(
    path: str, strange: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever PYTHONPATH says of the working folder."""
    monkeypatch.setenv("PYTHONPATH", path)
    command = [sys.executable, "-c", "import json, fe_squeal_start; print(json.__file__, fe_squeal_start.__file__)"]
    subprocess.run(command, check=False, capture_output=True)
    (strange / "executed").unlink()  # else the files held no danger
    done = subprocess.run(command, env=isolated_environment(), check=True, capture_output=True, text=True)
    assert str(strange) not in done.stdout


def test_children_import_the_same_package() -> None:
    first = isolated_environment()["PYTHONPATH"].split(os.pathsep)[0]
    assert Path(first) == Path(fe_squeal.__file__).resolve().parents[1]


def test_modules_of_the_user_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "of_the_user.py").write_text("")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    subprocess.run([sys.executable, "-c", "import of_the_user, fe_squeal"], env=isolated_environment(), check=True)
    with isolated_children():
        pass
    monkeypatch.delenv("PYTHONPATH")
    with isolated_children():
        assert "PYTHONSAFEPATH" in os.environ
    assert "PYTHONPATH" not in os.environ


STARTED = {
    "Open MPI": {"OMPI_COMM_WORLD_SIZE": "2", "OMPI_COMM_WORLD_RANK": "0", "PMIX_RANK": "0", "PMIX_NAMESPACE": "1"},
    "MPICH": {"PMI_SIZE": "2", "PMI_RANK": "0", "PMI_FD": "7", "MPI_LOCALNRANKS": "2"},
    "srun": {"PMIX_RANK": "0", "SLURM_NTASKS": "2", "SLURM_PROCID": "0", "SLURM_STEP_ID": "0"},
}  # fmt: skip


@pytest.mark.parametrize("launcher", STARTED)
def test_children_are_none_of_the_processes_of_mpiexec(launcher: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor does this process take itself for a single one meanwhile."""
    for key in [key for key in os.environ if key.startswith(("OMPI_", "PMI", "MPI_", "SLURM_"))]:
        monkeypatch.delenv(key)
    for key, value in STARTED[launcher].items():
        monkeypatch.setenv(key, value)
    monkeypatch.setattr(ranks, "_TOLD", dict(os.environ))
    before = dict(os.environ)
    program = "from fe_squeal.process.ranks import process_count; print(process_count())"
    with isolated_children():
        inside = ranks.process_count()
        left = {key for key in STARTED[launcher] if key in os.environ and not key.startswith("SLURM_")}
        said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert (inside, left, said.strip()) == (2, set(), "1")
    assert dict(os.environ) == before


@pytest.mark.slow
def test_measurements_in_processes_of_their_own(strange: Path) -> None:
    scene = belt_scene(supports=[{"surface": "nowhere", "fixed": "z"}])
    with pytest.raises(MeshError, match='no surface group "nowhere"'):
        measure_apart(scene, Setting(1, 0.04, 6, "direct", 1e-8), None, False, None)


@pytest.mark.slow
def test_workers_of_a_study(strange: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    """They run nothing of the working folder either, listen to this machine alone, and leave no temporary folder."""
    pytest.importorskip("distributed")
    temporary = tmp_path_factory.mktemp("temporary")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tempfile, "tempdir", str(temporary))
        with pool_of(Processes(workers=2)) as pool:
            pool.add(pow, 2, [(0, 3), (1, 5)])
            assert sorted(pool) == [(0, 8), (1, 32)]
            own = psutil.Process()
            sockets = [s for p in (own, *own.children(recursive=True)) for s in p.net_connections("tcp")]
            addresses = {s.laddr.ip for s in sockets if s.status == psutil.CONN_LISTEN}
    assert addresses == {"127.0.0.1"}
    assert not list(temporary.iterdir())


@pytest.mark.slow
def test_the_command_itself(strange: Path) -> None:
    """With the process that draws the shapes: it is VTK that draws, not the plainer pictures of its failure."""
    command = Path(sys.executable).with_name("fe-squeal")
    (strange / "matplotlibrc").write_text("text.usetex: True\ntext.latex.preamble: \\input{executed}\n")
    text = replaced("points = 5", "points = 2").replace('shapes = "none"', 'shapes = "unstable"')
    write_scene(strange, text)
    done = subprocess.run(
        [command, "run", "block.toml", "-o", "out"], env=environment(), capture_output=True, encoding="utf-8",
        timeout=120,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert len(list((strange / "out" / "shapes").glob("*.png"))) == 1
