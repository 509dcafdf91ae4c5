"""Two elastic chains coupled by friction, with any effects, and all their eigenvalues by LAPACK."""

from dataclasses import replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from dense import all_eigenvalues

from fe_squeal.eigen.pencil import FreeMotions
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term

N, MODES, PATCH = 260, 8, 8


def chain(*effects, n=N, pressed=None):
    """Return two chains coupled by friction in a patch, with masses 0.5 to 1.5 and stiffnesses over two decades.

    `pressed` (PATCH,) are the parts of the points of the patch that touch.
    """
    rng = np.random.default_rng(5)
    half = n // 2

    def line(low, high):
        k = np.exp(rng.uniform(np.log(low), np.log(high), half + 1))
        return sp.diags_array([k[:-1] + k[1:], -k[1:-1], -k[1:-1]], offsets=[0, 1, -1])

    K = sp.block_diag([line(1.0, 50.0), line(2.0, 100.0)], format="csr")
    patch, points = np.arange(half // 3, half // 3 + PATCH), np.tile(np.arange(PATCH), 2)
    ones = np.ones(PATCH)
    gap = sp.csr_array((np.r_[ones, -0.9 * ones], (points, np.r_[patch, patch + half])), (PATCH, n))
    slip = sp.csr_array((np.r_[ones, ones], (points, np.r_[patch + 1, patch + half])), (PATCH, n))
    touching = sp.diags_array(ones if pressed is None else pressed)
    terms = {
        "mass": Term("mass", "M", sp.diags_array(rng.uniform(0.5, 1.5, n)).tocsr(), True),
        "elastic": Term("elastic", "K", K, True),
        "contact": Term("contact", "K", sp.csr_array(gap.T @ touching @ gap), True),
        "friction": Term("friction", "K", sp.csr_array(1.7 * slip.T @ touching @ gap), False, {"mu": 1}),
        "damper": Term("damper", "C", sp.csr_array(0.002 * K + 0.01 * sp.eye_array(n)), True),
        "slip damping": Term("slip damping", "C", sp.csr_array(0.1 * slip.T @ slip), True, {"mu": 1}),
        "gyroscope": Term("gyroscope", "C", _skew(n), False, skew=True),
        "loss": Term("loss", "K", sp.csr_array(0.03 * K), True, imaginary=True),
    }
    return Problem(tuple(terms[t] for t in ("mass", "elastic", "contact", "friction", *effects)), {"mu": 0.3})


class Opening:
    """Chains whose patch opens point after point as mu rises, and which a stress stiffens by tanh mu.

    Contact and friction are as stiff as those of `chain`, or `stiffer` times as much.
    """

    def __init__(self, *effects, n=N, stiffer=1.0):
        self._effects, self._n, self._stiffer = effects, n, stiffer

    def problem(self, values):
        mu = values.get("mu", 0.3)
        made = chain(*self._effects, n=self._n, pressed=np.clip(1.3 - 0.3 * mu * np.arange(PATCH), 0.0, 1.0))
        (elastic,) = (t.matrix for t in made.terms if t.name == "elastic")
        touching = ("contact", "friction")
        terms = [replace(t, matrix=self._stiffer * t.matrix) if t.name in touching else t for t in made.terms]
        terms = (*terms, Term("stress", "K", sp.csr_array(0.02 * np.tanh(2 * mu) * elastic), True))
        held = FreeMotions.none(self._n)  # as of a scene: the springs at their ends hold the chains
        return Problem(terms, {"mu": mu}, None, self, frozenset({"mu"}), dict(values), free=lambda _: held)

    def check(self, values):
        pass

    def number(self, path):
        return {"mu": 0.3}[path]

    def solved_with(self, linear_solver):
        return self


def _skew(n):
    A = sp.diags_array([np.full(n // 2, 0.05)], offsets=[n // 2], shape=(n, n))
    return sp.csr_array(A - A.T)


def dense(problem, mu):
    """Return all eigenvalues with Im λ ≥ 0, by LAPACK."""
    pencil = problem.pencil(mu=mu)
    M, K = pencil.M.toarray(), pencil.K.toarray()
    if pencil.C is None:
        lam = 1j * np.sqrt(la.eigvals(K, M).astype(complex))
        lam = np.concatenate([lam, -lam]) if not np.iscomplexobj(K) else lam
    else:
        lam = all_eigenvalues(M, pencil.C, K)
    return lam[lam.imag > 0]


CLASSES = {
    "nonsymmetric": (), "quadratic": ("damper", "slip damping"), "gyroscopic": ("gyroscope",),
    "gyroscopic, damped": ("gyroscope", "damper"),
    "complex": ("loss",), "complex with C": ("loss", "damper"),
}  # fmt: skip


def stiffening_chain(n, meets, powers):
    """A chain whose stiffness is p times that of springs of 1, and whose modes 7 and 8 flutter from p = `meets` on.

    Skew friction c(uvᵀ − vuᵀ) p³ between the two, c = (θ₈ − θ₇)/(2 meets²). Returns the problem and θ (n,) at p = 1.
    """
    K = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n)).tocsr()
    j = np.arange(1, n + 1)
    u, v = (np.sqrt(2 / (n + 1)) * np.sin(i * j * np.pi / (n + 1)) for i in (7, 8))
    theta = 2 - 2 * np.cos(j * np.pi / (n + 1))
    friction = sp.csr_array((theta[7] - theta[6]) / (2 * meets**2) * (np.outer(u, v) - np.outer(v, u)))
    terms = (Term("m", "M", sp.eye_array(n, format="csr"), True), Term("k", "K", K, True, {"p": 1}),
             Term("f", "K", friction, False, powers))  # fmt: skip
    return Problem(terms, dict.fromkeys(("p", *powers), 1.0)), theta


def rising_oscillators(rising, still, powers):
    """Return oscillators of unit mass alone: θ = rising² Σ c pᵏ with the c of each power k, beside θ = still²."""
    size = len(rising) + len(still)

    def diagonal(values, first):
        at = np.arange(first, first + len(values))
        return sp.csr_array((values, (at, at)), shape=(size, size))

    terms = [Term("mass", "M", sp.eye_array(size, format="csr"), True),
             Term("still", "K", diagonal(still**2, len(rising)), True)]  # fmt: skip
    terms += [Term(f"rising {k}", "K", diagonal(c * rising**2, 0), True, {"p": k}) for k, c in powers.items()]
    return Problem(tuple(terms), {"p": 1.0})
