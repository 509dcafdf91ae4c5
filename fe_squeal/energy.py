"""Where a growth rate comes from: the energy balance of a mode, term by term."""

from __future__ import annotations

import numpy as np

from .problem import Problem


def growth_shares(problem: Problem, lam: complex, u: np.ndarray, **values: float) -> dict[str, float]:
    """Return the share of each term in Re λ; the shares add up to Re λ.

    Multiplying Q(λ)u = 0 by λ* uᴴ and taking real parts gives
    Re λ = −(|λ|² uᴴC_s u + Im λ Im(uᴴK u)) / (|λ|² uᴴM u + uᴴK_s u), subscript s the Hermitian part. A symmetric
    stiffness gives exactly zero and is left out. For a real λ, where that is 0/0 without damping, λ²m + λc + k = 0
    itself is shared out: −k_t/(λm) to every stiffness term and −c_t/m to every damping term, which add up to λ.

    Parameters
    ----------
    lam : complex, rad/s
    u : (n,)
    values : parameters other than nominal

    Returns
    -------
    dict of term name to 1/s
    """
    parameters = {**problem.parameters, **values}
    inertia, stiffness, real = 0.0, 0.0, lam.imag == 0
    work: dict[str, float] = {}
    for term in problem.terms:
        c = term.coefficient(parameters)
        if not c:
            continue
        form = complex(np.vdot(u, term.matrix @ u)) * c
        if term.slot == "M":
            inertia += form.real
        elif real:
            work[term.name] = work.get(term.name, 0.0) - form.real * (lam.real if term.slot == "C" else 1.0)
        elif term.slot == "C":
            work[term.name] = work.get(term.name, 0.0) - abs(lam) ** 2 * form.real
        else:
            stiffness += form.real
            if not term.symmetric:
                work[term.name] = work.get(term.name, 0.0) - lam.imag * form.imag
    total = lam.real * inertia if real else abs(lam) ** 2 * inertia + stiffness
    return {name: w / total for name, w in work.items()}
