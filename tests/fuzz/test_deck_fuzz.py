"""Hundreds of spoilt decks: a scene that can be read again, or one sentence; never a traceback."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from mutations import needs_timer, time_limit
from selection import amount
from test_mesh_fuzz import spoilt

from fe_squeal.cli import main
from fe_squeal.decks.scene import draft_of
from fe_squeal.errors import SquealError
from fe_squeal.scene.file import parse_scene

pytestmark = needs_timer
ROOT = Path(__file__).parents[2]
COUNT = amount(150, 500)
ODD = (b"", b"1", b"-1", b"x", b"1e400", b"7", b"nan", b"ALL", b"*", b"0", b"1e30", b"99999999999999999999")
# What stands behind the mesh, where the physics is.
PHYSICS = re.compile(rb"\*Assembly|\*Material|\*Element, type=MASS|PSOLID")


def physics_spoilt(base: bytes, rng: np.random.Generator) -> bytes:
    """Return the deck with lines exchanged, lost, doubled or cut, mostly those of the physics."""
    lines = base.split(b"\n")
    first = next((i for i, line in enumerate(lines) if PHYSICS.match(line)), 0)
    for _ in range(rng.choice([1, 1, 2, 4])):
        if len(lines) <= first + 3:
            break
        i, j = rng.integers(first, len(lines), size=2)
        what = rng.integers(6)
        if what == 0:
            del lines[i]
        elif what == 1:
            lines[i], lines[j] = lines[j], lines[i]
        elif what == 2:
            lines.insert(i, lines[j])
        elif what == 3:
            lines[i] = lines[i][: int(rng.integers(len(lines[i]) + 1))]
        elif what == 4:
            parts = lines[i].split(b",")
            parts[int(rng.integers(len(parts)))] = ODD[int(rng.integers(len(ODD)))]
            lines[i] = b",".join(parts)
        else:
            del lines[int(rng.integers(first, len(lines))) :]
    return b"\n".join(lines)


@pytest.fixture(scope="module")
def decks() -> dict[str, bytes]:
    """Good decks with all that is taken over."""
    import sys

    sys.path.insert(0, str(ROOT / "tests/unit"))
    import test_decks_nastran as nastran
    import test_decks_ties as ties
    from deck_scenes import deck
    from deck_texts import deck_of

    block = ties.box("hex1", (2, 1, 1), (0.06, 0.03, 0.02))
    tied = "*Heading\n" + deck_of(block, 1e3) + ties.REFERENCE % ties.SPELLINGS["averaged"]
    return {
        "brake.inp": (ROOT / "examples/small_brake.inp").read_bytes(), "pad.inp": deck().encode(),
        "tied.inp": tied.encode(), "free.bdf": nastran.deck()[0].encode(),
        "large.bdf": nastran.deck(nastran.large_field)[0].encode(),
    }  # fmt: skip


def result_of(path: Path) -> str:
    """Return "scene", "asked" or "refused"; a scene has to be TOML, and where nothing is missing one that is valid."""
    try:
        draft = draft_of(path)
    except SquealError as error:
        assert error.exit_code == 2 and str(error)
        return "refused"
    data = tomllib.loads(draft.text())
    if draft.missing:
        return "asked"
    try:
        parse_scene(data, path.name)
    except SquealError as error:
        assert error.exit_code == 2
        return "refused"
    return "scene"


@pytest.mark.slow
def test_spoilt_decks(decks: dict[str, bytes], tmp_path: Path) -> None:
    """Of 500 decks some fifth has to survive, or the search would look at the first check alone."""
    rng = np.random.default_rng(21)
    results: dict[str, int] = {}
    for i in range(COUNT):
        name = sorted(decks)[i % len(decks)]
        spoil = physics_spoilt if i % 3 else spoilt
        path = tmp_path / name
        path.write_bytes(spoil(decks[name], rng))
        try:
            with time_limit():
                found = result_of(path)
        except BaseException as error:
            (tmp_path / f"kept_{i}_{name}").write_bytes(path.read_bytes())
            raise AssertionError(f"number {i} of {name}: {type(error).__name__}: {error}") from error
        results[found] = results.get(found, 0) + 1
    assert results["scene"] > COUNT // 5 and results["refused"] > COUNT // 10 and results["asked"] > COUNT // 50


@pytest.mark.slow
def test_the_command_ends_with_one_line(
    decks: dict[str, bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """fe-squeal new: exit code 0 and a file, or 2, one line and no file."""
    rng = np.random.default_rng(22)
    for i in range(40):
        name = sorted(decks)[i % len(decks)]
        path, scene = tmp_path / name, tmp_path / f"{i}.toml"
        path.write_bytes(physics_spoilt(decks[name], rng))
        code = main(["new", str(path), "-o", str(scene)])
        err = capsys.readouterr().err
        assert code in (0, 2) and scene.is_file() == (code == 0)
        assert err.count("\n") == (code == 2)
