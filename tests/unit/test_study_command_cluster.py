"""fe-squeal study on several processes and clusters: the same samples, and what is told where a part is missing."""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from functools import partial

import numpy as np
import pandas as pd
import pytest

import fe_squeal.run.run
from fe_squeal.cli import main
from fe_squeal.errors import NotConvergedError
from fe_squeal.study import pools, solving
from tests.studies import SCATTER, write_study

SAMPLES = SCATTER.replace("[study]", "[study]\nindices = false")  # these would start a cluster of their own


@pytest.fixture
def scene(tmp_path, no_figures):
    """Write a scene of two modes with a study, and return its path."""
    return partial(write_study, tmp_path)


@pytest.mark.slow
def test_any_number_of_workers_gives_the_same_samples(scene, tmp_path, recwarn):
    """No fixed port is asked for: that of Dask's dashboard is taken, and nobody hears of it."""
    pytest.importorskip("distributed")
    path = scene(SAMPLES, 128)
    with socket.socket() as taken:
        with contextlib.suppress(OSError):  # by somebody else, which does as well
            taken.bind(("127.0.0.1", 8787))
            taken.listen()
        for workers in (0, 2):
            arguments = ["study", str(path), "-o", str(tmp_path / f"{workers}")]
            assert main([*arguments, "--workers", str(workers)]) == 0
    assert not [str(w.message) for w in recwarn if "port" in str(w.message).lower()]
    assert (tmp_path / "0" / "samples.csv").read_text() == (tmp_path / "2" / "samples.csv").read_text()


@pytest.mark.slow
def test_a_cluster_that_loses_a_part(scene, tmp_path):
    """Two workers: without one of them the study goes on; without the scheduler it ends, and keeps what is done."""
    pytest.importorskip("distributed")
    path, address = scene(SAMPLES, 1024), tmp_path / "scheduler.json"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    scheduler = subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0", "--no-dashboard",
         "--scheduler-file", str(address)], env=environment, **quiet)  # fmt: skip
    started = [scheduler]

    def study(out, victim):
        """Kill a part in the middle of a study, and return the study's process and its exit code."""
        command = ["study", str(path), "-o", str(out), "--scheduler", where]
        process = subprocess.Popen(
            [sys.executable, "-m", "fe_squeal", *command], env=environment, stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE, encoding="utf-8",
        )  # fmt: skip
        started.append(process)
        for _ in range(600):
            if len(list((out / "parts").glob("samples_*.npz"))) >= 2:
                break
            time.sleep(0.05)
        assert process.poll() is None  # it goes on
        victim.send_signal(signal.SIGKILL)
        return process, process.wait(120)

    try:
        for _ in range(300):
            if address.exists() and address.stat().st_size:
                break
            time.sleep(0.1)
        where = json.loads(address.read_text())["address"]
        workers = [
            subprocess.Popen(
                [sys.executable, "-m", "distributed.cli.dask_worker", where, "--nthreads", "1", "--no-nanny",
                 "--no-dashboard"], env=environment, **quiet)
            for _ in range(2)
        ]  # fmt: skip
        started += workers
        assert study(tmp_path / "worker", workers[0])[1] == 0
        samples = pd.read_csv(tmp_path / "worker" / "samples.csv")
        assert (samples["sample"] == np.arange(1, 1025)).all()
        assert (samples["unstable"] == (samples["delta"] < 2 * samples["mu"])).all()
        out = tmp_path / "scheduler"
        process, code = study(out, scheduler)
        assert code == 3 and "the scheduler is gone" in process.stderr.read()
        assert json.loads((out / "study.json").read_text())["status"] == "not converged"
        assert len(list((out / "parts").glob("samples_*.npz"))) >= 2
    finally:
        for process in reversed(started):
            process.kill()
            process.wait()


@pytest.mark.slow
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "tls://127.0.0.1:9"])
def test_a_scheduler_that_does_not_answer_is_told(scene, tmp_path, capsys, monkeypatch, address):
    """Without certificates nothing is sent to an address of TLS."""
    pytest.importorskip("distributed")
    monkeypatch.setattr(pools, "_PATIENCE", 0.5)
    out = tmp_path / "out"
    assert main(["study", str(scene(SCATTER)), "-o", str(out), "--scheduler", address]) == 3
    said = capsys.readouterr().err
    assert f"no scheduler of Dask answers at {address}" in said and said.count("\n") == 1
    assert NotConvergedError.exit_code == 3


def test_what_is_no_address_is_refused_before_anything_is_solved(scene, tmp_path, capsys, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(solving, "make_solver", lambda *_, **__: pytest.fail("a model is made"))
    assert main(["study", str(scene(SCATTER)), "-o", str(tmp_path / "out"), "--scheduler", "nowhere"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: --scheduler: given nowhere; expected an address") and said.count("\n") == 1


@pytest.mark.slow
def test_workers_without_this_version_are_told(scene, tmp_path, capsys, monkeypatch):
    """Of another version, or without the module that they are sent, of which they would die one after the other."""
    distributed = pytest.importorskip("distributed")
    arguments = ["study", str(scene(SCATTER)), "-o", str(tmp_path / "out"), "--scheduler"]
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        with monkeypatch.context() as patched:
            patched.setattr(pools, "__version__", "0.0.0")
            assert main([*arguments, cluster.scheduler_address]) == 3
        assert f"and all its workers, found {fe_squeal.__version__}" in capsys.readouterr().err
        with monkeypatch.context() as patched:
            (tmp_path / "absent.py").write_text("def version(): pass\n")
            patched.syspath_prepend(tmp_path)  # of this process alone
            patched.setattr(pools, "_version", importlib.import_module("absent").version)
            assert main([*arguments, cluster.scheduler_address]) == 3
        said = capsys.readouterr().err
        assert "all its workers, found" in said and "No module named 'absent'" in said and said.count("\n") == 1
        assert main([*arguments, cluster.scheduler_address]) == 0


def test_without_dask_the_message_says_what_to_install(scene, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["study", str(scene(SCATTER)), "-o", str(tmp_path / "out"), "--workers", "2"]) == 2
    assert "fe-squeal[cluster]" in capsys.readouterr().err
