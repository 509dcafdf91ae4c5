"""Structured scikit-fem meshes with named groups, and scenes on them, for the verification tests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import skfem
from renumbering import QUADRATIC

import fe_squeal
from fe_squeal.eigen.pencil import Modes
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.problem.problem import Problem

KINDS = ("hex1", "hex2", "tet1", "tet2")
STEEL = {"youngs_modulus": 2e11, "poisson_ratio": 0.3, "density": 7800.0}
BELT = {"direction": [1.0, 0.0, 0.0], "speed": 1.0}
_SIDES = {"left": (0, 0), "right": (0, -1), "front": (1, 0), "back": (1, -1), "bottom": (2, 0), "top": (2, -1)}


def box(kind, counts, size=(1.0, 1.0, 1.0), corner=(0.0, 0.0, 0.0), name="block"):
    """Mesh a box; groups: the volume, and left/right, front/back, bottom/top (`left_<name>` unless it is "block").
    """
    axes = [c + np.linspace(0, s, n + 1) for c, s, n in zip(corner, size, counts, strict=True)]
    mesh = (skfem.MeshHex if kind.startswith("hex") else skfem.MeshTet).init_tensor(*axes)
    suffix = "" if name == "block" else f"_{name}"
    tiny = 1e-9 * max(size)
    sides = {side + suffix: _on_plane(axis, axes[axis][end], tiny) for side, (axis, end) in _SIDES.items()}
    return raised(mesh.with_subdomains({name: np.arange(mesh.nelements)}).with_boundaries(sides), kind)


def _on_plane(axis, at, tiny):
    """Return a function of points x (3, k) that says which have the coordinate `at` along an axis."""
    return lambda x: np.abs(x[axis] - at) < tiny


def annulus(kind, counts, inner, outer, thickness, bottom=0.0, name="disc"):
    """Mesh a ring about z with (radial, around, through) elements; quadratic hexahedra follow the circles.

    Groups: the volume, hub, rim, bottom, top (`hub_<name>` ... unless name is "disc").
    """
    n_r, n_t, n_z = counts
    r = np.linspace(inner, outer, n_r + 1)
    z = bottom + np.linspace(0, thickness, n_z + 1)
    flat = skfem.MeshHex.init_tensor(r, np.arange(n_t + 1.0), z)
    # The last layer of nodes around the axis is identified with the first one.
    key = np.stack([np.searchsorted(r, flat.p[0]), flat.p[1].astype(int) % n_t, np.searchsorted(z, flat.p[2])])
    _, first, index = np.unique(key, axis=1, return_index=True, return_inverse=True)
    index = np.ravel(index)
    angle = 2 * np.pi * key[1] / n_t
    points = np.stack([flat.p[0] * np.cos(angle), flat.p[0] * np.sin(angle), flat.p[2]])[:, first]
    mesh = skfem.MeshHex(points, index[flat.t])
    if kind.startswith("tet"):
        mesh = _periodic_tets(flat, points, index)
    suffix = "" if name == "disc" else f"_{name}"
    middle = (inner + outer) / 2
    flat_face = {"bottom": z[0], "top": z[-1]}
    groups = {s + suffix: _on_plane(2, at, 1e-9 * outer) for s, at in flat_face.items()}
    mesh = mesh.with_subdomains({name: np.arange(mesh.nelements)}).with_boundaries(groups)
    radius = np.linalg.norm(mesh.p[:2][:, mesh.facets], axis=0)  # (corners, facets)
    on = {"hub": np.abs(radius - inner).max(axis=0), "rim": np.abs(radius - outer).max(axis=0)}
    found = {s + suffix: np.flatnonzero(d < 1e-3 * min(inner, outer - middle)) for s, d in on.items()}
    mesh = replace(mesh, _boundaries={**mesh.boundaries, **found})
    mesh = raised(mesh, kind)
    if kind != "hex2":
        return mesh
    # Midside nodes on edges around the axis are moved from the chord to the circle.
    x = mesh.doflocs.copy()
    step = np.arctan2(x[1], x[0]) * n_t / (2 * np.pi)
    x[:2] /= np.where(np.abs(step - np.round(step)) > 0.25, np.cos(np.pi / n_t), 1.0)
    return replace(mesh, doflocs=x)


def _periodic_tets(flat, points, index):
    tets = skfem.MeshTet.init_tensor(*(np.unique(flat.p[a]) for a in range(3)))
    place = {tuple(p): i for i, p in enumerate(flat.p.T)}
    return skfem.MeshTet(points, index[np.array([place[tuple(p)] for p in tets.p.T])][tets.t])


def raised(mesh, kind):
    """Return the mesh with midside nodes, on straight edges, if the kind has them, with the same groups."""
    if kind.endswith("1"):
        return mesh
    quadratic = QUADRATIC[type(mesh)].from_mesh(mesh)
    return replace(quadratic, _subdomains=mesh.subdomains, _boundaries=mesh.boundaries)


def mapped(mesh, f):
    """Return the mesh with all nodes, midside nodes too, moved by x -> f(x), x (3, nodes)."""
    return replace(mesh, doflocs=np.ascontiguousarray(f(mesh.doflocs)))


def distorted(mesh, amount, seed=0):
    """Return a mesh of a box whose inner nodes are moved at random by up to `amount`; quadratic edges become curved."""
    x = mesh.doflocs.copy()
    low, high = x.min(axis=1, keepdims=True), x.max(axis=1, keepdims=True)
    inside = ((x > low + 1e-9) & (x < high - 1e-9)).all(axis=0)
    x[:, inside] += np.random.default_rng(seed).uniform(-amount, amount, (3, inside.sum()))
    return replace(mesh, doflocs=x)


def join(*meshes):
    """Return one mesh of several meshes of the same kind, without merging nodes."""
    kind = type(meshes[0])
    corners = next((linear for linear, quadratic in QUADRATIC.items() if quadratic is kind), kind)
    starts = np.cumsum([0] + [m.nvertices for m in meshes])  # corners come first
    points = np.hstack([m.p[:, : m.nvertices] for m in meshes])
    mesh = corners(points, np.hstack([m.t + start for m, start in zip(meshes, starts, strict=False)]))
    rows = {tuple(f): i for i, f in enumerate(np.sort(mesh.facets, axis=0).T.tolist())}
    volumes, boundaries, elements = {}, {}, 0
    for m, start in zip(meshes, starts, strict=False):
        volumes |= {name: e + elements for name, e in m.subdomains.items()}
        for name, facets in m.boundaries.items():
            nodes = np.sort(m.facets[:, facets] + start, axis=0)
            boundaries[name] = np.array([rows[tuple(f)] for f in nodes.T.tolist()])
        elements += m.nelements
    if kind is not corners:
        mesh = kind.from_mesh(mesh)
        x = mesh.doflocs.copy()
        x[:, mesh.dofs.element_dofs] = np.concatenate([m.doflocs[:, m.dofs.element_dofs] for m in meshes], axis=2)
        mesh = replace(mesh, doflocs=x)
    return replace(mesh, _subdomains=volumes, _boundaries=boundaries)


def make_problem(mesh, order=2, materials=None, bodies=None, **tables) -> Problem:
    """Return the problem of a scene on a mesh; every volume has the material "steel" unless `bodies` says otherwise."""
    materials = materials or {"steel": STEEL}
    only = next(iter(materials))
    bodies = bodies or {name: {"material": only} for name in mesh.subdomains}
    scene = {"mesh": {"file": "none.msh", "order": order}, "materials": materials, "bodies": bodies, **tables}
    return fe_squeal.assemble(fe_squeal.parse_scene(scene), fe_squeal.from_skfem(mesh))


def modes_of(problem: Problem, count: int, **values) -> Modes:
    """Return the lowest modes."""
    return solve_modes(problem.pencil(**values), Request(count=count))


def frequencies(problem: Problem, count: int, **values) -> np.ndarray:
    """Return the lowest frequencies in Hz."""
    return modes_of(problem, count, **values).frequency_hz[:count]


def term(problem: Problem, name: str, slot: str = "K"):
    """Return the sparse matrix of the term whose name begins so."""
    (found,) = [
        t.matrix * t.coefficient({**problem.parameters, "mu": 1.0})
        for t in problem.terms
        if t.name.startswith(name) and t.slot == slot
    ]
    return found


def rigid_motions(problem: Problem) -> np.ndarray:
    """Return (n, 6): translations along x, y, z and rotations e × x about the origin, on the unknowns."""
    space = problem.discretisation.space
    x = space.coordinates
    columns = [np.tile(e, (len(x), 1)) for e in np.eye(3)] + [np.cross(e, x) for e in np.eye(3)]
    return np.stack([space.gather(c) for c in columns], axis=1)


def rotation(seed=1) -> np.ndarray:
    """Return a rotation matrix far from the coordinate axes."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    return q * np.sign(np.linalg.det(q))
