"""ν → ½, where standard elements lock and careless mixed ones are unstable; each docstring says what breaks and why."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse.linalg as spla
from mixed_cases import (
    SCHEMES,
    SIZE,
    WALLS,
    between_walls,
    formulated,
    lining,
    matrices,
    relative_errors,
)  # fmt: skip
from selection import some

from fe_squeal.eigen.inertia import count_below
from fe_squeal.fem.element_matrices import assemble_elasticity, element_shapes
from fe_squeal.fem.materials import Material, stiffness_tensor
from fe_squeal.fem.pressures import pressure_functions
from fe_squeal.fem.spaces import make_space
from meshes import KINDS, annulus, box, distorted, make_problem, modes_of

# Elements along an edge, and the largest error of ω² of six modes at ν = 0.49999 (measured, plus a tenth).
CELLS = {("hex1", 1): (5, 0.135), ("tet1", 1): (5, 0.33), ("hex1", 2): (3, 0.025), ("tet1", 2): (3, 0.08),
         ("hex1", 3): (2, 0.006)}  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "order"), some([*SCHEMES, ("hex1", 3)], lambda kind, order: (kind == "hex1") == (order != 2))
)
def test_error_bounded_as_nu_tends_to_a_half(kind, order, record):
    """Locking: where λ/μ → ∞ the constraint div u = 0 at every point leaves linear elements hardly any motion, and the
    exact shear modes between walls come out too high without bound (hexahedra) or by a factor (tetrahedra); order 2
    loses an order. The mixed error at ν = 0.49999 must be that at ν = 0.49, the standard one must not: else the test
    would not see locking. Pressure waves go to infinity with λ, the lowest modes all shear.
    """
    n, bound = CELLS[kind, order]
    mesh = box(kind, (n, n, n), SIZE)
    at_049, close = (np.abs(relative_errors(mesh, order, nu, 6)).max() for nu in (0.49, 0.49999))
    assert close < 1.2 * at_049
    assert close < bound
    standard = np.abs(relative_errors(mesh, order, 0.49999, 6, "standard")).max()
    assert standard > 2.5 * close
    kept, locked = (max(-np.log10(error / 2), 0.0) for error in (close, standard))  # of ω
    record(kept, "the error at ν = 0.49999 is that at 0.49", locked, elsewhere="(standard elements, whoever solves)")


@pytest.mark.parametrize(("kind", "order"), some(SCHEMES, lambda kind, order: (kind, order) == ("hex1", 2)))
def test_no_spurious_modes(kind, order):
    """Pressures that the displacements cannot answer (checkerboards of Q1–P0), or bubbles without stiffness, put modes
    among the true ones, and an element that locks loses modes: from there on the errors, mode by mode in the exact
    spectrum with its pairs and triples, do not tend to zero. They must, all, from above and nearly at the rate 2p.
    The count below the last by the inertia of K − σM says that none was skipped.
    """
    nu, count = 0.4999, 14
    coarse, fine = {1: (5, 8), 2: (3, 4)}[order]
    before = relative_errors(box(kind, (coarse,) * 3, SIZE), order, nu, count)
    mesh = box(kind, (fine,) * 3, SIZE)
    problem = make_problem(
        mesh, order=order, supports=WALLS, materials={"lining": lining(nu)}, bodies=formulated("block")
    )
    omega = modes_of(problem, count + 4).lam.imag
    after = (omega[:count] / between_walls(nu, count)) ** 2 - 1
    assert (after > 0).all() and (before > 0).all()
    rates = np.log(before / after) / np.log(fine / coarse)
    assert rates.min() > 1.1 * order and rates.mean() > 1.4 * order, rates
    last = count + int(np.argmax(np.diff(omega[count - 1 :])))  # below the widest gap behind the modes looked at
    assert count_below(problem.pencil(), (omega[last - 1] + omega[last]) / 2) == last


def smallest_inf_sup(mesh, order, bubbles=True, held=()):
    """Return β = min_p max_u ∫ p div u / (‖p‖₀ ‖u‖_A), ‖u‖_A² = ∫ 2 ε:ε + u·u: the root of the lowest eigenvalue of
    B A⁻¹ Bᵀ, with pressures that are orthonormal."""
    elements = np.arange(mesh.nelements)
    space = make_space(mesh, order, list(held), [elements] if bubbles else [])
    C = stiffness_tensor(Material(youngs_modulus=2.0, poisson_ratio=0.0, density=1.0))
    K, M = assemble_elasticity(space, elements, C, 1.0)
    rows = []
    for s in element_shapes(space, elements):
        P = pressure_functions(s.points, s.dx, order)
        block = np.einsum("eiq,ejaq->eija", P * s.dx[:, None], s.gradients, optimize=True)
        for B, nodes in zip(block, s.nodes, strict=True):
            full = np.zeros((len(B), space.functions, 3))
            full[:, nodes] = B
            rows.append(full.reshape(len(B), -1) @ space.prolongation)
    B = np.concatenate(rows)
    S = B @ spla.splu((K + M).tocsc()).solve(np.ascontiguousarray(B.T))
    return np.sqrt(max(la.eigvalsh(S, subset_by_index=[0, 0])[0], 0.0))


@pytest.mark.parametrize(
    ("kind", "order", "cells", "least"),
    some(
        [
            ("hex1", 1, (2, 3, 4), 0.55), ("tet1", 1, (2, 3, 4), 0.4), ("hex1", 2, (1, 2, 3), 0.55),
            ("tet1", 2, (1, 2, 3), 0.3),
        ],
        lambda kind, order, *_: (kind, order) != ("tet1", 2),
    ),
)  # fmt: skip
@pytest.mark.parametrize("shift", [0.0, 0.1])
def test_inf_sup_constant(kind, order, cells, least, shift):
    """Without displacements for every pressure the elimination still gives a stiffness, and a wrong limit: the measure
    of it is the inf-sup constant, which must not fall with the size of the elements (on distorted ones neither).
    Without bubbles it falls with h on linear hexahedra (measured 0.46, 0.30, 0.21), and is zero on tetrahedra.
    """
    meshes = [distorted(box(kind, (n, n, n)), shift / n) for n in cells]
    beta = [smallest_inf_sup(mesh, order) for mesh in meshes]
    assert min(beta) > least
    assert beta[-1] > 0.85 * beta[-2]
    if (kind, order) != ("hex1", 2):
        assert smallest_inf_sup(meshes[-1], order, bubbles=False) < 0.6 * beta[-1]


@pytest.mark.parametrize("kind", ["hex1", "tet1"])
def test_inf_sup_constant_where_there_is_little_inside(kind):
    """Bubbles sit on faces between elements only: a single layer has none above and below, a clamped side holds the
    nodes that would meet the mean of the pressure, a block of one hexahedron has none at all."""
    layer = box(kind, (4, 4, 1), (1.0, 1.0, 0.2))
    assert smallest_inf_sup(layer, 1) > 0.35
    clamped = [box(kind, (n, n, n)) for n in (2, 4)]
    held = [[(m.boundaries[side], "xyz") for side in ("left", "right", "bottom")] for m in clamped]
    coarse, fine = (smallest_inf_sup(m, 1, held=h) for m, h in zip(clamped, held, strict=True))
    assert fine > 0.95 * coarse > 0.2
    assert smallest_inf_sup(box(kind, (1, 1, 1)), 1) > 0.4


@pytest.mark.parametrize("kind", KINDS)
def test_breathing_of_an_incompressible_ring_is_stiff(kind):
    """What must not go soft: a hydrostatic state has the energy λ (div u)² V, though Π lets single points go free.

    A projection that loses the mean, or a pressure condensed twice, would leave a soft breathing mode.
    """
    ring = annulus(kind, (1, 12, 1), 0.1, 0.2, 0.05)
    nu = 0.4999
    space, K, _ = matrices(ring, int(kind[-1]), nu)
    u = space.gather(space.coordinates)
    volume = sum(s.dx.sum() for s in element_shapes(space, np.arange(ring.nelements)))
    assert u @ (K @ u) == pytest.approx(3 * volume / (1 - 2 * nu), rel=1e-10)


def test_linings_that_are_glued_to_others():
    """At a face shared with a standard body a bubble would tear the displacements apart, or have one stiffness alone.
    Three glued mixed thirds of a block are the block itself; with a standard third in the middle, whose displacements
    then are the standard ones, the block is stiffer, and less so than a standard block."""
    n = 6
    mesh = box("tet1", (n, 3, 3), (1.0, 0.5, 0.5))
    third = np.clip((3 * mesh.p[0][mesh.t].mean(axis=0)).astype(int), 0, 2)
    thirds = mesh.with_subdomains({f"part_{i}": np.flatnonzero(third == i) for i in range(3)})

    def lowest(mesh, bodies):
        problem = make_problem(
            mesh, order=1, supports=[{"surface": "left", "fixed": "xyz"}], materials={"lining": lining(0.49)},
            bodies=bodies,
        )  # fmt: skip
        return modes_of(problem, 6).lam.imag

    whole, standard = (lowest(mesh, formulated("block", f)) for f in ("mixed", "standard"))
    parts = {k: v for i in range(3) for k, v in formulated(f"part_{i}").items()}
    np.testing.assert_allclose(lowest(thirds, parts), whole, rtol=1e-9)
    some = lowest(thirds, {**parts, "part_1": {"material": "lining"}})
    assert (some > whole * 1.001).all() and (some < standard * 0.999).all()


def test_support_on_faces_inside():
    """A support may hold a plane in the middle of a body: its nodes, and with them the bubbles of its faces, or the
    clamped middle would still move between the nodes. Each half then moves as the half that is clamped there."""
    mesh = box("tet1", (4, 2, 2), (1.0, 0.5, 0.5))
    mesh = mesh.with_boundaries({"middle": mesh.facets_satisfying(lambda x: np.abs(x[0] - 0.5) < 1e-9)})
    space = matrices(mesh, 1, 0.49, held=[(mesh.boundaries["middle"], "xyz")])[0]
    free = matrices(mesh, 1, 0.49)[0]
    assert free.bubbles.unknowns - space.bubbles.unknowns == len(mesh.boundaries["middle"]) == 8
    whole = make_problem(
        mesh, order=1, supports=[{"surface": "middle", "fixed": "xyz"}], materials={"lining": lining(0.49)},
        bodies=formulated("block"),
    )  # fmt: skip
    halves = []
    for side, corner in (("right", 0.0), ("left", 0.5)):
        half = box("tet1", (2, 2, 2), (0.5, 0.5, 0.5), (corner, 0.0, 0.0))
        halves.append(modes_of(make_problem(
            half, order=1, supports=[{"surface": side, "fixed": "xyz"}], materials={"lining": lining(0.49)},
            bodies=formulated("block"),
        ), 4).lam.imag[:4])  # fmt: skip
    np.testing.assert_allclose(modes_of(whole, 8).lam.imag[:8], np.sort(np.concatenate(halves)), rtol=1e-9)
