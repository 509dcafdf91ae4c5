"""Draw the frames of a moving shape with VTK, off screen: `python -m fe_squeal.report.frames` reads a job from
standard input.

`fe_squeal.report.animation` runs it as a process of its own, since VTK ends the process where it cannot draw. The job
is JSON, `{"shape": .vtu, "count": ..., "axis": [x, y, z], "scale": ...}`; the frames (count, rows, columns, 3) uint8 of
a period go to standard output as a .npy file.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyvista

from fe_squeal.report.pictures import AMPLITUDE_COLOURS
from fe_squeal.report.shapes import axis_frame

PIXELS = (900, 700)
_SUBDIVISION = 1  # each face of a quadratic cell becomes 4 triangles
_TOWARDS = (1.0, -1.3, 1.15)


def draw_frames(shape: Path, count: int, axis: list[float], scale: float) -> np.ndarray:
    """Return one period of Re(u e^{iφ}), φ = 2πk/count: after the last frame the first one follows without a jump.

    Returns
    -------
    (count, rows, columns, 3) uint8
    """
    grid = pyvista.read(shape)
    frame = axis_frame(axis)
    size = float(grid.length)
    rest = grid.points @ frame.T
    grid.points = rest
    u = (grid.point_data["u_re"] + 1j * grid.point_data["u_im"]) @ frame.T
    edges = grid.extract_surface(nonlinear_subdivision=_SUBDIVISION).extract_feature_edges(
        feature_angle=35, boundary_edges=True, non_manifold_edges=False, manifold_edges=False
    )
    plotter: Any = pyvista.Plotter(off_screen=True, window_size=list(PIXELS), lighting="light kit")
    plotter.set_background("white")
    plotter.enable_parallel_projection()
    plotter.enable_anti_aliasing("ssaa")
    plotter.add_mesh(edges, color="dimgray", line_width=1.5, opacity=0.6)
    bounds = np.stack([rest.min(axis=0), rest.max(axis=0)], axis=1) + scale * size * np.array([-1.0, 1.0])
    actor, frames = None, []
    for k in range(count):
        grid.points = rest + scale * size * np.real(u * np.exp(2j * np.pi * k / count))
        surface = grid.extract_surface(nonlinear_subdivision=_SUBDIVISION)
        if actor is not None:
            plotter.remove_actor(actor, render=False)
        actor = plotter.add_mesh(surface, scalars="amplitude", clim=(0.0, 1.0), cmap=AMPLITUDE_COLOURS,
                                 show_scalar_bar=False, smooth_shading=True, split_sharp_edges=True, ambient=0.2,
                                 reset_camera=False)  # fmt: skip
        if k == 0:
            plotter.view_vector(_TOWARDS, viewup=(0.0, 0.0, 1.0))
            plotter.reset_camera(bounds=bounds.ravel().tolist())
            plotter.camera.zoom(1.35)  # VTK fits a ball around the bounds into the picture, which is too small
        frames.append(np.asarray(plotter.screenshot(return_img=True), np.uint8)[..., :3])
    plotter.close()
    return np.stack(frames)


def main() -> None:
    """Draw the job on standard input, and write its frames to standard output."""
    out = os.dup(1)
    os.dup2(2, 1)  # what VTK prints does not belong to them
    pyvista.OFF_SCREEN = True
    job = json.load(sys.stdin)
    frames = draw_frames(Path(job["shape"]), int(job["count"]), job["axis"], float(job["scale"]))
    with os.fdopen(out, "wb") as file:
        np.save(file, frames)


if __name__ == "__main__":
    main()
