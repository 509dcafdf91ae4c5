"""Elements in groups, by body, direction and place, whose errors fall at one rate each; and the error by these."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ..assembly.assembly import Assembly
from ..assembly.places import held_places
from ..mesh.groups import find_facets
from .directions import element_directions
from .edges import singular_elements

if TYPE_CHECKING:
    import pandas as pd

    from .quantities import Split

COLUMNS = ("quantity", "kind", "change", "scale", "body", "direction", "place", "part")
PLACES = ("elsewhere", "contact", "support", "edge")
EDGE = PLACES.index("edge")


def element_places(assembly: Assembly) -> np.ndarray:
    """Return (m,) int where each element lies, as a position in `PLACES`.

    An element lies at an edge where stresses are singular, see `edges`, at a support or at a contact if a node of it
    does; at that which is named first here, if at several.
    """
    scene, loaded, space = assembly.scene, assembly.loaded, assembly.space
    facets = [find_facets(loaded, c.surface, f"contacts[{i}].surface") for i, c in enumerate(scene.contacts)]
    facets += [
        find_facets(loaded, c.counterface, f"contacts[{i}].counterface")
        for i, c in enumerate(scene.contacts) if not c.is_rigid
    ]  # fmt: skip
    held, nodes = held_places(scene, loaded)
    found = np.zeros(space.mesh.nelements, int)
    for place, there in ((1, facets), (2, [f for f, _ in held])):
        for own in there:
            _mark(found, assembly, space.nodes_of(own), place)
    for own, _ in nodes:
        _mark(found, assembly, space.nodes_at(own, between=True), 2)
    found[singular_elements(assembly)] = EDGE
    return found


def _mark(found: np.ndarray, assembly: Assembly, nodes: np.ndarray, place: int) -> None:
    space = assembly.space
    marked = np.zeros(space.nodes, dtype=bool)
    marked[nodes] = True
    element_nodes = np.asarray(space.dofs.element_dofs)
    found[(marked[element_nodes]).any(axis=0)] = place


def element_groups(assembly: Assembly) -> tuple[list[tuple[str, str, str]], sp.csr_array]:
    """Return groups of elements and axes, by body, direction and place.

    Returns
    -------
    names : list of (body, direction, place)
        Those that have elements, by body first.
    groups : (g, m a) sparse
        Ones where an axis of an element belongs to a group.
    """
    directions = element_directions(assembly)
    kinds, along = np.unique(directions, return_inverse=True)
    along = along.reshape(directions.shape)
    place = element_places(assembly)[:, None]
    body = np.zeros(len(directions), int)
    for i, cells in enumerate(assembly.bodies.values()):
        body[cells] = i
    label = np.ravel_multi_index(
        (np.broadcast_to(body[:, None], along.shape), along, np.broadcast_to(place, along.shape)),
        (len(assembly.bodies), len(kinds), len(PLACES)),
    ).ravel()
    present, group = np.unique(label, return_inverse=True)
    b, d, p = np.unravel_index(present, (len(assembly.bodies), len(kinds), len(PLACES)))
    bodies = list(assembly.bodies)
    names = [(bodies[i], str(kinds[j]), PLACES[k]) for i, j, k in zip(b, d, p, strict=True)]
    shape = (len(present), len(label))
    return names, sp.csr_array((np.ones(len(label)), (group, np.arange(len(label)))), shape=shape)


def singular_groups(names: Sequence[tuple[str, str, str]]) -> np.ndarray:
    """Return (g,) bool, which groups of `element_groups` have singular stresses."""
    return np.array([place == PLACES[EDGE] for _, _, place in names], bool)


def split_dataframe(split: Split, assembly: Assembly) -> pd.DataFrame:
    """Return the changes of the quantities, split by body, direction and place, with the columns `COLUMNS`.

    A row is the part of one quantity's change that one group of elements adds; the parts of a quantity add up to its
    `change`. `change`, `scale` and `part` are in units of the quantity: rad/s for Im λ, 1/s for Re λ, the parameter's
    for onsets. Relative errors are meant relative to `scale`.
    """
    import pandas as pd

    names, groups = element_groups(assembly)
    parts = groups @ split.parts.reshape(len(split.names), -1).T
    told = zip(split.names, split.kinds, split.changes.tolist(), split.scales.tolist(), parts.T.tolist(), strict=True)
    rows = [(*own, *name, part) for *own, of in told for name, part in zip(names, of, strict=True)]
    return pd.DataFrame(rows, columns=list(COLUMNS))
