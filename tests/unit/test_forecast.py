"""The forecast of memory: what it consists of, how near it comes, and what `check` says would fit."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest
from chains import chain
from scene_texts import replaced, write_scene
from toy_solver import Toy

from fe_squeal.cli import main
from fe_squeal.eigen import columns, memory
from fe_squeal.eigen.linear import choice, mumps
from fe_squeal.eigen.linear.pardiso import has_pardiso
from fe_squeal.eigen.linear.petsc import MumpsReport
from fe_squeal.run import fits
from fe_squeal.run.fits import Machines, fits_here, fits_there, modes_that_fit
from fe_squeal.sweep.forecast import MemoryCount, count_memory

ROOT = Path(__file__).parents[2]
SMALL = replaced("size = 0.02", "size = 0.01", replaced('file = "block.msh"\n', ""))  # 405 unknowns, solved directly
LARGE = MemoryCount(
    100_000, 20, 15, "nonsymmetric", True, 10**9, {"program and model": 10**9, "factors": 10**9, "matrices": 10**9},
    terms_here=4 * 10**8,
)  # fmt: skip


@pytest.mark.parametrize("method", ["direct", "reduced"])
def test_the_parts_make_the_total_and_grow_with_the_modes(method):
    count = count_memory(chain(n=450), "mu", 7, method, Toy())
    few, many = count.at(4), count.at(40)
    assert sum(few.parts.values()) == few.total and few.factors == few.parts["factors"] == count.factors
    moved = {name for name in many.parts if many.parts[name] != few.parts[name]}
    assert moved == {"vectors"} | ({"projections", "small eigenproblems"} if method == "reduced" else set())
    # The Krylov space of the search for strong flutter is the same for any number of modes.
    assert many.parts["vectors"] > 3 * few.parts["vectors"] or method == "reduced"
    for name, size in few.parts.items():
        assert f"{name} {memory.memory_text(size)}" in str(few)


def test_freed_memory_is_given_back():
    """Arrays of 100 kB lie in the heap, where a small one that stays behind them keeps them from the system."""
    if memory._trim() is None:
        pytest.skip("not glibc")
    arrays = [np.ones(12_500) for _ in range(600)]
    kept = arrays[::40]
    del arrays
    before = psutil.Process().memory_info().rss
    memory.release_freed()
    assert before - psutil.Process().memory_info().rss > 2**25 and len(kept) == 15


def test_modes_that_fit_are_the_most():
    room = 6 * 10**9
    most = modes_that_fit(LARGE, room)
    assert LARGE.at(most).total <= room < LARGE.at(most + 1).total
    assert modes_that_fit(LARGE, 10**9) == 0


def test_check_says_what_fits(tmp_path, capsys, monkeypatch):
    """Here and on other machines, each in a row; the forecast is the command's own."""
    monkeypatch.setattr(fits, "has_mumps", lambda: False)
    path = write_scene(tmp_path, SMALL)
    assert main(["check", str(path), "--processes", "4", "--memory-per-process", "0.1"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert re.search(r"predicted memory [\d.]+ MiB \(reduced sweep\): program and model [\d.]+ MiB,", said)
    assert re.search(r"what fits here (about )?\d+ modes × 5 values or more; .* free on 4 processes process 0 ", said)
    assert "of 102 MiB each does not fit; what would: " in said and "MUMPS is not installed here" in said


def test_what_does_not_fit_here_has_what_takes_less(monkeypatch):
    monkeypatch.setattr(fits, "has_mumps", lambda: False)
    forecast = replace(LARGE.at(50), free=5 * 2**29, taken=10**9)
    said = fits_here(LARGE, 50, forecast)
    most = modes_that_fit(LARGE, 5 * 2**29 + 10**9)
    assert 0 < most < 50 and said.startswith(f"not 50 modes × 20 values; what takes less: {most} modes instead of 50, ")
    assert "out_of_core), which is not installed here, several processes" in said
    assert "reduced" not in said and "reduced" in fits_here(replace(LARGE, reduced=False), 5000, forecast)


def test_strong_friction_that_does_not_fit_is_told():
    large = replace(LARGE, large=True)
    total, strong = large.at(50).total, large.at(50).strong
    assert strong > 0
    for free, told in ((total + strong, False), (total + strong // 2, True)):
        said = fits_here(large, 50, replace(large.at(50), free=free - 10**9, taken=10**9))
        assert " modes × 20 values or more" in said
        assert ("; not 50 modes if friction or damping is strong" in said) == told


def rows(processes, gib, modes=50):
    memory = None if gib is None else int(gib * 2**30)
    return [text for _, text in fits_there(chain(), LARGE, modes, Machines(processes, memory))]


def besides(count):
    """The bytes that process 0 of so many has besides factors."""
    return LARGE.at(50, count).total - LARGE.factors


def shared(count):
    """The bytes of vectors, and of matrices, that each of so many processes has."""
    whole = LARGE.at(50, 1).parts["vectors"] - LARGE.at(50, 10**9).parts["vectors"]
    return whole / count, 1.4e9 / count


@pytest.mark.parametrize("count", [2, 8])
def test_rows_of_matrices_and_of_vectors_are_shared(count):
    """Of the terms, which this process has alone, of their sums, complex ones too, and of the basis."""
    one, some = LARGE.at(50, 1).parts, LARGE.at(50, count).parts
    assert some["matrices"] == 10**9 // count
    assert some["program and model"] == pytest.approx(10**9 - 4e8 * (1 - 1 / count))
    assert one["vectors"] - some["vectors"] == pytest.approx((count - 1) * shared(count)[0], rel=1e-6)
    lossy = replace(LARGE, problem_class="complex")
    assert lossy.at(50, count).parts["matrices"] == 10**9 // count and lossy.rows(count) == LARGE.rows(count)
    assert LARGE.rows(1) == replace(LARGE, unknowns=columns._LEAST - 1).rows(count) == 0


def test_process_0_holds_all_but_the_others_parts(monkeypatch):
    """Of the factors, and of matrices and of the basis, which are spread evenly."""
    monkeypatch.setattr(fits, "_factors", lambda _, count, processes: (count.factors, None, "as given"))
    for count in (1, 2, 8):
        found = [float(a) * {"M": 1, "G": 1024}[b] for a, b in re.findall(r"([\d.]+) ([MG])iB", rows(count, None)[0])]
        factors = 10**9 / 2**20 / count**0.7
        vectors, matrices = (size / 2**20 for size in shared(count))
        expected = [besides(count) / 2**20 + factors, factors]
        if count > 1:
            expected += [vectors, matrices, 120 + factors + vectors + matrices]
        assert found == pytest.approx(expected, rel=5e-3)


def test_what_would_fit_on_processes_does(monkeypatch):
    """The number of processes that is named is the smallest; fewer modes, and the memory of process 0, suffice too."""
    monkeypatch.setattr(fits, "_factors", lambda _, count, processes: (count.factors, None, "as given"))
    total = LARGE.at(50).total / 2**30
    assert "does not fit" in rows(1, total - 0.01)[1] and rows(1, total + 0.01)[1].startswith("fits; 5")
    for count in (8, 3):
        room = (besides(count) + 10**9 * count**-0.7) / 2**30 + 1e-4
        said = rows(2, room)[1]
        assert f"what would: {count} processes, or " in said
        assert rows(count, room)[1].startswith("fits") and rows(count - 1, room)[1].startswith("does not")
    modes = int(re.search(r"(\d+) modes", said)[1])
    assert rows(2, room, modes)[1].startswith("fits") and rows(2, room, modes + 1)[1].startswith("does not")
    assert "processes" not in rows(2, 1.0)[1]  # process 0 holds more than that besides its part of the factors


LARGEST, ON_DISK = 4 * 10**8, 10**8  # bytes of factors on the process that has most, told by the analysis of `started`


def started(monkeypatch, processes, here):
    """Be process 0 of so many that mpiexec has started, some of them on this machine, with MUMPS."""
    told = MumpsReport(-9, 0, 0, LARGEST, processes * LARGEST, ON_DISK, processes * ON_DISK, 10**9, 1e12)
    for module in (fits, columns):
        monkeypatch.setattr(module, "process_count", lambda: processes)
    for module in (mumps, columns):
        monkeypatch.setattr(module, "local_count", lambda: here)
    monkeypatch.setattr(mumps, "together", lambda *_, **__: told)
    monkeypatch.setattr(fits, "has_mumps", lambda: True)


@pytest.mark.parametrize(
    ("processes", "asked", "source"),
    [
        (4, 4, "by MUMPS' analysis"),
        (2, 8, "by MUMPS' analysis on 2 processes, and P to the -0.7"),
        (1, 4, "by MUMPS' analysis on one process, and P to the -0.7"),
    ],
)
def test_under_mpiexec_each_process_has_its_own_factors(processes, asked, source, monkeypatch):
    """On one machine or on several; other numbers of processes follow from the largest part on those that there are."""
    for here in {1, processes}:
        started(monkeypatch, processes, here)
        factors, disk = (of * (processes / asked) ** 0.7 for of in (LARGEST, ON_DISK))
        own = besides(asked)
        parts, room = rows(asked, (own + factors) / 2**30 + 1e-4)
        assert parts.endswith(f"({source})") and room.startswith(("fits; 50 modes", "fits; 51 modes"))
        found = [float(a) * {"M": 1, "G": 1024}[b] for a, b in re.findall(r"([\d.]+) ([MG])iB", parts)]
        expected = [own + factors, factors, *shared(asked), 120 * 2**20 + factors + sum(shared(asked))]
        assert found == pytest.approx([size / 2**20 for size in expected], rel=5e-3)
        room = rows(asked, (own + factors) / 2**30 - 1e-4)[1]
        assert f"does not fit; what would: {asked + 1} processes, or factors on disk" in room
        assert "factors on disk" in rows(asked, (own + disk) / 2**30 + 1e-4)[1]
        assert "factors on disk" not in rows(asked, (own + disk) / 2**30 - 1e-4)[1]


@pytest.mark.parametrize(("processes", "here"), [(1, 1), (4, 1), (4, 2), (4, 4)])
def test_the_forecast_is_what_this_machine_holds(processes, here, monkeypatch):
    """Of spread vectors the parts of its processes, and the largest part of the factors for each of them."""
    one = LARGE.at(50, 1).parts
    started(monkeypatch, processes, here)
    some, part = LARGE.at(50).parts, here / processes
    assert some["matrices"] == part * one["matrices"] and some["program and model"] == one["program and model"]
    assert one["vectors"] - some["vectors"] == pytest.approx((1 - part) * shared(1)[0], rel=1e-6)
    A = chain().pencil().K
    assert mumps.Mumps().memory(A, False) == here * LARGEST
    assert mumps.Mumps(mumps.MumpsOptions(out_of_core=True)).memory(A, False) == here * ON_DISK


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--memory-per-process", "8"], "--memory-per-process: given 8 alone; expected --processes P beside it"),
        (["--processes", "2", "--memory-per-process", "-1"], "--memory-per-process: given -1; expected a number"),
        (["--processes", "2", "--memory-per-process", "nan"], "--memory-per-process: given nan; expected a number"),
        (["--processes", "0"], "--processes"),
    ],
)
def test_what_makes_no_sense_is_one_message(tmp_path, capsys, arguments, message):
    assert main(["check", str(write_scene(tmp_path)), *arguments]) == 2
    said = capsys.readouterr().err
    assert message in said and said.count("\n") == 1


@pytest.mark.slow
@pytest.mark.skipif(not has_pardiso() or not sys.platform.startswith("linux"), reason="figures of PARDISO on Linux")
def test_a_forecast_is_right_within_15_per_cent():
    """A run of 6 558 unknowns in a process of its own, and the forecast of another; more: benchmarks/memory.py.

    The system may take back pages that rest for a while: a run can show less than it needs, and never more. One that
    shows too little is made again.
    """
    found, taken = {}, []
    for what in ("forecast", "run", "run"):
        if taken and found["forecast"] < 1.15 * max(taken):
            break
        command = [sys.executable, str(ROOT / "benchmarks/memory.py"), "hexahedra, direct", "--one", what]
        one = {**os.environ, "OMP_NUM_THREADS": "1"}  # PARDISO's analysis allows for each thread
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=one)
        found |= json.loads(done.stdout.splitlines()[-1])
        if what == "run":
            taken.append(found["taken"])
    assert found["unknowns"] == 6558
    assert 1 / 1.15 < found["forecast"] / max(taken) < 1.15


def test_a_large_problem_is_forecast_with_rough_factors(needs_pardiso, monkeypatch):
    """And it is said what factors of a matrix with friction would take more."""
    problem = chain(n=450)
    usual = count_memory(problem, "mu", 7, "reduced")
    monkeypatch.setattr(choice, "_MANY", 0)
    count = count_memory(problem, "mu", 7, "reduced")
    few, many = count.at(4), count.at(8)
    assert not usual.large and count.large and 0 < count.factors < usual.factors
    assert sum(few.parts.values()) == few.total and many.parts["vectors"] > few.parts["vectors"]
    # Of a smaller one those that shapes are made exact with, as far as these take more than the model before.
    assert 0 <= usual.at(4).strong <= usual.factors and few.strong > 0
    assert f"; {memory.memory_text(few.strong)} more if friction or damping is strong" in str(few)
    assert not count_memory(problem, "mu", 7, "direct").large
