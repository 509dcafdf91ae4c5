"""Factors on disk and low-rank factors of MUMPS: the same solutions, or an error; `make test-mpi` has petsc4py."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from chains import chain
from scene_texts import replaced, write_scene

from fe_squeal import sweep
from fe_squeal.cli import main
from fe_squeal.eigen.linear import scratch
from fe_squeal.eigen.linear.mumps import Mumps, MumpsFactor, MumpsOptions, has_mumps
from fe_squeal.eigen.linear.refinement import contraction
from fe_squeal.errors import NotConvergedError, SceneError, TooLargeError
from fe_squeal.process.ranks import process_count

needs_mumps = pytest.mark.skipif(not has_mumps(), reason="no petsc4py with MUMPS; see make test-mpi")
alone = pytest.mark.skipif(process_count() > 1, reason="of one process")
FINE = replaced("size = 0.02", "size = 0.006", replaced("order = 1", "order = 2", replaced('file = "block.msh"\n', "")))


def cube(m, shift=0.0, skew=0.0):
    """Minus Laplace on m³ points less a shift, with eigenvalues 4 Σ sin²(kπ/2(m + 1)), and a nonsymmetric part."""
    T = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(m, m))
    S, one = sp.diags_array([skew, -skew], offsets=[-1, 1], shape=(m, m)), sp.eye_array(m)
    A = sp.kron(sp.kron(T, one), one) + sp.kron(sp.kron(one, T), one) + sp.kron(sp.kron(one, one), T + S)
    return sp.csr_array(A - shift * sp.eye_array(m**3))


def below(m, shift):
    theta = 4 * np.sin(np.arange(1, m + 1) * np.pi / (2 * (m + 1))) ** 2
    return int(np.count_nonzero(theta[:, None, None] + theta[:, None] + theta < shift))


def files_in(folder):
    return [path for path in folder.rglob("*") if path.is_file()]


def worst(A, x, b):
    return np.abs(A @ x - b).max() / np.abs(b).max()


@needs_mumps
@pytest.mark.parametrize("imaginary", [False, True])
def test_factors_on_disk_solve_alike(tmp_path, imaginary):
    A = cube(12, 0.3, 0.2)
    A = sp.csr_array(A + 0.1j * cube(12)) if imaginary else A
    factor = MumpsFactor(A, False, options=MumpsOptions(True, str(tmp_path)))
    assert sum(path.stat().st_size for path in files_in(tmp_path)) > 8 * A.nnz
    b = np.random.default_rng(0).standard_normal((A.shape[0], 3))
    for apply, way in ((factor.solve, A), (factor.solve_transposed, A.T), (factor.solve_adjoint, A.conj().T)):
        assert worst(way, apply(b), b) < 1e-11


@needs_mumps
def test_a_sweep_on_disk_is_that_in_memory(tmp_path):
    values, options = np.linspace(0.0, 0.9, 4), MumpsOptions(True, str(tmp_path))
    expected = sweep(chain(n=450), values, modes=8, linear_solver="superlu", method="direct")
    found = sweep(chain(n=450), values, modes=8, linear_solver=Mumps(options), method="direct")
    assert files_in(tmp_path)
    for a, b in zip(found.points, expected.points, strict=True):
        np.testing.assert_allclose(a.modes.lam, b.modes.lam, rtol=0, atol=1e-9 * np.abs(b.modes.lam).max())


@needs_mumps
def test_low_rank_solves_are_as_exact_and_count_alike():
    """Blocks are compressed from fronts of some hundred unknowns on; what MUMPS itself solves is wrong by far more."""
    m = 28
    A = cube(m, 0.05)
    b = np.random.default_rng(0).standard_normal((m**3, 2))
    factor = MumpsFactor(A, True, options=MumpsOptions(low_rank=1e-6))
    assert worst(A, factor._apply(b, False), b) > 1e-6  # or nothing would be refined
    assert worst(A, factor.solve(b), b) < 1e-11
    assert factor.negative_pivots == below(m, 0.05)
    with pytest.raises(NotConvergedError, match=r"low_rank = 0\.3 .* too rough: a step of refinement leaves"):
        MumpsFactor(A, True, options=MumpsOptions(low_rank=0.3))


@pytest.mark.parametrize("rho", [0.4, 0.02, 1e-5])
def test_contraction_is_the_spectral_radius(rho):
    """Of 1 − AB⁻¹ with A = (1 − ρ s) B, s random with largest size one; sign and units of the rows do not matter."""
    rng = np.random.default_rng(1)
    n = 300
    units, share = 10.0 ** rng.uniform(-3, 3, n), rng.uniform(-1, 1, n)
    share[:6] = 1.0
    B = units**2 * rng.choice([-1, 1], n)
    A = sp.csr_array(sp.diags_array((1 - rho * share) * B))
    assert contraction(A, lambda b: b / B[:, None]) == pytest.approx(rho, rel=0.2)


@needs_mumps
@alone
def test_the_forecast_is_that_of_the_options():
    """On disk less, with room more."""
    A = cube(20)
    plain, disk, room = (
        Mumps(options).memory(A, True)
        for options in (MumpsOptions(), MumpsOptions(out_of_core=True), MumpsOptions(memory_relaxation=200))
    )
    assert disk < 0.8 * plain and room > 1.5 * plain


@needs_mumps
def test_folders_that_cannot_be_used_are_named(tmp_path):
    with pytest.raises(SceneError, match=r"solve\.mumps\.folder: given .*none.*No such file"):
        MumpsFactor(cube(5), True, options=MumpsOptions(True, str(tmp_path / "none")))


@needs_mumps
def test_a_disk_that_is_too_small_is_refused_beforehand(tmp_path, monkeypatch):
    from fe_squeal.eigen.linear import mumps

    monkeypatch.setattr(mumps, "_FORECAST", 100)
    monkeypatch.setattr(mumps.shutil, "disk_usage", lambda _: SimpleNamespace(free=2**18))
    with pytest.raises(TooLargeError, match=r"solve\.mumps\.folder: the factors of 1728 unknowns need .* 0\.25 MiB"):
        MumpsFactor(cube(12), True, options=MumpsOptions(True, str(tmp_path)))
    assert not files_in(tmp_path)


@needs_mumps
@alone
def test_files_that_are_gone_end_in_one_sentence(tmp_path):
    """As where somebody clears the folder; solves with other factors go on, also when these are given up."""
    A, b = cube(12), np.ones(12**3)
    factor, other = (MumpsFactor(A, True, options=o) for o in (MumpsOptions(True, str(tmp_path)), MumpsOptions()))
    assert worst(A, factor.solve(b), b) < 1e-11
    for path in files_in(tmp_path):
        path.unlink()
    with pytest.raises(TooLargeError, match=r"solve\.mumps\.folder: MUMPS could not read the factors of 1728 unknowns"):
        factor.solve(b)
    del factor
    assert worst(A, other.solve(b), b) < 1e-11


def test_folders_of_runs_that_are_no_more_are_removed(tmp_path):
    """Of this machine, and of processes that do not live; another one's stay."""
    import socket

    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    names = {f"fe_squeal_factors_{socket.gethostname()}_{pid}_x": pid == dead.pid for pid in (dead.pid, os.getpid())}
    names |= {f"fe_squeal_factors_elsewhere_{dead.pid}_x": False, "fe_squeal_factors_": False}
    for name in names:
        (tmp_path / name).mkdir()
        (tmp_path / name / "factors").touch()
    made = scratch.scratch_folder.__wrapped__(str(tmp_path))
    assert made.is_dir() and {name: not (tmp_path / name).exists() for name in names} == names


def test_on_another_machine_files_are_in_a_folder_of_its_own(tmp_path, monkeypatch):
    """It removes those of runs that were killed there, which the first process's machine does not see."""
    import socket

    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    host, disk = socket.gethostname(), tmp_path / "disk"  # which is not there before
    whole = disk / f"fe_squeal_factors_elsewhere_{os.getpid()}_x"
    monkeypatch.setattr(scratch, "_made", [])
    scratch.scratch_folder.cache_clear()
    own = scratch.own_folder(str(whole), 3)
    assert own == scratch.own_folder(str(whole), 3) and own.is_dir() and not whole.exists()
    killed = own.parent.rename(disk / f"fe_squeal_factors_{host}_{dead.pid}_x")
    scratch.scratch_folder.cache_clear()
    own = scratch.own_folder(str(whole), 3)
    assert not killed.exists() and own.is_dir()
    assert own.parent.name.startswith(f"fe_squeal_factors_{host}_{os.getpid()}_")
    scratch.remove_scratch()
    scratch.scratch_folder.cache_clear()
    assert not list(disk.iterdir())


# A process that is started by one of mpiexec's is none of these: it would be ended by MPI if it looked like one.
OUTSIDE = {name: value for name, value in os.environ.items() if not name.startswith(("OMPI_", "PMIX_", "PRTE_"))}

LIMITED = """
import resource, sys
from fe_squeal.cli import main
from fe_squeal.eigen.linear.petsc import petsc
petsc()  # which starts MPI: that needs larger files
resource.setrlimit(resource.RLIMIT_FSIZE, (2**20, 2**20))
sys.exit(main(["run", sys.argv[1], "-o", "out"]))
"""


def out_of_core(tmp_path, text=FINE):
    lines = 'modes = 8\nmethod = "direct"\nlinear_solver = "mumps"\n[solve.mumps]\nout_of_core = true\nfolder = "files"'
    (tmp_path / "files").mkdir()
    return write_scene(tmp_path, replaced("modes = 8", lines, text))


@needs_mumps
@alone
@pytest.mark.slow
def test_a_full_disk_ends_in_one_sentence(tmp_path):
    """Files of at most 1 MiB stand for a full disk: another error of the system at a write, the same of MUMPS."""
    path = out_of_core(tmp_path)
    done = subprocess.run([sys.executable, "-c", LIMITED, path.name], cwd=tmp_path, capture_output=True, text=True,
                          env=OUTSIDE, timeout=200)  # fmt: skip
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert "solve.mumps.folder: MUMPS could not write the factors of" in done.stderr
    assert not list((tmp_path / "files").iterdir())


@needs_mumps
@alone
@pytest.mark.slow
def test_files_are_removed_at_the_end_and_after_an_interruption(tmp_path, capsys):
    path = out_of_core(tmp_path, replaced("points = 5", "points = 40", FINE))
    process = subprocess.Popen([sys.executable, "-m", "fe_squeal", "run", path.name, "-o", "out"], cwd=tmp_path,
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=OUTSIDE)  # fmt: skip
    deadline = time.monotonic() + 100
    while not files_in(tmp_path / "files") and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    assert files_in(tmp_path / "files")
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=100)
    assert process.returncode == 130, said
    assert not list((tmp_path / "files").iterdir())
    assert main(["check", str(path)]) == 0
    assert "out of core" in " ".join(capsys.readouterr().out.split())
