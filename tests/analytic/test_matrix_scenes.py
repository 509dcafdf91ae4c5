"""Scenes of matrices from files, by closed forms: friction, damping, powers of parameters, gyroscopes."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest
import scipy.sparse as sp
from dense import all_eigenvalues
from matrix_scenes import SUFFIXES, assert_near, run, sweep_text, upper, write_scene
from selection import some

from fe_squeal.cli import main
from fe_squeal.run.folder import _SHAPE_FILE
from lumped import Minimal, NineDof, TwoMass

GYROSCOPE = np.array([[0.0, 2.0], [-2.0, 0.0]])
B = 5 * np.sqrt(3) / 2


def friction_terms(model) -> list:
    damping = [("damping", model.C)] if model.C.any() else []
    return [("mass", model.M), ("stiffness", model.K0), ("stiffness", model.friction_matrix, "powers = { mu = 1 }"),
            *damping]  # fmt: skip


@pytest.mark.parametrize(
    ("model", "onsets"),
    [
        (Minimal(k2=20.0), [4 / (7 * np.sqrt(3))]),
        (Minimal(k2=20.0, friction="contact"), [1 / np.sqrt(3)]),
        (Minimal(k2=20.0, friction="full"), [0.29333239703485345]),
        (Minimal(k2=20.0, c1=0.3, c2=0.3, c3=0.3), [116.2 / (175 * np.sqrt(3))]),
        (Minimal(k2=20.0, c1=0.3, c2=0.3), [0.325996705567428]),
        (Minimal(k2=20.0, c3=0.3), [B / 17.5]),
        (Minimal(c1=0.3, c2=0.3, c3=0.3), []),
        (TwoMass(), [0.2014936461296]),
        (TwoMass(friction="contact"), [0.21156832843608]),
        (TwoMass(friction="full"), [0.201629797017653]),
        (TwoMass(c1x=0.1, c2x=0.1), [0.200846969392334]),
        (TwoMass(c1x=0.3, c2x=0.3), [0.200665119304709]),
        (TwoMass(c1x=0.3, c2x=0.3, cy=0.3), [0.320707221248113]),
        (NineDof(), [0.85815420475276589, 2.7383310465820566, 3.6588856526499511]),
    ],
)  # fmt: skip
@pytest.mark.parametrize("first", [0, 3])
def test_lumped_onsets(tmp_path, model, onsets, first):
    """Critical friction from closed forms and 40-digit arithmetic, whatever file formats the matrices come in."""
    suffixes = SUFFIXES[first:] + SUFFIXES[:first]
    stop = 4.0 if isinstance(model, NineDof) else 0.7
    result = run(tmp_path, friction_terms(model), {"mu": 0.3}, "mu", 0, stop, 12, suffixes=suffixes)
    assert [o.value for o in result.onsets] == pytest.approx(onsets, rel=2e-13)
    assert all(o.kind == "flutter" and o.direction == "into" for o in result.onsets) and not result.warnings
    for o, exact in zip(result.onsets, onsets, strict=True):
        assert abs(o.value - exact) <= o.uncertainty + 1e-13 * exact
    assert result.problem.problem_class == ("quadratic" if model.C.any() else "nonsymmetric")


def test_lumped_spectra(tmp_path):
    """λ of the minimal model in 40 digits, and those of the damped degenerate one, which friction does not change."""
    result = run(tmp_path, friction_terms(Minimal(k2=20.0)), {"mu": 0.3}, "mu", 0, 0.5, 6)
    pair = 0.399787888218975 + 4.48996997267984j
    expected = {0: [3.87298334620742j, 5j], 3: [4.30051152833405j, 4.63741313607769j], 5: [pair, -pair.conjugate()]}
    for i, lam in expected.items():
        np.testing.assert_allclose(result.points[i].modes.lam, lam, atol=2e-14)
    degenerate = run(tmp_path, friction_terms(Minimal(c1=0.3, c2=0.3, c3=0.3)), {"mu": 0.3}, "mu", 0, 1, 4)
    for point in degenerate.points:  # a defective double eigenvalue: half the digits
        np.testing.assert_allclose(point.modes.lam, -0.225 + 3.8664421630227446j, atol=2e-7)
        assert (point.modes.stability == "stable").all()


def test_crossing_speed(tmp_path):
    """dRe λ/dμ at the onset; of the undamped pair the coefficient of √(μ − μc)."""
    for model, speed in ((Minimal(k2=20.0, c1=0.3, c2=0.3, c3=0.3), 2.0996082231), (Minimal(k2=20.0), 0.973249857636)):
        [onset] = run(tmp_path, friction_terms(model), {"mu": 0.3}, "mu", 0, 0.7, 12).onsets
        assert onset.crossing_speed == pytest.approx(speed, rel=1e-10)


def test_run_writes_all(tmp_path):
    """`fe-squeal run`: eigenvalues, onset, class and shapes in files; (λ²M + λC + K)u = 0 for the shapes."""
    model = NineDof(friction="contact")
    C = 0.1 * np.eye(9)
    tail = sweep_text("mu", 0, 2.5, 6) + '[output]\nshapes = "all"\n'
    scene = write_scene(tmp_path, [*friction_terms(model), ("damping", C)], {"mu": 0.5}, tail)
    assert main(["run", str(scene), "-o", str(tmp_path / "out")]) == 0
    names = ["contributions", "modes", "onsets", "root_locus", "run", "sensitivities", "shapes", "stability"]
    assert set(names) <= {p.stem for p in (tmp_path / "out").iterdir()}
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert (record["status"], record["problem_class"], record["unknowns"]) == ("complete", "quadratic", 9)
    [onset] = csv.DictReader((tmp_path / "out" / "onsets.csv").read_text("utf-8").splitlines())
    assert float(onset["value"]) == pytest.approx(1.63936399181397, rel=1e-12)
    assert 2 * np.pi * float(onset["frequency_hz"]) == pytest.approx(2.123418565, rel=1e-9)
    rows = csv.DictReader((tmp_path / "out" / "modes.csv").read_text("utf-8").splitlines())
    found = [complex(float(r["re"]), float(r["im"])) for r in rows if float(r["value"]) == 2.0]
    apart = np.abs(np.array(found)[:, None] - upper(all_eigenvalues(np.eye(9), C, model.K(2.0))))
    assert apart.shape == (9, 9) and apart.min(axis=0).max() < 1e-11 and apart.min(axis=1).max() < 1e-11
    shapes = list((tmp_path / "out" / "shapes").glob("*.npz"))
    assert len(shapes) == 9
    for path in shapes:
        with np.load(path) as file:
            u, lam, mu = file["u"], complex(file["re"], file["im"]), float(file["value"])
        parts = [lam**2 * u, lam * (C @ u), model.K(mu) @ u]
        assert u.shape == (9,) and np.linalg.norm(sum(parts)) <= 1e-13 * sum(np.linalg.norm(p) for p in parts)


def test_powers_and_scale(tmp_path):
    """Terms with μ², 1/ω and two parameters at once, in M, C and K, against scipy on the sum of the full matrices."""
    rng = np.random.default_rng(4)
    A = [rng.standard_normal((5, 5)) for _ in range(6)]
    M0, M1, K0, K1 = (a @ a.T + 5 * np.eye(5) for a in A[:4])
    C, K2 = A[4:]
    terms = [
        ("mass", M0, "scale = 0.5"), ("mass", M1, "powers = { omega = -1 }"), ("stiffness", K0, "scale = 1e3"),
        ("stiffness", K1, "powers = { mu = 2 }", "scale = -2"), ("stiffness", K2, "powers = { mu = 3, omega = -2 }"),
        ("damping", C, "powers = { omega = 1 }", "scale = 0.01"),
    ]  # fmt: skip

    def exact(mu, omega):
        M, K = M0 / 2 + M1 / omega, 1e3 * K0 - 2 * mu**2 * K1 + mu**3 / omega**2 * K2
        return all_eigenvalues(M, 0.01 * omega * C, K)

    given = {"mu": 1.5, "omega": 0.7}
    for parameter in ("mu", "omega", "mu, omega"):
        result = run(tmp_path, terms, given, parameter, 0.5, 2.5, 3)
        assert result.parameter == parameter
        for point in result.points:
            assert_near(point, exact(**given | dict.fromkeys(parameter.split(", "), point.value)), 1e-12)


def test_structural_damping(tmp_path):
    """K(1 + iη): λ = iω√(1 + iη), with η swept, of a chain of masses of closed form."""
    n, K = 12, sp.diags_array([2.0 * np.ones(12), -np.ones(11), -np.ones(11)], offsets=[0, 1, -1])
    omega = 2 * np.sin(np.arange(1, n + 1) * np.pi / (2 * n + 2))
    loss = ("stiffness", K, "imaginary = true", "powers = { eta = 1 }")
    result = run(tmp_path, [("mass", np.eye(n)), ("stiffness", K), loss], {"eta": 0.1}, "eta", 0, 0.3, 4)
    assert result.problem.problem_class == "complex" and not result.onsets
    for point in result.points:
        np.testing.assert_allclose(point.modes.lam, 1j * omega * np.sqrt(1 + 1j * point.value), rtol=1e-13)
        assert (point.modes.stability == ("stable" if point.value else "marginal")).all()


def path_matrix(n: int, k: float) -> sp.dia_array:
    return sp.diags_array([2 * k * np.ones(n), -k * np.ones(n - 1), -k * np.ones(n - 1)], offsets=[0, 1, -1])


def path_values(n: int, k: float) -> np.ndarray:
    return 4 * k * np.sin(np.arange(1, n + 1) * np.pi / (2 * n + 2)) ** 2


@pytest.mark.parametrize("n", some([6, 210], lambda n: n == 6))
def test_campbell_diagram(tmp_path, n):
    """Whirling of a symmetric shaft: frequencies √(k + Ω²) ± Ω, all of them on the imaginary axis."""
    terms = [("mass", sp.eye_array(2 * n)), ("stiffness", sp.kron(path_matrix(n, 1.0), np.eye(2))),
             ("damping", sp.kron(sp.eye_array(n), GYROSCOPE), "powers = { omega = 1 }")]  # fmt: skip
    result = run(tmp_path, terms, {"omega": 0.1}, "omega", 0, 2 / n, 4, 6)
    assert not result.onsets and result.problem.problem_class == "quadratic"
    for point in result.points:
        root = np.sqrt(path_values(n, 1.0) + point.value**2)
        exact = np.sort(np.concatenate([root - point.value, root + point.value]))[: len(point.modes)]
        np.testing.assert_allclose(point.modes.lam.imag, exact, rtol=1e-11)
        assert np.abs(point.modes.lam.real).max() < 1e-11 and (point.modes.stability == "marginal").all()


@pytest.mark.parametrize("n", some([1, 210], lambda n: n == 1))
def test_rotating_shaft(tmp_path, n):
    """In the rotating frame a shaft of stiffnesses k and 1.3k diverges between √k and √(1.3k), and not above."""
    eye = sp.eye_array(2 * n)
    terms = [("mass", eye), ("stiffness", sp.kron(path_matrix(n, 1.0), np.diag([1, 1.3]))),
             ("damping", sp.kron(sp.eye_array(n), GYROSCOPE), "powers = { omega = 1 }"),
             ("stiffness", eye, "powers = { omega = 2 }", "scale = -1")]  # fmt: skip
    critical = np.sqrt(path_values(n, 1.0)[0])
    ends = critical * np.array([0.5, 1.9])
    result = run(tmp_path, terms, {"omega": critical}, "omega", *ends, 8, 6, suffixes=(".mtx", ".npz"))
    into, out = result.onsets
    assert (into.kind, into.direction, out.kind, out.direction) == ("divergence", "into", "divergence", "out of")
    # A double zero: the onsets are bracketed, and tell themselves how closely.
    for onset, exact in ((into, critical), (out, np.sqrt(1.3) * critical)):
        assert abs(onset.value - exact) <= onset.uncertainty <= 5e-8 * critical
    for point in result.points:
        k = path_values(n, 1.0)[0] - point.value**2, 1.3 * path_values(n, 1.0)[0] - point.value**2
        unstable = point.modes.lam[point.modes.stability == "unstable"]
        if k[0] * k[1] > 0:
            assert not len(unstable)
        else:  # λ⁴ + (k₁ + k₂ + 4Ω²)λ² + k₁k₂ = 0
            half = (k[0] + k[1] + 4 * point.value**2) / 2
            np.testing.assert_allclose(unstable, np.sqrt(-k[0] * k[1] / (half + np.sqrt(half**2 - k[0] * k[1]))))


def test_gyroscopic_stabilisation(tmp_path):
    """K = −diag(1, 1.5) is held by rotation from Ω = (1 + √1.5)/2 on, where two pairs meet on the imaginary axis."""
    terms = [("mass", np.eye(2)), ("stiffness", -np.diag([1, 1.5])),
             ("damping", GYROSCOPE, "powers = { omega = 1 }")]  # fmt: skip
    result = run(tmp_path, terms, {"omega": 1.0}, "omega", 0.2, 2.0, 10)
    [onset] = result.onsets
    exact = (1 + np.sqrt(1.5)) / 2
    assert (onset.kind, onset.direction) == ("flutter", "out of") and not result.warnings
    assert abs(onset.value - exact) <= onset.uncertainty < 1e-7
    assert 2 * np.pi * onset.frequency_hz == pytest.approx(1.5**0.25, rel=1e-4)
    for point in result.points:
        p = 2 * point.value**2 - 1.25
        root = np.sqrt(complex(p * p - 1.5))
        squares = np.array([-p - root, -1.5 / (p + root) if p > 0 else -p + root])
        assert_near(point, np.concatenate([np.sqrt(squares), -np.sqrt(squares)]), 1e-13)
        expected = {"marginal"} if point.value > exact else {"stable", "unstable"}
        assert set(point.modes.stability) == expected


def test_without_a_sweep_the_tables_name_a_parameter_of_the_scene(tmp_path):
    """One unit mass with θ = 4 + ω² at ω = 1.5: λ = 2.5 i. Where there is friction, its coefficient is named."""
    terms = [("mass", np.eye(1)), ("stiffness", 4 * np.eye(1)), ("stiffness", np.eye(1), "powers = { omega = 2 }")]
    for more, named in (([], ("omega", 1.5)), ([("stiffness", np.eye(1), "powers = { mu = 1 }")], ("mu", 0.0))):
        path = write_scene(tmp_path, terms + more, {"omega": 1.5, **({"mu": 0.0} if more else {})})
        assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 0
        with (tmp_path / "out" / "modes.csv").open(newline="") as file:
            (row,) = csv.DictReader(file)
        assert (row["parameter"], float(row["value"])) == named
        assert float(row["im"]) == pytest.approx(2.5, rel=1e-12)


def test_shapes_at_values_that_agree_in_six_digits_have_files_of_their_own(tmp_path):
    """θ = 4.5 ± i √(1/p² − 1/4): the unstable mode grows fastest at the first value, and is written at the last too."""
    terms = [("mass", np.eye(2)), ("stiffness", np.diag([4.0, 5.0])),
             ("stiffness", np.array([[0.0, 1.0], [-1.0, 0.0]]), "powers = { p = -1 }")]  # fmt: skip
    tail = '[sweep]\nparameter = "p"\nvalues = [0.3761230, 0.3761231, 0.3761232]\n[output]\nshapes = "all"\n'
    scene = write_scene(tmp_path, terms, {"p": 0.3}, tail)
    assert main(["run", str(scene), "-o", str(tmp_path / "out")]) == 0
    shapes = sorted((tmp_path / "out" / "shapes").glob("*.npz"))
    assert all(re.fullmatch(_SHAPE_FILE, f"shapes/{path.name}") for path in shapes)
    found = {(float(shape["value"]), float(shape["re"]) > 0) for shape in map(np.load, shapes)}
    assert found == {(0.3761230, True), (0.3761232, True), (0.3761232, False)} and len(shapes) == 3
