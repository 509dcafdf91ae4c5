"""Real limits on the memory of the process: whatever runs out of it ends in one message with numbers, exit code 2."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from scene_texts import SCENE, environment, replaced, write_scene

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="RLIMIT_AS as on Linux")

# As many MiB more than the loaded program takes; the last one is enough.
PROGRAM = """
import resource, sys
import fe_squeal.cli, fe_squeal.run.run, fe_squeal.report.contributions, fe_squeal.report.export
import psutil, scipy.sparse.linalg, matplotlib.figure
from fe_squeal.eigen.linear.choice import solver_name
solver_name()
limit = psutil.Process().memory_info().vms + int(sys.argv[1]) * 2**20
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
sys.exit(fe_squeal.cli.main(["run", sys.argv[2], "-o", "out"]))
"""
FINE = replaced("size = 0.02", "size = 0.004", replaced("order = 1", "order = 2", replaced('file = "block.msh"\n', "")))


def run_with(extra: int, folder: Path, text: str) -> subprocess.CompletedProcess[str]:
    path = write_scene(folder, text)
    environment_ = environment(OPENBLAS_NUM_THREADS="1")
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, str(extra), path.name], cwd=folder, env=environment_, capture_output=True,
        encoding="utf-8", timeout=120,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("extra", "method"), [(20, "auto"), (70, "auto"), (110, "auto"), (150, "direct"), (250, "auto"), (250, "direct")]
)
def test_limits_of_the_process(tmp_path: Path, extra: int, method: str) -> None:
    """11 253 unknowns, of which mesh, matrices, factors and vectors take more than each of these limits."""
    done = run_with(extra, tmp_path, replaced("modes = 8", f'modes = 30\nmethod = "{method}"', FINE))
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("error: ") and done.stderr.count("\n") == 1
    assert re.search(r"(needs? more memory than the|needs? about|need) [\d.e+]+ [MG]iB", done.stderr)
    assert "are free" in done.stderr and "order = 1" in done.stderr
    if "sweep" in done.stderr:
        assert "unknowns would fit" in done.stderr or "fewer unknowns" in done.stderr
        assert ("reduced" in done.stderr) == (method == "direct")
    assert not (tmp_path / "out" / "modes.csv").exists()


@pytest.mark.slow
def test_limit_that_is_wide_enough(tmp_path: Path) -> None:
    """Else the tests above would be of a program that needs more than there can be."""
    done = run_with(4000, tmp_path, SCENE)
    assert done.returncode == 0, done.stderr


HUGE = {
    "size": ("size = 0.02", "size = 1e-9", "mesh.block: size = 1e-09 makes about"),
    "refinement": ("size = 0.02", "size = 0.02\nrefinement = 1000000", "elements, and at most 3e+06 are meshed"),
    "digits": ("size = 0.02", f"size = 0.02\nrefinement = 1{'0' * 400}", "mesh.block.refinement: given a whole number"),
    "points": ("points = 5", "points = 1000000000", "sweep.points: given 1000000000; expected a whole number ≤ 100000"),
    "modes": ("modes = 8", "modes = 1000000000", "solve.modes: given 1000000000; expected at most 90"),
    "values": ("points = 5", f"points = 1{'0' * 400}", "sweep.points"),
}


@pytest.mark.parametrize("kind", HUGE)
def test_huge_numbers_are_refused_at_once(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They are not tried: memory grows by less than what their arrays would take."""
    from fe_squeal.cli import main
    from fe_squeal.eigen.memory import peak_memory_mib

    old, new, message = HUGE[kind]
    before = peak_memory_mib()
    text = replaced(old, new, replaced('file = "block.msh"\n', ""))
    assert main(["run", str(write_scene(tmp_path, text)), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert message in said and said.count("\n") == 1
    assert before is None or (peak_memory_mib() or 0) - before < 200
