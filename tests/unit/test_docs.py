"""What README.md and docs/ show is what the program has."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from fe_squeal.scene.reference import reference

ROOT = Path(__file__).parents[2]


def test_scene_reference_is_the_one_the_command_makes() -> None:
    assert (ROOT / "docs/scene.md").read_text(encoding="utf-8") == reference()


def test_readme_shows_the_example() -> None:
    shown = (ROOT / "README.md").read_text(encoding="utf-8").partition("```toml\n")[2].partition("```\n")[0]
    assert shown == (ROOT / "examples/pad_on_belt.toml").read_text(encoding="utf-8")


MADE = sorted(p.stem for p in (ROOT / "docs").glob("*.md") if p.stem != "architecture")


@pytest.mark.parametrize("page", MADE)
def test_every_page_is_made_by_a_target(page: str) -> None:
    """`make docs/PAGE.md`, and what it runs is there and writes that page."""
    done = subprocess.run(
        ["make", "-n", f"docs/{page}.md"], cwd=ROOT, capture_output=True, encoding="utf-8", check=True
    )
    found = re.search(r"python (?:-m )?(\S+)", done.stdout.splitlines()[-1])
    assert found is not None, done.stdout
    script = ROOT / (found[1] if found[1].endswith(".py") else found[1].replace(".", "/") + ".py")
    assert page in script.stem or f"{page}.md" in script.read_text(encoding="utf-8") + done.stdout


def test_every_picture_is_shown() -> None:
    """Nothing is left over of pages that were."""
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    pictures = list((ROOT / "docs").rglob("*.png"))
    assert pictures and all(f"{p.parent.name}/{p.name}" in text for p in pictures)
