"""The folder of results: the names of its files, and how a command gets hold of it.

A command uses a folder that is new, empty, or has the manifest of an earlier command. It refuses any other folder and
leaves it as it is. In the folder, only files that the manifest lists are replaced or removed (see `manifest`).
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import OutputError
from ..report.files import owned_by
from .lock import LOCK, is_lock, locked
from .manifest import MANIFEST, MISSING, UNFINISHED, Manifest
from .open_folder import OpenFolder

# Every file and folder that a run or a study of accuracy writes.
RECORD = "run.json"
MODES_TABLE, ONSETS_TABLE, CONTRIBUTIONS_TABLE, SENSITIVITIES_TABLE, PRELOAD_TABLE = TABLES = (
    "modes.csv", "onsets.csv", "contributions.csv", "sensitivities.csv", "preload.csv",
)  # fmt: skip
STABILITY_FIGURE, ROOT_LOCUS_FIGURE, CONTRIBUTIONS_FIGURE = FIGURES = (
    "stability.png", "root_locus.png", "contributions.png",
)  # fmt: skip
PRELOAD_FILES = ("preload.png", "preload.vtu", "preload_contacts.vtu")  # written by `report.preload`
SHAPES, CHECKPOINT = "shapes", "checkpoint"
ACCURACY_TABLE, STAGES_TABLE, ACCURACY_FIGURE, ACCURACY_PAGE, MEASUREMENTS = (
    "accuracy.csv", "accuracy_stages.csv", "accuracy.png", "accuracy.md", "measurements",
)  # fmt: skip
REPORT, MESH = "report.html", "mesh.msh"
MESH_ERROR_TABLE, MESH_ERROR_FIGURE, MESH_ERROR_PICTURE, MESH_ERROR_GRID = MESH_ERROR_FILES = (
    "mesh_error.csv", "mesh_error.png", "mesh_error_elements.png", "mesh_error.vtu",
)  # fmt: skip
MAC_TABLE, MAC_FIGURE = MEASURED_FILES = "mac.csv", "mac.png"
DIFFERENCE_TABLE, DIFFERENCE_FIGURE, DIFFERENCE_RECORD = "diff.csv", "diff.png", "diff.json"
DIFFERENCE_FILES = (DIFFERENCE_TABLE, DIFFERENCE_FIGURE, DIFFERENCE_RECORD, REPORT)
STUDY_RECORD, BANDS_TABLE, INDICES_TABLE, SAMPLES_TABLE, UNSTABLE_TABLE = (
    "study.json", "bands.csv", "indices.csv", "samples.csv", "unstable_modes.csv",
)  # fmt: skip
PROBABILITY_FIGURE, SCATTER_FIGURE, INDICES_FIGURE = "probability.png", "scatter.png", "indices.png"
MAP_TABLE, BOUNDARIES_TABLE, MAP_FIGURE = "map.csv", "boundaries.csv", "map.png"
SCATTER_FILES = (
    STUDY_RECORD, BANDS_TABLE, INDICES_TABLE, SAMPLES_TABLE, UNSTABLE_TABLE, PROBABILITY_FIGURE, SCATTER_FIGURE,
    INDICES_FIGURE, REPORT,
)  # fmt: skip
MAP_FILES = (STUDY_RECORD, MAP_TABLE, BOUNDARIES_TABLE, MAP_FIGURE, REPORT)
DANGEROUS, PARTS = "dangerous", "parts"
PARTS_INPUTS = f"{PARTS}/inputs.json"
RUN_FILES = (RECORD, *TABLES, *FIGURES, *PRELOAD_FILES, *MEASURED_FILES, *MESH_ERROR_FILES, REPORT, MESH)
STUDY_FILES = (ACCURACY_TABLE, STAGES_TABLE, ACCURACY_FIGURE, ACCURACY_PAGE, REPORT)
FOLDERS = (SHAPES, CHECKPOINT, MEASUREMENTS, DANGEROUS, PARTS)
CHECKPOINT_INPUTS = f"{CHECKPOINT}/inputs.json"
SEARCH, NEXT_MESH = f"{CHECKPOINT}/search.json", "next_{}.npz"  # of a mesh for a target
_CHECKPOINT_FILES = (CHECKPOINT_INPUTS, *(f"{CHECKPOINT}/{name}.npz" for name in ("model", "first", "state")))
_LITTER = {".DS_Store", "Thumbs.db", "desktop.ini"}  # files that file browsers leave; an empty folder may have them
_UNFINISHED = re.compile(re.escape(UNFINISHED).replace(re.escape("{}"), "[0-9a-f]{32}"))
_NAMED = 3  # files in one message
RESULTS = "a folder of results with its manifest"  # what a command that shows results expects
_EXPECTED = "a new or empty folder, or one of earlier results, given by -o"
_LATER = {*MEASURED_FILES, *MESH_ERROR_FILES, REPORT, MESH}  # that came with the manifest
_SHAPE_FILE = rf"{SHAPES}/(branch|mode)_\d+\w*[\w.+-]*Hz(\.(vtu|pvd|png|npz|gif)|_frames/[\w.+-]+\.vtu)"
# Names inside these folders that are made as the work goes on.
_MADE = re.compile(
    rf"{_SHAPE_FILE}|{CHECKPOINT}/(point_\d+\.npz|next_\d+\.(npz|msh)|search\.json)|{MEASUREMENTS}/[\w.+-]+\.np[yz]"
    rf"|{DANGEROUS}/sample_\d+\.toml|{PARTS}/(inputs\.json|\w+_\d+\.npz)"
)
# Names of files of the version that wrote no manifest: a folder with such files alone holds its results.
_EARLIER = re.compile(
    "|".join(map(re.escape, {*RUN_FILES, *STUDY_FILES, *_CHECKPOINT_FILES} - _LATER))
    + rf"|{CHECKPOINT}/point_\d+\.npz|{MEASUREMENTS}/[\w.+-]+\.np[yz]|{_SHAPE_FILE}"
)
_STUDY_MARKS = ((ACCURACY_TABLE, b"order,size,modes,method,"), (f"{MEASUREMENTS}/probes.npy", b"\x93NUMPY"))
_EARLIER_PARTIAL = re.compile(r"(.*/)?\.[^/]*\.\d+\.partial\.\w+")  # unfinished files of a command that was killed
_RECORD_KEYS = {"version", "title", "status", "unknowns", "problem_class", "effects", "inputs"}


@contextmanager
def hold_folder(folder: Path, inputs: Iterable[Path] = (), expected: str = _EXPECTED) -> Iterator[Manifest]:
    """Make a folder if it is missing, and hold it during the block, so that no other command writes into it.

    Folders that were made for it and stay empty are removed again.

    Parameters
    ----------
    folder : Path
    inputs : iterable of Path
        The files that the command reads; it must not replace them.
    expected : str
        What a message about a folder of other files says that it should be.

    Yields
    ------
    Manifest
        Manifest of the folder.

    Raises
    ------
    OutputError
        Another command holds the folder, it has files that this program did not write, an input is among the files that
        would be replaced, or nothing can be written there.
    """
    _refuse_foreign(folder, expected)
    made: list[Path] = []
    try:
        with _explained(folder):
            missing = [p for p in (folder, *folder.parents) if not os.path.lexists(p)]
            for place in reversed(missing):
                with suppress(FileExistsError):  # another command made it in the meantime
                    place.mkdir()
                    made.append(place)
        with _explained(folder, inside := _Inside()), OpenFolder(folder) as opened, locked(opened):
            _refuse_foreign(folder, expected)
            manifest = Manifest(opened, () if Manifest.marks(folder) else tuple(_earlier(folder)))
            _refuse_names(manifest)
            _refuse_inputs(manifest, inputs)
            manifest.remove_partial()
            manifest.remove(lambda name: _EARLIER_PARTIAL.fullmatch(name) is not None)
            inside.begun = True
            with owned_by(manifest):
                try:
                    yield manifest
                finally:
                    manifest.close()
    finally:
        for place in reversed(made):
            with suppress(OSError):  # it is not empty
                place.rmdir()


def remove_results(manifest: Manifest) -> None:
    """Remove the results of an earlier run from the folder, so that results of two runs are never mixed.

    run.json is removed first: without it the other files do not count as complete results.

    Raises
    ------
    OutputError
        A file cannot be removed.
    """
    manifest.remove(is_result, first=RECORD)


def is_result(name: str) -> bool:
    """Return whether a file of the folder is one of a run's results."""
    return name in RUN_FILES or name.startswith(f"{SHAPES}/")


def is_study_result(name: str) -> bool:
    """Return whether a file of the folder is one of the results of a scatter or a map."""
    return name in (*SCATTER_FILES, *MAP_FILES) or name.startswith(f"{DANGEROUS}/")


def is_part(name: str) -> bool:
    """Return whether a file of the folder is a finished part of an unfinished study."""
    return name.startswith(f"{PARTS}/")


def is_shape(name: str) -> bool:
    """Return whether a file of the folder belongs to a shape."""
    return name.startswith(f"{SHAPES}/")


def is_kept(name: str) -> bool:
    """Return whether a file of the folder belongs to the checkpoint."""
    return name.startswith(f"{CHECKPOINT}/")


class _Inside:
    """Whether the block of `hold_folder` has begun: errors raised in the block are not about the folder."""

    begun = False


@contextmanager
def _explained(folder: Path, inside: _Inside | None = None) -> Iterator[None]:
    """Turn an OSError in the block into an OutputError, unless it was raised inside the block of `hold_folder`."""
    try:
        yield
    except OSError as error:
        if inside is not None and inside.begun:
            raise
        raise OutputError(
            f"{folder}: cannot write results here: {error.strerror or error}; expected a folder that can be written,"
            " given by -o"
        ) from error


def _refuse_foreign(folder: Path, expected: str) -> None:
    """Raise OutputError for a folder that is not empty and was not written by this program."""
    try:
        names = sorted(set(os.listdir(folder)) - _LITTER)
    except OSError:  # it does not exist or is not a folder; making the folder reports that
        return
    own = {LOCK} if is_lock(folder / LOCK) else set()
    own |= {name for name in FOLDERS if _is_empty_folder(folder / name)}  # of a command that was stopped right then
    others = [name for name in names if name not in own and not _UNFINISHED.fullmatch(name)]
    if not others or Manifest.marks(folder) or _earlier(folder):
        return
    rest = len(others) - _NAMED
    listed = ", ".join(others[:_NAMED]) + (f" and {rest} more" if rest > 0 else "")
    raise OutputError(
        f"{folder}: holds what fe-squeal did not write ({listed}) and no {MANIFEST}; expected {expected}"
    )


def _is_empty_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink() and not os.listdir(path)


def _refuse_names(manifest: Manifest) -> None:
    """Refuse to begin where files that this program did not write have names that will be written."""
    for name in FOLDERS:
        path = manifest.folder / name
        if os.path.lexists(path) and (path.is_symlink() or not path.is_dir()):
            raise OutputError(
                f"{path}: is no folder but a link or a file; nothing is written through links: move it, or give another"
                " folder by -o"
            )
    listed = set(manifest.names(lambda name: True))
    found = (path for name in FOLDERS for path in manifest.folder.glob(f"{name}/**/*"))
    inside = {path.relative_to(manifest.folder).as_posix() for path in found}
    made = {name for name in inside if _MADE.fullmatch(name)}
    fixed = {*RUN_FILES, *STUDY_FILES, *SCATTER_FILES, *MAP_FILES, *DIFFERENCE_FILES, *_CHECKPOINT_FILES}
    for name in sorted((fixed | made) - listed):
        if manifest.state(name) != MISSING:
            raise OutputError(
                f"{manifest.folder / name}: is no file that fe-squeal wrote; move it, or give another folder by -o"
            )


def _refuse_inputs(manifest: Manifest, inputs: Iterable[Path]) -> None:
    written = {_identity(manifest.folder / name): name for name in manifest.names(lambda name: True)}
    for path in inputs:
        identity = _identity(path)
        if identity is not None and identity in written:
            raise OutputError(
                f"{manifest.folder}: {written[identity]} is an input of this command ({path}) and would be replaced;"
                " give another folder by -o"
            )


def _identity(path: Path) -> tuple[int, int] | None:
    """Return device and inode of a file, which are the same under all of its names; None if there is no file."""
    try:
        found = path.stat()
    except (OSError, ValueError):  # a name with a zero byte is no name of a file
        return None
    return found.st_dev, found.st_ino


def _earlier(folder: Path) -> list[str]:
    """Return the files of a folder if all of them were written by a version without a manifest, else no file.

    As evidence the folder has to contain run.json of a run, inputs.json of a checkpoint, or the table or measurements
    of a study of accuracy, with the expected beginning.
    """
    names: list[str] = []
    for root, folders, files in os.walk(folder):
        if any(Path(root, name).is_symlink() for name in (*folders, *files)) or len(names) > 1_000_000:
            return []
        names += [Path(root, name).relative_to(folder).as_posix() for name in files]
    names = [name for name in names if name not in _LITTER and name != LOCK and "/.DS_Store" not in f"/{name}"]
    if not names or not all(_EARLIER.fullmatch(name) or _EARLIER_PARTIAL.fullmatch(name) for name in names):
        return []
    record, begun = (_json_keys(folder / name) for name in (RECORD, CHECKPOINT_INPUTS))
    study = any(_begins(folder / name, start) for name, start in _STUDY_MARKS)
    if record >= _RECORD_KEYS or {"version", "scene", "content"} <= begun or study:
        return names
    return []


def _begins(path: Path, start: bytes) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(len(start)) == start
    except OSError:
        return False


def _json_keys(path: Path) -> set[str]:
    try:
        found = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return set()
    return set(found) if isinstance(found, dict) else set()
