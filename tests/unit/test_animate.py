"""Films of shapes: one period, that closes; formats; what is refused."""

from __future__ import annotations

import json
import shutil
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scene_texts import replaced, write_scene

from fe_squeal.cli import main
from fe_squeal.report import animation
from fe_squeal.report.results import read_shape
from fe_squeal.report.vtk_files import write_shape


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("film")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fe_squeal.report.export.drawing_shapes", lambda *_: nullcontext())
        path = write_scene(folder, replaced('shapes = "none"', 'shapes = "unstable"'))
        assert main(["run", str(path), "-o", str(folder / "out")]) == 0
    return folder / "out"


def turning(count: int) -> list[np.ndarray]:
    """Frames of a dot on a circle."""
    pictures = []
    for k in range(count):
        picture = np.full((61, 81, 3), 255, np.uint8)
        x, y = 40 + 25 * np.cos(2 * np.pi * k / count), 30 + 25 * np.sin(2 * np.pi * k / count)
        picture[int(y) - 2 : int(y) + 3, int(x) - 2 : int(x) + 3] = (200, 30, 30)
        pictures.append(picture)
    return pictures


@pytest.mark.parametrize("suffix", [".gif", ".mp4"])
def test_films_have_every_frame_of_one_period(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str) -> None:
    """The step from the last frame to the first is one like all others: the film loops without a jump."""
    count = 24
    monkeypatch.setattr(animation, "_drawn", lambda *_: turning(count))
    path = animation.write_film(Path("shape.vtu"), tmp_path / f"film{suffix}", "5 nodal diameters\nμ", (0, 0, 1), count)
    if suffix == ".gif":
        film = Image.open(path)
        assert (film.n_frames, film.info["loop"]) == (count, 0)
        frames = []
        for k in range(count):
            film.seek(k)
            frames.append(np.asarray(film.convert("RGB")).astype(float))
    else:
        import imageio_ffmpeg

        reader = imageio_ffmpeg.read_frames(str(path))
        about = next(reader)
        assert about["duration"] == pytest.approx(animation.SECONDS, abs=0.1)
        w, h = about["size"]
        frames = [np.frombuffer(raw, np.uint8).reshape(h, w, 3).astype(float) for raw in reader]
        assert len(frames) == count
    red = [np.argwhere((f[..., 0] > 150) & (f[..., 1] < 110)).mean(axis=0) for f in frames]
    steps = np.linalg.norm(np.diff([*red, red[0]], axis=0), axis=1)
    assert steps.max() < 1.5 * steps.mean() and steps.min() > 0.5 * steps.mean()
    assert np.linalg.norm(np.mean(red, axis=0) - (red[0] + red[count // 2]) / 2) < 2.0  # pixels


@pytest.mark.slow
def test_a_film_of_each_shape_moves_and_closes(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Drawn by VTK: frames differ, opposite ones most, and neighbours, the last and the first among them, least."""
    assert main(["animate", str(out)]) == 0
    [path] = (out / "shapes").glob("*.gif")
    assert path.name in (out / "manifest.sha256").read_text() and str(path) in capsys.readouterr().out
    film = Image.open(path)
    frames = []
    for k in range(film.n_frames):
        film.seek(k)
        frames.append(np.asarray(film.convert("L")).astype(float))
    n = len(frames)
    assert n == animation.FRAMES
    apart = np.array([np.abs(frames[k] - frames[(k + 1) % n]).mean() for k in range(n)])
    opposite = np.array([np.abs(frames[k] - frames[(k + n // 2) % n]).mean() for k in range(n)])
    assert opposite.max() > 3 * apart.mean() > 0
    assert apart[-1] < 1.5 * apart.max()
    assert np.ptp(frames[0]) > 100


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--branch", "77"], "given branch 77; expected one with a shape: "),
        (["-o", "film.avi"], "given the format .avi; expected a name that ends in .gif or .mp4"),
        (["-o", "film"], "given the format (none)"),
    ],
)
def test_what_is_refused(out: Path, capsys: pytest.CaptureFixture[str], options: list[str], said: str) -> None:
    assert main(["animate", str(out), *options]) == 2
    found = capsys.readouterr().err
    assert said in found and found.count("\n") == 1


@pytest.mark.parametrize(
    ("key", "damaged"),
    [
        (None, []), (None, "text"), ("unstable", [1]), ("unstable", {}), ("axis", [0, 0, 1]), ("branch", None),
        ("value", [0.6]), ("nodal_diameters", "many"), ("other_share", None), ("body_share", "half"),
    ],
)  # fmt: skip
def test_a_damaged_record_costs_its_words_alone(
    out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, key: str | None, damaged: object
) -> None:
    """The films are drawn all the same, under what is still known of the modes."""
    titles = []

    def written(shape: Path, path: Path, title: str, axis: object) -> None:
        titles.append(title)
        path.write_bytes(b"film")

    monkeypatch.setattr(animation, "write_film", written)
    folder = Path(shutil.copytree(out, tmp_path / "out"))
    record = json.loads((folder / "run.json").read_text("utf-8"))
    assert record["unstable"][0]["body"] == "block"
    if key in ("unstable", "axis"):
        record[key] = damaged
    elif key is not None:  # of the mode, which the block has no nodal diameters for
        mixed = {"nodal_diameters": 3, "nodal_diameters_share": 0.6, "other_nodal_diameters": 5, "other_share": 0.3}
        record["unstable"][0] |= {**mixed, key: damaged}
    (folder / "run.json").write_text(json.dumps(damaged if key is None else record))
    assert main(["animate", str(folder)]) == 0
    assert len(titles) == 1 and titles[0].startswith("branch 1:  7")
    assert ("block 100 %" in titles[0]) == (key in ("axis", "nodal_diameters", "other_share"))


def test_of_several_shapes_of_a_branch_the_fastest_growing_is_filmed(
    out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As with shapes = "all", which adds those at the last value; a file without a branch needs one."""
    titles = []

    def written(shape: Path, path: Path, title: str, axis: object) -> None:
        titles.append(title)
        path.write_bytes(b"film")

    monkeypatch.setattr(animation, "write_film", written)
    [file] = (out / "shapes").glob("*.vtu")
    grid, shape = read_shape(file)
    for value, re in ((0.2, 3.0), (0.3, 80.0), (0.7, -9.0)):
        write_shape(grid, shape.u, tmp_path / f"shapes/{value}.vtu", shape.info | {"value": value, "re": re})
    assert main(["animate", str(tmp_path), "--branch", "1", "-o", str(tmp_path / "one.gif")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "note: of 3 shapes that with the largest Re λ is taken: branch 1: " in printed and "μ = 0.30" in printed
    assert len(titles) == 1 and "Re λ = +80 1/s" in titles[0]
    assert main(["animate", str(tmp_path), "-o", str(tmp_path / "other.gif")]) == 2
    assert "given one file for 3 shapes; expected --branch with one of 1" in capsys.readouterr().err


def test_a_folder_without_shapes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["animate", str(tmp_path)]) == 2
    assert "holds no shapes that can be drawn" in capsys.readouterr().err
    assert main(["animate", str(tmp_path / "none")]) == 2


@pytest.mark.slow
def test_a_film_is_not_written_over_another_file(out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "mine.gif"
    path.write_bytes(b"mine")
    assert main(["animate", str(out), "-o", str(path)]) == 2
    assert path.read_bytes() == b"mine" and "exists already" in capsys.readouterr().err
