"""The sparse solver that a scene asks for, and one that is handed in from outside the package."""

from __future__ import annotations

import csv
import importlib
import json
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from chains import chain
from scene_texts import SCENE, replaced, write_scene
from selection import crossed
from toy_solver import Toy

from fe_squeal import assemble, parse_scene, sweep
from fe_squeal.accuracy import refined, with_discretisation
from fe_squeal.cli import main
from fe_squeal.compare.table import compare_case
from fe_squeal.eigen.linear import choice, pardiso
from fe_squeal.eigen.linear.choice import choose, factorize
from fe_squeal.eigen.linear.dense import DenseFactor
from fe_squeal.eigen.linear.factor import DefiniteFactor, Factor, LinearSolver
from fe_squeal.eigen.linear.pardiso import PardisoFactor
from fe_squeal.eigen.linear.superlu import SuperLUCholesky, SuperLUFactor
from fe_squeal.eigen.request import Request
from fe_squeal.errors import SceneError
from fe_squeal.scene.file import load_scene
from fe_squeal.sweep.forecast import predict_memory

VALUES = np.linspace(0.0, 0.9, 7)
MODES, N = 8, 450  # more unknowns than go to LAPACK as a whole
# 90 unknowns, all modes by LAPACK; 405, solved directly, and 2295, which "auto" reduces.
COARSE = replaced('file = "block.msh"\n', "")
SMALL = replaced("size = 0.02", "size = 0.01", COARSE)
FINE = replaced("order = 1", "order = 2", SMALL)


def asking_for(word: str, text: str = SCENE) -> str:
    return replaced("modes = 8", f'modes = 8\nlinear_solver = "{word}"', text)


class Watched:
    """An object that notes which of its members are asked for."""

    def __init__(self, inner, kind, seen):
        self._inner, self._kind, self._seen = inner, kind, seen

    def __getattr__(self, name):
        self._seen.add(f"{self._kind}.{name}")
        found = getattr(self._inner, name)
        kind = {"factorize": "Factor", "factorize_definite": "DefiniteFactor"}.get(name)
        return found if kind is None else lambda *args: Watched(found(*args), kind, self._seen)


def test_sweeps_call_every_member_of_the_protocol_and_no_other():
    """What `factor.py` asks of a solver, and docs/architecture.md of one on a device, is what is used."""
    seen, protocol = set(), set()
    watched = Watched(Toy(), "LinearSolver", seen)
    for kind in (LinearSolver, Factor, DefiniteFactor):
        protocol |= {f"{kind.__name__}.{name}" for name in vars(kind) if not name.startswith("_")}
    for method in ("direct", "reduced"):
        sweep(chain(n=N), VALUES, modes=MODES, method=method, linear_solver=watched)
    sweep(chain("loss", n=N), VALUES[:2], modes=MODES, method="direct", linear_solver=watched)
    predict_memory(chain(n=N), "mu", 7, MODES, "direct", watched)
    assert seen - {"LinearSolver.rough"} == protocol  # a solver may have that, and need not
    page = (Path(__file__).parents[2] / "docs/architecture.md").read_text(encoding="utf-8")
    named = page.partition("## Factors on a device")[2].partition("## ")[0]
    assert all(f"`{name.partition('.')[2]}(" in named or f"`{name.partition('.')[2]}:" in named for name in protocol)


@pytest.fixture
def no_other(monkeypatch):
    """Let no other sparse solver factorise anything, from the call of what is returned on."""

    def refuse(*_, **__):
        raise AssertionError("another solver than the one handed in factorises")

    def begin():
        for kind in (PardisoFactor, SuperLUFactor, SuperLUCholesky):
            monkeypatch.setattr(kind, "__init__", refuse)

    return begin


@pytest.mark.parametrize(
    ("effects", "method"),
    crossed(
        [(), ("damper", "slip damping"), ("loss",)], ["direct", "reduced"],
        fast=lambda effects, method: "loss" not in effects and ("damper" in effects) == (method == "reduced"),
    ),
)  # fmt: skip
def test_a_solver_handed_in_goes_through_a_whole_sweep(effects, method, no_other):
    """Kernel, modes, count, reduced model and onsets; nothing is known of the motions of these matrices."""
    expected = sweep(chain(*effects, n=N), VALUES, modes=MODES, method=method)
    toy, problem = Toy(), chain(*effects, n=N)
    no_other()
    found = sweep(problem, VALUES, modes=MODES, method=method, linear_solver=toy)
    assert toy.plain > 0
    discs = method == "direct" and "damper" in effects
    assert toy.definite == (not discs)  # of the reduced model; without discs a direct sweep makes one to count modes
    if method == "direct":
        # It gives no inertia: whether anything may grow without swinging, however fast, is searched for and told.
        assert "that grow faster than" in found.unsettled[-1]
        assert found.method == ("block Krylov-Schur in discs, toy" if discs else "shift-invert ARPACK, toy")
    for a, b in zip(found.points, expected.points, strict=True):
        assert np.abs(a.modes.lam - b.modes.lam).max() <= 1e-7 * np.abs(b.modes.lam).max()
    assert len(found.onsets) == len(expected.onsets)
    for a, b in zip(found.onsets, expected.onsets, strict=True):
        assert a.value == pytest.approx(b.value, rel=1e-7)
    if not effects:
        assert found.onsets  # refined by Newton's method on bordered matrices


def test_a_solver_handed_in_estimates_the_error_of_the_mesh(no_other):
    block = {"order": 1, "block": {"length": 0.08, "width": 0.04, "height": 0.02, "size": 0.02}}
    scene = parse_scene({
        "mesh": block,
        "materials": {"steel": {"youngs_modulus": 2e11, "poisson_ratio": 0.3, "density": 7800.0}},
        "bodies": {"block": {"material": "steel"}},
        "supports": [{"surface": "left", "fixed": "xyz"}],
        "contacts": [{
            "surface": "bottom", "counterface": "rigid", "normal_stiffness": 3e8,
            "sliding": {"direction": [1.0, 0.0, 0.0], "speed": 1.0},
        }],
        "effects": {"friction": {"mu": 0.3}},
    })  # fmt: skip
    problem, toy = assemble(scene), Toy()
    no_other()
    found = with_discretisation(
        sweep(problem, [0.0, 0.3, 0.6], modes=4, method="reduced", linear_solver=toy), linear_solver=toy
    )
    assert toy.definite >= 2  # the reduced model, and the coarse problem under the refined one
    assert all(np.isfinite(point.discretisation).all() for point in found.points)


@pytest.mark.slow
def test_a_solver_handed_in_goes_through_a_comparison(no_other):
    toy = Toy()
    no_other()
    found = compare_case("nine-dof", toy)
    assert toy.plain > 0
    # Beside bodies this stiff, rounding leaves the critical values uncertain by 2e-4, as the onsets say themselves.
    away = {quantity: difference for _, quantity, _, _, difference in found if not np.isnan(difference)}
    assert away.pop("order in 1/E") < 0.05 and len(away) >= 4 and all(d < 2e-4 for d in away.values())


def test_forecast_is_that_of_the_solver_handed_in(no_other):
    problem = chain(n=N)
    no_other()
    told = predict_memory(problem, "mu", 7, MODES, "direct", Toy())
    A = problem.solved_with(Toy()).pencil()
    assert told.factors == 1000 * sp.csr_array(A.K + A.M).nnz


def test_small_full_matrices_go_to_lapack_with_any_solver():
    toy, A = Toy(), sp.csr_array(np.random.default_rng(0).standard_normal((30, 30)))
    assert isinstance(factorize(A, False, toy), DenseFactor) and not toy.plain


def test_pardiso_is_found_without_a_search_of_the_disc(monkeypatch, needs_pardiso):
    """The wheel of MKL lists its files; pypardiso would ask the compiler and walk through the whole environment."""
    wrapper = importlib.import_module("pypardiso.pardiso_wrapper")

    def searched(*_, **__):
        raise AssertionError("searched")

    monkeypatch.setattr(wrapper, "find_library", searched)
    monkeypatch.setattr(wrapper.glob, "glob", searched)
    monkeypatch.delenv("PYPARDISO_MKL_RT", raising=False)
    assert pardiso._pardiso.__wrapped__() is not None
    assert "PYPARDISO_MKL_RT" not in os.environ  # what children of the process inherit is the user's own


def test_auto_is_pardiso_where_it_is_there(monkeypatch):
    monkeypatch.setattr(choice, "has_pardiso", lambda: True)
    assert choose("auto").name == choose("pardiso").name == "PARDISO (MKL)"
    assert choose("superlu").name == "SuperLU (SciPy)"
    monkeypatch.setattr(choice, "has_pardiso", lambda: False)
    assert choose("auto").name == "SuperLU (SciPy)"
    toy = Toy()
    assert choose(toy) is toy


@pytest.mark.parametrize(
    ("word", "pardiso", "told"),
    [
        ("pardiso", False, "MKL's PARDISO cannot be loaded on this machine (package pypardiso); expected \"auto\" or"
                           ' "superlu"'),
        ("mumps", True, "MUMPS cannot be loaded on this machine (petsc4py with MUMPS and real numbers; see"
                        ' docs/cluster.md); expected "auto", "pardiso" or "superlu"'),
        ("mumps", False, "MUMPS cannot be loaded on this machine (petsc4py with MUMPS and real numbers; see"
                         ' docs/cluster.md); expected "auto" or "superlu"'),
    ],
)  # fmt: skip
def test_a_solver_that_is_not_there_is_bad_input(tmp_path, monkeypatch, capsys, word, pardiso, told):
    monkeypatch.setattr(choice, "has_pardiso", lambda: pardiso)
    monkeypatch.setattr(choice, "has_mumps", lambda: False)
    path = write_scene(tmp_path, asking_for(word))
    for command in (["run", str(path), "-o", str(tmp_path / "out")], ["check", str(path)], ["onset", str(path)],
                    ["run", str(path), "--accuracy", "0.1", "-o", str(tmp_path / "out")],
                    ["accuracy", str(path), "-o", str(tmp_path / "out")]):  # fmt: skip
        assert main(command) == 2
        said = capsys.readouterr().err
        assert said == f'error: {path}: solve.linear_solver: given "{word}", and {told}\n'
    assert not (tmp_path / "out").exists()
    with pytest.raises(SceneError, match=r"solve\.linear_solver"):
        sweep(assemble(load_scene(path)), [0.3], linear_solver=word)


def test_an_unknown_word_is_bad_input(tmp_path, capsys):
    path = write_scene(tmp_path, asking_for("umfpack"))
    assert main(["check", str(path)]) == 2
    assert 'solve.linear_solver: given "umfpack"; expected one of "auto"' in capsys.readouterr().err
    with pytest.raises(SceneError, match='given "umfpack"; expected "auto"'):
        sweep(chain(n=60), [0.3], linear_solver="umfpack")


def table(folder: Path) -> list[dict[str, str]]:
    with (folder / "modes.csv").open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def test_the_static_state_takes_the_solver_of_the_scene(tmp_path, monkeypatch):
    text = SCENE + "[effects.preload]\npressures = { top = 1e5 }\n"
    asked = []
    monkeypatch.setattr(SuperLUFactor, "solve", lambda factor, b: asked.append(len(b)) or factor._apply("N", b))
    monkeypatch.setattr(PardisoFactor, "__init__", None)  # fails where it is called
    problem = assemble(load_scene(write_scene(tmp_path, asking_for("superlu", text))))
    assert asked and set(asked) == {problem.unknowns}


def preloaded(tmp_path):
    text = replaced("[effects.friction]", "[effects.preload]\npressures = { top = 1e5 }\n[effects.friction]", COARSE)
    return load_scene(write_scene(tmp_path, text))


def test_a_solver_handed_in_finds_static_states(tmp_path, no_other):
    """That of the assembly, that at another value, and those of a sweep, which its own solver finds."""
    scene = preloaded(tmp_path)
    expected = sweep(assemble(scene), [0.1, 0.3], modes=4)
    no_other()
    first, later, last = Toy(), Toy(), Toy()
    problem = assemble(scene, linear_solver=first)
    assert first.plain >= 1
    solved = first.plain
    moved = problem.solved_with(later).at(mu=0.5)
    assert later.plain >= 1 and moved.discretisation.static_state.mu == 0.5
    found = sweep(problem, [0.1, 0.3], modes=4, linear_solver=last)
    assert first.plain == solved and last.plain > 0
    for a, b in zip(found.points, expected.points, strict=True):
        np.testing.assert_allclose(a.modes.lam, b.modes.lam, rtol=1e-7)
        assert a.pressed == {name: pytest.approx(state, rel=1e-9, nan_ok=True) for name, state in b.pressed.items()}
        assert a.pressed and all(state["mu"] == a.value for state in a.pressed.values())


@pytest.mark.slow
def test_a_solver_handed_in_finds_static_states_on_the_refined_mesh(tmp_path, no_other, monkeypatch):
    # The bars react to shapes, which are exact only to the root of the tolerance of λ.
    monkeypatch.setattr(refined, "Request", partial(Request, tolerance=1e-12))
    problem, toy = assemble(preloaded(tmp_path)), Toy()
    expected = with_discretisation(sweep(problem, [0.1, 0.3], modes=4))
    no_other()
    found = with_discretisation(sweep(problem, [0.1, 0.3], modes=4, linear_solver=toy), linear_solver=toy)
    for a, b in zip(found.points, expected.points, strict=True):
        np.testing.assert_allclose(a.discretisation, b.discretisation, rtol=1e-4, atol=1e-7 * np.abs(b.modes.lam).max())


@pytest.mark.slow
@pytest.mark.parametrize("text", [pytest.param(SMALL, id="direct"), pytest.param(FINE, id="reduced")])
def test_superlu_by_the_scene_gives_the_same_modes(tmp_path, text, needs_pardiso, monkeypatch, no_figures):
    tables, names = [], []
    for word in ("pardiso", "superlu"):
        path, out = write_scene(tmp_path, asking_for(word, text), f"{word}.toml"), tmp_path / word
        if word == "superlu":
            monkeypatch.setattr(PardisoFactor, "__init__", None)  # fails where it is called
        assert main(["run", str(path), "-o", str(out)]) == 0
        tables.append(table(out))
        names.append(json.loads((out / "run.json").read_text("utf-8"))["linear_solver"])
    assert names == ["PARDISO (MKL)", "SuperLU (SciPy)"]
    assert len(tables[0]) == len(tables[1]) >= 5 * 8
    for rows in tables:  # λ and −λ* have the same frequency but for rounding, which puts either first
        rows.sort(key=lambda row: (float(row["value"]), int(row["branch"])))
    for a, b in zip(*tables, strict=True):
        assert a.keys() == b.keys()
        assert all(a[key] == b[key] for key in ("value", "branch", "stability"))
        # [solve] tolerance is 1e-8.
        lam = [complex(float(row["re"]), float(row["im"])) for row in (a, b)]
        assert abs(lam[0] - lam[1]) <= 1e-8 * abs(lam[0])


@pytest.mark.skipif(not pardiso.has_pardiso(), reason="MKL is not there")
@pytest.mark.parametrize("symmetric", [False, True])
def test_rows_without_entries_do_not_break_memory(symmetric):
    """A solve with the adjoint of factors of such a matrix wrote beyond the end of memory, and the process died."""
    text = f"""
import numpy as np, scipy.sparse as sp
from fe_squeal.eigen.linear.pardiso import PardisoFactor
rng = np.random.default_rng(0)
for n, empty in [(8, 4), (8, 7), (40, 20)] * 40:
    diagonal = np.where(np.arange(n) < n - empty, 0.8, 0.0)[rng.permutation(n)]
    A = sp.diags_array(diagonal).tocsr()
    A.eliminate_zeros()
    factor, b = PardisoFactor(A, {symmetric}), A @ rng.standard_normal(n)
    for solve in (factor.solve, factor.solve_adjoint, factor.solve_transposed):
        assert np.allclose(A @ solve(b), b)
"""
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr[-2000:]
