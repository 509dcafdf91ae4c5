"""The example decks of CalculiX with their results, and CalculiX itself; .ci/run installs both."""

from __future__ import annotations

import gzip
import os
import re
import shutil
import subprocess
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import fe_squeal
from fe_squeal.decks.scene import draft_of
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.errors import SquealError
from fe_squeal.scene.file import parse_scene

_PLACES = (os.environ.get("CALCULIX_TESTS", ""), "/usr/share/doc/calculix-ccx-test/examples/test",
           str(Path(__file__).parents[1] / "build/calculix/usr/share/doc/calculix-ccx-test/examples/test"))  # fmt: skip
PROGRAM = shutil.which("ccx")
_LARGEST = 60_000  # unknowns: decks with more are not solved


def decks_folder() -> Path | None:
    """Return the folder of the decks, None if they are not installed."""
    return next((Path(place) for place in _PLACES if place and Path(place).is_dir()), None)


def unpack(folder: Path, target: Path) -> list[Path]:
    """Unpack all decks and their files into a folder, and return the decks."""
    for path in folder.iterdir():
        if path.suffix == ".gz":
            (target / path.stem).write_bytes(gzip.decompress(path.read_bytes()))
        elif path.is_file():
            shutil.copy(path, target / path.name)
    return sorted(target.glob("*.inp"))


def asks_for_frequencies(deck: Path) -> bool:
    return re.search(r"^\*(COMPLEX )?FREQUENCY", deck.read_text(errors="replace"), re.M | re.I) is not None


def frequencies_of(results: Path) -> np.ndarray:
    """Return the frequencies (k,) of the last table of real eigenvalues in a .dat file, in cycles per unit of time."""
    tables = re.findall(r"E I G E N V A L U E   O U T P U T(.*?)(?:P A R T|\Z)", results.read_text(), re.S)
    rows = [line.split() for line in tables[-1].splitlines()] if tables else []
    theta = np.array([float(row[1]) for row in rows if len(row) == 5 and row[0].isdigit()])
    return np.sqrt(np.maximum(theta, 0.0)) / (2 * np.pi)


@dataclass(frozen=True)
class Outcome:
    """The result of comparing a deck.

    Attributes
    ----------
    state : "compared", "asked", "refused" or "not compared"
        "asked": the draft of the scene has questions that the user has to answer.
    text : str
        The questions, or the reason.
    off : (k,) float
        Relative differences of the frequencies.
    unknowns : int
    """

    state: str
    text: str = ""
    off: np.ndarray | None = None
    unknowns: int = 0


def compare(deck: Path) -> Outcome:
    """Solve for the lowest frequencies of a deck, without its loads, and compare them with those in its .dat.ref."""
    try:
        draft = draft_of(deck)
        if draft.missing:
            return Outcome("asked", " | ".join(draft.missing))
        results = deck.with_suffix(".dat.ref")
        known = frequencies_of(results) if results.exists() else np.empty(0)
        if not len(known):
            return Outcome("not compared", "has no table of frequencies")
        scene = parse_scene(tomllib.loads(draft.text()), str(deck))
        scene._source = deck
        problem = fe_squeal.assemble(scene)
        if problem.unknowns > _LARGEST:
            return Outcome("not compared", f"{problem.unknowns} unknowns")
        found = np.sort(solve_modes(problem.pencil(), Request(count=len(known))).frequency_hz)[: len(known)]
    except SquealError as error:
        return Outcome("refused", str(error).replace(f"{deck.parent}/", ""))
    known = np.sort(known)[: len(found)]
    off = (found - known) / np.maximum(known, 1e-3 * known.max())
    return Outcome("compared", "; ".join(dict.fromkeys(f.what for f in draft.findings if f.weight == "changes")), off,
                   problem.unknowns)  # fmt: skip


def run_calculix(deck: Path) -> np.ndarray:
    """Solve a deck with CalculiX, and return the frequencies (k,) of the last table of its results."""
    assert PROGRAM is not None
    done = subprocess.run([PROGRAM, "-i", deck.stem], cwd=deck.parent, capture_output=True, text=True, timeout=300,
                          env={**os.environ, "OMP_NUM_THREADS": "1"})  # fmt: skip
    assert done.returncode == 0, done.stdout[-2000:]
    return frequencies_of(deck.with_suffix(".dat"))
