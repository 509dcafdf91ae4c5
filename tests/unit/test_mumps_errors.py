"""Errors of MUMPS while it solves, with objects in place of PETSc's: one message, and no process raises alone."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal.eigen.linear import mumps, petsc, processes
from fe_squeal.eigen.linear.factor import SingularError
from fe_squeal.eigen.linear.mumps import MumpsFactor, MumpsOptions
from fe_squeal.errors import NotConvergedError, TooLargeError

N, MB = 6, 10**6


class PetscError(RuntimeError):
    """What petsc4py raises, of which it says a number of PETSc's alone."""


class Dense:
    """A block of columns of PETSc."""

    made: list[Dense] = []

    def createDense(self, sizes: object, array: np.ndarray | None = None, comm: object = None) -> Dense:
        self.array, self.destroyed = array, False
        Dense.made.append(self)
        return self

    def setUp(self) -> None:
        self.array = np.zeros((N, 2))

    def getDenseArray(self) -> np.ndarray:
        assert self.array is not None
        return self.array

    def destroy(self) -> None:
        self.destroyed = True


class Factor:
    """Factors of 2 with MUMPS' number of an error; `fails` says whether PETSc raises one."""

    def __init__(self, error: int, fails: bool) -> None:
        self.error, self.fails, self.transposed = error, fails, 1

    def setMumpsIcntl(self, which: int, value: int) -> None:
        assert which == 9
        self.transposed = value

    def getMumpsInfog(self, which: int) -> int:
        assert which == 1
        return self.error

    def matSolve(self, B: Dense, X: Dense) -> None:
        if self.fails:
            raise PetscError(76)
        assert B.array is not None
        X.array = B.array / 2


@pytest.fixture
def matrix(monkeypatch: pytest.MonkeyPatch) -> Callable[[int, bool], petsc.PetscMatrix]:
    """Make a matrix that is factorised, with what happens at a solve."""
    monkeypatch.setattr(petsc, "petsc", lambda: SimpleNamespace(Mat=Dense, Error=PetscError))
    Dense.made.clear()

    def of(error: int, fails: bool) -> petsc.PetscMatrix:
        made = object.__new__(petsc.PetscMatrix)
        made._own = made._n = N
        made._matrix, made._factor = SimpleNamespace(comm=None), Factor(error, fails)
        return made

    return of


@pytest.mark.parametrize("error", [-90, -13, -1])
@pytest.mark.parametrize("transposed", [False, True])
def test_an_error_of_mumps_is_returned(
    error: int, transposed: bool, matrix: Callable[[int, bool], petsc.PetscMatrix]
) -> None:  # fmt: skip
    failing = matrix(error, True)
    rows, told = failing.solve(np.ones((N, 2)), transposed)
    assert told == error and rows.shape == (N, 2) and np.isnan(rows).all()
    assert len(Dense.made) == 2 and all(dense.destroyed for dense in Dense.made)
    assert failing._factor.transposed == 1


def test_another_error_of_petsc_is_raised(matrix: Callable[[int, bool], petsc.PetscMatrix]) -> None:
    failing = matrix(0, True)
    with pytest.raises(PetscError):
        failing.solve(np.ones((N, 2)), False)
    assert failing._factor.transposed == 1
    rows, told = matrix(0, False).solve(np.ones((N, 2)), True)
    np.testing.assert_array_equal(rows, np.full((N, 2), 0.5))
    assert told == 0 and all(dense.destroyed for dense in Dense.made[-2:])


def test_what_cannot_be_destroyed_is_kept(
    matrix: Callable[[int, bool], petsc.PetscMatrix], monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    """MUMPS fails again where files of factors are gone that it would remove; other matrices are not concerned."""
    destroyed, kept = [], []

    def fail() -> None:
        raise PetscError(76)

    monkeypatch.setattr(petsc, "_kept", kept)
    failing = matrix(-90, True)
    failing._factor = SimpleNamespace(destroy=lambda: destroyed.append("factor"))
    failing._matrix = SimpleNamespace(destroy=lambda: destroyed.append("matrix"))
    failing._solver = SimpleNamespace(destroy=fail)
    failing.destroy()
    assert destroyed == ["factor", "matrix"] and kept == [failing._solver]


def test_no_process_raises_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Behind an error all meet to gather rows, and the step ends."""
    met: list[np.ndarray] = []
    comm = SimpleNamespace(size=3, rank=1)
    monkeypatch.setattr(processes, "scattered", lambda *_: np.ones((2, 2)))
    monkeypatch.setattr(processes, "gathered", lambda comm, n, own, rows: met.append(own))
    failing = SimpleNamespace(solve=lambda b, transposed: (np.full(b.shape, np.nan), -90))
    monkeypatch.setitem(processes._matrices, -1, failing)
    what = {"handle": -1, "n": N, "columns": 2, "rows": 1, "transposed": False}
    assert processes._solve(comm, what, None) == (None, -90)
    assert len(met) == 1


@pytest.mark.parametrize("imaginary", [False, True])
@pytest.mark.parametrize(
    ("error", "raised", "message"),
    [
        (-90, TooLargeError, r"solve\.mumps\.folder: MUMPS could not read the factors of 6 unknowns in .*files; were "),
        (-13, TooLargeError, r"MUMPS: the factors of 6 unknowns need about 7\.63 MiB of memory, and .* are free"),
        (-1, NotConvergedError, r"^MUMPS failed with error -1$"),
        (0, SingularError, "singular"),
        (8, None, ""),  # a warning
    ],
)
def test_an_error_of_a_solve_is_one_message(
    error: int, raised: type[Exception] | None, message: str, imaginary: bool, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    told = petsc.MumpsReport(0, 0, 0, 8 * MB, 8 * MB, 8 * MB, 8 * MB, 8 * MB, 1e6)

    def together(name: str, data: np.ndarray, **what: object) -> object:
        return told if name == "factorize" else (data * (np.nan if error <= 0 else 0.5), error)

    monkeypatch.setattr(mumps, "together", together)
    monkeypatch.setattr(mumps, "_files", lambda parent: f"{parent}/files")
    A = sp.csr_array((2 + 0j if imaginary else 2.0) * sp.eye_array(N))
    factor = MumpsFactor(A, False, options=MumpsOptions(True, "folder"))
    for solve in (factor.solve, factor.solve_transposed, factor.solve_adjoint):
        if raised is None:
            np.testing.assert_array_equal(solve(np.ones(N)), np.full(N, 0.5))
        else:
            with pytest.raises(raised, match=message):
                solve(np.ones(N))
