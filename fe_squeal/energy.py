"""Where a growth rate comes from: the energy balance of a mode, term by term."""

from __future__ import annotations

import numpy as np

from .problem import Problem


def growth_shares(problem: Problem, lam: complex, u: np.ndarray, **values: float) -> dict[str, float]:
    """Return the share of each term in Re λ; the shares add up to Re λ.

    Multiplying Q(λ)u = 0 by λ* uᴴ and taking real parts gives
    Re λ = −(|λ|² uᴴC_s u + Im λ Im(uᴴK u)) / (|λ|² uᴴM u + uᴴK_s u), subscript s the Hermitian part. A symmetric
    stiffness gives exactly zero and is left out.

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
    inertia, stiffness = 0.0, 0.0
    work: dict[str, float] = {}
    for term in problem.terms:
        c = term.coefficient(parameters)
        if not c:
            continue
        form = complex(np.vdot(u, term.matrix @ u)) * c
        if term.slot == "M":
            inertia += form.real
        elif term.slot == "C":
            work[term.name] = work.get(term.name, 0.0) - abs(lam) ** 2 * form.real
        else:
            stiffness += form.real
            if not term.symmetric:
                work[term.name] = work.get(term.name, 0.0) - lam.imag * form.imag
    total = abs(lam) ** 2 * inertia + stiffness
    return {name: w / total for name, w in work.items()}
