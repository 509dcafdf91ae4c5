"""What a study varies: mesh size, order, number of modes, method and tolerance, and the scene at one such setting."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass, replace

import numpy as np

from ..assembly.assembly import assemble
from ..assembly.bodies import read_mesh
from ..assembly.contacts import with_gap_tolerances
from ..eigen.inertia import count_below
from ..eigen.shift import symmetric_part
from ..mesh import LoadedMesh
from ..mesh.digest import mesh_digest
from ..mesh.refining import refine
from ..scene import Scene
from ..scene.solver import solver_of
from ..sweep.sweep import MODES
from ..version import __version__
from .own_mesh import own_mesh

_SIZES = (2.0, 2**0.5, 1.0, 2**-0.5, 0.5)  # times the scene's own size of elements, for a parametric geometry
_LEVELS = 2  # how often a mesh from a file is refined, at most
_MORE_MODES = (1.5, 2.0, 3.0)  # times the modes asked for: further sizes of the modal projection
_TOLERANCES = (1e-2, 1e-4, 1e-6)  # of the reduced model


@dataclass(frozen=True)
class Setting:
    """One point of a study.

    Attributes
    ----------
    order : int
        Order of the elements, 1, 2 or 3.
    size : float, m
        Edge length of the elements; of a scene in other units in its unit of length.
    modes : int
        How many are asked for.
    method : "reduced", "direct" or "modal"
        How the sweep is solved.
    tolerance : float
        Relative tolerance of the reduced model.
    refinement : int
        How often the mesh of a file is refined; 0 for a parametric geometry, which is meshed with the size.
    knob : "size", "adapted", "modes", "tolerance", "method" or ""
        What the study varies in this setting: the size (in each order), a mesh that goes where the error is, the number
        of modes of the modal projection, the tolerance of the reduced model, or the method; "" outside of a study.
    estimated : bool
        Whether the change by refining the mesh is found too. The reference comes from such settings.
    adapted : int
        How often the mesh was adapted to the error of the one before.
    geometry : str
        The parametric geometry of such a mesh as JSON; `size` is then the one that equal elements would have.
    units : "SI" or "any"
        The units of the scene.
    """

    order: int
    size: float
    modes: int
    method: str
    tolerance: float
    refinement: int = 0
    knob: str = ""
    estimated: bool = False
    adapted: int = 0
    geometry: str = ""
    units: str = "SI"

    def key(self, scene_key: str) -> str:
        """Return a name (a hash) for the result of a scene with this `key_of`.

        `knob`, `estimated`, `adapted` and `units` do not enter: they do not change modes and onsets.
        """
        left_out = ("estimated", "adapted", "units", *(() if self.geometry else ("geometry",)))
        plain = {name: value for name, value in asdict(self).items() if name not in left_out} | {"knob": ""}
        return _hash(f"{scene_key} {sorted(plain.items())}")

    def __str__(self) -> str:
        unit = " m" if self.units == "SI" else ""
        words = f"order {self.order}, size {self.size:.3g}{unit}, {self.modes} modes, {self.method}, {self.tolerance:g}"
        return f"{words}, adapted" if self.adapted else words


def key_of(scene: Scene) -> str:
    """Return a name (a hash) for a scene: the same for the same physics, mesh and version of the program.

    Raises
    ------
    MeshError
        The mesh cannot be read.
    """
    content = "" if scene.mesh.geometry is not None else mesh_digest(read_mesh(scene))
    return _hash(f"{__version__} {scene.model_dump_json(exclude={'output', 'title', 'source'})} {content}")


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def plan(scene: Scene) -> list[Setting]:
    """Return the settings of a study: each knob in turn is varied while the others stay as the scene has them."""
    own = own_setting(scene)
    if scene.mesh.geometry is not None:
        meshes = [(own.size * factor, 0) for factor in _SIZES]
    else:
        meshes = [(own.size / 2**level, level) for level in range(_LEVELS + 1)]
    orders = (2, 3) if scene.mesh.order == 3 else (1, 2)
    settings = [
        replace(own, order=order, size=size, refinement=level, knob="size", estimated=order == orders[-1])
        for order in orders
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
    """Return the setting that the scene itself stands for; `mesh` saves reading its mesh again."""
    if scene.mesh.geometry is not None:
        size = scene.mesh.geometry.edge_length * scene.mesh.scale
    else:
        loaded = mesh or read_mesh(scene)
        corners = loaded.mesh.p[:, loaded.mesh.edges]
        size = float(np.median(np.linalg.norm(corners[:, 0] - corners[:, 1], axis=0)))
    return Setting(scene.mesh.order, size, _modes(scene), "reduced", scene.solve.tolerance, units=scene.units)


def _modes(scene: Scene) -> int:
    """Return how many modes the scene asks for.

    If it asks for a highest frequency instead, it is one more than the modes without friction and damping below it.
    """
    if scene.solve.max_frequency is None:
        return scene.solve.modes or MODES
    pencil = symmetric_part(assemble(scene).pencil())
    below = count_below(pencil, 2 * np.pi * scene.solve.max_frequency, solver_of(scene))
    return (below or MODES) + 1


def scene_at(scene: Scene, setting: Setting) -> tuple[Scene, LoadedMesh]:
    """Return the scene at a setting, and its mesh: a parametric geometry meshed anew, or the mesh of a file, refined.

    Raises
    ------
    MeshError
        The mesh cannot be read or made.
    """
    mesh = scene.mesh.model_copy(update={"order": setting.order})
    if scene.mesh.geometry is not None:
        size = setting.size / scene.mesh.scale
        key = "disc_pad" if scene.mesh.disc_pad is not None else "block"
        own = scene.mesh.geometry
        geometry = type(own).model_validate_json(setting.geometry) if setting.geometry else own.resized(size)
        mesh = mesh.model_copy(update={key: geometry, "file": None})
    solve = scene.solve.model_copy(
        update={"modes": setting.modes, "max_frequency": None, "method": setting.method, "tolerance": setting.tolerance}
    )
    changed = scene.model_copy(update={"mesh": mesh, "solve": solve})
    loaded = own_mesh(changed)
    if setting.refinement:
        changed = with_gap_tolerances(changed, loaded)
    for _ in range(setting.refinement):
        loaded = refine(loaded)
    return changed, loaded
