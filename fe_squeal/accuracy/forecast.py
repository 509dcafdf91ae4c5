"""Forecast unknowns, seconds and memory of a study before it starts, and put its settings into a useful order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..assembly.bodies import read_mesh
from ..fem.spaces import make_space
from ..scene import Scene
from ..scene.mesh import MeshSection
from .settings import Setting, own_setting

# Seconds of a reduced sweep, measured on two cores: for a process to start, and for each unknown at 40 modes.
_START, _PER_UNKNOWN = 2.0, 3e-4  # s
# MiB of the same until its modes are found, measured on brakes of 1 632 to 101 550 unknowns: of a process itself, and
# for each unknown by the order of the elements and for each mode.
_PROCESS, _MATRICES, _VECTORS = 150.0, {1: 0.012, 2: 0.016, 3: 0.024}, 24 * 8 / 2**20
_METHODS = {"reduced": 1.0, "modal": 0.6, "direct": 4.0}  # times the seconds of a reduced sweep
_ESTIMATE = 3.0  # times the seconds of the sweep: what the estimate of the mesh's error takes in addition
_GROWTH = 0.8  # power of the forecast work by which times grow, until two measured times of the study give it
_POWERS = (0.2, 1.5)  # limits of the power that measured times give
# Weights of what is learned from a setting, chosen. Most is learned where the mesh is refined too, since the reference
# comes from there; next from other meshes, which show the rates; the rest compares, on one mesh, the methods and the
# tolerances looser than the scene's.
_REFERENCE, _MESH, _LOOSER = 4.0, 2.0, 0.25
_OTHER_METHODS = {"direct": 1.0, "modal": 0.5}


@dataclass(frozen=True)
class Forecast:
    """Forecasts the unknowns and the seconds of settings, from the scene's own mesh and what was measured so far.

    Attributes
    ----------
    nodes : mapping of order to int
        Number of nodes that the scene's own mesh has with elements of each order of the study.
    size : float, m
        Length of the elements of this mesh.
    mesh : MeshSection or None
        The scene's table of the mesh, if its geometry is parametric and meshed by hexahedra: their nodes are counted.
    """

    nodes: dict[int, int]
    size: float
    mesh: MeshSection | None = None

    def unknowns(self, setting: Setting) -> int:
        """Return about how many unknowns a setting has: three for each node, those that supports hold included."""
        if self.mesh is not None and self.mesh.geometry is not None:
            own = self.mesh.geometry
            if setting.geometry:
                return 3 * type(own).model_validate_json(setting.geometry).nodes(setting.order)
            return 3 * own.resized(setting.size / self.mesh.scale).nodes(setting.order)
        return int(3 * self.nodes[setting.order] * (self.size / setting.size) ** 3)

    def memory(self, setting: Setting, done: Sequence[tuple[Setting, float]] = ()) -> float:
        """Return about how many MiB a setting takes until its modes are found, its estimate not included.

        Parameters
        ----------
        setting : Setting
        done : sequence of (Setting, float)
            The settings measured so far, and the MiB that each took. The largest one of the same order corrects what
            comes from other scenes.
        """
        known = [(self._solved(s), mib) for s, mib in done if s.order == setting.order and np.isfinite(mib)]
        most, taken = max(known, default=(1.0, 1.0 + _PROCESS))
        process = min(_PROCESS, taken)  # other versions of the libraries may take less
        ratio = (taken - process) / most if known else 1.0
        return process + ratio * self._solved(setting)

    def _solved(self, setting: Setting) -> float:
        return (_MATRICES[setting.order] + _VECTORS * setting.modes) * self.unknowns(setting)

    def work(self, setting: Setting) -> float:
        """Return about how many seconds a setting takes, from times of other scenes alone."""
        times = _METHODS[setting.method] * (1 + _ESTIMATE if setting.estimated else 1.0) * (setting.modes + 20) / 60
        return _START + _PER_UNKNOWN * self.unknowns(setting) * times

    def seconds(self, setting: Setting, done: Sequence[tuple[Setting, float]]) -> float:
        """Return about how many seconds a setting takes, from the times that this study has measured already.

        The time of the longest measured setting of the same order is scaled by (work/its work)^power. The power comes
        from the shortest and the longest setting if their work differs by more than a factor of two; with less, the
        time to start a process, the same for all, would hide it.

        Parameters
        ----------
        setting : Setting
        done : sequence of (Setting, float)
            The settings measured so far, and the seconds that each took.
        """
        like = sorted((self.work(s), t) for s, t in done if s.order == setting.order)
        if not like:
            ratio = max((t / self.work(s) for s, t in done), default=1.0)
            return ratio * self.work(setting)
        cost, seconds = like[-1]
        power = _GROWTH
        if cost > 2 * like[0][0]:
            power = float(np.clip(np.log(seconds / like[0][1]) / np.log(cost / like[0][0]), *_POWERS))
        return float(seconds * max(self.work(setting) / cost, 1e-3) ** power)


def forecast_of(scene: Scene) -> Forecast:
    """Return the forecast of a scene from its own mesh.

    Raises
    ------
    MeshError
        The mesh cannot be read, or is not valid.
    """
    loaded = read_mesh(scene)
    geometry = scene.mesh.geometry
    counted = scene.mesh if geometry is not None and geometry.element == "hex" else None
    nodes = {k: make_space(loaded.mesh, k, []).nodes for k in {1, 2, scene.mesh.order}}
    return Forecast(nodes, own_setting(scene, loaded).size, counted)


def by_information(settings: Sequence[Setting], forecast: Forecast) -> list[Setting]:
    """Return the settings in the order in which they are to be run: most information for each second first.

    The n-th setting of a kind (same method, order and use) counts 1/n of the first, so that kinds alternate.
    """
    tightest = min(s.tolerance for s in settings)

    def kind(s: Setting) -> tuple[str, int, bool]:
        return s.method, s.order if s.tolerance == tightest else 0, s.estimated

    def information(s: Setting) -> float:
        if s.method in _OTHER_METHODS:
            return _OTHER_METHODS[s.method]
        return _REFERENCE if s.estimated else _MESH if s.tolerance == tightest else _LOOSER

    found: list[Setting] = []
    left = list(settings)
    while left:
        known = Counter(kind(s) for s in found)
        worth = [information(s) / (1 + known[kind(s)]) / forecast.work(s) for s in left]
        found.append(left.pop(int(np.argmax(worth))))
    return found
