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
    """A node set; nodes are columns of `mesh.doflocs`, in ascending order.

    Attributes
    ----------
    nodes : (n,) int
        The nodes that the file lists.
    held : (m,) int
        The nodes that are fixed if the set is: those of the file, and the midside nodes and centres between them that
        the file does not have and that were added.
    """

    nodes: Ints
    held: Ints


@dataclass(frozen=True)
class LoadedMesh:
    """A mesh that has passed all checks.

    Attributes
    ----------
    mesh : skfem.Mesh
        MeshTet1, MeshTet2, MeshHex1 or MeshHex2, coordinates in metres; `subdomains` holds the volume groups (element
        indices, sorted) and `boundaries` the surface groups (facet indices, sorted).
    source : str
        The file's name, for messages.
    notes : tuple of str
        Sentences about what was converted.
    warnings : tuple of str
        Sentences about what is probably a mistake.
    element_labels : (n_elements,) str
        Each element's number in the file, with the Abaqus instance in front. Tetrahedra that a cell was split into have
        the cell's number.
    unusable : mapping of str to str
        Names in the file that give no group, with the reason.
    ignore_case : bool
        Whether names are looked up without regard to case (Abaqus).
    node_groups : mapping of str to NodeSet
        Node sets by name.
    node_numbers : mapping of str to ((n,) int, (n,) int)
        By the instance in front of their numbers in the file ("PAD-1.", or "" without instances): the numbers of the
        nodes in the file, and the nodes as columns of `mesh.doflocs`.
    added : (columns,) bool
        Which nodes the file does not have: midside nodes and centres that were added.
    length_unit : str
        What the file says of the unit of its coordinates, such as "mm"; "" where it says nothing.
    bisection : (n_elements, 7) int
        How each tetrahedron is cut next, if the mesh was refined by `marked.refine_marked`: its corners in the order of
        `_Cells.corners` there, the two marks and the flag.
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
    """Return the element indices (n,) of a volume group.

    Raises
    ------
    MeshError
        There is no such group; the message has the nearest name.
    """
    return _look_up(loaded, name, loaded.mesh.subdomains or {}, "volume", loaded.mesh.boundaries or {}, "surface")


def surface_group(loaded: LoadedMesh, name: str) -> Ints:
    """Return the facet indices (n,) of a surface group.

    Raises
    ------
    MeshError
        There is no such group; the message has the nearest name.
    """
    return _look_up(loaded, name, loaded.mesh.boundaries or {}, "surface", loaded.mesh.subdomains or {}, "volume")


def find_facets(loaded: LoadedMesh, group: str, key: str, *others: str) -> Ints:
    """Return the facet indices (n,) of a surface group that a key of the scene names.

    Parameters
    ----------
    loaded : LoadedMesh
    group : str
        The name of the group.
    key : str
        The key of the scene, such as "contacts[0].surface", for messages.
    others : str
        Words that are valid there besides groups: a message suggests them too.

    Raises
    ------
    MeshError
        There is no such group; the message has the key and the nearest name.
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
        if not len(groups[name]):
            raise MeshError(f'{kind} group "{name}" in {loaded.source} is empty')
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
