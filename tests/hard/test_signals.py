"""Signals, whenever they come: nothing is lost and nothing is left behind."""

from __future__ import annotations

import importlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import psutil
import pytest
from interrupted import assert_same_results, sweep_text, write_sweep
from matplotlib.figure import Figure
from matplotlib.text import Text
from scene_texts import environment, write_scene

from fe_squeal.cli import main
from fe_squeal.errors import InputError, OutputError
from fe_squeal.process import signals
from fe_squeal.process.signals import signals_deferred, stopped_by_signals
from fe_squeal.report.files import save_figure

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="devices and signals of POSIX")
COMMAND = [sys.executable, "-P", "-m", "fe_squeal"]
# Where the tests run in the background, the shell has SIGINT ignored, and nohup SIGHUP, which the command respects.
HEARING = [
    sys.executable, "-c",
    "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler);"
    "hasattr(signal, 'SIGHUP') and signal.signal(signal.SIGHUP, signal.SIG_DFL);"
    "from fe_squeal_start import main; sys.exit(main())",
]  # fmt: skip
SHOWN = sweep_text(3).replace('shapes = "none"', 'shapes = "unstable"')


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return write_sweep(tmp_path, 3)


@pytest.fixture(scope="module")
def whole_with_shapes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of results of the same scene with pictures of shapes."""
    folder = tmp_path_factory.mktemp("whole_with_shapes")
    assert main(["run", str(write_scene(folder, SHOWN)), "-o", str(folder / "out")]) == 0
    return folder / "out"


@POSIX
def test_a_signal_waits_for_a_figure(tmp_path: Path) -> None:
    """Compiled code that measures text would turn the interruption into another exception; and the figure is whole."""

    class Title(Text):
        def draw(self, renderer: object) -> None:
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(0.01)
            super().draw(renderer)

    figure = Figure()
    figure.add_artist(Title(0.5, 0.5, "Ctrl-C"))
    for dpi in (None, 50):
        path = tmp_path / f"{dpi}.png"
        with stopped_by_signals(), pytest.raises(KeyboardInterrupt):
            save_figure(figure, path, dpi=dpi)
        assert path.read_bytes().startswith(b"\x89PNG")


FULL = OutputError("out/run.json: cannot be written (No space left on device)")
DAMAGED = OutputError("out/checkpoint/state.npz: the checkpoint is damaged")
DAMAGED.__cause__ = TypeError("incompatible function arguments")


@POSIX
@pytest.mark.parametrize(
    "error", [TypeError("incompatible function arguments"), InputError("mesh.msh: is damaged"), DAMAGED, FULL]
)
def test_an_interruption_that_comes_out_as_another_exception(
    error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As of compiled code that a signal interrupts; without a signal the same exception is what it is.

    What could not be written behind the signal is told.
    """
    lost = f"; what was finished could not be written: {error}" if error is FULL else ""

    def told(*arguments: object, **options: object) -> None:
        try:
            if number is not None:
                os.kill(os.getpid(), number)
                time.sleep(1)
        except KeyboardInterrupt:
            pass
        raise error

    monkeypatch.setattr("fe_squeal.cli.app", told)
    for number in (signal.SIGINT, signal.SIGTERM):
        before = signal.signal(number, signal.default_int_handler)  # a shell lets its background jobs ignore SIGINT
        try:
            assert main(["info"]) == 130
        finally:
            signal.signal(number, before)
        assert capsys.readouterr().err == f"interrupted{lost}\n"
    number = None
    if isinstance(error, InputError):
        assert main(["info"]) == 2 and capsys.readouterr().err == f"error: {error}\n"
    else:
        with pytest.raises(TypeError):
            main(["info"])


@POSIX
@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_while_importing(number: signal.Signals, scene: Path, no_figures: None) -> None:
    """At moments from the first line of the program on: one word, and the exit code of an interruption."""
    hears = "signal.signal(signal.SIGINT, signal.default_int_handler)"
    program = HEARING[2].replace("sys.exit(main())", "print('begun', flush=True); sys.exit(main())")
    for delay in (0.02, 0.1, 0.3, 0.6):  # it prints just before it takes the signals, and imports after that
        child = subprocess.Popen(
            [sys.executable, "-c", program, "run", str(scene), "-o", str(scene.parent / "out")],
            env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8",
        )  # fmt: skip
        assert child.stdout is not None and child.stdout.readline() == "begun\n" and hears in program
        time.sleep(delay)
        child.send_signal(number)
        _, said = child.communicate(timeout=60)
        assert child.returncode == 130 and said.startswith("interrupted") and said.count("\n") == 1
    assert main(["run", str(scene), "-o", str(scene.parent / "out"), "--resume"]) == 0


@POSIX
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_that_wait(number: signal.Signals) -> None:
    """What a block starts is whole before the signal counts; without a signal nothing is raised."""
    done = []
    before = signal.signal(number, signal.default_int_handler)  # a shell lets its background jobs ignore SIGINT
    try:
        _wait(number, done)
    finally:
        signal.signal(number, before)
    assert done == ["alone", "whole"]


def _wait(number: signal.Signals, done: list[str]) -> None:
    with stopped_by_signals():
        with signals_deferred():
            done.append("alone")
        with pytest.raises(KeyboardInterrupt), signals_deferred():
            os.kill(os.getpid(), number)
            time.sleep(0.01)
            done.append("whole")
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), number)
            time.sleep(1)
            done.append("too late")


class Finalised:
    """Sends a signal while it is thrown away, where Python ignores every exception."""

    def __init__(self, number: int) -> None:
        self.number = number

    def __del__(self) -> None:
        os.kill(os.getpid(), self.number)
        time.sleep(0.01)


@POSIX
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_a_finalizer_is_not_lost(number: signal.Signals, capsys: pytest.CaptureFixture[str]) -> None:
    before, hook = signal.signal(number, signal.default_int_handler), sys.unraisablehook
    try:
        with stopped_by_signals(), pytest.raises(KeyboardInterrupt):
            thrown = Finalised(number)
            del thrown
            time.sleep(1)
    finally:
        signal.signal(number, before)
    assert sys.unraisablehook is hook and capsys.readouterr().err == ""


@POSIX
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_a_finalizer_is_not_lost_where_threads_start_slowly(
    number: signal.Signals, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    start = threading.Thread.start
    monkeypatch.setattr(threading.Thread, "start", lambda thread: (start(thread), time.sleep(0.1)))
    test_a_signal_in_a_finalizer_is_not_lost(number, capsys)


@POSIX
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_another_signal_while_one_is_sent_again_is_sent_again_too(
    number: signal.Signals, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def again(number: int) -> None:
        calls.append(number)
        if len(calls) == 1:
            os.kill(os.getpid(), number)
            time.sleep(0.01)

    monkeypatch.setattr(signals, "_again", again)
    before = signal.signal(number, signal.default_int_handler)
    try:
        with stopped_by_signals():
            thrown = Finalised(number)
            del thrown
            time.sleep(0.01)
    finally:
        signal.signal(number, before)
    assert calls == [number, number] and capsys.readouterr().err == ""


@POSIX
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_waits_for_an_import(
    number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A module is not left half made; and what imports the caller itself is none of its business."""
    sending = f"import os, time\nos.kill(os.getpid(), {int(number)})\ntime.sleep(0.05)\n"
    (tmp_path / f"module_that_is_whole_{number}.py").write_text(f"{sending}whole = True\n")
    (tmp_path / f"module_that_calls_{number}.py").write_text(
        "from fe_squeal.process.signals import stopped_by_signals\nstopped = False\ntry:\n"
        f"    with stopped_by_signals():\n        exec({sending!r})\nexcept KeyboardInterrupt:\n    stopped = True\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    before = signal.signal(number, signal.default_int_handler)
    try:
        with stopped_by_signals(), pytest.raises(KeyboardInterrupt):
            importlib.import_module(f"module_that_is_whole_{number}")
            time.sleep(1)
        assert importlib.import_module(f"module_that_calls_{number}").stopped
    finally:
        signal.signal(number, before)
    assert sys.modules[f"module_that_is_whole_{number}"].whole


def test_an_interruption_while_an_error_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("fe_squeal.cli.one_line", lambda text: exec("raise KeyboardInterrupt"))
    assert main(["run", "nowhere.toml"]) == 130
    assert capsys.readouterr().err == "interrupted\n"


@POSIX
@pytest.mark.slow
def test_signal_while_workers_start(tmp_path: Path) -> None:
    """Dask's cluster, half there, could not be closed, and said so on many lines."""
    pytest.importorskip("distributed")
    study = '[study]\nsamples = 64\nindices = false\n[study.parameters]\nmu = { uniform = { low = 0.1, high = 0.5 } }\n'
    path = write_scene(tmp_path, sweep_text(2) + study)
    child = subprocess.Popen(
        [*HEARING, "study", str(path), "-o", str(tmp_path / "out"), "--workers", "2"],
        env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8",
    )  # fmt: skip
    assert child.stdout is not None
    while "samples" not in child.stdout.readline():  # the cluster starts
        assert child.poll() is None
    time.sleep(0.7)
    child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=60)
    assert child.returncode == 130 and said.startswith("interrupted") and said.count("\n") == 1


@POSIX
@pytest.mark.slow
def test_signal_while_drawing(tmp_path: Path, whole_with_shapes: Path) -> None:
    """The process that draws ends with its parent, nothing half drawn stays, and --resume finishes.

    It is interrupted, goes on and is ended in drawing again.
    """
    path, out = write_scene(tmp_path, SHOWN), tmp_path / "out"
    (tmp_path / "tmp").mkdir()
    for number, options in ((signal.SIGINT, []), (signal.SIGTERM, ["--resume"])):
        child = subprocess.Popen(
            [*HEARING, "run", str(path), "-o", str(out), *options], env=environment(TMPDIR=str(tmp_path / "tmp")),
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8",
        )  # fmt: skip
        process = psutil.Process(child.pid)
        while not (drawing := process.children()):
            assert child.poll() is None
            time.sleep(0.01)
        time.sleep(0.3)
        child.send_signal(number)
        _, said = child.communicate(timeout=60)
        assert child.returncode == 130
        assert said == f"interrupted: 3 of 3 values were finished and are in {out}\n"
        assert not psutil.wait_procs(drawing, timeout=10)[1]
        assert not list((tmp_path / "tmp").iterdir()) and not list(out.rglob(".*"))
    assert main(["run", str(path), "-o", str(out), "--resume"]) == 0
    assert_same_results(out, whole_with_shapes)


@POSIX
@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_killed_study_leaves_nothing(number: signal.Signals, scene: Path, tmp_path: Path) -> None:
    """Its children end, and the folder for temporary files is empty."""
    (tmp_path / "tmp").mkdir()
    child = subprocess.Popen(
        [*COMMAND, "accuracy", str(scene), "-o", str(tmp_path / "out")], stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL, env=environment(TMPDIR=str(tmp_path / "tmp"), HOME=str(tmp_path / "no")),
    )  # fmt: skip
    process = psutil.Process(child.pid)
    while len(process.children(recursive=True)) < 2:
        assert child.poll() is None
        time.sleep(0.01)
    children = process.children(recursive=True)
    time.sleep(1.0)
    child.send_signal(number)
    child.wait(30)
    assert not psutil.wait_procs(children, timeout=20)[1]
    assert not list((tmp_path / "tmp").iterdir())
