"""Doublets of bodies of revolution: equal to round-off, slightly split, coupled without a threshold."""

from __future__ import annotations

import functools

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from hard_problems import digits, judged, plain_eigs, through_files
from selection import some

import fe_squeal
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from meshes import annulus, join, make_problem

HELD = [{"surface": "hub", "fixed": "xyz"}]
SECTORS = 16


@functools.cache
def disc():
    """Return a disc that is held at its hub, 1440 unknowns, and its lowest θ by LAPACK."""
    problem = make_problem(annulus("hex2", (2, SECTORS, 1), 0.1, 0.2, 0.02), supports=HELD)
    pencil = problem.pencil()
    return problem, la.eigh(pencil.K.toarray(), pencil.M.toarray(), eigvals_only=True, subset_by_index=[0, 29])


def test_axisymmetric_disc(record):
    """Every pattern with n nodal diameters comes twice, equal to round-off. A nonsymmetric solver splits a pair into
    λ and its mirror image, one of them growing; Lanczos may find one of the two alone."""
    problem, theta = disc()
    modes = solve_modes(problem.pencil(), Request(count=20))
    exact = 1j * np.sqrt(theta)
    assert set(modes.stability) == {"marginal"} and not modes.lam.real.any()
    np.testing.assert_allclose(modes.lam, exact[: len(modes)], rtol=1e-9)
    pairs = np.count_nonzero(np.diff(modes.lam.imag) < 1e-8 * modes.lam.imag[1:])
    assert pairs >= 7
    record(digits(modes.lam, exact[:20]), "both of each pair, marginal", *judged(plain_eigs(problem.pencil(), 20),
                                                                                 exact[:20]))  # fmt: skip


@functools.cache
def lopsided():
    """Return the disc with a spring on a part of its rim, as strong as the split that it is to make."""
    mesh = annulus("hex2", (2, SECTORS, 1), 0.1, 0.2, 0.02)
    x = mesh.p[:, mesh.facets[:, mesh.boundaries["rim"]]].mean(axis=1)
    spot = mesh.boundaries["rim"][np.abs(np.arctan2(x[1], x[0]) - 0.3) < 0.3]
    mesh = mesh.with_boundaries({**mesh.boundaries, "spot": spot})
    spring = {"name": "spot", "surface": "spot", "direction": [0, 0, 1], "stiffness": 1.0}
    return make_problem(mesh, supports=HELD, springs=[spring])


@pytest.mark.parametrize("split", some([1e-10, 1e-8, 1e-6, 1e-4, 1e-2], lambda split: split in (1e-8, 1e-2)))
@pytest.mark.parametrize("through", ["mesh", "files"])
def test_slightly_split_doublets(tmp_path, record, through, split):
    """A spring on the rim splits each pair by 1e-10 ... 1e-2; single shapes turn by 45 degrees and more from value to
    value, planes stay. Tracking by shape alone swaps branches, and single vectors in a basis are not the pair's."""
    problem, at = lopsided(), "springs.spot.stiffness"
    unit = 1e8 * split  # N/m: splits the pair of n = 1 by about that
    if through == "files":
        problem, at = through_files(problem, tmp_path, at, "k"), "k"
    values = unit * np.linspace(0.0, 1.0, 6)
    result = fe_squeal.sweep(problem, values, at, modes=8, keep_shapes=True)
    assert not result.warnings and not result.onsets
    pencil = problem.pencil({at: values[-1]})
    theta = la.eigh(pencil.K.toarray(), pencil.M.toarray(), eigvals_only=True, subset_by_index=[0, 9])
    last = result.points[-1]
    exact = 1j * np.sqrt(theta[: len(last.modes)])
    np.testing.assert_allclose(last.modes.lam, exact, rtol=1e-9)
    first = solve_modes(problem.pencil({at: 0.0}), Request(count=8))
    # The plane of a pair at the end is that of the same two branches at the start, and nothing of the others.
    for i in np.flatnonzero(np.diff(first.lam.imag) < 1e-8 * first.lam.imag[1:]):
        branches = result.points[0].branches[[i, i + 1]]
        here = np.flatnonzero(np.isin(last.branches, branches))
        assert len(here) == 2
        start = first.right[:, [i, i + 1]]
        cosines = la.svdvals(start.T @ (pencil.M @ np.stack([last.shapes[int(j)] for j in here], axis=1)))
        assert cosines.min() > 1 - 10 * split - 1e-9
    kept = digits(last.modes.lam, exact)
    record(kept, "branches keep their plane", *judged(plain_eigs(pencil, 8), exact))


@functools.cache
def ring_pad():
    """A ring pad on a disc, both of equal sectors: 2592 unknowns that the same turn leaves as they are."""
    disc_ = annulus("hex2", (1, SECTORS, 1), 0.1, 0.2, 0.02)
    pad = annulus("hex2", (1, SECTORS, 1), 0.12, 0.18, 0.015, 0.02, name="pad")
    contact = {
        "surface": "bottom_pad", "counterface": "top", "normal_stiffness": 1e11,
        "sliding": {"axis": [0, 0, 1], "speed": 5.0},
    }  # fmt: skip
    return make_problem(
        join(disc_, pad), order=1, supports=HELD,
        springs=[{"name": n, "surface": "top_pad", "direction": d, "stiffness": 1e8}
                 for n, d in (("x", [1, 0, 0]), ("y", [0, 1, 0]), ("z", [0, 0, 1]))],
        contacts=[contact], effects={"friction": {"mu": 0.0}},
    )  # fmt: skip


@pytest.mark.parametrize("method", ["direct", "reduced"])
def test_full_ring_pad_has_no_threshold(record, method):
    """A ring pad on an axisymmetric disc: friction couples the two modes of every doublet, [[a, bμ], [−bμ, a]], so that
    Re λ grows from μ = 0 in proportion to μ. A search for two frequencies that meet finds nothing; a search for
    Re λ > 0 finds rounding at μ = 0."""
    problem = ring_pad()
    values = np.array([0.0, 1e-3, 2e-3, 4e-3])
    result = fe_squeal.sweep(problem, values, modes=14, method=method, tolerance=1e-11)
    growth = [np.sort(p.modes.lam.real[p.modes.stability == "unstable"]) for p in result.points]
    assert len(growth[0]) == 0 and len(growth[1]) == len(growth[2]) == len(growth[3]) >= 3
    rate = growth[1] / values[1]
    for value, found in zip(values[2:], growth[2:], strict=True):
        np.testing.assert_allclose(found, rate * value, rtol=2e-2)
    assert len(result.onsets) == len(rate)
    assert all(o.value == 0.0 and np.isnan(o.crossing_speed) and o.kind == "flutter" for o in result.onsets)
    # LAPACK on the full matrix, whose doublets are turned by friction alone.
    pencil = problem.pencil(mu=values[-1])
    theta = la.eigvals(pencil.K.toarray(), pencil.M.toarray())
    lam = 1j * np.sqrt(theta[np.argsort(np.abs(theta))][:14].astype(complex))
    exact = np.concatenate([lam, -lam.conj()])
    exact = exact[np.abs(exact) <= np.abs(result.points[-1].modes.lam).max()]
    away = np.abs(exact[:, None] - result.points[-1].modes.lam[None, :]).min(axis=1)
    assert (away <= 1e-8 * np.abs(exact)).all()
    kept = digits(result.points[-1].modes.lam, exact)
    record(kept, "onset at 0, without a threshold", *judged(plain_eigs(pencil, 14), exact))


def small(matrices, powers):
    """A problem of unit masses with K = Σ A_i p^e_i, and a damping matrix where a power is None."""
    n = len(matrices[0])
    terms = [Term("m", "M", sp.eye_array(n, format="csr"), True)]
    for i, (A, power) in enumerate(zip(matrices, powers, strict=True)):
        A = np.asarray(A, float)
        slot = "C" if power is None else "K"
        terms.append(Term(f"t{i}", slot, sp.csr_array(A), bool((A == A.T).all()), {"p": power} if power else {}))
    return Problem(tuple(terms), {"p": 0.0})


@pytest.mark.parametrize("method", ["direct", "reduced"])
@pytest.mark.parametrize("friction", [0.2, 0.02, 1e-3])
def test_a_doublet_that_friction_alone_parts_first(friction, method):
    """K = [[20 + p², fp], [−fp, 20]]: θ = 20 + p²/2 ± √(p⁴/4 − f²p²), which is unstable for 0 < p < 2f.

    At p = 0 both eigenvalues are equal, and so are their derivatives.
    """
    problem = small([[[20, 0], [0, 20]], [[1, 0], [0, 0]], [[0, friction], [-friction, 0]]], [0, 2, 1])
    found = fe_squeal.sweep(problem, [0.0, 0.5, 1.0], "p", modes=2, method=method)
    assert [(o.direction, o.value) for o in found.onsets] == [
        ("into", pytest.approx(0.0, abs=1e-9)), ("out of", pytest.approx(2 * friction, rel=1e-7))
    ]  # fmt: skip
    assert not found.warnings
    both = fe_squeal.sweep(problem, [-0.5, 0.0, 0.5], "p", modes=2, method=method)
    assert [(o.direction, o.value) for o in both.onsets] == [
        ("into", pytest.approx(-2 * friction, rel=1e-7)), ("out of", pytest.approx(2 * friction, rel=1e-7))
    ]  # fmt: skip


@pytest.mark.parametrize("half", [1e-9, 1e-12, 1e-15])
def test_a_step_hardly_wider_than_the_spacing_of_floats(half):
    """λ² + λ/20 + 2 − p diverges at p = 2."""
    problem = small([[[2]], [[-1]], [[0.05]]], [0, 1, None])
    onset, = fe_squeal.sweep(problem, [2 - half, 2 + half], "p", modes=1).onsets
    assert onset.kind == "divergence" and abs(onset.value - 2) <= onset.uncertainty <= max(half, 1e-14)


@pytest.mark.parametrize("method", ["direct", "reduced"])
@pytest.mark.parametrize("power", [1, 2])
def test_a_free_motion_that_is_held_from_the_start_on(power, method):
    """θ = p^e/2 beside θ = 20. One that begins with p² is too slow to be followed from 0, which is told."""
    problem = small([[[0, 0], [0, 20]], [[0.5, 0], [0, 0]]], [0, power])
    found = fe_squeal.sweep(problem, [0.0, 0.5, 1.0], "p", modes=2, method=method)
    assert not found.onsets
    for point in found.points:
        exact = np.sqrt([0.5 * point.value**power, 20.0])
        np.testing.assert_allclose(point.modes.lam, 1j * exact, rtol=0, atol=1e-9)
    told = [w for w in found.warnings if "onsets are not looked for between 0 and 0.0" in w]
    assert len(told) == (power == 2)
