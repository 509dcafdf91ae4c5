"""Many identical pads with dampers: every copy of their multiple eigenvalues, although a block shows but a few.

A Krylov space of blocks of b vectors has b copies of a multiple eigenvalue, and rounding alone brings others. The pads
flutter, so that what is missed is unstable.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from selection import some

import fe_squeal
from fe_squeal.eigen import shift_invert
from fe_squeal.eigen.band import count_beside, with_far_growth
from fe_squeal.eigen.dense import solve_dense
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.sweep.onset import Onset

DAMPING = 0.01


def chain(n):
    return 3 * np.eye(n) - 1.4 * (np.eye(n, k=1) + np.eye(n, k=-1))


def pad(n, rng):
    """Return K (n, n) of a pad of unit masses: θ = 2 ± i/2, and 4, 5, …, of which no two modes are orthogonal."""
    V = np.eye(n) + 0.2 * rng.standard_normal((n, n))
    return V @ la.block_diag([[2.0, 0.5], [-0.5, 2.0]], np.diag(4.0 + np.arange(n - 2))) @ np.linalg.inv(V)


def swinging(theta, damping=DAMPING):
    """Return λ of the upper half plane with λ² + cλ + θ = 0."""
    root = np.sqrt(damping**2 / 4 - np.asarray(theta, complex))
    lam = np.concatenate([-damping / 2 + root, -damping / 2 - root])
    return lam[lam.imag > 1e-9]


@pytest.mark.parametrize(
    ("pads", "size", "others", "limit", "crowd"),
    some([(16, 20, 150, 1.5, 0), (40, 8, 100, 1.6, 0), (16, 20, 100, 1.5, 60)], lambda *row: row[-1] > 0),
)
def test_no_copy_of_an_unstable_mode_is_missed(pads, size, others, limit, crowd):
    """The third has overdamped modes beside them. Copies that decay as fast as others grow may lie outside discs."""
    one, rest = pad(size, np.random.default_rng(pads)), chain(others)
    slow = np.linspace(0.5, 2.0, crowd)
    K = la.block_diag(np.kron(np.eye(pads), one), rest, np.diag(slow))
    C = np.diag(np.r_[np.full(len(K) - crowd, DAMPING), np.full(crowd, 30.0)])
    pencil = Pencil(*(sp.csr_array(A) for A in (np.eye(len(K)), K, C)))
    modes = solve_modes(pencil, Request(max_frequency_hz=limit / (2 * np.pi)))
    expected = np.concatenate([np.repeat(swinging(la.eigvals(one)), pads), swinging(la.eigvalsh(rest))])
    expected = expected[expected.imag <= limit]
    found = modes.lam[modes.lam.imag > 0]
    found, expected = (lam[lam.real > -0.05 * lam.imag] for lam in (found, expected))
    assert len(found) == len(expected)
    np.testing.assert_allclose(np.sort(found.imag), np.sort(expected.imag), rtol=1e-9)
    assert np.count_nonzero(modes.stability == "unstable") == pads


@pytest.mark.parametrize("lost", ["stable", "pair", "zero"])
@pytest.mark.parametrize("loss", [0.0, 0.01, 0.5])
def test_copies_without_dampers_that_one_start_vector_misses(lost, loss):
    """The search for growth beyond the band has what was found taken out, and shows the copies of it that were not."""
    flutter = np.array([[1.0, 0.3], [-0.3, 1.0]])
    factor = 1 + 1j * loss if loss else 1.0
    K = la.block_diag(chain(42), flutter, flutter, 1.21 * np.eye(2), np.zeros((2, 2))) * factor
    pencil = Pencil(sp.eye_array(50, format="csr"), sp.csr_array(K), None)
    whole = solve_dense(pencil)
    modes = whole.select(np.flatnonzero(whole.lam.imag <= 1.5))
    at = 1j * np.sqrt({"stable": 1.21, "pair": 1 + 0.3j, "zero": 0.0}[lost] * factor)
    alike = np.abs(modes.lam - at) < 1e-6
    if lost == "pair" and not loss:
        alike |= np.abs(modes.lam + np.conj(at)) < 1e-6
    places = np.flatnonzero(alike)
    assert len(places) == (4 if lost == "pair" and not loss else 2)
    one = [places[modes.lam[places].real.argmax()], places[modes.lam[places].real.argmin()]][: len(places) // 2]
    less = modes if lost == "zero" else modes.select(np.delete(np.arange(len(modes)), one))
    found = with_far_growth(pencil, less, 1.5, None, "auto")
    assert len(found) == len(modes)
    order = [np.lexsort((m.lam.real.round(6), m.lam.imag.round(6))) for m in (found, modes)]
    np.testing.assert_allclose(found.lam[order[0]], modes.lam[order[1]], atol=1e-7)
    assert found.backward_error.max() < Request(count=1).tolerance


@pytest.mark.parametrize("seed", [20240607, 1])
@pytest.mark.parametrize("pads", [8, 16])
def test_copies_of_the_lowest_modes_of_which_right_and_left_ones_are_not_as_many(monkeypatch, pads, seed):
    """Nothing is nearer to the shift than the copies, of which a start vector shows some, and the left one others."""
    monkeypatch.setattr(shift_invert, "_SEED", seed)
    one = pad(20, np.random.default_rng(pads))
    K = sp.csr_array(la.block_diag(np.kron(np.eye(pads), one), chain(300) + 3 * np.eye(300)))
    modes = solve_modes(Pencil(sp.eye_array(K.shape[0], format="csr"), K), Request(count=pads))
    growing = modes.stability == "unstable"
    np.testing.assert_allclose(modes.lam[growing], np.repeat(swinging([2 - 0.5j], 0.0), pads), rtol=1e-9)
    assert modes.re_uncertainty[growing].max() < 1e-10


@pytest.mark.parametrize(("theta", "eta"), [(1.21, 0.002), (1 - 0.3j, 0.002), (1.21, 0.5)])
def test_copies_beside_losses_and_dampers_that_one_start_vector_misses(theta, eta):
    flutter, loss = np.array([[1.0, 0.3], [-0.3, 1.0]]), 1 + 1j * eta
    K = la.block_diag(chain(44), flutter, flutter, 1.21 * np.eye(2)) * loss
    pencil = Pencil(*(sp.csr_array(A) for A in (np.eye(50), K, DAMPING * np.eye(50))))
    every = solve_dense(pencil)
    modes = every.select(np.flatnonzero(every.lam.imag <= 1.5))
    places = np.flatnonzero(np.abs(modes.lam - swinging([theta * loss])) < 1e-6)
    assert len(places) == 2
    found = with_far_growth(pencil, modes.select(np.delete(np.arange(len(modes)), places[0])), 1.5, None, "auto")
    assert len(found) == len(modes) and found.backward_error.max() < Request(count=1).tolerance
    assert np.count_nonzero(np.abs(found.lam - modes.lam[places[0]]) < 1e-9) == 2


@pytest.mark.parametrize("lost", [pytest.param((0,), marks=pytest.mark.slow), (0, 1)])
def test_copies_of_known_modes_are_counted(lost):
    flutter = np.array([[1.0, 0.3], [-0.3, 1.0]])
    K = la.block_diag(chain(446), flutter, flutter)
    pencil = Pencil(*(sp.csr_array(A) for A in (np.eye(450), K, DAMPING * np.eye(450))))
    modes = solve_modes(pencil, Request(max_frequency_hz=1.2 / (2 * np.pi)))
    unstable = np.flatnonzero(modes.stability == "unstable")
    assert len(unstable) == 2
    less = modes.select(np.delete(np.arange(len(modes)), unstable[list(lost)]))
    assert count_beside(pencil, less, 1.2, None, "auto") == len(lost)


@pytest.mark.parametrize(("copies", "damping", "method"), some([
    (2, 0.0, "direct"), (3, 0.0, "direct"), (5, 0.0, "direct"), (2, 0.0, "reduced"), (3, 0.1, "direct"),
], lambda copies, damping, method: not damping and copies == {"direct": 3, "reduced": 2}[method]))  # fmt: skip
def test_onsets_of_copies_are_those_of_one_alone(copies, damping, method):
    """Every eigenvalue is as often there as there are copies, all along the sweep: what parts them is rounding."""
    rng, n = np.random.default_rng(3), 30
    root, friction = rng.standard_normal((n, n)), 30 * rng.standard_normal((n, n))
    stiffness = root @ root.T + np.diag(np.linspace(1, 60, n) ** 2)

    def swept(count):
        parts = [("m", "M", np.eye(n), True, {}), ("k", "K", stiffness, True, {})]
        parts.append(("f", "K", friction, False, {"p": 1}))
        if damping:
            parts.append(("c", "C", damping * np.eye(n) + 1e-4 * stiffness, True, {}))
        terms = tuple(
            Term(name, slot, sp.csr_array(la.block_diag(*[A] * count)), symmetric, powers)
            for name, slot, A, symmetric, powers in parts
        )
        return fe_squeal.sweep(Problem(terms, {"p": 1.0}), np.linspace(0, 1, 7), "p", modes=6 * count, method=method)

    one, all_of_them = swept(1), swept(copies)
    assert len(one.onsets) == 3 and not all_of_them.warnings
    values = np.repeat([o.value for o in one.onsets], copies)
    np.testing.assert_allclose([o.value for o in all_of_them.onsets], values, atol=1e-6)
    grow = [[np.count_nonzero(p.modes.stability == "unstable") for p in r.points] for r in (one, all_of_them)]
    assert grow[1] == [copies * g for g in grow[0]]


@pytest.mark.parametrize("copies", [1, 2, 3])
@pytest.mark.parametrize(("friction", "second", "onset"), [([[1, 1], [-1, 0]], 2, 1 / 3), ([[0, 1], [-1, 0]], 1, 0)])
def test_equal_pads_have_no_threshold_only_where_one_alone_has_none(friction, second, onset, copies):
    """K = diag(1, 2) + p [[1, 1], [−1, 0]]: ((1 − p)/2)² = p² at p = 1/3. Equal θ of one pad couple from p = 0 on."""
    parts = [("m", "M", np.eye(2), True, {}), ("k", "K", np.diag([1.0, second]), True, {})]
    parts.append(("f", "K", np.array(friction, float), False, {"p": 1}))
    terms = tuple(
        Term(name, slot, sp.csr_array(la.block_diag(*[A] * copies)), symmetric, powers)
        for name, slot, A, symmetric, powers in parts
    )
    found = fe_squeal.sweep(Problem(terms, {"p": 0.0}), [0, 0.5, 1], "p", modes=2 * copies)
    assert len(found.onsets) == copies and not found.warnings
    for o in found.onsets:
        assert abs(o.value - onset) <= o.uncertainty < 1e-6
        assert np.isnan(o.crossing_speed) == (not onset)


@pytest.mark.parametrize(("changes", "same"), [
    ({"value": 0.3 * (1 + 1e-9), "frequency_hz": 1000.0 * (1 - 1e-9), "branch_a": 5}, True),
    ({"value": 0.3 + 4e-5, "uncertainty": 5e-5}, True),
    ({"value": 0.3 + 1e-7}, False), ({"frequency_hz": 1000.1}, False), ({"direction": "out of"}, False),
    ({"kind": "divergence"}, False),
])  # fmt: skip
def test_which_onsets_are_of_equal_parts(changes, same):
    onset = Onset("mu", 0.3, 1000.0, "flutter", "into", 50.0, 1, 2, 1e-12)
    other = replace(onset, **changes)
    assert onset.is_copy_of(onset) and onset.is_copy_of(other) == other.is_copy_of(onset) == same


def blocks(count, youngs_modulus=2e9, above=2e7, behind=5e7, inclined=0.5, contact=1e10):
    """Return the scene of equal blocks on a belt that nothing couples."""
    names = [f"_{number}" for number in range(1, count + 1)] if count > 1 else [""]
    held = [("top", [0, 0, 1], above), ("right", [1, 0, inclined], behind), ("right", [0, 1, 0], 1e7)]
    return {
        "mesh": {"block": {"length": 0.04, "width": 0.03, "height": 0.015, "size": 0.015, "count": count}},
        "materials": {"lining": {"youngs_modulus": youngs_modulus, "poisson_ratio": 0.25, "density": 2600.0}},
        "bodies": {f"block{name}": {"material": "lining"} for name in names},
        "springs": [
            {"name": f"held{i}{name}", "surface": f"{face}{name}", "direction": direction, "stiffness": stiffness}
            for name in names for i, (face, direction, stiffness) in enumerate(held)
        ],
        "contacts": [
            {"name": f"sole{name}", "surface": f"bottom{name}", "counterface": "rigid", "normal_stiffness": contact,
             "sliding": {"direction": [1, 0, 0], "speed": 1.0}}
            for name in names
        ],
        "effects": {"friction": {"mu": 0.4}},
    }  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("method", ["direct", "reduced"])
def test_equal_blocks_on_a_belt_are_in_no_doubt(method):
    """Slopes of eigenvalues are less exact than eigenvalues where matrices are stiff, and part copies between values.

    A block alone has no onset.
    """
    problem = fe_squeal.assemble(fe_squeal.parse_scene(blocks(2)))
    found = fe_squeal.sweep(problem, np.linspace(0.0, 1.2, 13), "mu", modes=12, method=method)
    assert not found.warnings and not found.onsets
    for point in found.points:
        assert not (point.modes.stability == "unstable").any()
        np.testing.assert_allclose(point.modes.lam[::2], point.modes.lam[1::2], rtol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize(("method", "tolerance"), [("direct", 1e-8), ("reduced", 1e-8), ("reduced", 1e-4)])
def test_onsets_of_equal_blocks_are_those_of_one_alone(method, tolerance):
    """Projections of a step couple the blocks slightly, and part their eigenvalues by more than rounding does."""
    stiff = {"youngs_modulus": 1.0587e9, "above": 1.2371e8, "behind": 1.2077e7, "inclined": 0.46979}
    stiff["contact"] = 3.413e11

    def swept(number):
        problem = fe_squeal.assemble(fe_squeal.parse_scene(blocks(number, **stiff)))
        values, wanted = np.linspace(0, 1.2, 7)[:3], {"max_frequency": 11500, "tolerance": tolerance}
        return fe_squeal.sweep(problem, values, method=method, **wanted)

    one, both = swept(1), swept(2)
    assert len(one.onsets) == 2 and not both.warnings
    values = np.repeat([o.value for o in one.onsets], 2)
    np.testing.assert_allclose([o.value for o in both.onsets], values, atol=1e-6)


@pytest.mark.parametrize("share", [1e-2, 1e-6])
def test_two_modes_that_are_equal_at_both_values_may_grow_between(share):
    """θ = 4 (1 ± iεp(1 − p)): what parts them is no rounding, although they are equal at p = 0 and 1."""
    pushes = np.zeros((6, 6))
    pushes[0, 1], pushes[1, 0] = 4 * share, -4 * share
    parts = [("m", "M", np.eye(6), True, {}), ("k", "K", np.diag([4.0, 4.0, 9.0, 16.0, 25.0, 36.0]), True, {})]
    parts += [("f", "K", pushes, False, {"p": 1}), ("g", "K", -pushes, False, {"p": 2})]
    terms = tuple(Term(name, slot, sp.csr_array(A), symmetric, powers) for name, slot, A, symmetric, powers in parts)
    found = fe_squeal.sweep(Problem(terms, {"p": 1.0}), [0.0, 1.0], "p", modes=4)
    assert [o.direction for o in found.onsets] == ["into", "out of"]
    np.testing.assert_allclose([o.value for o in found.onsets], [0, 1], atol=1e-6)
