"""What the command says about scenes of matrices: one line per mistake, with file and key; `check` and `mesh`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from fe_squeal.cli import main
from fe_squeal.run.measured import read_measured
from fe_squeal.scene.file import load_scene

MASS = 'role = "mass"\nfile = "m.npy"\n'
STIFFNESS = 'role = "stiffness"\nfile = "k.npy"\n'
FRICTION = 'role = "stiffness"\nfile = "f.npy"\npowers = { mu = 1 }\n'
PARAMETERS = "[parameters]\nmu = 0.3\n"
SWEEP = '[sweep]\nparameter = "mu"\nfrom = 0.0\nto = 1.0\npoints = 3\n'


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    K, F = np.diag([1.0, 2.0, 3.0]), np.zeros((3, 3))
    F[0, 1] = 1.0
    matrices = {"m": np.eye(3), "k": K, "f": F, "k4": np.eye(4), "nan": np.where(F > 0, np.nan, K), "zero": 0 * F,
                "skewed": np.eye(3) + 0.5 * F, "table": np.ones((3, 2))}  # fmt: skip
    for name, matrix in matrices.items():
        np.save(tmp_path / f"{name}.npy", matrix)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(*terms: str, tail: str = "", parameters: str = PARAMETERS) -> None:
    Path("a.toml").write_text(parameters + "".join(f"[[terms]]\n{t}" for t in terms) + tail)


def other(section: str, old: str, new: str) -> str:
    assert old in section
    return section.replace(old, new)


@pytest.mark.parametrize(
    ("terms", "more", "message"),
    [
        # The matrices.
        ([MASS, other(STIFFNESS, "k.", "k4.")], {},
         "terms[1].file: k4.npy has 4 rows, and m.npy of terms[0] has 3; expected one size"),
        ([MASS, other(STIFFNESS, "k.", "nan.")], {},
         "terms[1].file: nan.npy: 1 of 4 entries are not finite, the first, nan, in row 1, column 2; expected finite"),
        ([MASS, other(STIFFNESS, "k.", "table.")], {}, "terms[1].file: table.npy: the matrix is of 3x2; expected"),
        ([MASS, other(STIFFNESS, "k.", "kk.")], {}, 'terms[1].file: kk.npy: no such matrix file; did you mean "k.npy"'),
        ([other(MASS, "m.", "skewed."), STIFFNESS], {},
         "terms[0].file: the mass matrix skewed.npy is not symmetric; expected that it is"),
        ([MASS, other(STIFFNESS, "k.", "zero.")], {}, "terms: every stiffness matrix is zero; expected one that"),
        ([MASS, STIFFNESS + "scale = 0\n"], {}, "terms: every stiffness matrix is zero; expected one that is not"),
        ([MASS, STIFFNESS + "imaginary = true\n"], {}, "terms: every stiffness matrix is zero; expected one that is"),
        ([other(MASS, "m.", "zero."), STIFFNESS], {}, "terms: every mass matrix is zero; expected one that is not"),
        ([MASS, STIFFNESS + 'variable = "K"\n'], {}, "terms[1].file: k.npy: only a .mat file has variables; leave out"),
        # The keys.
        ([MASS, other(STIFFNESS, "stiff", "stif")], {},
         'terms[1].role: given "stifness"; expected a role; did you mean "stiffness"?'),
        ([MASS, other(STIFFNESS, "stiffness", "spring")], {},
         'terms[1].role: given "spring"; expected a role; valid: damping, mass, stiffness'),
        ([MASS, STIFFNESS + "sclae = 2\n"], {}, 'terms[1].sclae: unknown key; did you mean "scale"?'),
        ([MASS, STIFFNESS + "scale = inf\n"], {}, "terms[1].scale: given inf; expected a finite number"),
        ([MASS + "imaginary = true\n", STIFFNESS], {},
         'terms[0]: given imaginary = true with role = "mass"; expected it with role = "stiffness"'),
        ([MASS, 'role = "stiffness"\n'], {}, "terms[1].file: is missing; expected a text in quotes"),
        ([MASS, other(STIFFNESS, "k.npy", "")], {}, 'terms[1].file: given ""; expected a text that is not empty'),
        ([STIFFNESS], {}, 'terms: expected at least one of role = "mass" and one of role = "stiffness"'),
        # The parameters.
        ([MASS, STIFFNESS + "powers = { mue = 1 }\n"], {},
         'terms[1].powers.mue: is no parameter; did you mean "mu"?; expected [parameters] to have it'),
        ([MASS, STIFFNESS + "powers = { mu = 0.5 }\n"], {}, "terms[1].powers.mu: given 0.5; expected a whole number"),
        ([MASS, STIFFNESS + "powers = { mu = 21 }\n"], {}, "terms[1].powers: mu: given 21; expected an exponent"),
        ([MASS, STIFFNESS + "powers = { mu = -1 }\n"], {"parameters": "[parameters]\nmu = 0.0\n"},
         "terms[1].powers.mu: given -1, and parameters.mu = 0"),
        ([MASS, STIFFNESS], {"parameters": '[parameters]\n"" = 1.0\n'}, 'parameters: given the name ""; expected one'),
        ([MASS, STIFFNESS], {"parameters": '[parameters]\n"a, b" = 1.0\n'},
         'parameters: given the name "a, b"; expected one not empty, and without a comma'),
        ([MASS, STIFFNESS], {"parameters": '[parameters]\n"effects.friction.mu" = 1.0\n'},
         'parameters: given the name "effects.friction.mu"; expected "mu", as it is known'),
        ([MASS, STIFFNESS], {"parameters": '[parameters]\n" a" = 1.0\n'}, 'given the name " a"; expected "a", as it'),
        *(([MASS, STIFFNESS], {"parameters": f'[parameters]\n"{name}" = 1.0\n'},
           f'given the name "{name}"; expected one not empty, and without a comma') for name in (" ", "parameters.")),
        ([MASS, STIFFNESS], {"parameters": "[parameters]\nmu = nan\n"}, "parameters.mu: given nan; expected a finite"),
        ([MASS, FRICTION], {"tail": other(SWEEP, '"mu"', '"nu"')},
         'sweep.parameter: given "nu", which is no parameter'),
        ([MASS, STIFFNESS + "powers = { mu = -1 }\n"], {"tail": SWEEP},
         "of which a term has a negative power; expected values that are all above 0 or all below"),
        ([MASS, STIFFNESS + "powers = { mu = -1 }\n"], {"tail": "[sweep]\nvalues = [-1.0, 1.0]\n"},
         "sweep: given mu from -1 to 1, of which a term has a negative power"),
        ([MASS, STIFFNESS + "powers = { mu = 20 }\n"], {"parameters": "[parameters]\nmu = 1e17\n"},
         "terms[1].powers.mu: mu^20 at mu = 1e+17 is no finite number; expected one up to 1.8e308"),
        ([MASS, STIFFNESS + "powers = { mu = -8 }\n"], {"parameters": "[parameters]\nmu = 1e-40\n"},
         "terms[1].powers.mu: mu^-8 at mu = 1e-40 is no finite number"),
        ([MASS, STIFFNESS + "powers = { mu = 5, nu = 5 }\n"], {"parameters": "[parameters]\nmu = 1e40\nnu = -1e40\n"},
         "terms[1].powers: mu^5 · nu^5 at mu = 1e+40, nu = -1e+40 is no finite number"),
        ([MASS, STIFFNESS + "powers = { mu = 20 }\n"], {"tail": other(SWEEP, "to = 1.0", "to = 1e17")},
         "terms[1].powers.mu: mu^20 at mu = 1e+17 is no finite number"),
        ([MASS, STIFFNESS + "powers = { mu = -8 }\n"], {"tail": other(SWEEP, "from = 0.0", "from = 1e-40")},
         "terms[1].powers.mu: mu^-8 at mu = 1e-40 is no finite number"),
        ([MASS, STIFFNESS + "powers = { mu = -8, nu = 10 }\n"],
         {"parameters": PARAMETERS + "nu = 1.0\n", "tail": "[study.parameters]\n"
          "mu = { values = [1e-20, 1.0, 2.0] }\nnu = { normal = { mean = 1.0, deviation = 1.0, low = -1e16 } }\n"},
         "terms[1].powers: mu^-8 · nu^10 at mu = 1e-20, nu = -1e+16 is no finite number"),
        # What belongs to scenes on a mesh.
        ([MASS, STIFFNESS], {"tail": '[mesh]\nfile = "a.msh"\n'}, "mesh: unknown key; valid: measured, output"),
        ([MASS, STIFFNESS], {"tail": "[rotation]\n"}, "rotation: unknown key; valid: measured, output, parameters"),
        ([MASS, STIFFNESS], {"tail": '[output]\nshapes = "unstabel"\n'},
         'output.shapes: given "unstabel"; expected one of "unstable", "all" or "none"'),
        ([MASS, STIFFNESS], {"tail": '[output]\nshape = "all"\n'}, 'output.shape: unknown key; did you mean "shapes"?'),
    ],
)  # fmt: skip
def test_mistakes(folder: Path, capsys: pytest.CaptureFixture[str], terms: list[str], more: dict, message: str) -> None:
    write(*terms, **more)
    for command in ("run", "check"):
        assert main([command, "a.toml"]) == 2
        out, err = capsys.readouterr()
        assert err.startswith("error: a.toml: ") and message in err
        assert err.count("\n") == 1 and err.strip().isprintable() and not out
        assert not Path("a_results").exists()


@pytest.mark.parametrize("text", ["terms = []\n", '[terms]\nrole = "mass"\n', 'terms = "m.npy"\n'])
def test_terms_that_are_no_list(folder: Path, capsys: pytest.CaptureFixture[str], text: str) -> None:
    Path("a.toml").write_text(text)
    assert main(["run", "a.toml"]) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: a.toml: terms: given ") and "expected" in err and err.count("\n") == 1


def test_singular_at_every_eigenvalue(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Constraints of which one is the sum of two others, in other units, and a row that nothing is in."""
    B = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 1.0, -1.0, 0.0], [1e6, 0.0, -1e6, 0.0]])
    np.save("m7.npy", np.diag([1.0, 1, 1, 1, 0, 0, 0]))
    for kept, message in ((3, "row 5 is a constraint that follows from others (1 such)"), (2, "row 7 is empty")):
        K = np.block([[np.diag([1.0, 2, 3, 4]), B.T], [B, np.zeros((3, 3))]])
        K[4 + kept :], K[:, 4 + kept :] = 0, 0
        np.save("k7.npy", K)
        write(other(MASS, "m.", "m7."), other(STIFFNESS, "k.", "k7."))
        assert main(["check", "a.toml"]) == 2
        err = capsys.readouterr().err
        assert "error: a.toml: terms: " in err and message in err and err.count("\n") == 1
    np.save("k7.npy", K + np.diag(np.r_[np.zeros(6), 1.0]))
    assert main(["check", "a.toml"]) == 0


def test_check(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(MASS, STIFFNESS, FRICTION, other(MASS, "mass", "damping"), tail=SWEEP)
    for options in ([], ["--groups"]):  # of which there are none
        assert main(["check", "a.toml", *options]) == 0
        out, err = capsys.readouterr()
        rows = {tuple(cell.strip() for cell in line.split("  ", 1)) for line in out.splitlines()}
        assert not err and rows >= {
            ("mass.m", "3 entries, symmetric"), ("stiffness.k", "3 entries, symmetric"),
            ("stiffness.f", "1 entries, nonsymmetric"), ("damping.m", "3 entries, symmetric"),
            ("parameters", "mu = 0.3"), ("problem class", "quadratic"), ("unknowns", "3"), ("effects on", "none"),
        }  # fmt: skip


def test_there_is_nothing_to_mesh(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(MASS, STIFFNESS)
    before = set(folder.iterdir())
    assert main(["mesh", "a.toml"]) == 2
    out, err = capsys.readouterr()
    assert err.startswith("error: a.toml: terms: a scene of matrices has no mesh") and err.count("\n") == 1 and not out
    assert set(folder.iterdir()) == before


def test_onset_without_a_sweep(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(MASS, STIFFNESS)
    assert main(["onset", "a.toml"]) == 2
    assert capsys.readouterr().err.startswith("error: a.toml: sweep: is missing")


@pytest.mark.parametrize(("scatter", "refused"), [
    ("lognormal = { median = 2.0, factor = 1.4 }", False),
    ("normal = { mean = 2.0, deviation = 0.4 }", True),
    ("uniform = { low = 1.0, high = 2.0 }", False),
])  # fmt: skip
def test_a_negative_power_of_a_number_that_is_scattered(
    folder: Path, capsys: pytest.CaptureFixture[str], scatter: str, refused: bool
) -> None:
    """Lognormal numbers stay above 0, whether they have a least value or not."""
    study = f"[study]\nsamples = 10\n[study.parameters]\nmu = {{ {scatter} }}\n"
    write(MASS, STIFFNESS + "powers = { mu = -1 }\n", parameters="[parameters]\nmu = 2.0\n", tail=study)
    assert main(["check", "a.toml"]) == (2 if refused else 0)
    assert ("given 0 among the values of mu" in capsys.readouterr().err) == refused


def test_units_of_matrices(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As of a scene on a mesh: "any" is another consistent set, and anything else is refused."""
    for units in ("SI", "any"):
        write(MASS, STIFFNESS, parameters=f'units = "{units}"\n', tail='[output]\nreport = false\n')
        assert main(["run", "a.toml", "-o", units]) == 0
        assert json.loads((folder / units / "run.json").read_text("utf-8"))["units"] == units
        assert read_measured(load_scene("a.toml")).units == units
    capsys.readouterr()
    write(MASS, STIFFNESS, parameters='units = "inch"\n')
    assert main(["check", "a.toml"]) == 2
    assert 'a.toml: units: given "inch"; expected' in capsys.readouterr().err


def test_a_mass_that_is_not_positive_is_refused(folder, capsys):
    np.save(folder / "m.npy", np.diag([0.5, -0.5, 1.0]))
    write(MASS, STIFFNESS)
    assert main(["check", "a.toml"]) == 2
    assert "the mass matrix has -0.5 on its diagonal in row 2" in capsys.readouterr().err
