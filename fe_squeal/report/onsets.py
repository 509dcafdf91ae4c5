"""Onsets at which growth goes on, and what the refined mesh says of onsets: their error, which one mesh alone has."""

from __future__ import annotations

import numpy as np
import pandas as pd

from fe_squeal.report.branches import Bools, numbers

REFINED_ONLY, VANISHES = "refined only", "vanishes refined"


def partings(onsets: pd.DataFrame) -> Bools:
    """Return (n,) bool, where two modes that grow already meet or part: growth neither begins nor ends there."""
    return np.asarray(onsets["law"] == "parting", bool) if "law" in onsets else np.zeros(len(onsets), bool)


def change_words(onsets: pd.DataFrame) -> list[tuple[str, str]]:
    """Return the kind and the direction of each onset, for tables; at a parting growth neither begins nor ends.

    Examples
    --------
    >>> change_words(pd.DataFrame({"kind": "divergence", "direction": "into", "law": ["linear", "parting"]}))
    [('divergence', 'into'), ('parting', 'grows on both sides')]
    """
    empty = pd.Series("", index=onsets.index)
    told = zip(onsets.get("kind", empty), onsets.get("direction", empty), partings(onsets).tolist(), strict=True)
    return [("parting", "grows on both sides") if parts else (str(kind), str(way)) for kind, way, parts in told]


def refined_only(onsets: pd.DataFrame) -> Bools:
    """Return (n,) bool, which onsets appear on the refined mesh alone: no branch of the sweep has them."""
    return np.asarray(numbers(onsets, "branch_a") == 0)


def vanishing(onsets: pd.DataFrame) -> Bools:
    """Return (n,) bool, which onsets of the mesh itself the refined mesh does not have."""
    return np.asarray(np.isinf(numbers(onsets, "discretisation")) & ~refined_only(onsets))


def mesh_states(onsets: pd.DataFrame) -> list[str]:
    """Return, for each onset, `refined only`, `vanishes refined`, or "" where both meshes have it.

    Examples
    --------
    >>> mesh_states(pd.DataFrame({"branch_a": [0, 3, 5], "discretisation": [np.inf, np.inf, 0.02]}))
    ['refined only', 'vanishes refined', '']
    """
    pairs = zip(refined_only(onsets).tolist(), vanishing(onsets).tolist(), strict=True)
    return [REFINED_ONLY if alone else VANISHES if gone else "" for alone, gone in pairs]


def mesh_errors(onsets: pd.DataFrame) -> list[str] | None:
    """Return the error of each onset by the mesh, as texts; None where it was not estimated.

    A table of an estimated run has a column of extrapolated values, even if no error is known.

    Examples
    --------
    >>> mesh_errors(pd.DataFrame({"branch_a": [0, 3, 5], "discretisation": [np.inf, np.nan, 0.02]}))
    ['refined only', '?', '± 0.02']
    """
    mesh = numbers(onsets, "discretisation")
    if np.isnan(mesh).all() and "value_extrapolated" not in onsets:
        return None
    texts = zip(mesh_states(onsets), mesh.tolist(), strict=True)
    return [state or ("?" if np.isnan(error) else f"± {error:.2g}") for state, error in texts]
