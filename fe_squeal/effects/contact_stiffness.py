"""Contact stiffness and damping: K_c = ∫ k_n δg g dA, and the same along both tangents where a contact is tied."""

from __future__ import annotations

import scipy.sparse as sp

from ..fem.contact import ContactOperators
from ..problem.terms import Slot, Term


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
    shape = sum((G.T @ W @ G for G in rows), start=sp.csr_array((rows[0].shape[1],) * 2))
    shape = sp.csr_array((shape + shape.T) / 2)
    slots: list[tuple[Slot, str, float]] = [("K", "normal_stiffness", stiffness), ("C", "normal_damping", damping)]
    path = f"contacts.{name}"
    return [
        Term(
            f"contact.{name}", slot, shape, symmetric=True, powers={f"{path}.{key}": 1}, penalty=tied and slot == "K"
        )
        for slot, key, size in slots
        if size
    ]
