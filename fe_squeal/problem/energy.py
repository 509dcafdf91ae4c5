"""Where a growth rate comes from and where the energy of a mode is: its energy balance, term by term."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .problem import Problem


@dataclass(frozen=True)
class Share:
    """What one term has of a mode.

    Attributes
    ----------
    growth : float, 1/s
        Its share in Re λ; exactly 0 for a conservative term.
    energy : float
        Its part of the kinetic energy (mass) or of the potential energy (stiffness), NaN where it holds none.
    kind : str
        "kinetic" or "potential": which energy that is; "" where it holds none.
    """

    growth: float
    energy: float
    kind: str


def energy_balance(problem: Problem, lam: complex, u: np.ndarray) -> dict[str, Share]:
    """Return the share of each term in Re λ, which add up to it, and in the energy of the mode.

    Multiplying Q(λ)u = 0 by λ* uᴴ and taking real parts gives
    Re λ = −(|λ|² uᴴC_s u + Im λ Im(uᴴK u)) / (|λ|² uᴴM u + uᴴK_s u), subscript s the Hermitian part. A symmetric
    stiffness and a gyroscopic term give exactly zero. For a real λ, where that is 0/0 without damping,
    λ²m + λc + k = 0 itself is shared out: −k_t/(λm) to every stiffness term and −c_t/m to every damping term, which
    add up to λ. The energies are uᴴM u, and uᴴK u of the symmetric stiffness, each over the sum of its kind.

    Parameters
    ----------
    problem : Problem
        The problem, at the values of its parameters that the mode belongs to.
    lam : complex, rad/s
    u : (n,)

    Returns
    -------
    dict of term name to Share
        Terms of one name in several slots count together.
    """
    real = lam.imag == 0
    inertia = stiffness = 0.0
    work: dict[str, float] = {}
    stored: dict[str, dict[str, float]] = {"M": {}, "K": {}}
    for term in problem.terms:
        c = term.factor(1.0, problem.parameters)
        if not c:
            continue
        form = complex(np.vdot(u, term.matrix @ u)) * c
        work.setdefault(term.name, 0.0)
        if term.slot != "C" and term.symmetric and not term.imaginary:
            stored[term.slot][term.name] = stored[term.slot].get(term.name, 0.0) + form.real
        if term.slot == "M":
            inertia += form.real
        elif real:
            work[term.name] -= form.real * (lam.real if term.slot == "C" else 1.0)
        elif term.slot == "C":
            work[term.name] -= 0.0 if term.conservative else abs(lam) ** 2 * form.real
        else:
            # Of real symmetric matrices times i, and of real skew ones, the Hermitian part is zero.
            none = term.symmetric if term.imaginary else term.skew
            stiffness += 0.0 if none else form.real
            work[term.name] -= 0.0 if term.conservative else lam.imag * form.imag
    total = lam.real * inertia if real else abs(lam) ** 2 * inertia + stiffness
    sums = {slot: sum(parts.values()) for slot, parts in stored.items()}
    kinds = {"M": "kinetic", "K": "potential"}
    energies = {
        name: (e / sums[slot], kinds[slot]) for slot, parts in stored.items() if sums[slot] for name, e in parts.items()
    }
    return {name: Share(w / total if total else np.nan, *energies.get(name, (np.nan, ""))) for name, w in work.items()}
