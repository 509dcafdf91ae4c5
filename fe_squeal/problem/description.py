"""What a mode looks like, in numbers that stand in a table beside its eigenvalue."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from ..eigen.blocks import lift
from ..eigen.columns import Columns
from .terms import Term

# Columns of modes.csv, in this order; a sweep without a describer has them empty.
DESCRIPTOR_COLUMNS = (
    "nodal_diameters", "nodal_circles", "out_of_plane", "body", "body_share",
    "nodal_diameters_share", "other_nodal_diameters", "other_share", "travelling",
)  # fmt: skip

Description = dict[str, list[Any]]


class Describer(Protocol):
    """Describes shapes. Whoever made a problem hands it in, since algebra does not know what the unknowns mean."""

    def describe(self, terms: Iterable[Term], parameters: Mapping[str, float], shapes: np.ndarray) -> Description:
        """Return the columns of `DESCRIPTOR_COLUMNS` for shapes (n, k) complex; None where there is nothing to say.

        Parameters
        ----------
        terms, parameters
            Those of the problem that the shapes belong to, at its values: masses count as they are there.
        """

    def on(self, V: Columns) -> Describer:
        """Return what describes shapes V y (n, k) by their coordinates y (r, k), with terms of these."""


def undescribed(count: int) -> Description:
    """Return the columns without any entry."""
    return {name: [None] * count for name in DESCRIPTOR_COLUMNS}


def shares_by_name(
    terms: Iterable[Term], parameters: Mapping[str, float], shapes: np.ndarray, names: Sequence[str]
) -> np.ndarray:
    """Return the part of the kinetic energy that the mass terms of these names have, (names, k)."""
    total, found = np.zeros(shapes.shape[1]), np.zeros((len(names), shapes.shape[1]))
    for term in terms:
        factor = term.factor(1.0, parameters) if term.slot == "M" else 0.0
        if not factor:
            continue
        energy = np.real(factor) * np.einsum("nk,nk->k", shapes.conj(), lift(term.matrix, shapes)).real
        total += energy
        if term.name in names:
            found[names.index(term.name)] += energy
    return np.divide(found, total, out=np.zeros_like(found), where=total > 0)
