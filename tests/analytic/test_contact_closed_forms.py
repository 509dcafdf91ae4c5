"""Contact stiffness and friction of a rigid block on a rigid counterface against integrals done by hand.

K_c = ∫ k_n (n·δu)(n·u) dA and K_f = ∫ k_n (t·δu)(n·u) dA: the pad feels the traction μ p t, t along the counterface's
velocity, and its pressure falls by k_n n·u, n from the counterface into the pad.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshes import BELT, KINDS, annulus, box, join, make_problem, mapped, rigid_motions, rotation, term

LENGTH, WIDTH, HEIGHT = 0.08, 0.05, 0.02
CORNER = np.array([0.03, -0.02, 0.01])
STIFFNESS = 3e10  # N/m per m^2
FRICTION = {"friction": {"mu": 0.3}}


def contact(sliding=BELT, counterface="rigid", surface="bottom", **more):
    return {"surface": surface, "counterface": counterface, "normal_stiffness": STIFFNESS, "sliding": sliding, **more}


def block_problem(kind="hex2", counts=(3, 2, 1), sliding=BELT, turned=None, **more):
    mesh = box(kind, counts, (LENGTH, WIDTH, HEIGHT), CORNER)
    if turned is not None:
        mesh = mapped(mesh, lambda x: turned @ x)
    return make_problem(mesh, contacts=[contact(sliding, **more)], effects=FRICTION)


def integral(f, points=24):
    """∫ f(x, y) dA over the bottom face by Gauss's rule of degree 2·points − 1, f giving a matrix."""
    g, w = np.polynomial.legendre.leggauss(points)
    xs, ys = CORNER[0] + LENGTH * (g + 1) / 2, CORNER[1] + WIDTH * (g + 1) / 2
    weights = np.outer(w, w) * LENGTH * WIDTH / 4
    return sum(weights[i, j] * f(x, y) for i, x in enumerate(xs) for j, y in enumerate(ys))


def along(d, x):
    """d·r_i for the six rigid motions r_i at x: translations d, rotations d·(e × x) = e·(x × d)."""
    return np.concatenate([d, np.cross(x, d)])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("angle", [0.0, 0.7, np.pi])
def test_belt_under_a_block(kind, angle):
    """Polynomials of degree two, which the quadrature takes exactly (1e-12). By hand, with A, x̄, ȳ of the face and
    n = e_z, t = (c, s, 0):  K_f[x, z] = k_n A c, K_f[x, rot x] = k_n A ȳ c, K_c[rot x, rot y] = −k_n A x̄ ȳ.
    """
    t = np.array([np.cos(angle), np.sin(angle), 0.0])
    problem = block_problem(kind, sliding={"direction": t.tolist(), "speed": 2.5})
    R = rigid_motions(problem)
    Kc, Kf = (R.T @ (term(problem, name) @ R) for name in ("contact", "friction"))
    n, z = np.array([0.0, 0.0, 1.0]), CORNER[2]
    expected = STIFFNESS * integral(lambda x, y: np.outer(along(n, [x, y, z]), along(n, [x, y, z])), 3)
    np.testing.assert_allclose(Kc, expected, atol=1e-12 * STIFFNESS * LENGTH * WIDTH)
    expected = STIFFNESS * integral(lambda x, y: np.outer(along(t, [x, y, z]), along(n, [x, y, z])), 3)
    np.testing.assert_allclose(Kf, expected, atol=1e-12 * STIFFNESS * LENGTH * WIDTH)
    total, xm, ym = STIFFNESS * LENGTH * WIDTH, CORNER[0] + LENGTH / 2, CORNER[1] + WIDTH / 2
    assert Kf[0, 2] == pytest.approx(total * t[0], abs=1e-12 * total)
    assert Kf[0, 3] == pytest.approx(total * t[0] * ym, abs=1e-12 * total)
    assert Kc[3, 4] == pytest.approx(-total * xm * ym, abs=1e-12 * total)
    assert np.abs(Kf[2]).max() < 1e-12 * total  # friction has no normal force


@pytest.mark.parametrize("speed", [5.0, -5.0])
def test_turning_disc_under_a_block(speed):
    """t = ± e_z × (x − c)/|…| is not a polynomial: the cell-wise rule of degree 4 is off by 1e-6 on 10 × 8 cells."""
    centre = np.array([-0.02, 0.01, 0.0])
    sliding = {"axis": [0.0, 0.0, 2.0], "centre": centre.tolist(), "speed": speed}
    problem = block_problem(counts=(10, 8, 1), sliding=sliding)
    R = rigid_motions(problem)
    n = np.array([0.0, 0.0, 1.0])

    def density(x, y):
        v = np.sign(speed) * np.array([-(y - centre[1]), x - centre[0], 0.0])
        X = [x, y, CORNER[2]]
        return np.outer(along(v / np.linalg.norm(v), X), along(n, X))

    expected = STIFFNESS * integral(density)
    found = R.T @ (term(problem, "friction") @ R)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


def test_normal_points_out_of_the_counterface_on_any_side():
    """A block turned in space with everything: R^T K R turns along, sign included."""
    Q = rotation()
    problem = block_problem(turned=Q, sliding={"direction": (Q @ [1.0, 0.0, 0.0]).tolist(), "speed": 1.0})
    R = rigid_motions(problem)[:, :3]
    found = R.T @ (term(problem, "friction") @ R)
    expected = STIFFNESS * LENGTH * WIDTH * np.outer(Q[:, 0], Q[:, 2])
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


def pair_problem(case):
    """Two elastic bodies in contact whose meshes do not match; flat faces, so that nothing is lost in the gap."""
    if case == "disc":
        disc = annulus("hex2", (2, 16, 1), 0.1, 0.2, 0.02, -0.02)
        pad = box("hex2", (3, 2, 1), (0.05, 0.04, 0.01), (0.12, -0.02, 0.0), name="pad")
        sliding, names = {"axis": [0, 0, 1], "speed": 5.0}, ("bottom_pad", "top")
    else:
        disc = box(case, (3, 4, 2), (0.2, 0.2, 0.02), (-0.05, -0.1, -0.02), name="belt")
        pad = box(case, (4, 3, 1), (0.05, 0.04, 0.01), (0.0, -0.02, 0.0), name="pad")
        sliding, names = {"direction": [1.0, 0.3, 0.0], "speed": 2.0}, ("bottom_pad", "top_belt")
    return make_problem(join(disc, pad), contacts=[contact(sliding, names[1], names[0])], effects=FRICTION)


@pytest.mark.parametrize("case", [*KINDS, "disc"])
@pytest.mark.parametrize("name", ["contact", "friction"])
def test_forces_and_moments_balance(case, name):
    """For every displacement (column) the forces on pad and counterface cancel, and so do their moments: 1e-12."""
    problem = pair_problem(case)
    matrix, R = term(problem, name), rigid_motions(problem)
    forces = (np.abs(R[:, :3]).T @ abs(matrix)).max()
    size = np.repeat([forces, forces * 0.2], 3)[:, None]  # moments over arms of up to 0.2 m
    assert (np.abs(R.T @ matrix) <= 1e-12 * size).all()
    # It is not that there is no force: those on the pad alone do not cancel.
    nodes = problem.discretisation.space.dofs.element_dofs[:, problem.discretisation.bodies["pad"]]
    on_pad = R * np.repeat(np.isin(np.arange(problem.discretisation.space.nodes), nodes), 3)[:, None]
    assert np.abs(on_pad.T @ matrix).max() > 1e-3 * forces


@pytest.mark.parametrize("case", ["hex2", "tet2", "disc"])
def test_non_matching_interface_carries_constant_gaps_exactly(case):
    """A rigid lift of the pad gives k_n A on both sides; the whole pad is in contact."""
    problem = pair_problem(case)
    (operators,) = problem.discretisation.contacts.values()
    assert operators.coverage == pytest.approx(1.0)
    assert operators.area == pytest.approx(0.05 * 0.04, rel=1e-12)
    owner = np.zeros(problem.discretisation.space.nodes)
    pad = problem.discretisation.bodies["pad"]
    owner[np.unique(problem.discretisation.space.dofs.element_dofs[:, pad])] = 1.0
    lift = np.kron(owner, [0.0, 0.0, 1.0])
    force = (term(problem, "contact") @ lift).reshape(-1, 3)
    assert force[owner == 1, 2].sum() == pytest.approx(STIFFNESS * 0.002, rel=1e-12)
    assert force[owner == 0, 2].sum() == pytest.approx(-STIFFNESS * 0.002, rel=1e-12)
    np.testing.assert_allclose(operators.gap @ lift, 1.0, rtol=1e-12)


@pytest.mark.parametrize("kind", ["hex1", "tet1"])
@pytest.mark.parametrize("angle", [0.0, 0.4])
def test_the_area_of_a_pad_that_overhangs_is_exact_whatever_the_mesh(kind, angle):
    """To 1 % of a facet: a pad of 0.04 x 0.02 m with four facets in a row, over a plate that ends at a line."""
    plate = box(kind, (3, 2, 1), (0.09, 0.06, 0.01), (-0.09, -0.03, -0.01), name="plate")
    pad = box(kind, (4, 1, 1), (0.04, 0.02, 0.01), (0.0, -0.01, 0.0), name="pad")
    turned = mapped(plate, lambda x: np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0],
                                               [0, 0, 1]]) @ x)  # fmt: skip
    for end in (0.0107, 0.0153, 0.0193, 0.0205, 0.026):
        moved = mapped(turned, lambda x, end=end: x + np.array([[end], [0], [0]]))
        problem = make_problem(join(pad, moved), contacts=[contact(BELT, "top_plate", "bottom_pad")])
        (operators,) = problem.discretisation.contacts.values()
        assert operators.area == pytest.approx(0.02 * end, abs=0.01 * 0.01 * 0.02)
        assert operators.coverage == pytest.approx(operators.area / (0.04 * 0.02), rel=1e-12)
        beyond = (operators.points[:, 0] - end) * np.cos(angle) + operators.points[:, 1] * np.sin(angle)
        assert beyond.max() < 1e-9


def test_facets_that_end_with_the_counterface_have_the_points_of_the_rule():
    """Two facets of 0.01 x 0.02 m on a plate that ends with them; two beside it."""
    plate = box("hex1", (3, 2, 1), (0.09, 0.06, 0.01), (-0.07, -0.03, -0.01), name="plate")
    pad = box("hex1", (4, 1, 1), (0.04, 0.02, 0.01), (0.0, -0.01, 0.0), name="pad")
    problem = make_problem(join(pad, plate), contacts=[contact(BELT, "top_plate", "bottom_pad")])
    (operators,) = problem.discretisation.contacts.values()
    assert operators.area == pytest.approx(0.02 * 0.02, rel=1e-12)
    assert len(operators.weights) == 2 * 2**2 * 3**2  # four parts of Gauss's rule


def test_rank_of_friction():
    """At most one per contact point: 9 in the quadrature of each facet, and no more than the face has nodes."""
    problem = block_problem("hex1", (2, 1, 1))
    (operators,) = problem.discretisation.contacts.values()
    rank = np.linalg.matrix_rank(term(problem, "friction").toarray())
    assert rank <= min(len(operators.weights), 5 * 3)
    assert rank == 15


def test_kinds_and_ratio():
    """friction_ratio multiplies K_f; "frictionless" has none and stays symmetric; "tied" holds all three directions."""
    plain, half = (term(block_problem(friction_ratio=r), "friction") for r in (1.0, 0.5))
    assert np.abs(half - 0.5 * plain).max() < 1e-15 * np.abs(plain).max()
    mesh = box("hex2", (3, 2, 1), (LENGTH, WIDTH, HEIGHT), CORNER)
    loose = make_problem(mesh, contacts=[{**contact(), "kind": "frictionless"}])
    assert loose.problem_class == "symmetric"
    K = loose.pencil().K
    assert np.abs(K - K.T).max() == 0.0
    R = rigid_motions(loose)
    tied = make_problem(mesh, contacts=[{**contact(), "kind": "tied"}])
    translations = R[:, :3].T @ (term(tied, "contact") @ R[:, :3])
    np.testing.assert_allclose(translations, STIFFNESS * LENGTH * WIDTH * np.eye(3), atol=1e-6 * STIFFNESS * 1e-3)
    sliding_damped = block_problem(normal_damping=7.0)
    damping = R[:, :3].T @ (term(sliding_damped, "contact", "C") @ R[:, :3])
    np.testing.assert_allclose(damping, np.diag([0, 0, 7.0 * LENGTH * WIDTH]), atol=1e-14)


@pytest.mark.parametrize("motion", [None, {"axis": [0, 0, 1], "speed": 5.0}, {"direction": [0, 0, 1], "speed": 1.0}])
def test_a_tied_contact_holds_all_directions_whatever_moves_under_it(motion):
    """K = k ∫ δu·u dA: kA along x, y and z, also at the axis, where nothing slides, and along the normal.

    The bore of a ring of 20 flat facets has the area of its chords, and normals that are not across the rotation.
    """
    flat = box("hex2", (1, 1, 1), (LENGTH, WIDTH, HEIGHT), (-LENGTH / 2, -WIDTH / 2, 0.0))
    bore = annulus("hex1", (1, 20, 1), 0.1, 0.2, HEIGHT)
    chords = 20 * 2 * 0.1 * np.sin(np.pi / 20)
    for mesh, surface, area in ((flat, "bottom", LENGTH * WIDTH), (bore, "hub", chords * HEIGHT)):
        tied = {**contact(surface=surface, kind="tied"), "sliding": motion}
        problem = make_problem(mesh, contacts=[{k: v for k, v in tied.items() if v is not None}], order=2)
        R = rigid_motions(problem)[:, :3]
        found = R.T @ (term(problem, "contact") @ R)
        np.testing.assert_allclose(found, STIFFNESS * area * np.eye(3), atol=1e-12 * STIFFNESS * area)
        assert not problem.warnings
