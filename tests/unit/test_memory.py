"""What a problem needs is known before it is solved, and what cannot fit is refused."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from scene_texts import write_scene

from fe_squeal.cli import main
from fe_squeal.eigen import memory
from fe_squeal.eigen.linear import superlu
from fe_squeal.eigen.linear.choice import factor_memory
from fe_squeal.eigen.linear.pardiso import PardisoFactor, has_pardiso
from fe_squeal.errors import TooLargeError

needs_pardiso = pytest.mark.skipif(not has_pardiso(), reason="PARDISO is not installed")


def line(m: int) -> sp.dia_array:
    return sp.diags_array([2.001 * np.ones(m), -np.ones(m - 1), -np.ones(m - 1)], offsets=[0, 1, -1])


def solid(m: int) -> sp.csr_array:
    """The seven-point matrix of a cube."""
    along, one = line(m), sp.eye_array(m)
    parts = [sp.kron(sp.kron(a, b), c) for a, b, c in ((along, one, one), (one, along, one), (one, one, along))]
    return sp.csr_array(parts[0] + parts[1] + parts[2])


def test_there_is_memory_and_limits_count(tmp_path, monkeypatch):
    free = memory.available_memory()
    assert free > 2**28
    (tmp_path / "memory.max").write_text("1000000\n")
    (tmp_path / "memory.current").write_text("400000\n")
    monkeypatch.setattr(memory, "_GROUP", tmp_path)
    assert memory.available_memory() == 600_000
    (tmp_path / "memory.stat").write_text("anon 300000\ninactive_file 100000\nactive_file 0\n")
    assert memory.available_memory() == 700_000  # files that were read count as used until somebody wants the memory
    (tmp_path / "memory.max").write_text("max\n")
    assert memory.available_memory() > 2**28


def group(folder: Path, **files: object) -> None:
    """Write the files of a control group, named with _ for a point."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (folder / f"memory.{name}").write_text(f"{content}\n")


@pytest.fixture
def groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Path]:
    """Make this process one of control groups, by the lines that the system has of them; returns their folder."""

    def of(lines: str) -> Path:
        (tmp_path / "cgroup").write_text(lines)
        monkeypatch.setattr(memory, "_GROUP", tmp_path / "fs")
        monkeypatch.setattr(memory, "_MEMBER", tmp_path / "cgroup")
        return tmp_path / "fs"

    return of


@pytest.mark.parametrize(("job", "step", "free"), [
    (900_000, "max", 600_000), (900_000, 300_000, 200_000), ("max", "max", None),
])  # fmt: skip
def test_limits_of_a_job_count(job: object, step: object, free: int | None, groups: Callable[[str], Path]) -> None:
    """Of SLURM or systemd, cgroup v2: its own group's and those of the groups around it, which it may not see all."""
    root = groups("0::/system.slice/job_7/step_0/task\n")
    around = root / "system.slice" / "job_7"
    group(around, max=job, current=400_000, stat="anon 1\ninactive_file 100000")
    group(around / "step_0", max=step, current=100_000)
    (around / "step_0" / "task").mkdir()
    found = memory.available_memory()
    assert found == free if free else found > 2**28


def test_limits_of_older_systems_count(groups: Callable[[str], Path]) -> None:
    """cgroup v1: by the line of the controller, beside other ones; a limit near 2⁶³ is none."""
    root = groups("11:cpu,cpuacct:/job\n7:memory:/slurm/uid_0/job_7\n1:name=systemd:/memory\n0::/user.slice\n")
    none = 2**63 - 4096
    job = root / "memory" / "slurm" / "uid_0" / "job_7"
    group(root / "memory", limit_in_bytes=none, usage_in_bytes=10**9)
    group(job.parent, limit_in_bytes=none, usage_in_bytes=10**6)
    group(job, limit_in_bytes=none, usage_in_bytes=10**6)
    assert memory.available_memory() > 2**28
    group(job.parent, limit_in_bytes=700_000, usage_in_bytes=400_000, stat="inactive_file 1\ntotal_inactive_file 50000")
    assert memory.available_memory() == 350_000


def test_a_group_that_is_not_there_is_no_limit(groups: Callable[[str], Path], tmp_path: Path) -> None:
    """As of a container that sees its own files as the uppermost, by a name from outside; and lines of nonsense."""
    root = groups("0::/docker/1f/../..\nnonsense\n")
    group(root, max=900_000, current=400_000)
    group(tmp_path, max=1000, current=999)
    assert memory.available_memory() == 500_000


def test_what_cannot_fit_is_refused_with_numbers(monkeypatch):
    monkeypatch.setattr(memory, "available_memory", lambda: 2**30)
    memory.require_memory(2**30, 1000)
    with pytest.raises(TooLargeError, match=r"need 16 GiB.*1 GiB are free; about 10000 unknowns would fit"):
        memory.require_memory(2**34, 80_000)  # an eighth of the unknowns needs a sixteenth of the memory


@pytest.mark.slow
@needs_pardiso
@pytest.mark.parametrize("definite", [True, False])
def test_analysis_knows_what_the_factors_take(definite):
    """Against the resident memory that factorising really adds, and against another size of the same solid."""
    small, large = (factor_memory(solid(m), True, definite) for m in (24, 48))
    assert 8 < large / small < 8**1.5
    code = f"""
import sys; sys.path[:0] = {[str(folder) for folder in Path(__file__).parents[:2]]!r}
import psutil
from test_memory import solid
from fe_squeal.eigen.linear.pardiso import PardisoFactor
A = solid(44)
PardisoFactor(solid(6), True, {definite})
before = psutil.Process().memory_info().rss
factor = PardisoFactor(A, True, {definite})
print(factor.memory, psutil.Process().memory_info().rss - before)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    told, taken = (int(part) for part in done.stdout.split())
    assert 0.6 < told / taken < 1.7


@needs_pardiso
def test_solvers_refuse_before_they_factorise(monkeypatch):
    monkeypatch.setattr(memory, "available_memory", lambda: 1000)
    phases = []
    call = PardisoFactor._call
    monkeypatch.setattr(PardisoFactor, "_call", lambda self, phase, b: (phases.append(phase), call(self, phase, b))[1])
    with pytest.raises(TooLargeError):
        PardisoFactor(solid(6), True)
    assert 22 not in phases
    with pytest.raises(TooLargeError):
        superlu.SuperLUFactor(solid(6), True)


@pytest.mark.parametrize("symmetric", [True, False])
def test_superlu_law_is_right_to_a_factor_of_three(symmetric):
    """Vector-valued and denser matrices come nearer to the law than this one."""
    for m in (16, 22):
        A = solid(m)
        factors = superlu.SuperLUFactor(A, symmetric)._lu
        real = 12 * (factors.L.nnz + factors.U.nnz) * (2 if symmetric else 1)  # with the copy whose pivots are counted
        assert 1 / 3 < superlu.superlu_memory(A, symmetric) / real < 3


def narrow(kind: str) -> sp.csr_array:
    """A chain, a strip of squares with six unknowns a node, or the same matrix with nodes in any order."""
    if kind == "chain":
        return sp.csr_array(line(3000))
    A = sp.csr_array(sp.kron(sp.kron(line(250), line(4)), np.ones((6, 6)) + 90 * np.eye(6)))
    order = np.random.default_rng(1).permutation(A.shape[0]) if kind == "shuffled" else np.arange(A.shape[0])
    return sp.csr_array(A[order][:, order])


@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("kind", ["chain", "strip", "shuffled"])
def test_narrow_matrices_need_less_than_solids(kind: str, symmetric: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The envelope of a triangle holds each factor, and of beams and strips not much more; rows are exchanged, too."""
    A = narrow(kind)
    if not symmetric:
        rng = np.random.default_rng(2)
        A.data = rng.uniform(-1, 1, A.nnz)
        A = sp.csr_array(sp.triu(A) + sp.tril(A) * (rng.uniform(size=A.shape[0]) < 0.9)[:, None])
    told = superlu.superlu_memory(A, symmetric)
    assert told < superlu.solid_memory(A, symmetric) / 3
    monkeypatch.setattr(memory, "available_memory", lambda: told)
    factors = superlu.SuperLUFactor(A, symmetric)._lu
    real = 12 * (factors.L.nnz + factors.U.nnz) * (2 if symmetric else 1)
    assert 0.9 < told / real < 5
    monkeypatch.setattr(memory, "available_memory", lambda: told - 1)
    with pytest.raises(TooLargeError, match=r"about .* unknowns would fit"):
        superlu.SuperLUFactor(A, symmetric)


def test_envelopes_are_counted() -> None:
    """Of a chain 2n − 1 entries in a triangle; of unknowns alone n; of a full matrix n(n + 1)/2; also with one side."""
    n = 50
    upper = sp.diags_array([np.ones(n - 1)], offsets=[1], shape=(n, n))
    none, full = sp.csr_array((n, n)), np.ones((n, n))
    for A, count in ((upper, 2 * n - 1), (none, n), (sp.eye_array(n), n), (full, n * (n + 1) // 2)):
        assert superlu._envelope(sp.csr_array(A)) == count
    # A million unknowns in a chain: 2n - 1 entries of eight bytes and an index in L and in U, and their copies.
    assert superlu.superlu_memory(sp.csr_array(line(10**6)), True) == 2 * 2 * (2 * 10**6 - 1) * 12


def test_command_says_what_would_fit(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(memory, "available_memory", lambda: 2**16)
    monkeypatch.setattr(memory, "_BUFFERS", 0)
    root = Path(__file__).parents[2]
    text = (root / "examples" / "disc_pad.toml").read_text("utf-8")
    scene = write_scene(tmp_path, text.replace("../meshes", (root / "meshes").as_posix()))
    assert main(["run", str(scene), "-o", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert "of memory" in told and "would fit" in told and "Traceback" not in told


def test_check_prints_the_prediction(tmp_path, capsys):
    assert main(["check", str(write_scene(tmp_path))]) == 0
    assert "predicted memory" in capsys.readouterr().out
