"""A linear solver from outside the package, for tests that pass one as an argument."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from fe_squeal.eigen.linear.factor import SingularError
from fe_squeal.errors import NotConvergedError


class ToyFactor:
    """LU factors of SciPy, without inertia."""

    negative_pivots = None

    def __init__(self, A):
        self._real = not np.iscomplexobj(A)
        try:
            self._lu = splu(sp.csc_array(A))
        except RuntimeError as error:
            raise SingularError(str(error)) from error

    def solve(self, b):
        return self._apply(b, "N")

    def solve_transposed(self, b):
        return self._apply(b, "T")

    def solve_adjoint(self, b):
        return self._apply(b, "H")

    def _apply(self, b, which):
        if not self._real:
            return self._lu.solve(np.asarray(b, complex), which)
        if np.iscomplexobj(b):
            return self._lu.solve(b.real, which) + 1j * self._lu.solve(b.imag, which)
        return self._lu.solve(b, which)


class ToyCholesky:
    """Cholesky factors of LAPACK."""

    def __init__(self, A):
        try:
            self._L = la.cholesky(A.toarray(), lower=True)
        except la.LinAlgError as error:
            raise NotConvergedError(str(error)) from error

    def solve(self, b):
        return la.cho_solve((self._L, True), b)

    solve_adjoint = solve

    def half_solve(self, b):
        return la.solve_triangular(self._L, b, lower=True, trans="T")


class Toy:
    """A linear solver that counts its factorisations."""

    name = "toy"

    def __init__(self):
        self.plain, self.definite = 0, 0

    def factorize(self, A, symmetric):
        self.plain += 1
        return ToyFactor(A)

    def factorize_definite(self, A):
        self.definite += 1
        return ToyCholesky(A)

    def memory(self, A, symmetric, definite=False):
        return 1000 * A.nnz
