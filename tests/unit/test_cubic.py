"""Hexahedra of order 3: functions, numbering of nodes, and what they are refused for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import skfem

from fe_squeal.errors import SceneError
from fe_squeal.fem.cells import geometry_map, shape_functions
from fe_squeal.fem.cubic import CubicDofs, ElementHex3
from fe_squeal.fem.spaces import make_space
from fe_squeal.mesh import from_skfem
from fe_squeal.mesh.groups import NodeSet
from fe_squeal.mesh.refining import refine
from meshes import annulus, box, distorted

MESHES = {
    "boxes": distorted(box("hex1", (3, 2, 4), (1.0, 0.8, 0.7)), 0.04),
    "ring": annulus("hex2", (2, 9, 2), 0.1, 0.2, 0.05),
}


def renumbered(mesh, seed):
    """The mesh with its corners numbered anew, and each element's corners in another order (turned about an axis)."""
    rng, corners = np.random.default_rng(seed), mesh.t.max() + 1
    new = np.concatenate([rng.permutation(corners), np.arange(corners, mesh.doflocs.shape[1])])
    x = np.empty_like(mesh.doflocs)
    x[:, new] = mesh.doflocs
    t = new[mesh.t]
    turned = np.array([np.abs(mesh.refdom.p.T - p).sum(axis=1).argmin() for p in mesh.refdom.p.T[:, [1, 2, 0]]])
    some = rng.uniform(size=t.shape[1]) < 0.5
    t[:, some] = t[:, some][turned]
    return skfem.MeshHex(x[:, :corners], t)


def test_functions_are_one_at_their_own_node_alone():
    element = ElementHex3()
    N, dN = shape_functions(element, element.doflocs.T)
    np.testing.assert_allclose(N, np.eye(64), atol=1e-14)
    assert np.abs(dN.sum(axis=0)).max() < 1e-13  # their sum is one everywhere
    X = np.random.default_rng(0).uniform(size=(3, 9))
    x, y, z = X
    cubic = lambda x, y, z: x**3 * y**2 * z - 2 * y**3 * z**3 + x * y  # noqa: E731
    N, dN = shape_functions(element, X)
    at_nodes = cubic(*element.doflocs.T)
    np.testing.assert_allclose(at_nodes @ N, cubic(x, y, z), atol=1e-13)
    slopes = np.einsum("j,jaq->aq", at_nodes, dN)
    exact = [3 * x**2 * y**2 * z + y, 2 * x**3 * y * z - 6 * y**2 * z**3 + x, x**3 * y**2 - 6 * y**3 * z**2]
    np.testing.assert_allclose(slopes, exact, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_elements_that_share_a_node_agree_where_it_is(seed):
    """In whatever order each of them has its corners, and however these are numbered."""
    mesh = renumbered(MESHES["boxes"], seed)
    dofs, places = CubicDofs(mesh), np.full((3, 10 * 7 * 13), np.nan)
    assert places.shape[1] == dofs.N
    for row, X in zip(dofs.element_dofs, ElementHex3.doflocs, strict=True):
        at = geometry_map(mesh, np.arange(mesh.nelements), np.repeat(X[:, None], mesh.nelements, axis=1))[0]
        known = places[:, row]
        np.testing.assert_allclose(np.where(np.isnan(known), at, known), at, atol=1e-14)
        places[:, row] = at
    assert not np.isnan(places).any()
    assert len(np.unique(places.round(9), axis=1).T) == dofs.N


@pytest.mark.parametrize("name", MESHES)
def test_a_linear_field_is_exact_on_surfaces_of_curved_and_of_distorted_elements(name):
    space = make_space(MESHES[name], 3, [])
    surface, slopes = space.surface(space.mesh.boundary_facets()), np.array([1.0, 0.3, -1.0])
    np.testing.assert_allclose(surface.values @ (space.coordinates @ slopes), surface.points @ slopes, atol=1e-14)


def test_a_cubic_field_is_exact_on_surfaces_of_boxes():
    space = make_space(box("hex1", (3, 2, 4), (1.0, 0.8, 0.7)), 3, [])
    surface = space.surface(space.mesh.boundary_facets())
    at_nodes, at_points = ((x[:, 0] - 2 * x[:, 1]) ** 3 + np.prod(x**[2, 1, 3], axis=1)
                           for x in (space.coordinates, surface.points))  # fmt: skip
    np.testing.assert_allclose(surface.values @ at_nodes, at_points, atol=1e-13)


def test_what_a_node_set_moves_by_is_interpolated_at_its_middles():
    space, slopes = make_space(MESHES["ring"], 3, []), np.array([1.0, 0.3, -1.0])
    places = np.random.default_rng(5).permutation(space.mesh.doflocs.shape[1])[:90]  # corners and all kinds of middles
    patch = space.patch(places)
    np.testing.assert_allclose(patch.points, space.mesh.doflocs.T[places], atol=1e-15)
    np.testing.assert_allclose(patch.values @ (space.coordinates @ slopes), patch.points @ slopes, atol=1e-14)
    corner = places < space.mesh.nvertices
    np.testing.assert_allclose(patch.values[corner].max(axis=1).toarray(), 1.0, atol=1e-13)
    plain = make_space(box("hex1", (2, 2, 2)), 3, [])
    curved = make_space(skfem.MeshHex2.from_mesh(plain.mesh), 3, [])
    every = curved.patch(np.arange(curved.mesh.doflocs.shape[1]))
    at_nodes, at_points = (x[:, 0] ** 3 * x[:, 1] - x[:, 2] ** 2 for x in (curved.coordinates, every.points))
    np.testing.assert_allclose(every.values @ at_nodes, at_points, atol=1e-13)


def test_tetrahedra_and_nodes_at_middles_of_edges_are_refused():
    with pytest.raises(SceneError, match=r"mesh\.order: given 3; expected 1 or 2 for tetrahedra"):
        make_space(box("tet1", (1, 1, 1), (1.0, 1.0, 1.0)), 3, [])
    space = make_space(MESHES["ring"], 3, [])
    corners = np.arange(space.mesh.nvertices)
    np.testing.assert_allclose(space.coordinates[space.nodes_at(corners)], space.mesh.doflocs.T[corners], atol=1e-15)
    with pytest.raises(SceneError, match="a node set has the middle of an edge without its ends"):
        space.nodes_at(np.array([0, space.mesh.nvertices + 30]), between=True)


def test_a_node_set_of_corners_holds_what_is_between_them():
    mesh = box("hex1", (2, 2, 2))
    corners = np.flatnonzero(np.abs(mesh.p[0]) < 1e-12)
    space = make_space(mesh, 3, [], points=[(corners, "xyz")])
    held = space.fixed.reshape(-1, 3).all(axis=1)
    assert held.sum() == 49 and np.abs(space.coordinates[held, 0]).max() < 1e-15


@pytest.mark.parametrize(("middles", "held"), [(True, (49, 169)), (False, (9, 9))])
def test_a_node_set_of_a_quadratic_mesh_holds_what_it_has(middles, held):
    """Whole edges and faces where it has their middles, corners alone where it has not; on the refined mesh as well."""
    mesh = skfem.MeshHex2.from_mesh(box("hex1", (2, 2, 2)))
    places = np.flatnonzero(np.abs(mesh.doflocs[0]) < 1e-12)
    places = places if middles else places[places < mesh.nvertices]
    loaded = replace(from_skfem(mesh), node_groups={"face": NodeSet(places, places)})
    for own, count in zip((loaded, refine(loaded)), held, strict=True):
        space = make_space(own.mesh, 3, [], points=[(own.node_groups["face"].held, "xyz")])
        fixed = space.fixed.reshape(-1, 3).all(axis=1)
        assert fixed.sum() == count and np.abs(space.coordinates[fixed, 0]).max() < 1e-15
