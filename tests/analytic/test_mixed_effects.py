"""Effects on a body of the mixed formulation: each reads its elasticity, and its pressure, not λ div u."""

from __future__ import annotations

import numpy as np
import pytest
from mixed_cases import SCHEMES, formulated, lining, matrices

from fe_squeal.fem.contact import contact_operators
from fe_squeal.fem.materials import Material, elasticity
from fe_squeal.fem.stress import element_stress, von_mises
from fe_squeal.sweep.sweep import sweep
from meshes import BELT, annulus, box, distorted, join, make_problem, modes_of, term

PAIR = {"pad": {"material": "lining", "formulation": "mixed"}, "belt": {"material": "steel"}}
STEEL = {"youngs_modulus": 100.0, "poisson_ratio": 0.3, "density": 1.0}
NU = 0.4999


@pytest.mark.parametrize(("kind", "order"), SCHEMES)
def test_stress_is_in_equilibrium(kind, order):
    """∫ σ(u):∇N = K u on every unknown, bubbles included, for any u. With λ div u in place of p = λ Π div u it is off
    by orders of magnitude, since only Π div u is small."""
    mesh = distorted(box(kind, (2, 2, 2)), 0.03)
    space, K, _ = matrices(mesh, order, NU)
    law = elasticity(Material(**lining(NU)), mixed=True)
    u = np.random.default_rng(2).standard_normal(space.unknowns)
    force = np.zeros((space.functions, 3))
    for s, stress in element_stress(space, np.arange(mesh.nelements), law, u):
        np.add.at(force, s.nodes, np.einsum("eabq,ejbq,eq->eja", stress, s.gradients, s.dx, optimize=True))
    np.testing.assert_allclose(space.prolongation.T @ force.ravel(), K @ u, atol=1e-12 * (abs(K) @ np.abs(u)).max())


@pytest.mark.parametrize(("kind", "order"), SCHEMES)
def test_preload_of_an_incompressible_block(kind, order):
    """A block at two smooth walls under pressure p: contact pressure p, von Mises p, and p/k_n + pH/E of approach."""
    p, stiffness = 0.02, 10.0
    problem = make_problem(
        box(kind, (2, 2, 2), (1.0, 1.0, 0.5)), order=order, materials={"lining": lining(NU)},
        bodies=formulated("block"),
        contacts=[
            {"name": "belt", "surface": "bottom", "counterface": "rigid", "kind": "frictionless",
             "normal_stiffness": stiffness}
        ],
        supports=[{"surface": "left", "fixed": "x"}, {"surface": "front", "fixed": "y"}],
        effects={"preload": {"pressures": {"top": p}}},
    )  # fmt: skip
    space, state = problem.discretisation.space, problem.discretisation.static_state
    np.testing.assert_allclose(state.contacts["belt"].pressure, p, rtol=1e-8)
    u = space.expand(state.u)
    top = space.coordinates[:, 2] > 0.5 - 1e-9
    np.testing.assert_allclose(u[top, 2], -(p / stiffness + 0.5 * p), rtol=1e-8)
    law = problem.source.scene.elasticity("block")
    np.testing.assert_allclose(von_mises(space, problem.discretisation.bodies["block"], law, state.u), p, rtol=1e-7)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("kind", ["hex1", "tet1"])
def test_stress_stiffening_of_a_free_bar(kind, order):
    """Dead forces ±F on the ends of a stiff bar resist its rotation: ω² = F L/I, I = m(L² + b²)/12, whatever ν."""
    stress, soft = 1e-5, 1e-15
    problem = make_problem(
        box(kind, (4, 1, 1), (1.0, 0.1, 0.1), (-0.5, -0.05, -0.05)), order=order,
        materials={"lining": lining(NU)}, bodies=formulated("block"),
        springs=[
            {"name": c, "surface": "bottom", "direction": [float(c == d) for d in "xyz"], "stiffness": soft}
            for c in "xyz"
        ],
        effects={"preload": {"pressures": {"left": -stress, "right": -stress}}, "stress_stiffening": {}},
    )  # fmt: skip
    exact = np.sqrt(stress * 0.01 / (0.01 * (1.0 + 0.01) / 12))
    # The bar bends a little, by σ/E (L/b)² = 1e-3.
    np.testing.assert_allclose(modes_of(problem, 8).lam.imag[4:6], exact, rtol=3e-3)


def test_damping_and_sweeps_act_on_the_elastic_stiffness():
    """β and η multiply the mixed stiffness itself, bubbles and pressure alike; E scales it, ν makes it anew."""
    tables = {
        "materials": {"lining": {**lining(0.49), "loss_factor": 0.1}}, "bodies": formulated("block"),
        "supports": [{"surface": "bottom", "fixed": "xyz"}],
    }  # fmt: skip
    mesh = box("tet1", (2, 2, 2))
    problem = make_problem(
        mesh, order=2, effects={"rayleigh": {"alpha": 0.5, "beta": 0.01}, "structural_damping": {}}, **tables
    )
    K = term(problem, "elastic.block")
    C = problem.pencil().C
    assert abs(C - 0.01 * K - 0.5 * problem.mass).max() < 1e-14 * abs(C).max()
    assert abs(term(problem, "structural_damping") - 0.1 * K).max() == 0
    plain = make_problem(mesh, order=2, **tables)
    path = "materials.lining."
    assert plain.is_affine(f"{path}youngs_modulus") and not plain.is_affine(f"{path}poisson_ratio")
    for key, value in (("youngs_modulus", 3.0), ("poisson_ratio", 0.4999)):
        changed = {"lining": {**tables["materials"]["lining"], key: value}}
        fresh = make_problem(mesh, order=2, **{**tables, "materials": changed}).pencil().K
        assert abs(plain.at({path + key: value}).pencil().K - fresh).max() < 1e-13 * abs(fresh).max()
    # Every mode has the loss factor of its only material: λ² = −ω²(1 + iη).
    loss = make_problem(mesh, order=2, effects={"structural_damping": {}}, **tables)
    still = modes_of(plain, 4).lam.imag[:4]
    np.testing.assert_allclose(modes_of(loss, 4).lam[:4] ** 2, -(still**2) * (1 + 0.1j), rtol=1e-8)


def pad_on_belt(kind, order, formulation="mixed", cells=3, nu=NU, **tables):
    """A lining on an elastic belt whose mesh does not match."""
    pad = box(kind, (cells, cells, 2), (1.0, 0.8, 0.4), (0.1, 0.1, 0.3), name="pad")
    belt = box(kind, (cells + 1, cells, 1), (1.4, 1.0, 0.3), name="belt")
    return make_problem(
        join(pad, belt), order=order, materials={"lining": lining(nu), "steel": STEEL},
        bodies={**PAIR, "pad": {"material": "lining", "formulation": formulation}},
        supports=[{"surface": "bottom_belt", "fixed": "xyz"}, {"surface": "top_pad", "fixed": "x"}],
        springs=[
            {"name": f"hold_{c}", "surface": "top_pad", "direction": [float(c == d) for d in "xyz"], "stiffness": 1.0}
            for c in "yz"
        ],
        contacts=[{"name": "pad", "surface": "bottom_pad", "counterface": "top_belt", "normal_stiffness": 20.0,
                   "sliding": BELT}],
        effects={"friction": {"mu": 0.5}}, **tables,
    )  # fmt: skip


@pytest.mark.parametrize(("kind", "order"), SCHEMES)
def test_contact_does_virtual_work_on_nodes_alone(kind, order):
    """K_c and K_f are those of the standard form: bubbles vanish on every surface, so gap and slip do not see them."""
    mixed, standard = (pad_on_belt(kind, order, f) for f in ("mixed", "standard"))
    n = standard.unknowns
    assert mixed.unknowns > n or (kind, order) == ("hex1", 2)
    for name in ("contact.pad", "friction.pad", "spring.hold_z"):
        A, B = term(mixed, name), term(standard, name)
        assert abs(A[:n][:, :n] - B).max() == 0 and A.nnz == B.nnz
    c = mixed.discretisation.contacts["pad"]
    fresh = contact_operators(standard.discretisation.space, *(
        standard.discretisation.space.mesh.boundaries[g] for g in ("bottom_pad", "top_belt")
    ), standard.source.scene.contacts[0].sliding.motion())  # fmt: skip
    assert abs(c.gap[:, :n] - fresh.gap).max() == 0 and c.gap.shape[1] == mixed.unknowns


@pytest.mark.parametrize(("kind", "order"), [pytest.param("hex1", 2, marks=pytest.mark.slow), ("tet1", 1)])
def test_friction_sweep_reduced_and_direct(kind, order):
    """Growth rates and frequencies of the reduced model are those of direct solves, with bubbles in the unknowns."""
    problem = pad_on_belt(kind, order)
    values = np.linspace(0.0, 1.0, 3)
    direct, reduced = (sweep(problem, values, modes=10, method=m) for m in ("direct", "reduced"))
    assert direct.completeness.proven and reduced.completeness.proven
    for a, b in zip(direct.points, reduced.points, strict=True):
        np.testing.assert_allclose(b.modes.lam[:10], a.modes.lam[:10], atol=1e-5 * np.abs(a.modes.lam).max())


def test_mixed_bodies_beside_a_disc_that_rotates():
    """The disc's gyroscopic and circulatory matrices do not touch the lining's bubbles; a lining may not rotate."""
    disc = annulus("tet1", (1, 12, 1), 0.1, 0.15, 0.01)
    pad = annulus("tet1", (1, 12, 2), 0.1, 0.15, 0.01, bottom=0.01, name="pad")
    problem = make_problem(
        join(disc, pad), order=1, materials={"lining": lining(0.49), "steel": STEEL},
        bodies={"disc": {"material": "steel"}, "pad": PAIR["pad"]},
        supports=[{"surface": "hub", "fixed": "xyz"}, {"surface": "top_pad", "fixed": "xyz"}],
        contacts=[{"name": "pad", "surface": "bottom_pad", "counterface": "top", "normal_stiffness": 1.0,
                   "sliding": {"axis": [0.0, 0.0, 1.0], "speed": 0.1}}],
        effects={"friction": {"mu": 0.3}, "rotation": {"bodies": ["disc"]}, "rayleigh": {"beta": 0.01}},
    )  # fmt: skip
    of_disc = np.zeros((problem.discretisation.space.nodes, 3))
    of_disc[np.unique(problem.discretisation.space.dofs.element_dofs[:, problem.discretisation.bodies["disc"]])] = 1.0
    others = np.flatnonzero(problem.discretisation.space.gather(of_disc) == 0)
    for name, slot in (("gyroscopic.disc", "C"), ("convection.disc", "K"), ("rotating_damping.disc", "K")):
        A = term(problem, name, slot)
        assert A.nnz > 0 and abs(A[others]).sum() == 0
    assert (modes_of(problem, 6).lam.imag > 0).any()
