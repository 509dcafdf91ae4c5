"""A part that is stiff where the basis of a reduced model begins, soft at another value, and hardly coupled."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from chains import MODES, N, chain

from fe_squeal import sweep
from fe_squeal.eigen.linear.choice import factorize
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.reduced.soft import soft_vectors


def with_pair(coupling: float, stiffness: float, power: int, *effects: str) -> Problem:
    """Return chains with a pair of masses of that stiffness at mu = 0, and a soft one at mu = 1, or ½ for power 2.

    Friction makes the pair unstable there.
    """
    n, soft, near = N + 2, 0.02, 0.01

    def wide(A: sp.csr_array) -> sp.csr_array:
        return sp.csr_array(sp.block_diag([A, sp.csr_array((2, 2))], format="csr"))

    def pair(B: object, link: float = 0.0) -> sp.csr_array:
        A = sp.lil_array((n, n))
        A[N:, N:] = np.array(B, float)
        for i, j, c in ((N, N, link), (10, 10, link), (N, 10, -link), (10, N, -link)):
            A[i, j] += c
        return sp.csr_array(A)

    falls = [-(stiffness - soft)] if power == 1 else [-4 * (stiffness - soft), 4 * (stiffness - soft)]
    terms = [replace(t, matrix=wide(t.matrix)) for t in chain(*effects).terms]
    terms += [
        Term("masses", "M", pair(np.eye(2)), True),
        Term("springs", "K", pair(np.diag([stiffness, stiffness + near / 2]), coupling), True),
        *(Term(f"softening {i}", "K", pair(c * np.eye(2)), True, {"mu": i}) for i, c in enumerate(falls, 1)),
        Term("friction of the pair", "K", pair([[0, 2 * near], [-2 * near, 0]]), False, {"mu": 1}),
    ]
    return Problem(tuple(terms), {"mu": 0.0})


@pytest.mark.parametrize(
    ("coupling", "stiffness", "power", "solver"),
    [
        (0.0, 0.3, 1, "auto"), (1e-6, 3e4, 1, "superlu"),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in [
            (0.0, 0.3, 1, "superlu"), (0.0, 30.0, 1, "auto"), (1e-6, 3e4, 1, "auto"), (1e-4, 300.0, 2, "auto"),
        ]),
    ],
)  # fmt: skip
def test_a_reduced_model_has_it(coupling: float, stiffness: float, power: int, solver: str) -> None:
    """The modes are those of LAPACK at the value where the part is soft, which no mode of the start contains."""
    problem, soft = with_pair(coupling, stiffness, power), 1.0 / power
    result = sweep(problem, np.linspace(0, 1, 3), modes=MODES, method="reduced", linear_solver=solver)
    (point,) = (p for p in result.points if p.value == soft)
    pencil = problem.pencil(mu=soft)
    theta = la.eigvals(pencil.K.toarray(), pencil.M.toarray()).astype(complex)
    lam = 1j * np.sqrt(theta)
    exact = lam[np.argsort(lam.imag, kind="stable")][: len(point.modes)]
    np.testing.assert_allclose(np.sort(point.modes.lam.imag), np.sort(exact.imag), rtol=1e-8)
    assert np.count_nonzero(point.modes.stability == "unstable") == np.count_nonzero(exact.real > 1e-6) > 0


@pytest.mark.slow
@pytest.mark.parametrize(("coupling", "stiffness", "rtol"), [(1e-6, 300.0, 1e-8), (1e-2, 3e8, 1e-6)])
def test_a_damped_reduced_model_has_it(coupling: float, stiffness: float, rtol: float) -> None:
    """However little of what moves with it is left where lengths are measured with its stiffness at the start."""
    problem = with_pair(coupling, stiffness, 1, "damper")
    found = sweep(problem, np.linspace(0, 1, 3), modes=MODES, method="reduced").points[-1].modes.lam
    exact = solve_modes(problem.pencil(mu=1.0), Request(count=MODES)).lam
    np.testing.assert_allclose(found, exact[: len(found)], rtol=rtol)


@pytest.mark.parametrize("coupling", [0.0, 1e-2])
def test_soft_directions_are_those_that_a_basis_lacks(coupling: float) -> None:
    """The basis has all modes of chains alone, none of the pair; with what is returned it has every θ below c."""
    soft, c = with_pair(coupling, 3e8, 1).at({"mu": 1.0}).pencil(), 0.1
    K = sp.csr_array((soft.K + soft.K.T) / 2)
    V = la.eigh(K[:N, :N].toarray(), soft.M[:N, :N].toarray())[1][:, :40]
    V = np.vstack([V, np.zeros((2, 40))])
    u, _ = soft_vectors(V, V.T @ (soft.M @ V), V.T @ (K @ V), replace(soft, K=K), c, factorize(K - c * soft.M, True))
    assert u.shape[1] == 2
    W = la.qr(np.hstack([V, u]), mode="economic")[0]
    theta = la.eigvalsh(W.T @ (K @ W), W.T @ (soft.M @ W))
    exact = la.eigvalsh(K.toarray(), soft.M.toarray())
    np.testing.assert_allclose(theta[theta < c], exact[exact < c], rtol=1e-6)
