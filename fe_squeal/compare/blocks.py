"""Stiff bodies of hexahedra: small meshes that move as rigid masses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import skfem

from ..mesh import LoadedMesh, from_skfem


@dataclass(frozen=True)
class Body:
    """A body of bricks on a grid, some cells left out.

    Attributes
    ----------
    name : str
    x, y, z : (k,) float, m
        Grid lines.
    regions : mapping of name to mask (cx, cy, cz) bool
        Cells of each volume group; cells in none are left out. Default: all cells, under the body's name.
    """

    name: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    z: tuple[float, ...]
    regions: dict[str, np.ndarray] | None = None


def brick(name: str, centre: tuple[float, float, float], size: tuple[float, float, float]) -> Body:
    """Return a body of one hexahedron."""
    x, y, z = ((c - s / 2, c + s / 2) for c, s in zip(centre, size, strict=True))
    return Body(name, x, y, z)


def mesh_of_bodies(bodies: list[Body], patches: dict[str, tuple[str, tuple[float, float], float]]) -> LoadedMesh:
    """Return one mesh of several bodies that share no nodes.

    Surface groups, NAME the body: NAME.ends (across x), NAME.sides (across y), NAME.bottom and NAME.top (its lowest and
    highest faces).

    Parameters
    ----------
    patches : mapping of name to (body, (x_low, x_high), z)
        Further surface groups: the faces of a body in the plane z between two values of x.
    """
    points: list[np.ndarray] = []
    cells: list[np.ndarray] = []
    owner: list[str] = []
    volumes: dict[str, np.ndarray] = {}
    first = 0
    for body in bodies:
        grid = skfem.MeshHex.init_tensor(np.array(body.x), np.array(body.y), np.array(body.z))
        middle = grid.p[:, grid.t].mean(axis=1)
        where = tuple(np.searchsorted(lines, m) - 1 for lines, m in zip((body.x, body.y, body.z), middle, strict=True))
        everything = {body.name: np.ones(tuple(len(lines) - 1 for lines in (body.x, body.y, body.z)), bool)}
        kept = np.zeros(grid.t.shape[1], bool)
        members = {name: mask[where] for name, mask in (body.regions or everything).items()}
        for mask in members.values():
            kept |= mask
        number = np.cumsum(kept) - 1 + first
        volumes |= {name: number[mask & kept] for name, mask in members.items()}
        used, t = np.unique(grid.t[:, kept], return_inverse=True)
        cells.append(t.reshape(8, -1) + sum(p.shape[1] for p in points))
        points.append(grid.p[:, used])
        owner += [body.name] * int(kept.sum())
        first += int(kept.sum())
    mesh = skfem.MeshHex1(np.ascontiguousarray(np.hstack(points)), np.ascontiguousarray(np.hstack(cells)))
    surfaces = _surfaces(mesh, np.array(owner), bodies, patches)
    return from_skfem(mesh.with_subdomains(volumes).with_boundaries(surfaces), "stiff bodies")


def _surfaces(
    mesh: skfem.Mesh, owner: np.ndarray, bodies: list[Body], patches: dict[str, tuple[str, tuple[float, float], float]]
) -> dict[str, np.ndarray]:
    facets = mesh.boundary_facets()
    corners = mesh.p[:, mesh.facets[:, facets]]
    low, high = corners.min(axis=1), corners.max(axis=1)
    of = owner[mesh.f2t[0, facets]]
    across = [high[c] - low[c] < 1e-9 * np.ptp(mesh.p[c]) for c in range(3)]
    groups = {}
    for body in bodies:
        mine = of == body.name
        ends = [(low[0] == body.x[0]), (low[0] == body.x[-1])]
        groups[f"{body.name}.ends"] = facets[mine & across[0] & (ends[0] | ends[1])]
        groups[f"{body.name}.sides"] = facets[mine & across[1]]
        groups[f"{body.name}.bottom"] = facets[mine & across[2] & (low[2] == body.z[0])]
        groups[f"{body.name}.top"] = facets[mine & across[2] & (low[2] == body.z[-1])]
    for name, (owner_name, (left, right), z) in patches.items():
        inside = (low[0] >= left - 1e-12) & (high[0] <= right + 1e-12) & (np.abs(low[2] - z) < 1e-12)
        groups[name] = facets[(of == owner_name) & across[2] & inside]
    return groups
