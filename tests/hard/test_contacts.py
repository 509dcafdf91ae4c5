"""Contacts at their limits: corners, overhang, unlike meshes, a pad over the axis, all open, sets that alternate.

See tests/analytic/test_preload.py for lift-off with closed forms and tests/convergence/test_interfaces.py for rates.
"""

from __future__ import annotations

import functools

import numpy as np
import pytest
import scipy.sparse as sp
from hard_problems import LINING, digits
from selection import some

import fe_squeal
from fe_squeal.eigen.linear.choice import factorize
from fe_squeal.errors import NotConvergedError, SceneError
from fe_squeal.fem import static_contact
from fe_squeal.fem.static_contact import SlidingContact, solve_static_contact
from fe_squeal.sweep import forecast
from meshes import BELT, STEEL, annulus, box, join, make_problem, modes_of, rigid_motions, term

K_N = 1e11
MATERIALS = {"materials": {"steel": STEEL, "lining": LINING}}
TWO = {"bodies": {"pad": {"material": "lining"}, "belt": {"material": "steel"}}}


def pair(pad, belt, mu=0.3, **contact):
    touch = {"name": "face", "surface": "bottom_pad", "counterface": "top_belt", "normal_stiffness": K_N,
             "sliding": BELT, **contact}  # fmt: skip
    return make_problem(
        join(pad, belt), **MATERIALS, **TWO, contacts=[touch], effects={"friction": {"mu": mu}},
        supports=[{"surface": "bottom_belt", "fixed": "xyz"}],
        springs=[{"name": n, "surface": "top_pad", "direction": list(e), "stiffness": 1e8}
                 for n, e in zip("xyz", np.eye(3), strict=True)],
    )  # fmt: skip


def blocks(ratio=1, lift=0.0, offset=0.0, kind="hex2"):
    pad = box(kind, (2, 2, 1), (0.06, 0.06, 0.02), (offset, 0.0, lift), name="pad")
    belt = box(kind, (2 * ratio, 2 * ratio, 1), (0.06, 0.06, 0.02), (0, 0, -0.02), name="belt")
    return pad, belt


@pytest.mark.parametrize("overlap", [0.5, 0.1, 0.01, 1e-6])
def test_corner_alone_touches(record, overlap):
    """A pad that hangs over the belt's edge until a strip of it, or a corner, is left: quadrature points in contact get
    few and then none. Exact: what does not touch carries nothing, K_f of a lift is k_n times the strip."""
    width = 0.06 * overlap
    pad, belt = blocks(offset=0.06 - width)
    try:
        problem = pair(pad, belt)
    except SceneError as error:
        assert overlap < 0.05 and "do not touch" in str(error)
        record(15, "a strip thinner than the quadrature sees is refused")
        return
    (operators,) = problem.discretisation.contacts.values()
    x = operators.points[:, 0]
    assert (x >= 0.06 - width - 1e-9).all() and (x <= 0.06 + 1e-9).all()
    assert operators.area == pytest.approx(width * 0.06, rel=0.5)  # by points 4 mm apart
    told = problem.discretisation.warnings if operators.coverage < 0.5 else problem.discretisation.notes
    [text] = [t for t in told if "lies on its counterface" in t]
    assert f"{100 * operators.coverage:.3g} % of the surface" in text
    R = rigid_motions(problem)
    # The belt is held; the motions of the whole lift the pad alone, and rigid motions of both leave no gap there.
    up = R[:, 2].copy()
    on_pad = problem.discretisation.space.coordinates[problem.discretisation.space.free // 3, 2] > 1e-9
    up[~on_pad] = 0.0
    assert np.isfinite(problem.pencil(mu=0.3).K.data).all() and on_pad.any()
    modes = modes_of(problem, 6, mu=0.3)
    assert modes.backward_error.max() < 1e-10
    record(digits(np.array([operators.area]), np.array([width * 0.06])), "area by quadrature; a thin strip is refused")


@functools.cache
def touching():
    return pair(*blocks())


@pytest.mark.parametrize("lift", some([1e-12, 1e-6, -1e-6, 4e-4], lambda lift: lift in (1e-12, -1e-6)))
def test_gap_closed_within_its_tolerance(record, lift):
    """A pad that the mesher left 1 pm to 0.4 mm above the belt, or in it: within the tolerance the contact is closed
    and its matrices do not depend on the gap, but for the arm of friction."""
    pad, belt = blocks(lift=lift)
    reference = touching()
    problem = pair(pad, belt)
    (operators,) = problem.discretisation.contacts.values()
    assert operators.coverage == pytest.approx(1.0)
    np.testing.assert_allclose(operators.separation, lift, atol=1e-15)
    for name in ("contact", "friction"):
        a, b = term(problem, name), term(reference, name)
        assert abs(a - b).max() <= 1e-9 * abs(b).max() + abs(lift)
    lam, exact = modes_of(problem, 8, mu=0.3).lam, modes_of(reference, 8, mu=0.3).lam
    assert (np.abs(lam - exact) <= 1e-8 * np.abs(exact)).all()
    record(digits(lam, exact), "closed, with the gap in run.json")


def test_gap_beyond_its_tolerance_is_refused():
    """2 % of the facet and more: no guess, but the gap and the key that closes it."""
    with pytest.raises(SceneError, match="gap_tolerance"):
        pair(*blocks(lift=2e-3))
    assert pair(*blocks(lift=2e-3), gap_tolerance=3e-3).discretisation.contacts["face"].coverage == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("pad_cells", "belt_cells"), some([(1, 10), (10, 1)], lambda pad_cells, belt_cells: pad_cells == 1)
)
def test_interface_meshes_ten_to_one(record, pad_cells, belt_cells):
    """Facets ten times as large on one side: nodes that no quadrature point sees, and pressure that checks itself out
    between them. Exact: force and moment of rigid motions pass, the gap of a rigid motion of both is zero."""
    size = (0.06, 0.06, 0.02)
    pad = box("hex2", (pad_cells, pad_cells, 1), size, name="pad")
    belt = box("hex2", (belt_cells, belt_cells, 1), size, (0, 0, -0.02), name="belt")
    problem = make_problem(
        join(pad, belt), **MATERIALS, **TWO, effects={"friction": {"mu": 0.3}},
        contacts=[{"surface": "bottom_pad", "counterface": "top_belt", "normal_stiffness": K_N, "sliding": BELT}],
    )  # fmt: skip
    (operators,) = problem.discretisation.contacts.values()
    R = rigid_motions(problem)
    assert operators.area == pytest.approx(0.06**2, rel=1e-12)
    assert np.abs(operators.gap @ R).max() <= 1e-12 and np.abs(operators.slip @ R).max() <= 1e-12
    balance = R.T @ (operators.gap.T @ operators.weights)
    assert np.abs(balance).max() <= 1e-12 * operators.area
    K = problem.pencil(mu=0.3).K
    rigid = np.abs(K @ R).max() / (abs(K) @ np.abs(R)).max()
    assert rigid <= 1e-13
    modes = modes_of(problem, 10, mu=0.3)
    assert (modes.lam[:6] == 0).all() and (modes.stability[:6] == "marginal").all()
    record(-np.log10(max(rigid, 1e-15)), "balanced forces, six zeros at any friction")


def test_axis_of_the_disc_under_the_pad(record):
    """A pad that covers the axis of rotation: the sliding direction turns once around it and does not exist on it. No
    division by the speed there; friction's torque about the axis is finite, and its resultant zero."""
    pad = box("hex2", (4, 4, 1), (0.04, 0.04, 0.01), (-0.02, -0.02, 0.0), name="pad")
    contact = {"surface": "bottom_pad", "counterface": "rigid", "normal_stiffness": K_N,
               "sliding": {"axis": [0, 0, 1], "centre": [0, 0, 0], "speed": 10.0}}  # fmt: skip
    problem = make_problem(pad, materials={"lining": LINING}, contacts=[contact], effects={"friction": {"mu": 0.5}})
    (operators,) = problem.discretisation.contacts.values()
    t = operators.directions
    assert np.isfinite(t).all() and np.isfinite(problem.pencil(mu=0.5).K.data).all()
    resultant = operators.weights @ t
    assert np.abs(resultant).max() < 1e-12 * operators.area
    # ∫ r dA over a square of side a about its middle: a³ (√2 + asinh 1)/6.
    torque = operators.weights @ np.cross(operators.points, t)[:, 2]
    exact = 0.04**3 * (np.sqrt(2) + np.arcsinh(1)) / 6
    assert torque == pytest.approx(exact, rel=1e-3)
    odd = box("hex2", (3, 3, 1), (0.04, 0.04, 0.01), (-0.02, -0.02, 0.0), name="pad")  # a quadrature point on the axis
    other = make_problem(odd, materials={"lining": LINING}, contacts=[contact], effects={"friction": {"mu": 0.5}})
    (at_axis,) = other.discretisation.contacts.values()
    assert np.linalg.norm(at_axis.points[:, :2], axis=1).min() < 1e-12
    assert np.isfinite(other.pencil(mu=0.5).K.data).all()
    modes = modes_of(other, 8, mu=0.5)
    assert modes.backward_error.max() < 1e-10
    record(digits(np.array([torque]), np.array([exact])), "no direction on the axis itself, torque by quadrature")


@pytest.mark.parametrize("kind", some(["hex2", "tet2"], lambda kind: kind == "hex2"))
def test_pad_overhangs_the_edge_of_the_disc(record, kind):
    """A pad that is wider than the disc's face: only what lies over the face touches, whatever the two meshes are. The
    rest must not find the rim or the other face instead."""
    disc = annulus(kind, (2, 24, 1), 0.08, 0.15, 0.02, name="belt")
    pad = box(kind, (6, 6, 1), (0.06, 0.06, 0.015), (0.11, -0.03, 0.02), name="pad")
    touch = {"name": "face", "surface": "bottom_pad", "counterface": "top_belt", "normal_stiffness": K_N,
             "sliding": {"axis": [0, 0, 1], "speed": 5.0}}  # fmt: skip
    problem = make_problem(
        join(pad, disc), **MATERIALS, **TWO, contacts=[touch], effects={"friction": {"mu": 0.3}},
        supports=[{"surface": "hub_belt", "fixed": "xyz"}],
        springs=[{"name": n, "surface": "top_pad", "direction": list(e), "stiffness": 1e8}
                 for n, e in zip("xyz", np.eye(3), strict=True)],
    )  # fmt: skip
    (operators,) = problem.discretisation.contacts.values()
    r = np.linalg.norm(operators.points[:, :2], axis=1)
    assert r.max() <= 0.15 + 1e-6 and np.abs(operators.points[:, 2] - 0.02).max() < 1e-12
    # The square's part inside the circle: ∫ (√(R² − y²) − 0.11) dy.
    y, R = 0.03, 0.15
    exact = y * np.sqrt(R**2 - y**2) + R**2 * np.arcsin(y / R) - 2 * y * 0.11
    assert operators.area == pytest.approx(exact, rel=0.03)  # the rim of straight tetrahedra is a polygon of 24 sides
    modes = modes_of(problem, 8, mu=0.3)
    assert modes.backward_error.max() < 1e-10
    record(digits(np.array([operators.area]), np.array([exact])), "the part over the face, by quadrature")


def test_all_lifted_off_is_refused():
    """A pull, or a pressure on the wrong side, opens every contact: not a spectrum of loose parts, but exit 2."""
    with pytest.raises(SceneError, match="open every contact"):
        make_problem(
            box("hex2", (2, 2, 1), (0.06, 0.06, 0.02)), materials={"lining": LINING},
            contacts=[{"surface": "bottom", "counterface": "rigid", "normal_stiffness": K_N, "sliding": BELT}],
            springs=[{"name": n, "surface": "top", "direction": list(e), "stiffness": 1e8}
                     for n, e in zip("xyz", np.eye(3), strict=True)],
            effects={"friction": {"mu": 0.3}, "preload": {"pressures": {"top": -1e6}}},
        )  # fmt: skip


@pytest.mark.parametrize("least", [10**9, 0])
def test_contact_that_opens_within_the_sweep_keeps_what_was_found(least, monkeypatch):
    """A sweep whose pressure passes zero: what was solved before is kept, with exit 3 and the value.

    Also where a reduced model is tried first, which asks for the last value before the others (`least` unknowns)."""
    monkeypatch.setattr(forecast, "UNKNOWNS", least)
    problem = make_problem(
        box("hex2", (2, 2, 1), (0.06, 0.06, 0.02)), materials={"lining": LINING},
        contacts=[{"surface": "bottom", "counterface": "rigid", "normal_stiffness": K_N, "sliding": BELT}],
        springs=[{"name": n, "surface": "left", "direction": list(e), "stiffness": 1e8}
                 for n, e in zip("xyz", np.eye(3), strict=True)],
        effects={"friction": {"mu": 0.3}, "preload": {"pressures": {"top": 1e6, "bottom": 1.0}}},
    )  # fmt: skip
    at = "effects.preload.pressures.bottom"
    with pytest.raises(NotConvergedError, match="open every contact") as caught:
        fe_squeal.sweep(problem, [1.0, 0.5e6, 2e6], at, modes=4)
    assert [p.value for p in caught.value.partial.points] == [1.0, 0.5e6]
    told = [w for w in caught.value.partial.warnings if "solved directly at every value" in w]
    assert len(told) == (least == 0) and all("open every contact" in w for w in told)


def alternating(mu):
    """Two points on one bar: friction of the one lifts the other, so that the sets of closed points go in circles."""
    K = sp.csr_array(np.array([[2.0, -1.0], [-1.0, 2.0]]))
    gap = sp.csr_array(np.eye(2))
    slip = sp.csr_array(np.array([[0.0, 1.0], [-1.0, 0.0]]))
    return K, [SlidingContact(gap, slip, np.array([50.0, 50.0]), mu, True)]


@pytest.mark.parametrize("mu", [0.0, 0.5, 1.5, 3.0, 10.0])
@pytest.mark.parametrize("seed", range(12))
def test_alternating_contact_ends_with_an_answer_or_an_error(record, seed, mu):
    """With large friction the active sets of Newton's method may go in circles for ever, or an equilibrium may not
    exist at all. Every set of closed points is tried by hand; what the solver returns must be one of them, and where
    it returns nothing it says so."""
    K, contacts = alternating(mu)
    rng = np.random.default_rng(seed)
    load = rng.uniform(-1, 1, 2)
    exact = []
    for closed in ((0, 0), (0, 1), (1, 0), (1, 1)):
        c = contacts[0]
        A = K.toarray() + c.reaction.toarray().T @ np.diag(c.stiffness * closed) @ c.gap.toarray()
        u = np.linalg.solve(A, load)
        if ((u < 0) == np.array(closed, bool)).all():
            exact.append(u)
    try:
        found = solve_static_contact(K, load, contacts)
    except NotConvergedError as error:
        assert error.partial is not None
        record(15, "an equilibrium of all sets tried by hand, or exit 3")
        return
    assert found.residual <= static_contact._EQUILIBRIUM and exact
    away = min(np.abs(found.u - u).max() / np.abs(u).max() for u in exact)
    assert away < 1e-9
    record(min(15, -np.log10(max(away, 1e-15))), "an equilibrium of all sets tried by hand, or exit 3")


def pressed_row(mu, load=1.0, points=6):
    """A row of springs pressed on points that friction and the load open one after the other; K and the contacts."""
    K = sp.diags_array([np.full(points, 2.1), -np.ones(points - 1), -np.ones(points - 1)], offsets=[0, 1, -1])
    gap = sp.csr_array(np.eye(points))
    slip = sp.csr_array(np.eye(points, k=1) + 0.3 * np.eye(points, k=-1))
    forces = load * np.linspace(1.0, -2.0, points)  # some points are pulled off
    return sp.csr_array(K), forces, [SlidingContact(gap, slip, np.full(points, 5.0), mu, True)]


def test_static_states_of_a_sweep_share_factors(monkeypatch):
    """The states are those of factors of their own to rounding, and few factors are made."""
    made = []
    factorize = static_contact.factorize
    monkeypatch.setattr(static_contact, "factorize", lambda *args: made.append(args) or factorize(*args))
    tangents, values = static_contact.TangentSolver(), np.linspace(0.0, 0.8, 21)
    for mu in values:
        K, load, contacts = pressed_row(mu)
        shared = solve_static_contact(K, load, contacts, tangents=tangents)
        before = len(made)
        alone = solve_static_contact(K, load, contacts)
        del made[before:]
        assert 0 < shared.closed[0].sum() < len(load)
        assert (shared.closed[0] == alone.closed[0]).all()
        np.testing.assert_allclose(shared.u, alone.u, rtol=0, atol=1e-12 * np.abs(alone.u).max())
    assert len(made) <= 4


def test_a_solution_is_sought_among_earlier_ones_first():
    """For matrices A + tB the solutions at three values leave t³ of what is sought; copies of one are no harm."""
    rng = np.random.default_rng(5)
    A, B, b = 5 * np.eye(8) + 0.3 * rng.standard_normal((8, 8)), rng.standard_normal((8, 8)), rng.standard_normal(8)
    assert static_contact._nearest(sp.csr_array(A), b, []) is None

    def off(t):
        near = sp.csr_array(A + t * B)
        before = [np.linalg.solve(A + k * t * B, b) for k in (1, 2, 3)]
        u = static_contact._nearest(near * 2.0, b, [*before, before[0], before[0].copy()])
        there = static_contact._nearest(sp.csr_array(A), b, [*before, before[0]])
        np.testing.assert_allclose(u, before[0] / 2, rtol=0, atol=1e-12)  # one of them, to a factor
        return np.abs(A @ there - b).max()

    assert off(0.01) < 1e-2 * off(0.1) < 1e-3


def test_a_singular_tangent_spoils_no_later_solution(monkeypatch):
    """Its solution is not finite, and later ones are not sought among such."""
    tangents, b, held = static_contact.TangentSolver(), np.ones(2), sp.csr_array(np.diag([2.0, 4.0]))
    with monkeypatch.context() as patched:
        spoilt = type("Spoilt", (), {"solve": staticmethod(lambda b: np.full_like(b, np.inf))})
        patched.setattr(static_contact, "factorize", lambda *_: spoilt)
        assert not np.isfinite(tangents.solve(held, True, b)).any()
    tangents.settle(2)  # gives the factors up
    for factor in (1.0, 2.0):
        np.testing.assert_allclose(tangents.solve(factor * held, True, b), np.array([0.5, 0.25]) / factor, rtol=1e-13)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e9])
def test_factors_of_another_state_hide_no_loose_body(scale):
    """Two masses that the contact alone held: without it no solution exists, and what comes out, if anything, has
    forces as large as those of a singular stiffness; with another contact it is the exact one."""
    K = scale * sp.csr_array(np.array([[1.0, -1.0], [-1.0, 1.0]]))
    held = sp.csr_array(K + scale * sp.csr_array(np.diag([1.0, 0.0])))
    factor = factorize(held, True)
    loose = static_contact._by_other_factors(K, np.array([-0.5, -0.5]), factor)
    assert loose is None or (abs(K) @ np.abs(loose)).max() > 0.5 * static_contact._FLOATING
    other = sp.csr_array(K + scale * sp.csr_array(np.diag([7.0, 0.0])))
    u = static_contact._by_other_factors(other, np.array([-0.5, -0.5]), factor)
    np.testing.assert_allclose(u, np.array([-1 / 7, -1 / 7 - 0.5]) / scale, rtol=1e-13)
