"""Truncated and mutated files end in a mesh or in a MeshError, nothing else, and soon."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fe_squeal.errors import MeshError
from fe_squeal.mesh import LoadedMesh, load_mesh

DATA = Path(__file__).parents[1] / "data"
FILES = sorted(path.name for path in DATA.glob("mesh_*"))


def outcome(path):
    try:
        loaded = load_mesh(path)
    except MeshError as error:
        assert "\n" not in str(error) and len(str(error)) > 10
        return "refused"
    assert isinstance(loaded, LoadedMesh) and np.isfinite(loaded.mesh.doflocs).all()
    return "loaded"


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_truncated(tmp_path, name, capsys):
    data = (DATA / name).read_bytes()
    target = tmp_path / name
    outcomes = []
    for length in np.linspace(1, len(data), 40, dtype=int):
        target.write_bytes(data[:length])
        outcomes.append(outcome(target))
    assert outcomes[0] == "refused" and outcomes[-1] == "loaded"
    assert capsys.readouterr().out == ""


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_mutated(tmp_path, name):
    data = np.frombuffer((DATA / name).read_bytes(), dtype=np.uint8)
    rng = np.random.default_rng(sum(name.encode()))
    target = tmp_path / name
    outcomes = []
    for round_ in range(40):
        bad = data.copy()
        at = rng.integers(0, len(bad), 1 + round_ % 6)
        bad[at] = rng.choice(np.frombuffer(b"0123456789-.,* \n$\0\xffeED", dtype=np.uint8), len(at))
        target.write_bytes(bad.tobytes())
        outcomes.append(outcome(target))
    assert "refused" in outcomes
