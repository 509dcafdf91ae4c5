"""What README.md and docs/ show is what the program has."""

from __future__ import annotations

import ast
import pkgutil
import re
import shutil
import subprocess
from contextlib import nullcontext
from pathlib import Path

import pytest

import fe_squeal.report.export
from fe_squeal.eigen.dense import DENSE_LIMIT
from fe_squeal.scene.reference import reference
from fe_squeal.sweep.forecast import UNKNOWNS, VALUES

ROOT = Path(__file__).parents[2]


def test_scene_reference_is_the_one_the_command_makes() -> None:
    assert (ROOT / "docs/scene.md").read_text(encoding="utf-8") == reference()


def test_numbers_of_the_reference_can_be_read() -> None:
    assert "≤ 2 147 483 648" in reference() and not re.search(r"[<>≤≥] [\d.]+e", reference())
    assert "`a table`" not in reference()
    assert f'takes "reduced" from five values of the sweep and {DENSE_LIMIT + 1} unknowns' in reference()
    assert VALUES == 5
    assert f"at fewer values with friction or damping from {UNKNOWNS} unknowns on" in reference()


def test_every_key_of_the_reference_has_a_meaning() -> None:
    assert "|  |\n" not in reference()


def test_rows_of_tables_have_the_cells_of_their_heads() -> None:
    """A bar inside a cell, as of |λ|, that is not escaped splits it."""
    seen, broken = 0, []
    for page in [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]:
        cells = 0
        for line in page.read_text(encoding="utf-8").splitlines():
            found = len(re.findall(r"(?<!\\)\|", line)) if line.startswith("|") else 0
            broken += [f"{page.name}: {line}"] if found and cells and found != cells else []
            cells, seen = found and (cells or found), seen + bool(found)
    assert seen > 1000 and not broken


def test_readme_shows_the_example() -> None:
    shown = (ROOT / "README.md").read_text(encoding="utf-8").partition("```toml\n")[2].partition("```\n")[0]
    assert shown == (ROOT / "examples/pad_on_belt.toml").read_text(encoding="utf-8")


@pytest.mark.slow
def test_python_of_the_readme_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The onset of the example, that of the stiffer one, and the files; pictures are left out."""
    monkeypatch.setattr(fe_squeal.report.export, "drawing_shapes", lambda *_: nullcontext())
    for folder in ("examples", "meshes"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    monkeypatch.chdir(tmp_path)
    section = (ROOT / "README.md").read_text(encoding="utf-8").partition("## The same in Python\n")[2]
    exec(section.partition("```python\n")[2].partition("```")[0], {})
    said = capsys.readouterr().out
    first, second = re.findall(r"at mu = ([\d.]+)|\bvalue=([\d.]+)", said)
    assert float(first[0]) == pytest.approx(0.27107574, rel=1e-6)
    assert float(second[1]) > 1.01 * float(first[0])
    assert list((tmp_path / "pad_on_belt_results/shapes").glob("*.vtu"))


MADE = sorted(p.stem for p in (ROOT / "docs").glob("*.md") if p.stem != "architecture")


@pytest.mark.parametrize("page", MADE)
def test_every_page_is_made_by_a_target(page: str) -> None:
    """`make docs/PAGE.md`, and what it runs is there and writes that page."""
    done = subprocess.run(
        ["make", "-n", "--no-print-directory", f"docs/{page}.md"], cwd=ROOT, capture_output=True, encoding="utf-8",
        check=True,
    )  # fmt: skip
    found = re.search(r"python (?:-m )?(\S+)", done.stdout.splitlines()[-1])
    assert found is not None, done.stdout
    script = ROOT / (found[1] if found[1].endswith(".py") else found[1].replace(".", "/") + ".py")
    assert page in script.stem or f"{page}.md" in script.read_text(encoding="utf-8") + done.stdout
    for file in (ROOT / "benchmarks").rglob("*.py"):
        text = file.read_text(encoding="utf-8")
        if '"--write"' in text and f"docs/{page}.md" in text:
            assert file.relative_to(ROOT).as_posix() in done.stdout


def test_architecture_names_what_is_there() -> None:
    """Every room has its row, and every path, module, function and class in the text exists."""
    text = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    package = ROOT / "fe_squeal"
    rooms = [p.name for p in package.iterdir() if (p / "__init__.py").exists()]
    assert len(rooms) > 15 and all(f"`{room}/`" in text.partition("## ")[0] for room in rooms)
    sources = {p: p.read_text(encoding="utf-8") for p in package.rglob("*.py")}
    places = [f"/{p.relative_to(ROOT).as_posix()}{'/' if p.is_dir() else ''}" for p in package.rglob("*")]
    missing, seen = [], 0
    for name in set(re.findall(r"`([A-Za-z_/.]+)`", text)) - {"fe_squeal", "mpiexec", "report.html"}:
        if "/" in name or name.endswith((".py", ".toml")):
            there = (ROOT / name).exists() or any(place.endswith(f"/{name}") for place in places)
        elif "." in name:
            try:
                there = pkgutil.resolve_name(f"fe_squeal.{name}") is not None
            except (ImportError, AttributeError):
                there = False
        else:
            defined = re.compile(rf"^(?:def|class) {name}\b", re.MULTILINE)
            there = any(p.stem == name or defined.search(source) for p, source in sources.items())
        missing += [] if there else [name]
        seen += 1
    assert seen > 80 and not missing


def _raised(function: ast.AST) -> set[str]:
    """Return the names of this program's errors that a function raises itself, not in functions inside it."""
    found: set[str] = set()
    for node in ast.iter_child_nodes(function):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and isinstance(node.exc.func, ast.Name):
            found.add(node.exc.func.id)
        if not isinstance(node, ast.FunctionDef | ast.Lambda):
            found |= _raised(node)
    return found & {"SceneError", "MeshError", "OutputError", "TooLargeError", "NotConvergedError"}


def test_docstrings_of_shared_functions_name_errors_and_shapes() -> None:
    """What another module imports has a docstring, which names the errors raised in its body and shapes of arrays."""
    trees = {p: ast.parse(p.read_text(encoding="utf-8")) for p in sorted((ROOT / "fe_squeal").rglob("*.py"))}
    imports = [node for tree in trees.values() for node in tree.body if isinstance(node, ast.ImportFrom)]
    imported = {alias.name for node in imports for alias in node.names}
    shape, array = re.compile(r"\([^()]*[\w…](?:,[^()]*)?\)"), re.compile("ndarray|Floats|Ints|Complexes|Integers")
    seen, lacking = 0, []
    for path, tree in trees.items():
        if path.parent.name == "commands":  # the docstring of a command is its help on the terminal
            continue
        shared = [n for n in tree.body if isinstance(n, ast.FunctionDef | ast.ClassDef) and n.name in imported]
        methods = [m for n in shared if isinstance(n, ast.ClassDef) for m in n.body if isinstance(m, ast.FunctionDef)]
        for node in (n for n in [*shared, *methods] if not n.name.startswith("_")):
            text, where = ast.get_docstring(node) or "", f"{path.name}: {node.name}"
            lacking += [] if text else [where]
            if isinstance(node, ast.FunctionDef):
                lacking += [f"{where}: {error}" for error in _raised(node) if error not in text]
                annotations = [ast.unparse(a.annotation) for a in node.args.args if a.annotation is not None]
                lacking += [f"{where}: shape"] if any(map(array.search, annotations)) and not shape.search(text) else []
            seen += 1
    assert seen > 900 and not lacking


def test_every_picture_is_shown() -> None:
    """Nothing is left over of pages that were."""
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    pictures = list((ROOT / "docs").rglob("*.png"))
    assert pictures and all(f"{p.parent.name}/{p.name}" in text for p in pictures)
