"""Contact stiffness and damping: K_c = ∫ k_n δg g dA, and the same along both tangents where a contact is tied."""

from __future__ import annotations

import scipy.sparse as sp

from ..contact import ContactOperators
from ..terms import Slot, Term


def contact_terms(
    name: str, operators: ContactOperators, stiffness: float, damping: float = 0.0, tied: bool = False
) -> list[Term]:
    """Return the terms of a contact's normal (tied: full) stiffness and normal damping, only those that are not zero.

    Parameters
    ----------
    stiffness : float, N/m per m^2
    damping : float, N s/m per m^2
    """
    W = sp.diags_array(operators.weights)
    rows = [operators.gap, operators.slip, operators.cross] if tied else [operators.gap]
    slots: list[tuple[Slot, float]] = [("K", stiffness), ("C", damping)]
    terms = []
    for slot, size in slots:
        if size:
            matrix = sum((G.T @ (W * size) @ G for G in rows), start=sp.csr_array((rows[0].shape[1],) * 2))
            terms.append(Term(f"contact.{name}", slot, sp.csr_array((matrix + matrix.T) / 2), symmetric=True))
    return terms
