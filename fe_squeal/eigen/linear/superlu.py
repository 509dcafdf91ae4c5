"""SuperLU, which SciPy brings along."""

from __future__ import annotations

import functools
from contextlib import suppress
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu, spsolve_triangular

from ...errors import NotConvergedError, TooLargeError
from ..memory import require_memory
from .factor import DefiniteFactor, Factor, SingularError, solve_real_parts

# Entries of SuperLU's factors of solids over n to the 4/3, by whether the matrix is symmetric (then 9 to 44, measured).
_FILL = {True: 20.0, False: 45.0}
# The same over the entries of the envelope of one triangle: L and U without exchanges of rows; with these U's band is
# as wide as its own and L's (Golub and Van Loan, Matrix Computations, section 4.3).
_IN_ENVELOPE = {True: 2, False: 3}
_ON_DIAGONAL: dict[str, Any] = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
# Pivots on the diagonal count as stable if no residual of the trial solve exceeds so much of the sum of its terms'
# sizes. Of solids it is some 1e-16; three digits may be lost, as by the exchange of rows where units are unlike.
_STABLE = 1e3 * np.finfo(float).eps
# If the trial solution is wrong by more than this, the matrix is singular to working precision: rounding of it may have
# turned the sign of an eigenvalue.
_DOUBT = 1e-2
_SEED = 20251123


class SuperLUFactor:
    """LU factors by SuperLU; those of a symmetric matrix have all pivots on the diagonal where that is stable.

    Without exchanges of rows LU is LDLᵀ, with D the diagonal of U, whose signs are the inertia. A trial solve shows how
    stable it is. Where that is not enough for solves, these take factors with exchanged rows; where it is not enough
    for signs either, no inertia is known.

    L, D and U of a symmetric matrix are rounded one by one, so A⁻¹ by these is not quite symmetric. Beside modes much
    softer than the others that costs a symmetric Lanczos method up to nine digits of the others. Solves with a real
    symmetric matrix therefore return the mean of A⁻¹ b and A⁻ᵀ b, which is symmetric.
    """

    def __init__(self, A: sp.csr_array, symmetric: bool) -> None:
        self._complex = np.iscomplexobj(A)
        _require(A, symmetric)
        self._lu: Any = None
        self._order: np.ndarray | None = None  # of the unknowns in the matrix that SuperLU is given, if not A's own
        self._signs = False  # whether the signs of the pivots are those of the eigenvalues
        self._mean = symmetric and not self._complex
        if not (symmetric and self._pivot_on_diagonal(A)):
            _ = self.negative_pivots  # of the factors that are given up: they are right to fewer digits, not wrong
            self._order = self._lu = None
            self._lu = _factors(A, permc_spec="COLAMD")

    @functools.cached_property
    def negative_pivots(self) -> int | None:
        """Number of negative eigenvalues of a real symmetric A; None where not known. SciPy copies L and U for it."""
        return int(np.count_nonzero(self._lu.U.diagonal() < 0)) if self._signs else None

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b."""
        return self._apply("N", b)

    def solve_transposed(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᵀ b."""
        return self._apply("T", b)

    def solve_adjoint(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᴴ b."""
        return self._apply("H", b)

    def _apply(self, trans: str, b: np.ndarray) -> np.ndarray:
        if self._complex:
            return self._solve(np.asarray(b, dtype=complex), trans)
        if self._mean:
            return solve_real_parts(lambda x: (self._solve(x, "N") + self._solve(x, "T")) / 2, b)
        return solve_real_parts(lambda x: self._solve(x, trans), b)

    def _solve(self, b: np.ndarray, trans: str) -> np.ndarray:
        if self._order is None:
            return np.asarray(self._lu.solve(b, trans=trans))
        x = np.empty_like(b)
        x[self._order] = self._lu.solve(b[self._order], trans=trans)
        return x

    def _pivot_on_diagonal(self, A: sp.csr_array) -> bool:
        """Factorise a symmetric A without exchanging rows; return whether that is possible and stable."""
        try:
            if (A.diagonal() == 0).any():
                order = self._order = _multipliers_last(A)
                self._lu = _factors(sp.csr_array(A[order][:, order]), permc_spec="NATURAL", **_ON_DIAGONAL)
            else:
                self._lu = _factors(A, permc_spec="MMD_AT_PLUS_A", **_ON_DIAGONAL)
        except SingularError:  # perhaps only without exchanges
            return False
        if not _unexchanged(self._lu):
            return False
        sizes = abs(A)
        unit = 1 / np.sqrt(sizes.max(axis=1).toarray().ravel())
        x = unit * np.random.default_rng(_SEED).standard_normal(len(unit))
        b = A @ x
        with np.errstate(over="ignore", invalid="ignore"):
            found = self._solve(b, "N")
            self._signs = not self._complex and bool((np.abs(found - x) < _DOUBT * unit).all())
            return bool((np.abs(b - A @ found) <= _STABLE * (sizes @ np.abs(found))).all())


def _factors(A: sp.csr_array, **options: Any) -> Any:
    try:
        return splu(sp.csc_array(A), **options)
    except RuntimeError as error:
        raise SingularError(f"SuperLU: the shifted matrix cannot be factorised: {error}") from error


def _unexchanged(lu: Any) -> bool:
    return bool((lu.perm_r == lu.perm_c).all())


def _multipliers_last(A: sp.csr_array) -> np.ndarray:
    """Return an order of elimination (n,) in which each unknown with a zero on the diagonal follows its neighbours.

    Lagrange multipliers have a pivot −B K⁻¹ Bᵀ there, and none before. The others have the order of minimum degree. It
    is that of factors with other numbers on the diagonal, since SuperLU tells it with factors only, and with zeros it
    would exchange rows: of 600 ties in 6000 unknowns that takes three times the memory and five times as long.
    """
    zero = A.diagonal() == 0
    largest = abs(A).max(axis=1).toarray().ravel()
    filled = sp.csr_array(A - sp.diags_array(np.where(zero, largest, 0.0)))
    position = _factors(filled, permc_spec="MMD_AT_PLUS_A", **_ON_DIAGONAL).perm_c
    links = sp.csr_array(A[np.flatnonzero(zero)])
    links.data = np.where(zero[links.indices], 0, position[links.indices])
    last = position.copy()
    last[zero] = np.maximum(links.max(axis=1).toarray().ravel(), position[zero])
    return np.lexsort((position, zero, last))


class SuperLUCholesky:
    """LDLᵀ by SuperLU without pivoting off the diagonal."""

    def __init__(self, A: sp.csr_array) -> None:
        _require(A, True)
        self._lu = _factors(A, permc_spec="MMD_AT_PLUS_A", **_ON_DIAGONAL)
        pivots = self._lu.U.diagonal()
        if not (pivots > 0).all() or not _unexchanged(self._lu):
            raise NotConvergedError("the matrix is not positive definite")
        self._root = np.sqrt(pivots)

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b."""
        return np.asarray(self._lu.solve(b))

    def solve_adjoint(self, b: np.ndarray) -> np.ndarray:
        """Return the same: A is symmetric."""
        return self.solve(b)

    def half_solve(self, b: np.ndarray) -> np.ndarray:
        """Return L⁻ᵀ b."""
        scaled = self._root.reshape(-1, *[1] * (b.ndim - 1)) * b
        return np.asarray(spsolve_triangular(sp.csr_array(self._lu.U), scaled, lower=False))[self._lu.perm_c]


def _require(A: sp.csr_array, symmetric: bool) -> None:
    """Refuse factors that cannot fit; the pattern is looked at where those of a solid could not."""
    with suppress(TooLargeError):
        require_memory(solid_memory(A, symmetric), A.shape[0])
        return
    require_memory(superlu_memory(A, symmetric), A.shape[0])


def superlu_memory(A: sp.csr_array, symmetric: bool) -> int:
    """Return the bytes that SuperLU's factors take: as of a solid, or less where the pattern of A (n, n) is narrow.

    In the order of reverse Cuthill and McKee no factor has entries outside the envelope of A + Aᵀ, which has
    Σ (i − f(i) + 1) entries in one triangle, where f(i) is the first column of row i. SuperLU's own orders fill less.
    """
    return min(solid_memory(A, symmetric), _bytes(_IN_ENVELOPE[symmetric] * _envelope(A), A, symmetric))


def solid_memory(A: sp.csr_array, symmetric: bool) -> int:
    """Return the bytes that SuperLU's factors of a solid's matrix (n, n) take, to a factor of three."""
    return _bytes(_FILL[symmetric] * A.shape[0] ** (4 / 3), A, symmetric)


def _bytes(entries: float, A: sp.csr_array, symmetric: bool) -> int:
    """Return the bytes of factors; real symmetric ones count twice, as SciPy copies them to count their pivots."""
    copies = 2 if symmetric and not np.iscomplexobj(A) else 1
    return int(copies * entries * (A.dtype.itemsize + 4))


def _envelope(A: sp.csr_array) -> int:
    """Return the number of entries of the envelope of a triangle of A + Aᵀ, in the order of reverse Cuthill-McKee."""
    n = A.shape[0]
    pattern = sp.csr_array((np.ones(len(A.indices), np.int8), A.indices, A.indptr), shape=A.shape)
    pattern = sp.csr_array(pattern + pattern.T + sp.eye_array(n, dtype=np.int8))  # no row is empty
    place = np.empty(n, int)
    place[reverse_cuthill_mckee(pattern, symmetric_mode=True)] = np.arange(n)
    first = np.minimum.reduceat(place[pattern.indices], pattern.indptr[:-1])
    return int((place - first + 1).sum())


class SuperLU:
    """SuperLU as a `LinearSolver`: always there, and slower."""

    name = "SuperLU (SciPy)"

    def factorize(self, A: sp.csr_array, symmetric: bool) -> Factor:
        """Return LU factors; those of a real symmetric matrix know its inertia where no rows had to be exchanged."""
        return SuperLUFactor(A, symmetric)

    def factorize_definite(self, A: sp.csr_array) -> DefiniteFactor:
        """Return LDLᵀ factors."""
        return SuperLUCholesky(A)

    def memory(self, A: sp.csr_array, symmetric: bool, definite: bool = False) -> int:
        """Return what factors take at most, of meshes of solids to a factor of three."""
        return superlu_memory(A, symmetric)


SUPERLU = SuperLU()
