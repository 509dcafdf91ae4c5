"""The same problem in other forms: over the powers of one parameter, or projected on a subspace."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import scipy.sparse as sp

from ..eigen.blocks import projected
from ..eigen.columns import Columns
from ..eigen.pencil import FreeMotions
from ..errors import SceneError
from .parameters import paths_of
from .problem import Problem
from .terms import Slot, Term, sum_terms


def collect_powers(problem: Problem, parameter: str | tuple[str, ...]) -> Problem:
    """Return the same problem over one parameter, or over several, as few terms.

    There is one for each slot, powers of the parameters and symmetry; the other parameters stay at their values.

    Raises
    ------
    SceneError
        If a parameter does more than change coefficients.

    Examples
    --------
    >>> one = sp.eye_array(2, format="csr")
    >>> terms = (Term("m", "M", one, True), Term("k", "K", one, True), Term("spring", "K", one, True, {"s": 1}))
    >>> problem = Problem((*terms, Term("other", "K", one, True, {"s": 1})), {"s": 3.0})
    >>> [(t.name, float(t.matrix[0, 0])) for t in collect_powers(problem, "s").terms]
    [('M0', 1.0), ('K0', 1.0), ('K1', 2.0)]
    """
    several = (parameter,) if isinstance(parameter, str) else parameter
    together = [paths_of(p) for p in several]
    moved = [p for paths in together for p in paths]
    for p in several:
        if not problem.is_affine(p):
            raise SceneError(f"{p} changes matrices, not coefficients alone")
    groups: dict[tuple[Slot, tuple[int, ...], bool, bool], list[tuple[Term, float]]] = {}
    for t in problem.terms:
        others = replace(t, powers={p: e for p, e in t.powers.items() if p not in moved})
        c = others.coefficient(problem.parameters)
        if c:
            powers = tuple(sum(t.powers.get(p, 0) for p in paths) for paths in together)
            key = (t.slot, powers, t.symmetric, t.imaginary)
            groups.setdefault(key, []).append((replace(t, imaginary=False), c))
    terms = []
    for (slot, powers, symmetric, imaginary), parts in groups.items():
        matrix = sum_terms(parts)
        assert matrix is not None
        skew = all(t.skew for t, _ in parts)
        name = f"{slot}{'.'.join(map(str, powers))}" + ("" if symmetric else "n") + ("i" if imaginary else "")
        exponents = {paths[0]: e for paths, e in zip(together, powers, strict=True)}
        terms.append(Term(name, slot, matrix, symmetric, exponents, skew, imaginary))
    at = {p: problem.value(q) for q in several for p in paths_of(q)}
    own, none = problem.parameters, FreeMotions.none(problem.unknowns)
    if problem.is_held(moved):  # then the terms that were summed are not needed any more
        return Problem(tuple(terms), at, free=lambda _: none)

    def free(values: Mapping[str, float]) -> FreeMotions:
        return replace(problem, parameters={**own, **{p: values[p] for p in moved}}).free_motions()

    return Problem(tuple(terms), at, free=free)


def is_linear(problem: Problem, parameter: str) -> bool:
    """Return whether K and M are linear in a parameter."""
    swept = paths_of(parameter)
    return problem.is_affine(parameter) and all(
        t.only is None and sum(t.powers.get(path, 0) for path in swept) in (0, 1)
        for t in problem.terms if t.slot in ("K", "M")
    )  # fmt: skip


def project(problem: Problem, V: Columns) -> Problem:
    """Return the Galerkin projection of every term on the columns of a real V (n, r): terms VᵀAV of size r.

    It takes every motion as held. The caller replaces `free` where combinations of V are free: entries of the projected
    matrices are too small to tell that from rounding.
    """
    none = FreeMotions.none(V.shape[1])
    terms = []
    for t in problem.terms:
        sign = 1 if t.symmetric else -1 if t.skew else 0
        terms.append(replace(t, matrix=sp.csr_array(projected(V, t.matrix, sign))))
    return Problem(tuple(terms), problem.parameters, free=lambda _: none)
