"""Matrices of terms in files: the same matrices, out of memory, and nothing left on the disk."""

from __future__ import annotations

import os
import sys
import tempfile
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
import scipy.sparse as sp

from fe_squeal import sweep
from fe_squeal.eigen.linear import choice
from fe_squeal.problem import aside
from fe_squeal.problem.aside import forget_pages, movable_bytes, put_aside
from fe_squeal.problem.terms import Term, sum_terms
from fe_squeal.reduced import begun
from meshes import box, make_problem


@pytest.fixture
def terms(monkeypatch):
    monkeypatch.setattr(aside, "_LEAST", 100)
    monkeypatch.setattr(aside, "_room", lambda: 2**30)
    rng = np.random.default_rng(8)
    A, B = (sp.csr_array(np.where(rng.random((50, 50)) < 0.2, rng.random((50, 50)), 0.0)) for _ in range(2))
    few = sp.csr_array(sp.eye_array(50))
    return [Term("a", "K", A, False), Term("b", "K", B, False, {"b": 1}), Term("few", "K", few, True)]


def on_disk(A: sp.csr_array) -> bool:
    return not A.data.flags.writeable


def test_matrices_stay_what_they_are(terms, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    before = [t.matrix.toarray() for t in terms]
    total = sum_terms((t, 2.0) for t in terms)
    x = np.ones((50, 3))
    expected = movable_bytes(terms, [])
    assert put_aside(terms, []) == expected == sum(12 * t.matrix.nnz for t in terms[:2])
    assert [on_disk(t.matrix) for t in terms] == [True, True, False]
    for term, dense in zip(terms, before, strict=True):
        assert (term.matrix.toarray() == dense).all() and (term.matrix @ x == sp.csr_array(dense) @ x).all()
        np.testing.assert_array_equal((term.matrix.T.tocsr() * 3 + term.matrix).toarray(), 3 * dense.T + dense)
    np.testing.assert_array_equal(sum_terms((t, 2.0) for t in terms).toarray(), total.toarray())
    assert os.listdir(tmp_path) == []  # a file without a name: gone with the process, however that ends
    assert put_aside(terms, []) == movable_bytes(terms, []) == 0  # once is enough
    forget_pages(terms)
    assert all((term.matrix.toarray() == dense).all() for term, dense in zip(terms, before, strict=True))


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the system does not tell what comes from files")
def test_pages_that_were_read_are_given_back(monkeypatch):
    monkeypatch.setattr(aside, "_room", lambda: 2**30)
    n = 2_000_000
    term = Term("m", "M", sp.csr_array(sp.eye_array(n, format="csr")), True)
    assert put_aside([term], []) == 12 * n

    def held() -> int:
        return psutil.Process().memory_info().shared  # what comes from files

    before = held()
    assert term.matrix.data.sum() == n
    read = held()
    forget_pages([term])
    assert read - before >= 8 * n and held() <= before + 2**20


def test_what_is_worked_with_stays(terms):
    assert put_aside(terms, [terms[0].matrix]) == 12 * terms[1].matrix.nnz
    assert [on_disk(t.matrix) for t in terms] == [False, True, False]


def test_without_room_on_the_disk(terms, monkeypatch):
    """What has no room stays in memory."""

    class Full:
        def __init__(self) -> None:
            self._file = open("/dev/full", "wb", buffering=0)  # noqa: SIM115

        def __enter__(self):
            return self._file

        def __exit__(self, *raised):
            self._file.close()

    before = [t.matrix.toarray() for t in terms]
    monkeypatch.setattr(tempfile, "TemporaryFile", Full)
    assert put_aside(terms, []) == 0
    for term, dense in zip(terms, before, strict=True):
        assert (term.matrix.toarray() == dense).all() and not on_disk(term.matrix)


def test_matrices_that_share_their_arrays_are_moved_once(terms):
    A = terms[0].matrix
    twin = sp.csr_array(A.shape)
    twin.data, twin.indices, twin.indptr = A.data, A.indices, A.indptr
    both = [terms[0], Term("twin", "C", twin, False)]
    assert movable_bytes(both, []) == put_aside(both, []) == 12 * A.nnz
    assert on_disk(A) and twin.data is A.data and twin.indices is A.indices


def test_only_what_there_is_room_for_is_moved(terms, monkeypatch):
    """So that the forecast, which is told the same, is right."""
    monkeypatch.setattr(aside, "_room", lambda: 12 * terms[0].matrix.nnz + 100)
    assert movable_bytes(terms, []) == put_aside(terms, []) == 12 * terms[0].matrix.nnz
    assert [on_disk(t.matrix) for t in terms] == [True, False, False]


@pytest.mark.parametrize("in_memory", [False, True])
def test_room_is_that_of_the_disk(in_memory, monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(aside, "_is_in_memory", lambda folder: in_memory)
    monkeypatch.setattr(aside.shutil, "disk_usage", lambda folder: SimpleNamespace(free=3 * 2**30))
    assert aside._room() == (0 if in_memory else 2 * 2**30)
    monkeypatch.setattr(aside.shutil, "disk_usage", lambda folder: os.listdir(folder / "absent"))
    assert aside._room() == 0


def test_file_systems_are_known(tmp_path, monkeypatch):
    class Part:
        def __init__(self, mountpoint, fstype):
            self.mountpoint, self.fstype = str(mountpoint), fstype

    parts = [Part("/", "ext4"), Part(tmp_path, "tmpfs"), Part(tmp_path / "disk", "xfs")]
    monkeypatch.setattr(aside.psutil, "disk_partitions", lambda all: parts)
    (tmp_path / "disk").mkdir()
    assert [aside._is_in_memory(p) for p in (tmp_path, tmp_path / "x" / "y", tmp_path / "disk", tmp_path.parent)] == [
        True, True, False, False
    ]  # fmt: skip


@pytest.mark.slow
def test_a_large_problem_is_swept_with_its_terms_on_disk(monkeypatch):
    """Modes, onsets, shares and sensitivities are those of the same problem with its terms in memory."""

    def swept():
        problem = make_problem(
            box("hex2", (6, 4, 3), (0.08, 0.05, 0.03)), order=2,
            materials={"m": {"youngs_modulus": 2e9, "poisson_ratio": 0.3, "density": 2600.0}},
            supports=[{"surface": "left", "fixed": "xyz"}],
            contacts=[{"name": "belt", "surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e11,
                       "sliding": {"direction": [1, 0, 0], "speed": 1.0}}], effects={"friction": {"mu": 0.3}},
        )  # fmt: skip
        return problem, sweep(problem, np.linspace(0.0, 1.2, 3), modes=6, method="reduced")

    _, usual = swept()
    monkeypatch.setattr(choice, "_MANY", 0)
    monkeypatch.setattr(aside, "_LEAST", 100)
    monkeypatch.setattr(aside, "_room", lambda: 2**30)
    moved = []
    monkeypatch.setattr(begun, "put_aside", lambda terms, used: moved.append(put_aside(terms, used)))
    problem, large = swept()
    if not choice.is_large(1):
        pytest.skip("the solver has no rough factors, and large problems are nothing special to it")
    assert moved and moved[0] > 0 and any(on_disk(t.matrix) for t in problem.terms)
    for one, other in zip(usual.points, large.points, strict=True):
        np.testing.assert_allclose(other.modes.lam, one.modes.lam, rtol=1e-7, atol=1e-3)
    np.testing.assert_allclose([o.value for o in large.onsets], [o.value for o in usual.onsets], rtol=1e-6)
    shares, again = usual.contributions_dataframe(), large.contributions_dataframe()
    for name in shares.select_dtypes("number").columns:
        one, other = (frame[name].to_numpy(float) for frame in (shares, again))
        np.testing.assert_allclose(other, one, rtol=1e-3, atol=1e-4 * np.nanmax(np.abs(one)), err_msg=name)
    assert len(large.sensitivities_dataframe()) == len(usual.sensitivities_dataframe()) > 0
