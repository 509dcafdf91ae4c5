"""What the mixed formulation shares with the standard one: rigid motions, constant strains, and no new sign."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
from mixed_cases import SCHEMES, formulated, lining, matrices

from fe_squeal.fem.element_matrices import element_shapes
from fe_squeal.fem.materials import Material, elasticity, stiffness_tensor
from fe_squeal.fem.pressures import pressure_functions
from fe_squeal.fem.stress import element_stress
from meshes import KINDS, annulus, box, distorted, make_problem, modes_of, rigid_motions

MESHES = {
    **{kind: distorted(box(kind, (2, 3, 2), (1.0, 0.8, 0.7)), 0.03) for kind in KINDS},
    "ring": annulus("hex2", (1, 8, 1), 0.1, 0.2, 0.03),
}
ORDERS = [(name, order) for name in MESHES
          for order in {"hex1": (1, 2, 3), "tet1": (1, 2), "ring": (2, 3)}.get(name, (2,))]  # fmt: skip
NU = 0.499


def volume_and_law(space):
    every = np.arange(space.mesh.nelements)
    law = elasticity(Material(**lining(NU)), mixed=True)
    return sum(s.dx.sum() for s in element_shapes(space, every)), law


@pytest.mark.parametrize(("name", "order"), ORDERS)
def test_constant_strain(name, order):
    """u = A x, bubbles at rest: energy ½ V ε:C:ε, no force inside, on no bubble either, and the stress C:ε itself.

    A pressure space without constants, a bubble along the wrong normal on one side of its face, or λ counted twice
    would each break one of the three. Rounding is that of λ/μ = 500.
    """
    space, K, _ = matrices(MESHES[name], order, NU)
    A = np.random.default_rng(3).standard_normal((3, 3))
    u, strain = space.gather(space.coordinates @ A.T), (A + A.T) / 2
    volume, law = volume_and_law(space)
    stress = np.einsum("ijkl,kl", stiffness_tensor(Material(**lining(NU))), strain)
    assert u @ (K @ u) == pytest.approx(volume * np.sum(strain * stress), rel=1e-11)
    force = K @ u
    edge = np.zeros((space.nodes, 3), bool)
    edge[space.nodes_of(space.mesh.boundary_facets())] = True
    inner = np.ones(space.unknowns, bool)
    inner[: edge.size] = ~edge.ravel()
    assert inner.sum() > 0 and np.abs(force[inner]).max() < 1e-12 * (abs(K) @ np.abs(u)).max()
    for _, found in element_stress(space, np.arange(space.mesh.nelements), law, u):
        np.testing.assert_allclose(found, np.broadcast_to(stress[None, :, :, None], found.shape), atol=1e-9)


@pytest.mark.parametrize("nu", [-0.5, 0.3, 0.49999])
@pytest.mark.parametrize(("name", "order"), ORDERS)
def test_six_rigid_motions_and_no_other(name, order, nu):
    """K is symmetric and positive semidefinite with a null space of six, M positive definite; for ν < 0 too, λ < 0.

    The seventh eigenvalue of K x = θ M x stays what an elastic body has: no hourglass, no bubble without stiffness.
    """
    _, K, M = matrices(MESHES[name], order, nu)
    assert (K != K.T).nnz == 0
    theta = la.eigvalsh(K.toarray(), M.toarray())
    assert np.abs(theta[:6]).max() < 1e-10 * theta[-1] and theta[6] > 0.02
    # Not of M's diagonal, on which a mass without coupling would look as good.
    d = 1 / np.sqrt(M.diagonal())
    assert la.eigvalsh(d[:, None] * M.toarray() * d)[0] > 0.03
    problem = make_problem(MESHES[name], order=order, materials={"lining": lining(nu)},
                           bodies=formulated("disc" if name == "ring" else "block"))  # fmt: skip
    R = rigid_motions(problem)
    assert np.abs(problem.pencil().K @ R).max() < 1e-12 * abs(K).max()
    assert (modes_of(problem, 8).lam[:6] == 0).all()


@pytest.mark.parametrize(("kind", "order"), SCHEMES)
def test_total_mass(kind, order):
    """A translation weighs ρV in its direction alone; bubbles, at rest in it, do not enter."""
    problem = make_problem(MESHES[kind], order=order, materials={"lining": lining(0.4)}, bodies=formulated("block"))
    T = rigid_motions(problem)[:, :3]
    volume, _ = volume_and_law(problem.discretisation.space)
    np.testing.assert_allclose(T.T @ (problem.mass @ T), volume * np.eye(3), atol=1e-12)


@pytest.mark.parametrize(("kind", "order"), SCHEMES)
def test_energy_of_nodal_displacements(kind, order):
    """With bubbles at rest: on hexahedra less than that of the standard form, for ‖Π div u‖ < ‖div u‖.

    On straight tetrahedra div u of order k − 1 is a pressure already and the energies are equal; there it is the
    bubbles alone that keep the elements from locking.
    """
    mesh = MESHES[kind]
    mixed, K, _ = matrices(mesh, order, NU)
    standard, K0, _ = matrices(mesh, order, NU, mixed=False)
    u = np.random.default_rng(5).standard_normal((standard.nodes, 3))
    ratio = mixed.gather(u) @ (K @ mixed.gather(u)) / (standard.gather(u) @ (K0 @ standard.gather(u)))
    assert ratio == pytest.approx(1, rel=1e-12) if kind == "tet1" else ratio < 0.9
    assert mixed.unknowns - standard.unknowns == bubbles_of(mesh, order)


def bubbles_of(mesh, order):
    """Return the number of bubbles: a normal one per inner face, three per quadratic tetrahedron, else none."""
    inner = mesh.nfacets - len(mesh.boundary_facets())
    if order == 2:
        return inner + 3 * mesh.nelements if mesh.t.shape[0] == 4 else 0
    return inner


def test_pressures_are_linear_in_space():
    """The projection of order 2 keeps x, y and z on distorted hexahedra, and makes a constant of them for order 1."""
    space, _, _ = matrices(MESHES["hex1"], 2, NU)
    for s in element_shapes(space, np.arange(space.mesh.nelements)):
        for order, kept in ((2, True), (1, False)):
            P = pressure_functions(s.points, s.dx, order)
            back = np.einsum("eiq,eir,ecr,er->ecq", P, P, s.points, s.dx, optimize=True)
            assert (np.abs(back - s.points).max() < 1e-12) == kept
