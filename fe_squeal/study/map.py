"""A map of stability over two parameters: modes on a grid of places, and the boundaries of stability between them."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from ..eigen.dense import DENSE_LIMIT, solve_dense
from ..eigen.pencil import FreeMotions, Modes
from ..eigen.request import select_wanted
from ..errors import SceneError
from ..problem.problem import Problem
from ..scene.faults import validated
from ..scene.study import Axis, StudySection
from .boundary import Scaled
from .curves import Curve, follow
from .islands import islands
from .models import DirectModel, Solver
from .points import sobol_points
from .seeds import Seed, seeds_on_lines
from .solving import TRAINED, Options, Solving, check_together, check_value

if TYPE_CHECKING:
    import pandas as pd

_SEED = 7  # of the points for which the reduced model is made
_COLUMNS_AT = 6  # lines of the grid along its second axis on which onsets are looked for; along the first axis all are


@dataclass(frozen=True)
class StabilityMap:
    """Result of a map.

    Attributes
    ----------
    axes : (Scaled, Scaled)
        The two axes.
    places : (m, 2) float
        Values of both parameters at the places of the grid, row by row: the first one changes fastest.
    rows : (m, columns) float
        What is kept of the modes at each place, see `Outcome.row`.
    curves : list of Curve
        The boundaries of stability.
    errors : list of (k,) float
        Uncertainty of the points of each curve, including that of the reduced model, as a part of the map's width.
    told : list of str
        Sentences on boundaries that could not be followed to their end.
    solver : Solver
        How the modes were solved for.
    """

    axes: tuple[Scaled, Scaled]
    places: np.ndarray
    rows: np.ndarray
    curves: list[Curve]
    errors: list[np.ndarray]
    told: list[str]
    solver: Solver = field(repr=False)

    @property
    def grid(self) -> pd.DataFrame:
        """A table with a row per place of the grid and the columns of map.csv."""
        import pandas as pd

        frame = pd.DataFrame(self.places, columns=["x", "y"])
        for name, at in (("unstable", 0), ("worst_re", 1), ("worst_frequency_hz", 2), ("error", 5)):
            frame[name] = self.rows[:, at]
        frame["unstable"] = frame["unstable"].astype(int)
        return frame

    @property
    def boundaries(self) -> pd.DataFrame:
        """A table with a row per point of each boundary, in order, and the columns of boundaries.csv.

        `x` and `y` are the values of the two parameters. `uncertainty` is how far the boundary may be from the point,
        as a part of the map's width.
        """
        import pandas as pd

        rows = []
        for number, (curve, errors) in enumerate(zip(self.curves, self.errors, strict=True), 1):
            kind = "divergence" if curve.boundary.kind == "divergence" else "flutter"
            for point, error in zip(curve.points, errors, strict=True):
                hz = curve.boundary.eigenvalue(point.u).imag / (2 * np.pi)
                rows.append((number, *curve.boundary.place(point.u), hz, kind, error))
        return pd.DataFrame(rows, columns=["curve", "x", "y", "frequency_hz", "kind", "uncertainty"])


def stability_map(
    problem: Problem,
    x: Axis | Mapping[str, Any],
    y: Axis | Mapping[str, Any],
    **options: Unpack[Options],
) -> StabilityMap:
    """Solve for the modes on a grid of two parameters, and follow the boundaries of stability between its places.

    A boundary is followed by continuation on a reduced model (see `Boundary` for its equations), and is not
    interpolated from the grid.

    Parameters
    ----------
    problem : Problem
        From `assemble`.
    x, y : mapping
        The two axes, as `[study.x]` and `[study.y]` of a scene: {"parameter": "mu", "from": 0.0, "to": 0.7, "points":
        29}, with "scale": "log" for a logarithmic one.
    **options
        modes, max_frequency, tolerance, workers, scheduler, linear_solver, method, scene, parts and progress, see
        `fe_squeal.study.solving.Options`.

    Returns
    -------
    StabilityMap

    Raises
    ------
    SceneError
        An axis is wrong or has values that the scene does not allow, alone or at a corner with those of the other, both
        have the same parameter, the problem does not have it, or nothing depends on it.
    NotConvergedError
        A direct solve failed, or the scheduler is gone.

    Examples
    --------
    >>> import scipy.sparse as sp
    >>> from fe_squeal.problem.terms import Term
    >>> M, K, G, F = (np.eye(2), np.eye(2), np.diag([0.0, 1.0]), np.array([[0, 1.0], [-1, 0]]))
    >>> parts = ("m", "M", M, {}), ("k", "K", K, {}), ("gap", "K", G, {"delta": 1}), ("f", "K", F, {"mu": 1})
    >>> terms = tuple(Term(n, slot, sp.csr_array(A), n != "f", powers) for n, slot, A, powers in parts)
    >>> problem = Problem(terms, {"delta": 0.1, "mu": 0.1})
    >>> axes = ({"parameter": p, "from": 0.01, "to": 0.4, "points": 5} for p in ("mu", "delta"))
    >>> found = stability_map(problem, *axes, modes=2).boundaries  # flutter where delta < 2 mu
    >>> bool(abs(found["y"] - 2 * found["x"]).max() < 1e-12)
    True
    """
    for key, axis in (("x", x), ("y", y)):
        if not isinstance(axis, Axis | Mapping):
            example = '{"parameter": "mu", "from": 0.0, "to": 0.7, "points": 29}'
            raise SceneError(f"stability_map: {key}: given {axis!r:.60}; expected an axis, as {example}")
    tables = [a if isinstance(a, Axis) else validated(Axis, dict(a), key) for key, a in (("x", x), ("y", y))]
    validated(StudySection, dict(zip("xy", tables, strict=True)), "stability_map")  # both together
    for key, table in zip("xy", tables, strict=True):
        for value in (table.start, table.stop):
            try:
                check_value(problem, table.parameter, value, options.get("scene"))
            except SceneError as error:
                raise SceneError(f"stability_map: {key}: {error}") from error
    first, second = (Scaled(a.parameter, a.start, a.stop, a.scale == "log") for a in tables)
    axes, grids = (first, second), (tables[0].grid, tables[1].grid)
    names = (first.name, second.name)
    places = np.stack(np.meshgrid(*grids), axis=-1).reshape(-1, 2)
    if (scene := options.get("scene")) is not None:
        row = len(grids[0])
        try:
            check_together(scene, names, places[[0, row - 1, -row, -1]])
        except SceneError as error:
            raise SceneError(f"stability_map: a corner has numbers that do not fit together: {error}") from error

    def draw(i: int) -> np.ndarray:
        u = sobol_points(TRAINED, 2, _SEED + i)
        return np.array([[a.value(float(s)) for a, s in zip(axes, point, strict=True)] for point in u])

    low, high = (np.array([getattr(a, end) for a in axes]) for end in ("low", "high"))
    solving = Solving(problem, names, low, high, draw, **options)
    rows, _ = solving.places("grid", places)
    solver = solving.solver
    told: list[str] = []
    small = _small_problem(problem, names, solver)
    if small is None:
        told.append(f"boundaries are not followed: {solver.why}")
        return StabilityMap(axes, places, rows, [], [], told, solver)
    curves = _boundaries(small, axes, grids, solving, told)
    errors = [_uncertainties(curve, solver) for curve in curves]
    return StabilityMap(axes, places, rows, curves, errors, list(dict.fromkeys(told)), solver)


def _small_problem(problem: Problem, names: tuple[str, ...], solver: Solver) -> Problem | None:
    """Return the problem on which boundaries are followed: the reduced one, or itself if it is small, else None."""
    if solver.box is not None:
        return solver.box.collected
    if not isinstance(solver.model, DirectModel):
        return None
    problem = solver.model.problem  # which has the terms that a parameter brings, where the scene has it at zero
    affine = all(problem.is_affine(n) for n in names)
    return problem if affine and problem.unknowns <= DENSE_LIMIT else None


_CONSERVATIVE = (
    "boundaries of flutter are not followed: with gyroscopic forces, and neither friction nor damping, Re λ is zero"
    " wherever it does not grow"
)


def _is_conservative(problem: Problem) -> bool:
    """Return whether there are gyroscopic terms, and neither friction nor damping: Re λ = 0 wherever it is stable."""
    damping = [t for t in problem.terms if t.slot == "C"]
    others = [t for t in problem.terms if t.slot != "C"]
    return bool(damping) and all(t.skew for t in damping) and all(t.symmetric and not t.imaginary for t in others)


def _boundaries(
    problem: Problem, axes: tuple[Scaled, Scaled], grids: tuple[np.ndarray, np.ndarray], solving: Solving,
    told: list[str],
) -> list[Curve]:  # fmt: skip
    """Follow the boundary through every seed that is not on a boundary found before."""
    curves: list[Curve] = []
    request = solving.request

    def modes_of(own: Problem) -> Callable[[float, float], Modes]:
        @functools.cache  # every search for islands asks at all nodes
        def modes_at(x: float, y: float) -> Modes:
            every = solve_dense(own.pencil({axes[0].name: x, axes[1].name: y}))
            wanted = select_wanted(every, request, np.inf)
            assert wanted is not None
            return wanted.without_shapes()

        return modes_at

    conservative, undamped = _is_conservative(problem), None
    if problem.is_damped:
        plain = tuple(t for t in problem.terms if t.slot != "C" and not t.imaginary)
        undamped = modes_of(Problem(plain, problem.parameters, free=lambda values: FreeMotions.none(problem.unknowns)))
    columns = grids[0][np.unique(np.round(np.linspace(0, len(grids[0]) - 1, _COLUMNS_AT)).astype(int))]
    count, limit = request.count, request.max_frequency_hz
    total = len(grids[1]) + len(columns)
    blind = 0.0 if solving.solver.box is None else request.tolerance

    def on_line(along: int, at: float) -> Iterator[Seed]:
        return seeds_on_lines(problem, axes, grids, along, np.array([at]), count, limit, told.append, blind)

    stages = [
        *(on_line(0, y) for y in grids[1].tolist()),
        *(on_line(1, x) for x in columns.tolist()),
        islands(problem, axes, grids, modes_of(problem), told.append, undamped_at=undamped, blind=blind),
    ]
    solving.tell("boundaries", 0, total)
    for i, stage in enumerate(stages):
        for boundary, point, held in stage:
            if conservative and boundary.kind == "hopf":
                told.append(_CONSERVATIVE)
                continue
            alike = [c for c in curves if c.boundary.kind == boundary.kind]
            if any(c.passes(_rescaled(point.u, boundary, c), held) for c in alike):
                continue
            curve = follow(boundary, point)
            curves.append(curve)
            told += [f"curve {len(curves)}: {end}" for end in curve.ends if end not in ("box", "closed")]
        solving.tell("boundaries", min(i + 1, total), total)
    return curves


def _rescaled(u: np.ndarray, boundary: Any, curve: Curve) -> np.ndarray:
    """Return u of one boundary with θ or ω in the unit of another boundary of the same kind."""
    if boundary.kind == "divergence":
        return u
    return np.append(u[0] * boundary.unit / curve.boundary.unit, u[1:])


def _uncertainties(curve: Curve, solver: Solver) -> np.ndarray:
    """Return the uncertainty (k,) of the points of a curve, as a part of the map's width.

    To Newton's last step and rounding it adds the error of the reduced model, ‖η‖‖ρ‖ / |ψᴴ (∂Q/∂s) φ|, with the
    residuals ρ = Qφ and η = Qᴴψ.
    """
    found = []
    for point in curve.points:
        error = point.uncertainty
        if solver.box is not None:
            place, lam = curve.boundary.place(point.u), curve.boundary.eigenvalue(point.u)
            product = solver.box.residual_product(place, lam, point.residual.right, point.residual.left)
            error += product / max(float(np.hypot(*point.residual.slopes)), np.finfo(float).tiny)
        found.append(error)
    return np.array(found)
