"""A template for any mesh: its groups with their sizes and places, a body each, and questions for the rest."""

from __future__ import annotations

import numpy as np

from ..mesh import LoadedMesh
from ..mesh.loading import UNITS
from ..mesh.measures import area_of, volume_of
from .draft import Draft, plain_name, toml

_LARGEST = 5.0  # m: brakes are smaller, so that larger numbers are millimetres


def draft_template(loaded: LoadedMesh, mesh_file: str) -> Draft:
    """Return a scene of the bodies of a mesh, whose materials, supports and contacts have to be given.

    Parameters
    ----------
    loaded : LoadedMesh
        With coordinates as they stand in the file.
    mesh_file : str
        How the scene names it.
    """
    mesh = loaded.mesh
    size = float(np.ptp(mesh.p, axis=1).max())
    unit = loaded.length_unit if loaded.length_unit in UNITS else "mm" if size > _LARGEST else "m"
    draft = Draft(loaded.source.rpartition(".")[0] or loaded.source)
    draft.head += [f"Made by fe-squeal new from the mesh {loaded.source}.", ""]
    draft.head.append("Groups of the mesh, in its own unit of length:")
    for name, elements in (mesh.subdomains or {}).items():
        volume, centre = volume_of(mesh, np.asarray(elements))
        draft.head.append(f"  volume {name}: {len(elements)} elements, {volume:.4g}, about {_point(centre)}")
    for name, facets in (mesh.boundaries or {}).items():
        area, centre, normal = area_of(mesh, np.asarray(facets))
        draft.head.append(
            f"  surface {name}: {len(facets)} faces, {area:.4g}, about {_point(centre)}, mean normal {_point(normal)}"
        )
    for name, group in loaded.node_groups.items():
        rows = group.nodes
        centre = mesh.doflocs[:, rows].mean(axis=1)
        draft.head.append(f"  nodes {name}: {len(rows)}, about {_point(centre)}")
    table = draft.add("mesh", values={"file": mesh_file, "length_unit": unit, "order": 2})
    other = "m" if unit == "mm" else "mm"
    table.notes["length_unit"] = f"the mesh is {size:.4g} across; write {other} if this is wrong"
    _add_bodies(draft, loaded)
    names = list(mesh.boundaries or {})
    some = names[0] if names else "SURFACE"
    quoted = toml(some)
    draft.tail += [
        "What holds the bodies, presses them and lets them slide, if anything; all keys: docs/scene.md",
        "[[supports]]", f"surface = {quoted}", 'fixed = "xyz"', "",
        "[[springs]]", 'name = "piston"', f"surface = {quoted}", "direction = [0, 0, 1]", "stiffness = 1.0e7", "",
        "[[contacts]]", f"surface = {quoted}  # pad", 'counterface = "rigid"  # or the disc',
        "normal_stiffness = 1.0e12  # N/m per m^2",
        "sliding = { axis = [0, 0, 1], centre = [0, 0, 0], speed = 5.0 }", "",
        "[effects.friction]", "mu = 0.4", "",
        "[sweep]", 'parameter = "mu"', "from = 0.0", "to = 0.7", "points = 36",
    ]  # fmt: skip
    for note in loaded.notes:
        draft.find("mesh", "", note, "harmless")
    return draft


def _add_bodies(draft: Draft, loaded: LoadedMesh) -> None:
    """Add a body, with a material of its own, for each volume group that shares no element with one before."""
    covered = np.zeros(loaded.mesh.nelements, bool)
    taken: list[str] = []
    for group, elements in (loaded.mesh.subdomains or {}).items():
        if covered[np.asarray(elements)].any():
            continue
        covered[np.asarray(elements)] = True
        name = plain_name(group, taken)
        taken.append(name)
        material = draft.add("materials", f"of_{name}")
        for key, what in (("youngs_modulus", "Young's modulus"), ("poisson_ratio", "Poisson's ratio"),
                          ("density", "density")):  # fmt: skip
            draft.ask(material, key, f"{what} of {name}")
        body = draft.add("bodies", name, values={"material": f"of_{name}"})
        if name != group:
            body.values["groups"] = [group]
    if not covered.all():
        draft.find(
            "mesh", "", f"{int((~covered).sum())} of {len(covered)} elements are in no volume group, or in several;"
            " every element belongs to exactly one body", "missing",
        )  # fmt: skip


def _point(x: np.ndarray) -> str:
    return f"({', '.join(f'{v:.4g}' for v in np.where(np.abs(x) < 1e-12 * np.abs(x).max(initial=0.0), 0.0, x))})"
