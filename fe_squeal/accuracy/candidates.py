"""The next mesh of a search for a target: finer where the error comes from.

A parametric mesh of hexahedra gets more elements along some of its lines, a mesh of tetrahedra is cut finer where its
elements are marked, and hexahedra from a file are all cut into eight.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..assembly.assembly import Assembly
from ..assembly.bodies import read_mesh
from ..assembly.contacts import with_gap_tolerances
from ..fem.spaces import make_space
from ..mesh import LoadedMesh
from ..mesh.marked import refine_marked
from ..mesh.refining import refine
from ..scene import Scene
from .adapt import finer_geometry, told
from .bars import Parts, bar_of_parts
from .groups import element_groups, singular_groups
from .line_errors import LineErrors, line_errors
from .own_mesh import own_mesh
from .quantities import Split

# Orders of the elements: on every scene measured, order 1 takes many times as long as 2 for the same error, and of
# parametric hexahedra order 2 longer than 3. Elements that are so many times as long have about as many nodes.
_LEAST, _HEXAHEDRA = 2, 3
_LONGER = {1: (2.0, "twice"), 2: (1.5, "1.5 times")}  # by the order that they had, one less
_FALLS = 0.8  # part of an element's share in the error that is expected to vanish when it is cut into eight
_PARTS = 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9  # of the whole error: what the marked elements may have of it
_EVERYWHERE = 1.5  # times the elements along every line, where no line explains the error
_SHARP = 5.0  # power of bar/target that weighs each quantity: the larger, the more the worst quantity decides


@dataclass(frozen=True)
class Candidate:
    """A mesh to be tried.

    Attributes
    ----------
    scene : Scene
        The scene with elements of order 2 or 3 and, for a parametric mesh, with its numbers of elements.
    loaded : LoadedMesh
        The mesh.
    told : str
        What the mesh is, in words, such as "disc_layers 1 to 2".
    unknowns : int
        Three for each node, those that supports hold included.
    errors : LineErrors or None
        The errors on the previous mesh by line, where both meshes are parametric ones of hexahedra.
    """

    scene: Scene
    loaded: LoadedMesh
    told: str
    unknowns: int
    errors: LineErrors | None = None


def first_candidate(scene: Scene) -> Candidate:
    """Return the first mesh: the scene's own with elements of `search_order`. Later ones have its gap tolerances.

    Where the scene has a geometry beside a file, it is the mesh of the geometry. A parametric mesh whose elements get
    another order gets longer ones, and so about as many nodes as before.

    Raises
    ------
    SceneError, MeshError
        As `own_mesh`.
    """
    geometry, order = scene.mesh.geometry, search_order(scene)
    words = "the scene's own mesh"
    update: dict[str, object] = {"order": order}
    if geometry is not None:
        words = words if scene.mesh.file is None else f"the mesh of [mesh.{_key(scene)}]"
        update["file"] = None
        if scene.mesh.order < order:
            longer, told_longer = _LONGER[scene.mesh.order]
            words += f", order {order}, elements {told_longer} as long"
            update[_key(scene)] = geometry.resized(longer * geometry.edge_length)
    mesh = scene.mesh.model_copy(update=update)
    changed = scene.model_copy(update={"mesh": mesh})
    loaded = own_mesh(changed)
    return _candidate(with_gap_tolerances(changed, loaded), loaded, words)


def search_order(scene: Scene) -> int:
    """Return the order of the elements that meshes are searched with: the scene's own, at least 2.

    Where the scene says none, parametric hexahedra have order 3.
    """
    geometry = scene.mesh.geometry
    if geometry is not None and geometry.element == "hex" and "order" not in scene.mesh.model_fields_set:
        return _HEXAHEDRA
    return max(scene.mesh.order, _LEAST)


def restored(
    scene: Scene, loaded: LoadedMesh, geometry: Mapping[str, Any] | None, words: str, errors: LineErrors | None
) -> Candidate:
    """Return a candidate from what was kept of it: its mesh, the numbers of a parametric geometry, and `errors`.

    Raises
    ------
    ValueError
        The numbers are not those of such a geometry.
    """
    update: dict[str, object] = {"order": search_order(scene) if errors is None else errors.order}
    scene = scene.model_copy(update={"contacts": first_candidate(scene).scene.contacts})
    own = scene.mesh.geometry
    if (geometry is None) != (own is None):
        raise ValueError("a geometry for a scene that has none, or none for one that has")
    if geometry is not None and own is not None:
        update |= {"file": None, _key(scene): type(own).model_validate(dict(geometry))}
    mesh = scene.mesh.model_copy(update=update)
    return replace(_candidate(scene.model_copy(update={"mesh": mesh}), loaded, words), errors=errors)


def next_candidate(candidate: Candidate, assembly: Assembly, split: Split, target: float) -> Candidate:
    """Return a mesh on which every bar, to first order, is expected to be below a target.

    Parameters
    ----------
    candidate : Candidate
        The present mesh.
    assembly : Assembly
        The problem on the present mesh.
    split : Split
        What refining the present mesh changes, by element and axis.
    target : float
        For the bar of each quantity, relative to its scale.
    """
    scene, geometry = candidate.scene, candidate.scene.mesh.geometry
    if geometry is not None and geometry.element == "hex":
        errors = line_errors(split, assembly, candidate.errors)
        finer = finer_geometry(errors, geometry, target)
        changed = scene.model_copy(update={"mesh": scene.mesh.model_copy(update={_key(scene): finer})})
        found = _candidate(changed, read_mesh(changed), told(finer, geometry))
        return replace(found, errors=errors)
    if candidate.loaded.mesh.elem.refdom.p.shape[1] == 8:
        return _candidate(scene, refine(candidate.loaded), "every element into eight")
    grouped, order = element_groups(assembly), assembly.space.order
    marked = marked_elements(split, lambda expected: first_order_bars(expected, *grouped, order) / target)
    if len(marked) == split.parts.shape[1]:
        return _candidate(scene, refine(candidate.loaded), "every element into eight")
    loaded, _ = refine_marked(candidate.loaded, marked)
    return _candidate(scene, loaded, f"{len(marked)} of {split.parts.shape[1]} elements into eight")


def finer_candidate(candidate: Candidate) -> Candidate:
    """Return a mesh that is finer everywhere.

    It is tried where the errors cannot be traced to elements, for instance because an onset is missing on this mesh.
    """
    scene, geometry = candidate.scene, candidate.scene.mesh.geometry
    if geometry is None or geometry.element != "hex":
        return _candidate(scene, refine(candidate.loaded), "every element into eight")
    counts = {}
    for key, line in geometry.lines.items():
        steps = line.elements // line.multiple
        counts[key] = line.multiple * max(round(_EVERYWHERE * steps), steps + 1)
    finer = geometry.with_counts(counts)
    changed = scene.model_copy(update={"mesh": scene.mesh.model_copy(update={_key(scene): finer})})
    return _candidate(changed, read_mesh(changed), "more elements along every line")


def first_order_bars(
    split: Split, names: Sequence[tuple[str, str, str]], groups: sp.csr_array, order: int
) -> np.ndarray:  # fmt: skip
    """Return the bars (q,), relative, that changes to first order and their parts give, see `bars`.

    The names and the matrix of the groups are those of `element_groups`, and the order is that of the elements.
    """
    parts = Parts.of(groups @ split.parts.reshape(len(split.names), groups.shape[1]).T, singular_groups(names))
    return bar_of_parts(split.changes, parts, order) / split.scales


def marked_elements(split: Split, missed: Callable[[Split], np.ndarray]) -> np.ndarray:
    """Return the elements (e,) int, ascending, whose refinement is expected to bring every bar below a target.

    An element's share is Σ_q m_q^5 |its part of quantity q| / Σ |parts of q|, with m the bars over the target:
    quantities count the more, the farther they miss it. Of the elements with the largest shares so many are taken that
    the bars meet the target when what is expected to vanish of their parts has vanished. Parts of either sign cancel in
    a bar, and refining some elements alone may make it wider: then it takes more of them, or all.

    Parameters
    ----------
    missed : callable of Split
        Returns each quantity's bar over the target, (q,).
    """
    sizes, own = np.abs(split.parts.sum(axis=2)), missed(split)
    whole = sizes.sum(axis=1, keepdims=True)
    share = own**_SHARP @ np.divide(sizes, whole, out=np.zeros_like(sizes), where=whole > 0)
    order = np.argsort(-share)
    held = np.cumsum(share[order])
    for part in _PARTS:
        marked = np.sort(order[: 1 + int(np.searchsorted(held, part * held[-1]))])
        left = np.ones(len(share))
        left[marked] -= _FALLS
        expected = missed(replace(split, parts=split.parts * left[:, None]))
        if expected.max(initial=0.0) <= 1 and len(marked) < len(share):
            return marked
    return np.arange(len(share))


def _candidate(scene: Scene, loaded: LoadedMesh, words: str) -> Candidate:
    unknowns = 3 * make_space(loaded.mesh, scene.mesh.order, []).nodes
    return Candidate(scene, loaded, words, unknowns)


def _key(scene: Scene) -> str:
    return "disc_pad" if scene.mesh.disc_pad is not None else "block"
