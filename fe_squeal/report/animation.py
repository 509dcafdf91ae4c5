"""One period of a shape as a film: GIF or MP4."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from fe_squeal.errors import OutputError
from fe_squeal.process.isolation import isolated_environment
from fe_squeal.report.files import replace_atomically
from fe_squeal.report.vtk_files import VISIBLE

FRAMES, SECONDS = 24, 2.0  # frames and length of one period: 12 frames a second
FORMATS = (".gif", ".mp4")
_MARGIN, _LETTERS = 12, 16  # pixels
_PATIENCE = 300.0  # s for all frames; without a graphics card VTK takes up to 10 s for a frame of a large model
Pixels = NDArray[np.uint8]


def write_film(
    shape: Path, path: Path, title: str, axis: Sequence[float], frames: int = FRAMES, scale: float = VISIBLE
) -> Path:
    """Draw one period of a shape as a film that can be repeated without a jump.

    Parameters
    ----------
    shape : Path
        A .vtu file of `write_shape`.
    path : Path
        The file to write, with the suffix .gif or .mp4.
    title : str
        Text above the picture, in one or more lines.
    axis : (3,) float
        Axis of the disc, or normal of the belt; it points upwards in the picture.
    frames : int
        Number of frames.
    scale : float
        Largest displacement that is drawn, over the size of the model.

    Raises
    ------
    OutputError
        VTK cannot draw here, or the file cannot be written.
    """
    pictures = _titled(_drawn(shape, frames, axis, scale), title)
    with replace_atomically(path) as temporary:
        if path.suffix.lower() == ".gif":
            _write_gif(pictures, temporary)
        else:
            _write_mp4(pictures, temporary)
    return path


def _drawn(shape: Path, frames: int, axis: Sequence[float], scale: float) -> list[Pixels]:
    """Return the frames, drawn by another process, all cut to the part of the picture that is not always white."""
    job = {"shape": str(shape.absolute()), "count": frames, "axis": list(axis), "scale": scale}
    with tempfile.TemporaryFile() as out:  # it has no name, so that nothing is left of it if this process is killed
        try:
            child = subprocess.run(
                [sys.executable, "-m", "fe_squeal.report.frames"], input=json.dumps(job), stdout=out,
                stderr=subprocess.PIPE, env=isolated_environment(), timeout=_PATIENCE, encoding="utf-8",
                errors="replace", cwd=Path(__file__).parent, check=False,
            )  # fmt: skip
        except (OSError, subprocess.TimeoutExpired) as error:
            raise OutputError(f"{shape}: cannot be drawn: {error}") from error
        if child.returncode or not out.seek(0, os.SEEK_END):
            last = (child.stderr.strip().splitlines() or ["no reason given"])[-1]
            raise OutputError(
                f"{shape}: cannot be drawn: VTK's process ended with code {child.returncode} ({last}); the .pvd file"
                " beside it moves in ParaView"
            )
        out.seek(0)
        pictures = list(np.load(out))
    inked = np.any([np.any(p < 250, axis=2) for p in pictures], axis=0)
    rows, columns = np.flatnonzero(inked.any(axis=1)), np.flatnonzero(inked.any(axis=0))
    if not len(rows):
        raise OutputError(f"{shape}: cannot be drawn: VTK drew empty pictures")
    window = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    return [p[window] for p in pictures]


def _titled(pictures: list[Pixels], title: str) -> list[Image.Image]:
    """Return the pictures with a margin and the title above; their width and height are even, as videos need them."""
    import matplotlib

    font = ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts/ttf/DejaVuSans.ttf"), _LETTERS)
    box = ImageDraw.Draw(Image.new("RGB", (1, 1))).multiline_textbbox((0, 0), title, font=font)
    head = int(box[3]) + 2 * _MARGIN if title else _MARGIN
    height, width = pictures[0].shape[:2]
    wide = max(width, int(box[2])) + 2 * _MARGIN
    size = (wide + wide % 2, (high := height + head + _MARGIN) + high % 2)
    found = []
    for picture in pictures:
        image = Image.new("RGB", size, "white")
        image.paste(Image.fromarray(picture), ((size[0] - width) // 2, head))
        ImageDraw.Draw(image).multiline_text((_MARGIN, _MARGIN), title, fill="black", font=font)
        found.append(image)
    return found


def _write_gif(pictures: list[Image.Image], path: Path) -> None:
    """Write a film that repeats without end; all frames have the same colours, so that nothing flickers."""
    some = pictures[:: max(len(pictures) // 4, 1)]
    sheet = Image.new("RGB", (some[0].width, some[0].height * len(some)))
    for k, picture in enumerate(some):
        sheet.paste(picture, (0, k * picture.height))
    # By this method colours of few pixels, those of the largest amplitudes, keep an entry of the palette.
    palette = sheet.quantize(256, method=Image.Quantize.MAXCOVERAGE)
    frames = [p.quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures]
    duration = 10 * round(100 * SECONDS / len(frames))  # ms; GIF counts in hundredths of a second
    frames[0].save(path, save_all=True, append_images=frames[1:], loop=0, duration=duration, disposal=1)


def _write_mp4(pictures: list[Image.Image], path: Path) -> None:
    import imageio_ffmpeg

    writer = imageio_ffmpeg.write_frames(
        str(path), pictures[0].size, fps=len(pictures) / SECONDS, codec="libx264", quality=8, macro_block_size=2,
        output_params=["-movflags", "+faststart"],
    )  # fmt: skip
    try:
        writer.send(None)
        for picture in pictures:
            writer.send(picture.tobytes())
    except OSError as error:
        raise OutputError(f"{path}: ffmpeg cannot write it: {error}") from error
    finally:
        writer.close()
