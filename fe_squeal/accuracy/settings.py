"""What a study varies: mesh size, order, number of modes, method and tolerance, and the scene at one such setting."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass, replace

import numpy as np

from ..assembly.assembly import assemble
from ..assembly.bodies import read_mesh
from ..eigen.inertia import count_below
from ..eigen.shift import symmetric_part
from ..mesh import LoadedMesh
from ..mesh.refining import refine
from ..scene import Scene
from ..sweep.sweep import MODES
from ..version import __version__

_SIZES = (2.0, 2**0.5, 1.0, 2**-0.5, 0.5)  # times the scene's own size, where there is a geometry to mesh
_LEVELS = 2  # how often a mesh from a file is refined
_MORE_MODES = (1.5, 2.0, 3.0)  # times the modes asked for: what a modal projection may take
_TOLERANCES = (1e-2, 1e-4, 1e-6)


@dataclass(frozen=True)
class Setting:
    """One point of a study.

    Attributes
    ----------
    order : int
        Of the displacements.
    size : float, m
        Of the elements.
    modes : int
    method : "reduced", "direct" or "modal"
    tolerance : float
    refinement : int
        How often the mesh of a file is refined; 0 where the size is that of a parametric geometry.
    knob : "size", "modes", "tolerance", "method" or ""
        What the study varies here: the size in each order, the modes of the modal projection, the tolerance of the
        reduced model, or the method; "" outside of a study.
    estimated : bool
        Whether its mesh is refined too, to see what that changes: from such settings comes the reference.
    """

    order: int
    size: float
    modes: int
    method: str
    tolerance: float
    refinement: int = 0
    knob: str = ""
    estimated: bool = False

    def key(self, scene: Scene) -> str:
        """Return a name for the result, the same for the same scene, setting and version."""
        plain = {name: value for name, value in asdict(self).items() if name != "estimated"} | {"knob": ""}
        text = f"{__version__} {scene.model_dump_json(exclude={'output', 'title', 'source'})} {sorted(plain.items())}"
        mesh = scene.mesh_path
        if mesh is not None and scene.mesh.geometry is None:
            text += hashlib.sha256(mesh.read_bytes()).hexdigest()
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def __str__(self) -> str:
        return f"order {self.order}, size {self.size:.3g} m, {self.modes} modes, {self.method}, {self.tolerance:g}"


def plan(scene: Scene) -> list[Setting]:
    """Return the settings of a study, each knob turned by itself from the scene's own ones."""
    own = own_setting(scene)
    if scene.mesh.geometry is not None:
        meshes = [(own.size * factor, 0) for factor in _SIZES]
    else:
        meshes = [(own.size / 2**level, level) for level in range(_LEVELS + 1)]
    settings = [
        replace(own, order=order, size=size, refinement=level, knob="size", estimated=order == 2)
        for order in (1, 2)
        for size, level in meshes
    ]
    base = replace(own, order=scene.mesh.order)
    settings += [
        replace(base, method="modal", modes=max(1, round(own.modes * more)), knob="modes")
        for more in (1.0, *_MORE_MODES)
    ]
    settings += [replace(base, method="reduced", tolerance=t, knob="tolerance") for t in _TOLERANCES]
    settings.append(replace(base, method="direct", knob="method"))
    return settings


def own_setting(scene: Scene, mesh: LoadedMesh | None = None) -> Setting:
    """Return the scene's own setting."""
    if scene.mesh.geometry is not None:
        size = scene.mesh.geometry.edge_length * scene.mesh.scale
    else:
        loaded = mesh or read_mesh(scene)
        corners = loaded.mesh.p[:, loaded.mesh.edges]
        size = float(np.median(np.linalg.norm(corners[:, 0] - corners[:, 1], axis=0)))
    return Setting(scene.mesh.order, size, _modes(scene), "reduced", scene.solve.tolerance)


def _modes(scene: Scene) -> int:
    """Return how many modes are wanted; of those up to a frequency the number without friction and damping."""
    if scene.solve.max_frequency is None:
        return scene.solve.modes or MODES
    pencil = symmetric_part(assemble(scene).pencil())
    below = count_below(pencil, 2 * np.pi * scene.solve.max_frequency, scene.solve.linear_solver)
    return (below or MODES) + 1


def scene_at(scene: Scene, setting: Setting) -> tuple[Scene, LoadedMesh]:
    """Return the scene at a setting, and its mesh: of the geometry where there is one, else of the file, refined."""
    mesh = scene.mesh.model_copy(update={"order": setting.order})
    if scene.mesh.geometry is not None:
        size = setting.size / scene.mesh.scale
        key = "disc_pad" if scene.mesh.disc_pad is not None else "block"
        geometry = scene.mesh.geometry.resized(size)
        mesh = mesh.model_copy(update={key: geometry, "file": None})
    solve = scene.solve.model_copy(
        update={"modes": setting.modes, "max_frequency": None, "method": setting.method, "tolerance": setting.tolerance}
    )
    changed = scene.model_copy(update={"mesh": mesh, "solve": solve})
    loaded = read_mesh(changed)
    for _ in range(setting.refinement):
        loaded = refine(loaded)
    return changed, loaded
