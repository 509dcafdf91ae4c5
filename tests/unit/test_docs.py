"""What README.md and docs/ show is what the program has."""

from __future__ import annotations

from pathlib import Path

from fe_squeal.scene.reference import reference

ROOT = Path(__file__).parents[2]


def test_scene_reference_is_the_one_the_command_makes() -> None:
    assert (ROOT / "docs/scene.md").read_text(encoding="utf-8") == reference()


def test_readme_shows_the_example() -> None:
    shown = (ROOT / "README.md").read_text(encoding="utf-8").partition("```toml\n")[2].partition("```\n")[0]
    assert shown == (ROOT / "examples/pad_on_belt.toml").read_text(encoding="utf-8")
