"""A sweep over one parameter: modes at every value, followed into branches, with the onsets between them.

`fe_squeal.sweep` is the name of the function and of this folder. So that it always means the function, `fe_squeal`
imports this file at once; to keep that quick, solvers are imported inside the function.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from numbers import Integral, Real
from typing import TYPE_CHECKING

import numpy as np

from ..errors import NotConvergedError, SceneError, SceneWarning, TooLargeError
from ..problem.parameters import MU, parameter_name, paths_of

if TYPE_CHECKING:
    from ..eigen.linear.factor import LinearSolver
    from ..problem.problem import Problem
    from .onset import Onset
    from .result import Sweep
    from .running import RunningSweep
    from .state import Store

METHODS = "auto", "direct", "reduced", "modal"
MODES = 20  # number of modes, if neither a number nor a highest frequency is given


def sweep(
    problem: Problem,
    values: Sequence[float] | np.ndarray,
    parameter: str = "mu",
    modes: int | None = None,
    max_frequency: float | None = None,
    tolerance: float = 1e-8,
    keep_shapes: bool = False,
    method: str = "auto",
    precise: bool = False,
    progress: Callable[[int, int], None] = lambda done, total: None,
    store: Store | None = None,
    linear_solver: LinearSolver | str = "auto",
) -> Sweep:
    """Solve for the complex modes at every value of a parameter, follow them, and find the onsets of instability.

    The modes satisfy (λ²M + λC + K)u = 0 with λ in rad/s, where M, C and K depend on the parameter; a mode is unstable
    where Re λ > 0.

    Parameters
    ----------
    problem : Problem
        From `assemble`.
    values : (m,) float
        Values of the parameter, ascending, in its unit.
    parameter : str
        "mu" (friction coefficient), or the path of another number in the scene, such as "springs.along.stiffness". A
        problem without friction has one value of "mu", whichever.
    modes : int, optional
        Number of modes, those of the lowest frequencies (default 20).
    max_frequency : float, Hz, optional
        All modes up to this frequency, instead of a number of modes.
    tolerance : float
        For the backward error of every mode, relative.
    keep_shapes : bool
        Whether to keep the shapes of all modes at the last value; those of unstable modes are kept at every value.
    method : "auto", "direct", "reduced" or "modal"
        "direct" solves the problem itself at every value; "reduced" solves a reduced model that meets the tolerance
        over the whole sweep; "modal" projects on the modes without friction and damping, whatever error this makes.
        "auto" is "reduced" where that is faster, else "direct".
    precise : bool
        Whether to refine onsets on the problem itself, with a few factorisations each, even if the reduced model gives
        them to 1e-7 of their value.
    progress : callable of (int, int)
        Gets the number of values done, and of all values.
    store : Store, optional
        Keeps every finished value. If it has some already, the sweep continues after them.
    linear_solver : "auto", "pardiso", "superlu", "mumps" or LinearSolver
        What factorises sparse matrices, see `fe_squeal.eigen.linear`; "auto" is PARDISO if it can be loaded, else
        SuperLU. Static states under preload that the sweep solves anew use it too.

    Returns
    -------
    Sweep

    Raises
    ------
    SceneError
        The values are empty, not finite, not ascending, or not allowed by the scene; the problem does not have the
        parameter; there is no static state at the first value; the linear solver is not installed; or modes, frequency,
        tolerance or method are not what is described above.
    NotConvergedError
        Modes were not found at some value; `partial` is the sweep so far (None if no value was finished).
    TooLargeError
        The problem does not fit into memory.
    KeyboardInterrupt
        Ctrl-C; its argument is the sweep so far (None if no value was finished).

    Examples
    --------
    Two masses on springs, coupled by friction. Their θ = 1.5 ± √(1/4 − μ²) meet at μ = 0.5.

    >>> import scipy.sparse as sp
    >>> from fe_squeal.problem.problem import Problem
    >>> from fe_squeal.problem.terms import Term
    >>> terms = (
    ...     Term("inertia", "M", sp.eye_array(2, format="csr"), symmetric=True),
    ...     Term("springs", "K", sp.csr_array([[1.0, 0.0], [0.0, 2.0]]), symmetric=True),
    ...     Term("friction", "K", sp.csr_array([[0.0, 1.0], [-1.0, 0.0]]), symmetric=False, powers={"mu": 1}),
    ... )
    >>> result = sweep(Problem(terms, {"mu": 0.0}), [0.0, 0.4, 0.8], modes=2)
    >>> [(o.kind, round(o.value, 6)) for o in result.onsets]
    [('flutter', 0.5)]
    >>> result.points[-1].modes.lam.round(4)
    array([ 0.2498+1.25j, -0.2498+1.25j])
    """
    from ..eigen.linear.choice import choose
    from ..eigen.request import Request
    from ..problem.terms import check_terms
    from .running import RunningSweep
    from .warnings import flat_warnings

    _check_request(modes, max_frequency, tolerance, method)
    parameter = parameter_name(parameter)
    values, solver = checked_values(problem, parameter, values), choose(linear_solver)
    if not problem.has(parameter):  # one value of mu where there is no friction
        problem = replace(problem, parameters={**problem.parameters, parameter: float(values[0])})
    if problem.source is None:
        check_terms(problem.terms, problem.parameters)
    problem = problem.solved_with(solver).prepared(parameter, values)
    request = Request(None if max_frequency else MODES if modes is None else modes, max_frequency, tolerance)
    tracker = RunningSweep(problem, parameter, request, values, precise, solver)
    known = None if store is None else store.load()
    if known is None:
        tracker.told.add(*flat_warnings(problem, parameter, values))
    try:
        tracker.reduce(values, method, store, known)
        if known is not None:
            tracker.restore(known)
            progress(sum(not p.between for p in known.points), len(values))
        _advance(tracker, values, keep_shapes, progress, store)
        if store is not None:
            store.flush()
        return tracker.result()
    except KeyboardInterrupt as stop:
        if store is not None:
            store.flush()
        raise KeyboardInterrupt(tracker.result() if tracker.points else None) from stop


def _advance(
    tracker: RunningSweep, values: np.ndarray, keep_shapes: bool, progress: Callable[[int, int], None],
    store: Store | None,
) -> None:  # fmt: skip
    """Solve at the values (m,) that are left."""
    from ..eigen.threads import one_openblas_thread

    for i, value in enumerate(values):
        if i < sum(not p.between for p in tracker.points):
            continue
        try:
            with one_openblas_thread():
                tracker.advance(float(value), keep_all=keep_shapes and i == len(values) - 1)
            if store is not None:
                store.save(tracker.state())
            progress(i + 1, len(values))
        except (NotConvergedError, SceneError) as error:
            if store is not None:
                store.flush()
            # A scene may not have a solution from some value on (a contact opens): the sweep ends and keeps what it
            # has.
            text = f"{tracker.parameter} = {value:g}: {error}"
            if isinstance(error, SceneError) and not tracker.points:
                raise SceneError(text) from error
            raise NotConvergedError(text, partial=tracker.result() if tracker.points else None) from error
        except (TooLargeError, MemoryError):
            if store is not None:
                store.flush()
            raise


def find_onsets(
    problem: Problem,
    values: Sequence[float] | np.ndarray,
    parameter: str = "mu",
    modes: int | None = None,
    max_frequency: float | None = None,
    tolerance: float = 1e-8,
    method: str = "auto",
    linear_solver: LinearSolver | str = "auto",
) -> tuple[Onset, ...]:
    """Return the critical values of a parameter between the first and the last of the given values, to full precision.

    Parameters
    ----------
    problem : Problem
        From `assemble`.
    values : (m,) float
        Values of the parameter, ascending, at which modes are solved for; critical values are found between them.
    parameter : str
        "mu" (friction coefficient), or the path of another number in the scene.
    modes, max_frequency, tolerance, method, linear_solver
        As for `sweep`.

    Returns
    -------
    tuple of Onset
        Ascending. What could not be decided of others is a `SceneWarning` each; `sweep` has it in its result.

    Raises
    ------
    SceneError, NotConvergedError, TooLargeError
        As `sweep`.
    """
    found = sweep(problem, values, parameter, modes, max_frequency, tolerance, method=method, precise=True,
                  linear_solver=linear_solver)  # fmt: skip
    for text in found.unsettled:
        warnings.warn(text, SceneWarning, stacklevel=2)
    return found.onsets


def _check_request(modes: int | None, max_frequency: float | None, tolerance: float, method: str) -> None:
    """Raise SceneError where a caller from Python asks for something that there is not; scenes are checked before."""
    if modes is not None and not (isinstance(modes, Integral) and modes > 0):
        raise SceneError(f"modes: given {modes!r}; expected a whole number above 0")
    if modes is not None and max_frequency is not None:
        raise SceneError("sweep: given modes and max_frequency; expected one of them")
    if max_frequency is not None and not (isinstance(max_frequency, Real) and 0 < max_frequency < np.inf):
        raise SceneError(f"max_frequency: given {max_frequency!r}; expected a frequency in Hz above 0")
    if not (isinstance(tolerance, Real) and 0 < tolerance < 1):
        raise SceneError(f"tolerance: given {tolerance!r}; expected a relative backward error between 0 and 1")
    if method not in METHODS:
        raise SceneError(f"method: given {method!r}; expected {', '.join(METHODS[:-1])} or {METHODS[-1]}")


def checked_values(problem: Problem, parameter: str, values: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return the values of a sweep as an array (m,) float, in the unit of the parameter.

    Raises
    ------
    SceneError
        They are empty, not finite, not ascending, or not allowed by the scene, or the problem has no such parameter.
    """
    given = np.asarray(list(values) if isinstance(values, Iterator | range) else values)
    if given.dtype.kind not in "fiub":
        raise SceneError(f"sweep: given the values {values!r:.60}; expected real numbers that increase")
    grid = np.atleast_1d(given.astype(float))
    if grid.ndim != 1 or not len(grid) or not np.isfinite(grid).all() or (np.diff(grid) <= 0).any():
        raise SceneError(f"sweep: given the values {values}; expected finite numbers that increase, at least one")
    if grid[0] <= 0 <= grid[-1]:
        for path in paths_of(parameter):
            if pole := next((t.name for t in problem.terms if t.powers.get(path, 0) < 0), None):
                raise SceneError(
                    f"sweep: given {path} from {grid[0]:g} to {grid[-1]:g}, of which {pole} has a negative power;"
                    " expected values that are all above 0 or all below"
                )
    if len(grid) > 1 or parameter != MU:  # a scene without friction has no mu, and needs none for one value
        for path in paths_of(parameter):
            problem.value(path)  # raises SceneError if the problem does not have it
    if problem.source is not None:
        # Of what multiplies terms, with 0 a term is not there, whatever the scene says, and between the ends is what
        # the ends allow. Of anything else any value may be one that the scene does not allow.
        inside = set() if len(grid) == 1 else set(grid.tolist())
        asked = {float(grid[0]), float(grid[-1])} - {0.0} if problem.is_affine(parameter) else inside
        for value in sorted(asked):
            problem.source.check(dict.fromkeys(paths_of(parameter), value))
    return grid
