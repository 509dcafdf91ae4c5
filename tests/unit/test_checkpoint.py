"""The files from which an interrupted run goes on: damaged, written by another version, or made to do harm."""

from __future__ import annotations

import io
import json
import shutil
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from interrupted import interrupt, refused, write_sweep

import fe_squeal
import fe_squeal.run.run
from fe_squeal.cli import main
from fe_squeal.eigen.request import Completeness
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.run import checkpoint
from fe_squeal.run.folder import hold_folder
from fe_squeal.sweep.state import SweepState


@pytest.fixture(autouse=True)
def _no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """They take most of the time of such small runs."""
    monkeypatch.setattr(fe_squeal.run.run, "write_figures", lambda *_: None)


class _Payload:
    """Unpickled, it makes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return Path.touch, (self.path,)


def truncated(content: bytes) -> bytes:
    return content[: len(content) // 2]


def flipped(content: bytes) -> bytes:
    at = len(content) // 3
    return content[:at] + bytes([content[at] ^ 0xFF]) + content[at + 1 :]


def without_json(content: bytes) -> bytes:
    found = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as before, zipfile.ZipFile(found, "w") as after:
        for name in before.namelist():
            if name != "json.npy":
                after.writestr(name, before.read(name))
    return found.getvalue()


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a scene and the results of its run, interrupted at the third value."""
    folder = tmp_path_factory.mktemp("begun")
    with pytest.MonkeyPatch.context() as patch:
        interrupt(write_sweep(folder, 3), folder / "out", 3, patch)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("spoil", [truncated, flipped, without_json, lambda content: b"", lambda content: b"[]"])
@pytest.mark.parametrize("name", ["state.npz", "first.npz", "point_00000.npz"])
def test_damaged_checkpoint_is_refused(
    name: str, spoil: Any, begun: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(begun, tmp_path, dirs_exist_ok=True)
    path, out = write_sweep(tmp_path, 3), tmp_path / "out"
    file = out / "checkpoint" / name
    file.write_bytes(spoil(file.read_bytes()))
    assert f"{name}: the checkpoint is damaged" in refused(path, out, capsys)
    file.unlink()
    if name != "state.npz":
        assert f"{name}: the checkpoint is damaged" in refused(path, out, capsys)


def test_checkpoint_is_never_unpickled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = write_sweep(tmp_path, 3), tmp_path / "out"
    interrupt(path, out, 3, monkeypatch)
    mark = tmp_path / "executed"
    np.savez(out / "checkpoint" / "state.npz", json=np.array([_Payload(mark)], dtype=object))
    assert "state.npz: the checkpoint is damaged" in refused(path, out, capsys)
    assert not mark.exists()
    np.load(out / "checkpoint" / "state.npz", allow_pickle=True)["json"]
    assert mark.exists()  # else the test would be one of nothing


def test_damaged_record_of_inputs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = write_sweep(tmp_path, 3), tmp_path / "out"
    interrupt(path, out, 3, monkeypatch)
    for text in ("", "{", "[1]", "{}", '{"version": 1, "scene": 2, "content": 3}', "\xff"):
        (out / "checkpoint" / "inputs.json").write_text(text, encoding="latin-1")
        assert "run without --resume" in refused(path, out, capsys)


@pytest.fixture(scope="module")
def reduced(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a scene and the results of its run on a reduced model, interrupted at the third value."""
    folder = tmp_path_factory.mktemp("reduced")
    with pytest.MonkeyPatch.context() as patch:
        interrupt(write_sweep(folder, 3, "reduced"), folder / "out", 3, patch)
    return folder


def kept_names(file: Path) -> list[str]:
    """Return the names of the arrays in a file of a checkpoint, those of its tables behind "json"."""
    with np.load(file) as arrays:
        tables = json.loads(str(arrays["json"]))
        inner = [f"json.{k}.{i}" for k in ("completeness", "basis") if k in tables for i in tables[k]]
        return [name for name in arrays.files if name != "json"] + [f"json.{name}" for name in tables] + inner


def renamed(file: Path, name: str) -> None:
    """Write a file anew with one of its names as an older version might have called it."""
    with np.load(file) as found:
        arrays = dict(found)
    if not name.startswith("json."):
        arrays[f"old_{name}"] = arrays.pop(name)
    else:
        tables = json.loads(str(arrays["json"]))
        *outer, key = name.split(".")[1:]
        holder = tables[outer[0]] if outer else tables
        holder[f"old_{key}"] = holder.pop(key)
        arrays["json"] = np.array(json.dumps(tables))
    np.savez(file, **arrays)


OPTIONAL = ("shape_", "left")  # arrays of those modes that have them


@pytest.mark.slow
@pytest.mark.parametrize("name", ["model.npz", "state.npz", "first.npz", "point_00000.npz"])
def test_names_of_another_version_are_refused(
    name: str, reduced: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Names of arrays and in tables: one sentence that says what to do, and no results that lack something."""
    shutil.copytree(reduced, tmp_path, dirs_exist_ok=True)
    path, out = tmp_path / "reduced.toml", tmp_path / "out"
    file = out / "checkpoint" / name
    content, names = file.read_bytes(), kept_names(file)
    needed = [n for n in names if not n.startswith(OPTIONAL)]
    assert len(needed) >= 5
    for changed in needed:
        renamed(file, changed)
        said = refused(path, out, capsys)
        assert f"{name}: " in said and said.endswith("run without --resume to start anew\n"), changed
        file.write_bytes(content)
    assert main(["run", str(path), "-o", str(out), "--resume"]) == 0
    assert json.loads((out / "run.json").read_text(encoding="utf-8"))["status"] == "complete"


@pytest.mark.parametrize("layout", [None, checkpoint.LAYOUT - 1, checkpoint.LAYOUT + 1, str(checkpoint.LAYOUT)])
def test_another_layout_is_refused(
    layout: Any, begun: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of versions before layouts were numbered there is none."""
    shutil.copytree(begun, tmp_path, dirs_exist_ok=True)
    path, out = write_sweep(tmp_path, 3), tmp_path / "out"
    inputs = out / "checkpoint" / "inputs.json"
    known = json.loads(inputs.read_text(encoding="utf-8"))
    assert known.pop("layout") == checkpoint.LAYOUT
    inputs.write_text(json.dumps(known if layout is None else {**known, "layout": layout}), encoding="utf-8")
    said = refused(path, out, capsys)
    assert said == (
        f"error: {out / 'checkpoint'}: another version of the program left this checkpoint (what it kept is laid out"
        " in another way); run without --resume to start anew\n"
    )


def test_the_first_modes_are_kept_again_where_a_sweep_takes_others(tmp_path: Path) -> None:
    """A mode with θ = p²/2 is too slow to be followed from p = 0: the modes are followed from the next value on."""
    parts = [("m", "M", np.eye(2), {}), ("k", "K", np.diag([0.0, 20.0]), {}), ("p", "K", np.diag([0.5, 0.0]), {"p": 2})]
    terms = tuple(Term(name, slot, sp.csr_array(A), True, powers) for name, slot, A, powers in parts)
    with hold_folder(tmp_path / "out") as held:
        kept = checkpoint.Checkpoint(held)
        kept.begin({})

        class Store:
            load, load_model, save_model = kept.load, kept.load_model, kept.save_model

            @staticmethod
            def save(state: SweepState) -> None:
                kept.save(state)
                kept.flush()
                states.append(state)

            flush = staticmethod(kept.flush)

        states: list[SweepState] = []
        fe_squeal.sweep(Problem(terms, {"p": 0.0}), [0.0, 0.5, 1.0], "p", modes=2, method="direct", store=Store)
        found = checkpoint.Checkpoint(held).load()
    assert found is not None and states[0].first is not states[-1].first
    np.testing.assert_array_equal(found.first.lam, states[-1].first.lam)
    assert len(found.first_branches) == len(found.first)


def test_what_is_not_decided_so_far_is_in_the_result_so_far() -> None:
    """Which is what the record of a run that was killed says of its onsets."""
    nothing: Any = np.zeros(0)
    state = SweepState(
        (), (), (), Completeness(0, None, False), {}, nothing, nothing, nothing, nothing, 1, 0.0, 0.5, False, 0.25,
        ("an onset may be missing",),
    )  # fmt: skip
    one = sp.csr_array(np.eye(1))
    result = state.sweep(Problem((Term("m", "M", one, True), Term("k", "K", one, True)), {"mu": 0.0}), "mu")
    assert (result.window, result.unsettled) == (0.25, ("an onset may be missing",))
