"""Study of the error against the time that it takes, over mesh size, order, number of modes, method and tolerance."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ..errors import NotConvergedError, SquealError
from ..scene import Scene
from .forecast import Forecast, by_information, forecast_of
from .measure import Measurement, measure_apart
from .reference import Errors, Reference, along, as_reference, errors_of, reference_of, with_exact
from .settings import Setting, key_of, plan

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = (
    "order", "size", "modes", "method", "tolerance", "unknowns", "seconds", "peak_memory_mib", "error_frequency",
    "error_growth", "error_onset", "algebraic_frequency", "algebraic_growth", "algebraic_onset", "seconds_estimate",
    "knob", "units", "lost_frequency", "lost_growth", "lost_onset",
)  # fmt: skip


_ADAPTED = 2  # meshes that are adapted, each to the error of the one before


class MeasurementStore(Protocol):
    """Keeps measurements by the keys of their settings, each as soon as it is made, so that a study can be resumed."""

    def load(self, key: str) -> Measurement | None:
        """Return the measurement that was kept under a key, or None."""

    def save(self, key: str, measured: Measurement) -> None:
        """Keep a measurement under a key."""

    def load_probes(self, key: str) -> np.ndarray | None:
        """Return the points (p, 4) at which all shapes of a scene with this key are stored, see `measure`, or None."""

    def save_probes(self, key: str, probes: np.ndarray) -> None:
        """Keep the points (p, 4) at which all shapes of a scene are stored under its key."""


@dataclass(frozen=True)
class Study:
    """What was measured.

    Attributes
    ----------
    settings, measurements : tuple of Setting, tuple of Measurement
        The settings that were solved, and the results of each.
    reference : Reference
        What all are compared with.
    finest : Setting
        The setting from which the reference was extrapolated.
    left_out : tuple of (Setting, str)
        The settings that were not solved, and why.
    exact : bool
        Whether the frequencies of the reference are known exactly.
    """

    settings: tuple[Setting, ...]
    measurements: tuple[Measurement, ...]
    reference: Reference
    finest: Setting
    left_out: tuple[tuple[Setting, str], ...]
    exact: bool = False

    def to_dataframe(self) -> pd.DataFrame:
        """Return a row per setting, with the columns of accuracy.csv.

        The `error_` columns are errors against the reference, the `algebraic_` ones against the best solution on the
        same mesh: a direct solve, or else the setting with the smallest tolerance; these are the largest over all
        values of the sweep. The `lost_` columns are how many
        modes, growing modes and onsets of the finest mesh are not found again when it is refined, or onsets of the
        refined mesh are not those of it, and so not compared.
        """
        import pandas as pd

        rows = []
        for s, m in zip(self.settings, self.measurements, strict=True):
            e, a = errors_of(m, self.reference), self._algebraic(s, m)
            rows.append((
                s.order, s.size, s.modes, s.method, s.tolerance, m.unknowns, m.total, m.peak_memory_mib, e.frequency,
                e.growth, e.onset, a.frequency, a.growth, a.onset, m.seconds.get("estimate", np.nan), s.knob, s.units,
                *self.reference.lost,
            ))  # fmt: skip
        return pd.DataFrame(rows, columns=list(COLUMNS))

    def stages(self) -> pd.DataFrame:
        """Return a row per setting with the seconds of every stage, as in accuracy_stages.csv."""
        import pandas as pd

        left_out = ("refinement", "knob", "estimated", "adapted", "geometry", "units")
        plain = [{k: v for k, v in asdict(s).items() if k not in left_out} for s in self.settings]
        rows = zip(plain, self.measurements, strict=True)
        return pd.DataFrame([{**setting, **m.seconds} for setting, m in rows])

    def _algebraic(self, setting: Setting, measured: Measurement) -> Errors:
        """Return the errors of a setting against the best solution on the same mesh; NaN for this solution itself."""
        same = [
            (s, m) for s, m in zip(self.settings, self.measurements, strict=True)
            if (s.order, s.size) == (setting.order, setting.size) and s.method != "modal"
        ]  # fmt: skip
        best = min(same, key=lambda p: (p[0].method != "direct", p[0].tolerance), default=None)
        if best is None or best[1] is measured:
            return Errors()
        return along(errors_of(measured, as_reference(best[1])), measured, best[1])


def run_study(
    scene: Scene,
    store: MeasurementStore,
    budget: float | None = None,
    settings: list[Setting] | None = None,
    progress: Callable[[int, int, str, bool], None] = lambda done, total, text, stays: None,
    exact: np.ndarray | None = None,
) -> Study:
    """Run the settings of a study, in the order of `by_information`, and meshes that go where the error is.

    The scene's own mesh with elements of the higher order is adapted to its error, and the mesh that comes from it once
    more; an adapted mesh is measured next.
    A setting whose measurement is in the store already is not solved again. A setting that fails is left out.

    Parameters
    ----------
    scene : Scene
    store : MeasurementStore
        Where each measurement is kept as soon as it is made.
    budget : float, s, optional
        Time that the study may take. Settings that are not expected to fit into the rest of it are left out.
    settings : list of Setting, optional
        The settings to run; without them those of `plan(scene)`.
    progress : callable of (int, int, str, bool)
        Gets the number of settings done so far, the number of all, a sentence, and whether this sentence is to stay on
        the screen: the forecast and what is left out are to stay, what runs next is replaced by the next sentence.
    exact : (f,) float, Hz, optional
        The lowest frequencies where they are known exactly, ascending: errors are then relative to these.

    Raises
    ------
    MeshError
        The scene's mesh cannot be read or made.
    NotConvergedError
        No setting could be measured within the budget.
    KeyboardInterrupt
        Ctrl-C; its argument is the `Study` so far, or None if nothing was measured.
    """
    start = time.perf_counter()
    forecast = forecast_of(scene)
    every = by_information(settings or plan(scene), forecast)
    done: list[tuple[Setting, Measurement]] = []
    left_out: list[tuple[Setting, str]] = []
    of_scene = key_of(scene)
    probes = store.load_probes(of_scene)
    progress(0, len(every), _announced(every, forecast, budget), True)

    def leave_out(setting: Setting, why: str) -> None:
        left_out.append((setting, why))
        progress(len(done), len(every), f"left out: {setting}: {why}", True)

    stopped = False
    try:
        for place, setting in enumerate(every, 1):
            key = setting.key(of_scene)
            kept = store.load(key) if probes is not None else None
            # Without the estimate that is asked for, it is that of a setting alike in all else, such as a tolerance.
            if kept is not None and ("estimate" in kept.seconds or not setting.estimated):
                done.append((setting, kept))
                every[place:place] = _adapted(setting, kept, forecast)
                continue
            rest = None if budget is None else budget - (time.perf_counter() - start)
            expected = forecast.seconds(setting, [(s, _spent(m)) for s, m in done])
            if rest is not None and (rest <= 0 or expected > rest):
                leave_out(setting, f"it would take about {expected:.0f} s" if rest > 0 else "the budget is spent")
                continue
            unknowns = forecast.unknowns(setting)
            mib = forecast.memory(setting, [(s, m.peak_memory_mib) for s, m in done])
            told = f"{setting}: about {unknowns} unknowns, {expected:.0f} s, {mib:.0f} MiB"
            progress(len(done), len(every), told, False)
            try:
                found = measure_apart(scene, setting, probes, setting.estimated, rest)
            except SquealError as error:
                leave_out(setting, str(error))
                continue
            if found is None:
                leave_out(setting, "the budget ran out")
                continue
            measured, probes = found
            store.save_probes(of_scene, probes)
            store.save(key, measured)
            done.append((setting, measured))
            every[place:place] = _adapted(setting, measured, forecast)
    except KeyboardInterrupt as stop:
        stopped = True
        known = [s for s, _ in (*done, *left_out)]
        left_out += [(s, "interrupted") for s in every if s not in known]
        if not done:
            raise KeyboardInterrupt(None) from stop
    progress(len(done), len(every), f"{len(done)} of {len(every)} measured", False)
    fine = [(s, m) for s, m in done if len(m.likely)] or [(s, m) for s, m in done if s.method != "modal"]
    if not fine:
        reasons = "; ".join(f"{s}: {why}" for s, why in left_out[:3])
        raise NotConvergedError(f"nothing could be measured ({reasons})")
    finest, best = max(fine, key=lambda p: p[1].unknowns)
    reference = reference_of(best)
    if exact is not None:
        reference = with_exact(reference, exact)
    solved, measurements = zip(*done, strict=True)
    study = Study(solved, measurements, reference, finest, tuple(left_out), exact is not None)
    if stopped:
        raise KeyboardInterrupt(study)
    return study


def _adapted(setting: Setting, measured: Measurement, forecast: Forecast) -> list[Setting]:
    """Return the setting whose mesh is adapted to the error of a measured one, or none."""
    own = setting.knob == "adapted" or (setting.knob == "size" and np.isclose(setting.size, forecast.size))
    if not (measured.finer and own and setting.estimated) or setting.adapted >= _ADAPTED:
        return []
    now, then = (replace(setting, geometry=g) for g in (setting.geometry, measured.finer))
    finer = forecast.unknowns(then) / forecast.unknowns(now)
    # The last one is not estimated: it would cost most, and no mesh is made from it.
    last = setting.adapted + 1 == _ADAPTED
    return [
        replace(
            then, size=setting.size / finer ** (1 / 3), knob="adapted", adapted=setting.adapted + 1, estimated=not last
        )
    ]


def _spent(measured: Measurement) -> float:
    """Return the seconds of a measurement, with its estimate."""
    return measured.total + measured.seconds.get("estimate", 0.0)


def _announced(settings: list[Setting], forecast: Forecast, budget: float | None) -> str:
    """Return the first line of a study: its settings, the most unknowns and MiB that one takes, and seconds in all."""
    largest, mib = max(forecast.unknowns(s) for s in settings), max(forecast.memory(s) for s in settings)
    whole = sum(forecast.seconds(s, []) for s in settings)
    bounded = "" if budget is None else f", of which {budget:g} s may be spent (--budget)"
    most = f"up to about {largest} unknowns and {mib:.0f} MiB"
    return f"{len(settings)} settings, {most}: some {whole:.0f} s in all{bounded}"
