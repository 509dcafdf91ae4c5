"""The checked mesh, and the look-up of its groups by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import skfem
from numpy.typing import NDArray

from fe_squeal.errors import MeshError, suggest

from .raw import Ints


@dataclass(frozen=True)
class NodeSet:
    """A node set as sorted columns of `mesh.doflocs`.

    Attributes
    ----------
    nodes
        Those that the file names.
    held
        With them all nodes that have to rest where these are held: the file does not have those that were added between
        them.
    """

    nodes: Ints
    held: Ints


@dataclass(frozen=True)
class LoadedMesh:
    """A mesh that has passed all checks.

    Attributes
    ----------
    mesh
        MeshTet1, MeshTet2, MeshHex1 or MeshHex2, coordinates in metres; `subdomains` holds the volume groups and
        `boundaries` the surface groups (facet indices, sorted).
    source
        The file's name, for messages.
    notes
        Sentences about what was converted.
    warnings
        Sentences about what is probably a mistake.
    element_labels
        (n_elements,) each element's number in the file, with the instance in front; tetrahedra that were split off a
        cell have the cell's.
    unusable
        Names in the file that give no group, with the reason.
    ignore_case
        Whether names are looked up without regard to case (Abaqus).
    node_groups
        Node sets by name.
    node_numbers
        By what stands in front of them in the file ("" or "PAD-1."): the nodes' numbers there, and their columns.
    added
        (columns,) which nodes the file does not have.
    length_unit
        What the file says of its coordinates, "mm", "" where it says nothing.
    bisection
        (n_elements, 7), how tetrahedra are cut next, where marked ones were refined; see `marked`.
    """

    mesh: skfem.Mesh
    source: str
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    element_labels: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=str))
    unusable: dict[str, str] = field(default_factory=dict)
    ignore_case: bool = False
    node_groups: dict[str, NodeSet] = field(default_factory=dict)
    node_numbers: dict[str, tuple[Ints, Ints]] = field(default_factory=dict)
    added: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))
    length_unit: str = ""
    bisection: Ints = field(default_factory=lambda: np.empty((0, 7), np.int64))


def volume_group(loaded: LoadedMesh, name: str) -> Ints:
    """Return the element indices of a volume group; MeshError with the nearest name if there is none."""
    return _look_up(loaded, name, loaded.mesh.subdomains or {}, "volume", loaded.mesh.boundaries or {}, "surface")


def surface_group(loaded: LoadedMesh, name: str) -> Ints:
    """Return the facet indices of a surface group; MeshError with the nearest name if there is none."""
    return _look_up(loaded, name, loaded.mesh.boundaries or {}, "surface", loaded.mesh.subdomains or {}, "volume")


def find_facets(loaded: LoadedMesh, group: str, key: str, *others: str) -> Ints:
    """Return the facets of a surface group.

    Parameters
    ----------
    key : str
        Where it was named, for messages.
    others : str
        Other words that are valid there, for the suggestion of a message.

    Raises
    ------
    MeshError
    """
    try:
        return surface_group(loaded, group)
    except MeshError as error:
        close = suggest(group, others)
        if "did you mean" in close:
            raise MeshError(f'{key}: no surface group "{group}" in {loaded.source}{close}') from error
        raise MeshError(f"{key}: {error}") from error


def _look_up(
    loaded: LoadedMesh, name: str, groups: Mapping[str, Ints], kind: str, others: Mapping[str, Ints], other: str
) -> Ints:
    if name in groups:
        return np.asarray(groups[name])
    alike = [key for key in groups if key.casefold() == name.casefold()]
    if loaded.ignore_case and len(alike) == 1:
        return np.asarray(groups[alike[0]])
    message = f'no {kind} group "{name}" in {loaded.source}'
    reasons = {key.casefold(): text for key, text in loaded.unusable.items()}
    if len(alike) > 1 and loaded.ignore_case:
        raise MeshError(f"{message}; several differ only in case: " + ", ".join(sorted(alike)))
    same = {key for key in others if key == name or (loaded.ignore_case and key.casefold() == name.casefold())}
    if same:
        raise MeshError(f"{message}: that is a {other} group{suggest(name, groups)}")
    if name.casefold() in reasons:
        raise MeshError(f"{message}: {reasons[name.casefold()]}{suggest(name, groups)}")
    raise MeshError(message + suggest(name, groups))
