"""Matrices that a script puts together itself: converted, or refused with a reason, never another problem silently."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import scipy.sparse as sp

import fe_squeal
from fe_squeal.errors import SceneError, SceneWarning
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from meshes import STEEL

N = 6
K = np.diag(np.arange(1.0, N + 1))
PUSH = np.zeros((N, N))
PUSH[0, 1], PUSH[1, 0] = 1.0, -1.0
EYE = sp.csr_array(np.eye(N))


def swept(*terms, mass=EYE):
    own = Term("inertia", "M", mass, True), Term("springs", "K", sp.csr_array(K), True)
    return fe_squeal.sweep(Problem((*own, *terms), {"mu": 0.0}), [0.0, 0.3, 0.9], modes=3)


@pytest.mark.parametrize("made", [sp.coo_array, sp.csc_array, sp.csr_matrix, sp.lil_matrix, sp.dok_array])
def test_any_sparse_format_is_taken(made):
    """θ = 1.5 ± √(1/4 − μ²) meet at μ = 0.5."""
    (onset,) = swept(Term("push", "K", made(PUSH), False, {"mu": 1}), mass=made(np.eye(N))).onsets
    assert onset.value == pytest.approx(0.5, rel=1e-9)


@pytest.mark.parametrize("kind", [np.float32, np.int64, np.int8, np.uint8])
@pytest.mark.parametrize("n", [100, 450])
def test_any_real_numbers_are_taken_as_floats(kind, n):
    """Two springs of 100 on each mass, θ = 200 + 2 μ cos(kπ/(n + 1)) with symmetric friction: 8-bit sums would end at
    127 or 255, and single precision is exact to seven digits alone."""
    springs, beside = sp.eye_array(n, format="csr"), sp.diags_array(np.ones((2, n - 1)), offsets=[-1, 1], shape=(n, n))
    problem = Problem((
        Term("inertia", "M", springs.astype(kind), True),
        *(Term(name, "K", (100 * springs).astype(kind), True) for name in ("springs", "others")),
        Term("chain", "K", sp.csr_array(beside).astype(kind), True, {"mu": 1}),
    ), {"mu": 0.3})  # fmt: skip
    (point,) = fe_squeal.sweep(problem, [0.3], modes=5).points
    exact = 200 + 0.6 * np.cos(np.arange(n, n - 5, -1) * np.pi / (n + 1))
    assert point.modes.lam.imag**2 == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize(("term", "message"), [
    (("damper", "C", np.eye(N), True), r"damper: given a ndarray as the matrix; expected a sparse one"),
    (("push", "K", sp.csr_array(PUSH), True, {"mu": 1}), "push: the matrix is not symmetric, but symmetric=True"),
    (("gyro", "C", EYE, False, {}, True), "gyro: the matrix is not skew-symmetric, but skew=True"),
    (("loss", "K", sp.csr_array(0.1j * K), True), r"loss: the matrix is complex128; .*imaginary=True"),
    (("bad", "K", sp.csr_array(K * np.nan), True), "bad: the matrix has entries that are not finite"),
    (("bad", "K", sp.csr_array(K[:-1]), True), r"bad: the matrix has the shape \(5, 6\)"),
    (("bad", "K", sp.csr_array(K[:-1, :-1]), True), "bad: the matrix has 5 rows, and that of inertia 6"),
    (("loss", "C", EYE, True, {}, False, True), 'loss: given imaginary=True in the slot "C"; expected it in the slot'),
    (("added", "M", sp.csr_array(np.eye(N) + PUSH), False), "added: the mass matrix is not symmetric; expected that"),
    (("push", "K", sp.csr_array(PUSH), False, {"nu": 1}), 'push: given a power of "nu", which has no value; valid: '),
])  # fmt: skip
def test_what_would_be_another_problem_is_refused(term, message):
    with pytest.raises(SceneError, match=message):
        swept(Term(*term))
    own = Term("inertia", "M", EYE, True), Term("springs", "K", sp.csr_array(K), True, {"k": 1})
    problem = Problem((*own, Term(*term)), {"k": 1.0, "mu": 0.3})
    with pytest.raises(SceneError, match=message):
        fe_squeal.scatter(problem, {"k": {"uniform": {"low": 0.9, "high": 1.1}}}, samples=16)


@pytest.mark.parametrize(("powers", "at"), [
    ({"mu": 20}, {"mu": 1e17}), ({"mu": -8}, {"mu": 1e-40}), ({"mu": 20}, {"mu": np.float64(-1e17)}),
    ({"mu": 5, "h": 5}, {"mu": 1e40, "h": 1e40}), ({"mu": -1}, {"mu": 0.0}), ({"mu": 1, "h": 1}, {"mu": 1.0}),
])  # fmt: skip
def test_a_term_that_counts_with_no_number_says_so(powers, at):
    """Its factor overflows, as a power or as a product of some, or a parameter has no value."""
    term = Term("push", "K", sp.csr_array(PUSH), False, powers)
    for of in (term.coefficient, lambda at: term.slope("mu", at)):
        with pytest.raises(SceneError, match=r"^term push: .*(mu\^|\"h\", which has no value)"):
            of(at)


def test_a_slope_may_be_beyond_all_numbers_where_the_term_is_not():
    """∂h⁻⁷/∂h = −7 h⁻⁸ is 7e320 at 1e-40."""
    term = Term("push", "K", sp.csr_array(PUSH), False, {"h": -7})
    assert term.coefficient({"h": 1e-40}) == pytest.approx(1e280, rel=1e-12)
    assert term.slope("h", {"h": 2.0}) == pytest.approx(-7 / 256, rel=1e-15)
    with pytest.raises(SceneError, match=r"^term push: h\^-8 at h = 1e-40 is no finite number"):
        term.slope("h", {"h": 1e-40})


@pytest.mark.parametrize("slot", ["c", "damping", "", None])
def test_a_slot_that_there_is_not(slot):
    with pytest.raises(SceneError, match=r'term damper: given the slot .*; expected "M", "C" or "K"'):
        Term("damper", slot, EYE, True)


def test_scripts_are_warned_of_what_looks_doubtful():
    """A beam of 200 m, in a mesh that was meant in millimetres."""
    scene = fe_squeal.parse_scene({
        "mesh": {"order": 1, "block": {"length": 200.0, "width": 10.0, "height": 10.0, "size": 50.0}},
        "materials": {"steel": STEEL}, "bodies": {"block": {"material": "steel"}},
    })  # fmt: skip
    with pytest.warns(SceneWarning, match="length_unit") as told:
        problem = fe_squeal.assemble(scene)
    assert {str(w.message) for w in told} == set(problem.warnings) and told[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        problem.at({"materials.steel.density": 7000.0})


def test_sums_beyond_all_numbers_and_a_problem_of_nothing():
    terms = (Term("mass", "M", EYE, True), Term("stiffness", "K", EYE * 1e200, True, {"s": 1}))
    problem = Problem(terms, {"s": 1e200})
    with pytest.raises(SceneError, match=r"^K: entries times powers of parameters are beyond the largest number"):
        problem.pencil()
    assert problem.pencil(s=2.0).K.max() == 2e200
    with pytest.raises(SceneError, match="given no terms"):
        Problem((), {})
