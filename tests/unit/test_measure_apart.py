"""A measurement in a process of its own: what it gives, what its failures become, and that it ends with its parent."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from accuracy_cases import belt_scene, sliding_scene

from fe_squeal.accuracy.measure import measure, measure_apart
from fe_squeal.accuracy.settings import Setting
from fe_squeal.errors import MeshError

COARSE = Setting(1, 0.04, 6, "direct", 1e-8)


@pytest.mark.slow
def test_same_as_in_this_process():
    scene, _ = sliding_scene("hex", 1, 0.04)
    here, probes = measure(scene, COARSE, None, True)
    [there, same] = measure_apart(scene, COARSE, None, True, None) or pytest.fail("no result")
    np.testing.assert_array_equal(probes, same)
    np.testing.assert_allclose(there.lam, here.lam, rtol=1e-9)
    np.testing.assert_allclose(there.likely, here.likely, atol=1e-6 * np.abs(here.lam).max())


@pytest.mark.slow
def test_failure_and_limit():
    with pytest.raises(MeshError, match='no surface group "nowhere"'):
        measure_apart(belt_scene(supports=[{"surface": "nowhere", "fixed": "z"}]), COARSE, None, False, None)
    assert measure_apart(belt_scene(), COARSE, None, False, 1e-3) is None


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for the process in /proc")
def test_child_ends_with_its_parent(tmp_path: Path):
    """A parent that is killed cannot end the child; left alone, it would compute for minutes."""
    script = tmp_path / "parent.py"
    script.write_text(f"""
import multiprocessing, sys, threading, time
sys.path.insert(0, {str(Path(__file__).parents[2] / "benchmarks")!r})
from accuracy_cases import sliding_scene
from fe_squeal.accuracy.measure import measure_apart
from fe_squeal.accuracy.settings import Setting

def tell():
    while not multiprocessing.active_children():
        time.sleep(0.01)
    print(multiprocessing.active_children()[0].pid, flush=True)

if __name__ == "__main__":
    threading.Thread(target=tell, daemon=True).start()
    measure_apart(sliding_scene("hex", 2, 0.003)[0], Setting(2, 0.003, 20, "direct", 1e-8), None, False, None)
""")
    parent = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    child = Path("/proc") / parent.stdout.readline().strip()
    deadline = time.monotonic() + 120.0
    while running(child) and parent.poll() is None and seconds(child) < 3.0:  # until its threads are there
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert running(child) and parent.poll() is None
    parent.kill()
    parent.wait()
    while running(child):
        assert time.monotonic() < deadline, "the child goes on"
        time.sleep(0.05)


def running(process: Path) -> bool:
    """Return whether a process is there, and no zombie that nobody has asked for."""
    try:
        return (process / "stat").read_text().rsplit(")", 1)[1].split()[0] not in "ZX"
    except (FileNotFoundError, ProcessLookupError):
        return False


def seconds(process: Path) -> float:
    """Return the time that a process has computed."""
    fields = (process / "stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / 100.0
