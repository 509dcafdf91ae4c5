"""Scatter: how probable instability is if several numbers of a scene are known only by their distributions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Unpack

import numpy as np

from ..errors import SceneError
from ..problem.problem import Problem
from ..scene import Scene
from ..scene.faults import validated
from ..scene.study import Distribution, StudySection
from .outcome import COLUMNS, MODE_COLUMNS
from .points import Scatter, sobol_points
from .scatter_result import OWN_COLUMNS, ScatterResult
from .solving import TRAINED, Options, Solving, check_together, check_value

SAMPLES = 1000  # samples, if their number is not given
_SEEDS = 1_000_003  # difference between the seeds of points for different purposes


def scatter(
    problem: Problem,
    parameters: Mapping[str, Distribution | Mapping[str, Any]],
    samples: int = SAMPLES,
    seed: int = 0,
    correlation: Sequence[tuple[str, str, float]] = (),
    bands: Sequence[float] | None = None,
    indices: bool = True,
    **options: Unpack[Options],
) -> ScatterResult:
    """Solve for the modes at many points of scattered parameters: how probable is instability, and what drives it?

    Parameters
    ----------
    problem : Problem
        From `assemble`.
    parameters : mapping of str to mapping
        The distribution of each parameter, as the tables of `[study.parameters]` in a scene:
        {"mu": {"normal": {"mean": 0.4, "deviation": 0.06}}}.
    samples : int
        Number of samples, which are scrambled Sobol points.
    seed : int
        Seed of the scrambling.
    correlation : sequence of (str, str, float)
        Pairs of parameters with their correlation coefficient: that of the numbers themselves if they are normal, of
        their logarithms if they are lognormal.
    bands : sequence of float, Hz, optional
        Edges of the bands of frequency; by default octaves that cover all unstable modes.
    indices : bool
        Whether to solve as many samples again for total Sobol indices; it is not done if every sample has to be solved
        directly.
    **options
        modes, max_frequency, tolerance, workers, scheduler, linear_solver, method, scene, parts and progress, see
        `fe_squeal.study.solving.Options`.

    Returns
    -------
    ScatterResult

    Raises
    ------
    SceneError
        The problem does not have a parameter, nothing depends on it, its distribution reaches values that the scene
        does not allow, or it is named like a column of samples.csv that is there anyway.
    NotConvergedError
        A direct solve failed, or the scheduler is gone.

    Examples
    --------
    >>> import scipy.sparse as sp
    >>> from fe_squeal.problem.terms import Term
    >>> M, K, F = (sp.csr_array(np.array(a)) for a in (np.eye(2), np.diag([1.0, 1.2]), [[0, 1.0], [-1, 0]]))
    >>> terms = (Term("m", "M", M, True), Term("k", "K", K, True), Term("f", "K", F, False, {"mu": 1}))
    >>> problem = Problem(terms, {"mu": 0.1})
    >>> result = scatter(problem, {"mu": {"uniform": {"low": 0.0, "high": 0.4}}}, samples=64)
    >>> result.probability  # unstable where 2 mu > 0.2
    0.75
    """
    if not parameters or samples < 8:
        raise SceneError(f"scatter: given {len(parameters)} parameters, {samples} samples; expected at least 1 and 8")
    for name, table in parameters.items():
        if not isinstance(table, Distribution | Mapping):
            example = '{"normal": {"mean": 0.4, "deviation": 0.06}}'
            raise SceneError(f"scatter: {name}: given {table!r:.60}; expected a distribution, as {example}")
    tables = {
        name: table if isinstance(table, Distribution) else validated(Distribution, dict(table), name)
        for name, table in parameters.items()
    }
    bands = None if bands is None else np.asarray(bands, float).tolist()
    table = {"parameters": tables, "correlation": [list(c) for c in correlation], "bands": bands}
    section = validated(StudySection, table | {"samples": int(samples), "seed": int(seed)}, "scatter")
    whole = Scatter.of(section.parameters, section.correlation)
    names, d = whole.names, len(whole.names)
    for name in names:
        if name in OWN_COLUMNS:
            raise SceneError(
                f'study.parameters: given "{name}", which samples.csv has a column of its own for; expected another'
            )
    z = whole.normals(sobol_points(samples, d, seed))
    points = whole.values(z)
    q = min(samples, max(samples // d, 64)) if indices else 0
    # Independent of the samples, as other Sobol points would not be.
    again = np.random.default_rng([seed, _SEEDS]).random((q, d))
    redrawn = np.stack([whole.values(whole.redrawn(z[:q], i, again[:, i])) for i in range(d)])
    places = np.vstack([points, *redrawn])
    _check_values(problem, names, places, options.get("scene"))
    if (scene := options.get("scene")) is not None:
        try:
            check_together(scene, names, places)
        except SceneError as error:
            raise SceneError(
                f"study.parameters: a sample has numbers that do not fit together: {error}: cut their distributions"
                " off by low and high"
            ) from error
    low, high = places.min(axis=0), places.max(axis=0)

    def draw(i: int) -> np.ndarray:
        return np.clip(whole.values(whole.normals(sobol_points(TRAINED, d, seed + _SEEDS * (i + 1)))), low, high)

    solving = Solving(problem, names, low, high, draw, **options)
    rows, found = solving.places("samples", points)
    cheap = solving.solver.box is not None or problem.unknowns <= 100
    more = [solving.places(f"indices {i + 1}", new) for i, new in enumerate(redrawn)] if q and cheap else []
    columns = rows.shape[1]
    edges = _edges(bands, found, float(rows[:, COLUMNS.index("known_hz")].min(initial=np.inf)))
    return ScatterResult(
        names, points, rows, found, edges, np.array([r for r, _ in more]).reshape(d, -1, columns),
        [m for _, m in more] or [np.zeros((0, 1 + len(MODE_COLUMNS)))] * d, solving.solver,
    )  # fmt: skip


def _edges(bands: Sequence[float] | None, modes: np.ndarray, known: float) -> np.ndarray:
    """Return the edges (b + 1,) of the bands, Hz: those given, or 0 and octaves about 1 kHz.

    These go as far as all modes of every sample are `known`, Hz, and cover all unstable modes; what is below the octave
    of the lowest of these is one band.
    """
    if bands is not None:
        return np.asarray(bands, float)
    hz = modes[:, 1]
    if not len(hz) and not np.isfinite(known):
        return np.array([0.0, 1000.0, 2000.0])
    top = max(float(hz.max(initial=62.5)), 62.5) / 1000.0
    whole = np.floor(np.log2(known / 1000.0)) if np.isfinite(known) and known > 0 else -np.inf
    high = max(np.floor(np.log2(top)) + 1, whole) if len(hz) else max(whole, -4.0)
    low = np.floor(np.log2(max(float(hz.min()), 62.5) / 1000.0)) if len(hz) else high - 1
    return np.concatenate([[0.0], 1000.0 * 2.0 ** np.arange(low, high + 1)])


def _check_values(
    problem: Problem, names: Sequence[str], points: np.ndarray, scene: Scene | None
) -> None:
    """Refuse a distribution that leaves what is allowed, at its least and its largest value (m, d).

    Raises
    ------
    SceneError
        A distribution reaches a value that the scene does not allow.
    """
    for i, name in enumerate(names):
        for value in (float(points[:, i].min()), float(points[:, i].max())):
            try:
                check_value(problem, name, value, scene)
                if scene is None:
                    problem.at({name: value}) if problem.has(name) else problem.value(name)
            except SceneError as error:
                expected = str(error).rpartition("expected ")[2]  # what the message about the value itself ends with
                raise SceneError(
                    f"study.parameters: the distribution of {name} reaches {value:.6g}; expected {expected}: cut it off"
                    " by low and high"
                ) from error
