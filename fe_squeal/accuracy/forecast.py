"""What a study will take, before it starts, and in which order its settings tell most for their time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..assembly.bodies import read_mesh
from ..fem.spaces import make_space
from ..scene import Scene
from .settings import Setting, own_setting

# Of a reduced sweep, measured on two cores: what a process takes to start, and per unknown at 40 modes.
_START, _PER_UNKNOWN = 2.0, 3e-4  # s
_METHODS = {"reduced": 1.0, "modal": 0.6, "direct": 4.0}  # times as long
_ESTIMATE = 3.0  # times the rest: what refining the mesh once takes beside it
_GROWTH, _POWERS = 0.8, (0.2, 1.5)  # power of the work with which times grow, until the study's own tell; limits
# What a setting tells: the reference comes from those whose mesh is refined, rates from meshes of both orders; the rest
# compares methods, and tolerances looser than the scene's, on one mesh.
_REFERENCE, _MESH, _LOOSER = 4.0, 2.0, 0.25
_OTHER_METHODS = {"direct": 1.0, "modal": 0.5}


@dataclass(frozen=True)
class Forecast:
    """Unknowns and seconds of settings, as far as the mesh and what is measured already tell.

    Attributes
    ----------
    nodes : mapping of order to int
        Of the scene's own mesh.
    size : float, m
        Of its elements.
    """

    nodes: dict[int, int]
    size: float

    def unknowns(self, setting: Setting) -> int:
        """Return about how many unknowns a setting has."""
        return int(3 * self.nodes[setting.order] * (self.size / setting.size) ** 3)

    def work(self, setting: Setting) -> float:
        """Return about how long it takes, in seconds, from experience with other scenes."""
        times = _METHODS[setting.method] * (1 + _ESTIMATE if setting.estimated else 1.0) * (setting.modes + 20) / 60
        return _START + _PER_UNKNOWN * self.unknowns(setting) * times

    def seconds(self, setting: Setting, done: Sequence[tuple[Setting, float]]) -> float:
        """Return about how long it takes here: from the dearest of the same order, by the growth up to there.

        What starting a process takes is the same for all, and so the first few say little about how times grow.

        Parameters
        ----------
        done : sequence of (Setting, s)
            What was measured so far.
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
    """
    loaded = read_mesh(scene)
    return Forecast({k: make_space(loaded.mesh, k, []).nodes for k in (1, 2)}, own_setting(scene, loaded).size)


def by_information(settings: Sequence[Setting], forecast: Forecast) -> list[Setting]:
    """Return the settings in the order of what they tell for the second; the next of a kind tells less."""
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
