"""Patch tests: constant strains, masses and inertia, and scikit-fem's own elasticity as a second implementation."""

from __future__ import annotations

import numpy as np
import pytest
import skfem
from selection import some
from skfem.helpers import dot
from skfem.models.elasticity import lame_parameters, linear_elasticity
from skfem.refdom import RefQuad, RefTri

from fe_squeal.fem.element_matrices import assemble_elasticity
from fe_squeal.fem.facets import scattered_quadrature, subdivided_quadrature
from fe_squeal.fem.materials import Material, material_axes, stiffness_tensor
from fe_squeal.fem.spaces import make_space
from meshes import KINDS, STEEL, annulus, box, distorted, mapped, rotation

ISOTROPIC = Material(**STEEL)
WOOD = Material(
    youngs_modulus=[11e9, 0.9e9, 0.5e9], poisson_ratio=[0.6, 0.45, 0.37], shear_modulus=[0.15e9, 0.6e9, 0.7e9],
    density=450.0,
)  # fmt: skip
AXES = material_axes((1.0, 2.0, 0.3), (0.0, 1.0, -1.0))
MESHES = {
    **{kind: distorted(box(kind, (3, 3, 3), (1.0, 0.8, 0.7)), 0.03) for kind in KINDS},
    "ring": annulus("hex2", (2, 12, 1), 0.1, 0.2, 0.03),
}
ORDERS = [(name, order) for name in MESHES
          for order in {"hex1": (1, 2, 3), "tet1": (1, 2), "hex2": (2, 3), "ring": (2, 3)}.get(name, (2,))]  # fmt: skip


@skfem.Functional
def one(w):
    return 1.0 + 0 * w.x[0]


def volume(mesh):
    return one.assemble(skfem.CellBasis(mesh, mesh.elem(), intorder=8))


def assemble(mesh, order, material=ISOTROPIC, axes=None):
    space = make_space(mesh, order, [])
    C = stiffness_tensor(material, axes)
    K, M = assemble_elasticity(space, np.arange(mesh.nelements), C, material.density)
    return space, K, M


@pytest.mark.parametrize(("name", "order"), ORDERS)
@pytest.mark.parametrize(("material", "axes"), [(ISOTROPIC, None), (WOOD, AXES)], ids=["isotropic", "wood"])
def test_constant_strain(name, order, material, axes):
    """u = A x has the energy ½ V ε:C:ε, and loads no inner node: exact up to rounding, 1e-12, on any cells."""
    space, K, _ = assemble(MESHES[name], order, material, axes)
    A = np.random.default_rng(3).standard_normal((3, 3))
    u = (space.coordinates @ A.T).ravel()
    strain = (A + A.T) / 2
    C = stiffness_tensor(material, axes)
    energy = volume(space.mesh) * np.einsum("ij,ijkl,kl", strain, C, strain) / 2
    assert u @ (K @ u) / 2 == pytest.approx(energy, rel=1e-12)
    inner = np.ones(space.nodes, bool)
    inner[space.nodes_of(space.mesh.boundary_facets())] = False
    force = (K @ u).reshape(-1, 3)
    assert np.abs(force[inner]).max(initial=0.0) < 1e-12 * (abs(K) @ abs(u)).max()
    # The boundary carries ∫ σ·n N: its total virial is V σ.
    stress = np.einsum("ijkl,kl", C, strain)
    virial = force.T @ space.coordinates
    np.testing.assert_allclose(virial, volume(space.mesh) * stress, atol=1e-11 * np.abs(stress).max())


@pytest.mark.parametrize(("name", "order"), ORDERS)
def test_total_mass(name, order):
    """1ᵀM1 = ρV in each direction and nothing between directions."""
    space, _, M = assemble(MESHES[name], order)
    T = np.kron(np.ones((space.nodes, 1)), np.eye(3))
    expected = STEEL["density"] * volume(space.mesh) * np.eye(3)
    np.testing.assert_allclose(T.T @ (M @ T), expected, atol=1e-12 * expected[0, 0])


@pytest.mark.parametrize("kind", KINDS)
def test_inertia_of_a_turned_box(kind):
    """Inertia m/12 (b² + c²), ... about the centre, on axes turned far from the mesh's; exact for straight cells."""
    Q, size = rotation(), np.array([1.0, 0.8, 0.6])
    mesh = mapped(box(kind, (2, 3, 2), size, -size / 2), lambda x: Q @ x)
    space, _, M = assemble(mesh, 2)
    R = np.stack([np.cross(e, space.coordinates).ravel() for e in np.eye(3)], axis=1)
    squares = size**2
    expected = STEEL["density"] * size.prod() / 12 * Q @ np.diag(squares.sum() - squares) @ Q.T
    np.testing.assert_allclose(R.T @ (M @ R), expected, atol=1e-12 * expected.max())


def test_inertia_of_a_ring():
    """m(a² + b²)/2 about the axis, m(3(a² + b²) + h²)/12 across; 24 curved sectors are off by h⁴/30 ~ 1e-5."""
    a, b, h = 0.2, 0.1, 0.03
    space, _, M = assemble(annulus("hex2", (2, 24, 1), b, a, h, -h / 2), 2)
    R = np.stack([np.cross(e, space.coordinates).ravel() for e in np.eye(3)], axis=1)
    mass = STEEL["density"] * np.pi * (a**2 - b**2) * h
    across = mass * (3 * (a**2 + b**2) + h**2) / 12
    expected = np.diag([across, across, mass * (a**2 + b**2) / 2])
    np.testing.assert_allclose(R.T @ (M @ R), expected, atol=3e-5 * expected.max())


# The slowest are of order 3; of the two that have curved cells, one.
@pytest.mark.parametrize(("name", "order"), some([o for o in ORDERS if o != ("ring", 3)], lambda _, order: order < 3))
def test_same_matrices_as_scikit_fem(name, order):
    """skfem.models.elasticity with a vector element on the same quadrature: equal to rounding, 1e-12.

    The random vectors are evaluated in both numberings through the places of the nodes.
    """
    space, K, M = assemble(MESHES[name], order)
    basis = skfem.CellBasis(space.mesh, skfem.ElementVector(space.element), intorder=space.integration_order)
    if order == 3:  # whose vector elements scikit-fem does not number as elements that share edges need it
        rows = 3 * space.dofs.element_dofs[:, None, :] + np.arange(3)[None, :, None]
        basis.dofs.element_dofs = rows.reshape(-1, space.mesh.nelements)
    A = linear_elasticity(*lame_parameters(STEEL["youngs_modulus"], STEEL["poisson_ratio"])).assemble(basis)
    B = skfem.BilinearForm(lambda u, v, w: STEEL["density"] * dot(u, v)).assemble(basis)
    theirs = basis.element_dofs.reshape(-1, 3, space.mesh.nelements)  # vector elements run through components first
    ours = 3 * space.dofs.element_dofs[:, None, :] + np.arange(3)[None, :, None]
    order_of = np.zeros(3 * space.nodes, int)
    order_of[ours.ravel()] = theirs.ravel()
    for found, expected in ((K, A), (M, B)):
        difference = found - expected.tocsr()[order_of][:, order_of]
        assert np.abs(difference).max() < 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize(("name", "order"), ORDERS)
def test_same_surfaces_as_scikit_fem(name, order, parts):
    """∫ N_I n, ∫ N_I x and ∫ N_I N_J over the boundary by skfem.FacetBasis: equal to 1e-12; and ∫ x·n is 3 V."""
    space = make_space(MESHES[name], order, [])
    facets = space.mesh.boundary_facets()
    surface = space.surface(facets, parts)
    quadrature = subdivided_quadrature(space.mesh.brefdom, space.integration_order, parts)
    basis = skfem.FacetBasis(space.mesh, space.element, facets=facets, quadrature=quadrature, dofs=space.dofs)
    expected = skfem.BilinearForm(lambda u, v, w: u * v).assemble(basis)
    found = surface.values.T @ (surface.weights[:, None] * surface.values.toarray())
    np.testing.assert_allclose(found, expected.toarray(), atol=1e-12 * surface.area)
    for field, name in ((surface.normals, "n"), (surface.points, "x")):
        expected = [skfem.LinearForm(lambda v, w, c=c, key=name: w[key][c] * v).assemble(basis) for c in range(3)]
        found = surface.values.T @ (surface.weights[:, None] * field)
        np.testing.assert_allclose(found, np.transpose(expected), atol=1e-12 * surface.area)
    assert np.einsum("qc,qc,q", surface.points, surface.normals, surface.weights) == pytest.approx(
        3 * volume(space.mesh), rel=1e-12
    )


@pytest.mark.parametrize("refdom", [RefQuad, RefTri])
def test_scattered_points_tell_the_part_of_a_facet_before_a_line(refdom):
    """Along an edge, and across the diagonal, which many points are near at once."""
    X, W = scattered_quadrature(refdom)
    x, c = np.linspace(-0.05, 1.05, 41), np.linspace(0.0, 1.0, 41)
    inside = np.clip(x, 0, 1)
    exact = inside if refdom is RefQuad else inside - inside**2 / 2
    for axis in (0, 1):
        np.testing.assert_allclose([W[X[axis] < at].sum() for at in x], exact, atol=2e-3)
    np.testing.assert_allclose([W[X.sum(axis=0) < at].sum() for at in c], c**2 / 2, atol=4e-3)
    assert W.sum() == pytest.approx(exact[-1]) and X.min() > 0


@pytest.mark.parametrize("kind", ["hex1", "hex2", "tet2"])
def test_surface_between_distorted_elements(kind):
    """A linear field is exact on facets of elements so distorted that scikit-fem does not find the points in them."""
    mesh = distorted(box(kind, (2, 2, 2)), 0.1)
    space = make_space(mesh, 2, [])
    surface = space.surface(np.flatnonzero(mesh.f2t[1] >= 0))
    slope = np.array([0.3, -0.7, 0.2])
    np.testing.assert_allclose(surface.values @ (space.coordinates @ slope), surface.points @ slope, atol=1e-13)


@pytest.mark.parametrize("name", ["hex1", "hex2", "tet2", "ring"])
def test_mass_matrix_against_high_quadrature(name):
    """The kinetic energy of a smooth field: on distorted cells the quadrature of degree 2p is close (1e-3)."""
    space, _, M = assemble(MESHES[name], 2)
    basis = skfem.CellBasis(space.mesh, space.element, intorder=8, dofs=space.dofs)
    B = skfem.BilinearForm(lambda u, v, w: STEEL["density"] * u * v).assemble(basis)
    u = np.cos(3 * space.coordinates @ [1.0, 2.0, 3.0])
    v = np.kron(u, [1.0, 0.0, 0.0])
    assert v @ (M @ v) == pytest.approx(u @ (B @ u), rel=1e-3)
