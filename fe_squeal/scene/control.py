"""What is asked for: the sweep, the number of modes, the output."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from ..eigen.linear.choice import SolverName
from ..errors import SceneError
from ..problem.parameters import MU, parameter_name
from ..schema.section import Positive, Section, Text


def checked_name(text: str) -> str:
    """Return the name of a parameter as it is known.

    Raises
    ------
    ValueError
        Where `parameter_name` raises SceneError, which validators do not pass on.
    """
    try:
        return parameter_name(text)
    except SceneError as error:
        raise ValueError(str(error)) from error


def joined_paths(value: object) -> str:
    """Return a path or a list of paths as one name, with "mu" short for effects.friction.mu.

    Raises
    ------
    ValueError
        It is neither, or as `checked_name`.
    """
    paths = [p for p in (value if isinstance(value, list) else [value]) if isinstance(p, str) and p.strip()]
    if not paths or (isinstance(value, list) and len(paths) < len(value)):
        raise ValueError('expected "mu", the path of a number such as "springs.NAME.damping", or a list of paths')
    return checked_name(", ".join(paths))


class SweepSection(Section):
    """Values of the parameter that the sweep takes: `from`, `to` and `points`, or `values`.

    Attributes
    ----------
    parameter : str
        "mu", short for effects.friction.mu, or the dotted path of any other number of the scene, such as
        "contacts.NAME.normal_stiffness", "springs.NAME.damping" or "materials.NAME.youngs_modulus"; a list of paths
        moves several together.
    from : float
        First value.
    to : float
        Last value.
    points : int
        Number of values, equally spaced from the first to the last.
    values : list of float
        The values themselves, increasing.
    """

    parameter: str = MU
    start: float | None = Field(default=None, alias="from")
    stop: float | None = Field(default=None, alias="to")
    points: Annotated[int, Field(ge=1, le=100_000)] | None = None
    values: Annotated[list[float], Field(min_length=1, max_length=100_000)] | None = None

    @field_validator("parameter", mode="before")
    @classmethod
    def _paths(cls, value: object) -> str:
        return joined_paths(value)

    @field_validator("values")
    @classmethod
    def _increasing(cls, value: list[float] | None) -> list[float] | None:
        for a, b in pairwise(value or ()):
            if a >= b:
                raise ValueError(f"expected values that increase; {b:g} comes after {a:g}")
        return value

    @model_validator(mode="after")
    def _one_range(self) -> SweepSection:
        ranged = {"from": self.start, "to": self.stop, "points": self.points, "values": self.values}
        given = [key for key, value in ranged.items() if value is not None]
        if given not in (["from", "to", "points"], ["values"]):
            raise ValueError(f"given {', '.join(given) or 'nothing'}; expected from, to and points, or values = [...]")
        if self.values is None and not (np.diff(self.grid) > 0).all():
            raise ValueError(f"given from = {self.start:g}, to = {self.stop:g}; expected from < to")
        if self.values is None and self.points == 1 and self.start != self.stop:
            raise ValueError("given points = 1; expected at least 2 from one value to another (one: values = [...])")
        return self

    @property
    def grid(self) -> np.ndarray:
        """(m,) float: the values, increasing."""
        if self.values is not None:
            return np.array(self.values)
        assert self.start is not None and self.stop is not None and self.points is not None
        return np.linspace(self.start, self.stop, self.points)


class MumpsTable(Section):
    """How MUMPS keeps its factors, where `linear_solver` is "mumps", or "auto" on several processes.

    Eigenvalues and shapes have the same backward errors whichever of these are given, or the run ends with a message.

    Attributes
    ----------
    out_of_core : bool
        Whether factors are written to files, read again at every solve, and removed at the end.
    folder : str
        Folder for these files, relative to the scene file; a fast disk with room for the factors, on every machine
        (default: the system's for temporary files).
    low_rank : float
        Blocks of the factors are compressed by what is smaller than this, relative to the matrix's entries once it is
        scaled; solves are refined until they are as exact as without. Factors that are too rough for that end the run:
        1e-10 is rarely too rough (default: no compression).
    memory_relaxation : int
        Percent of workspace beyond what MUMPS' analysis expects (default: MUMPS' own, 20 to 35, and where pivoting
        takes more than that 50, then 200).
    """

    out_of_core: bool = False
    folder: Text | None = None
    low_rank: Annotated[float, Field(gt=0, lt=1)] | None = None
    memory_relaxation: Annotated[int, Field(ge=0, le=1000)] | None = None

    @model_validator(mode="after")
    def _folder_for_files(self) -> MumpsTable:
        if self.folder is not None and not self.out_of_core:
            raise ValueError("given folder, but factors stay in memory; expected out_of_core = true beside it")
        return self


class Solve(Section):
    """What the eigen-solver is asked for.

    Attributes
    ----------
    modes : int
        Number of modes, the lowest (default: 20, or as many as there are, where `max_frequency` is not given).
    max_frequency : float, Hz
        All modes up to it, instead of `modes`.
    method : "auto", "direct", "reduced" or "modal"
        How the modes are computed: "direct" solves at every value; "reduced" makes a reduced model that holds over the
        sweep within the tolerance; "modal" projects on the modes without friction and damping and tells the error that
        this makes; "auto" takes "reduced" from five values of the sweep and 401 unknowns on, at fewer values with
        friction or damping from 2000 unknowns on, and "direct" otherwise. A study has no "modal"; with "direct" it
        solves directly at every place, otherwise on a reduced model where there can be one that pays.
    tolerance : float
        Relative error of every eigenvalue, next to a double one times its condition; in a reduced model of those below
        a thousandth of the band relative to that. Shapes that are written, and modes of direct solves, have this
        backward error as well. It is not that of a study, which has its own, `tolerance` of [study].
    linear_solver : "auto", "pardiso", "superlu" or "mumps"
        What factorises sparse matrices: "pardiso" is MKL's, "superlu" is SciPy's, which is always there, but
        slower; "mumps" comes with petsc4py (docs/cluster.md). "auto" takes "mumps" where mpiexec has started several
        processes, else "pardiso" where it can be loaded, else "superlu".
    mumps : table
        How MUMPS keeps its factors.
    """

    modes: Annotated[int, Field(ge=1)] | None = None  # 20, or as many as there are, where max_frequency is not given
    max_frequency: Positive | None = None
    method: Literal["auto", "direct", "reduced", "modal"] = "auto"
    tolerance: Annotated[float, Field(gt=0, lt=1)] = 1e-8
    linear_solver: SolverName = "auto"
    mumps: MumpsTable | None = None

    @model_validator(mode="after")
    def _of_mumps(self) -> Solve:
        if self.mumps is not None and self.linear_solver not in ("auto", "mumps"):
            raise ValueError(
                f'given the table mumps with linear_solver = "{self.linear_solver}", which it does not belong to;'
                f' expected "mumps", or "auto"'
            )
        return self

    @model_validator(mode="after")
    def _one_limit(self) -> Solve:
        if self.modes is not None and self.max_frequency is not None:
            raise ValueError("given modes and max_frequency; expected one of them")
        return self


class Output(Section):
    """What is written beside the tables and figures.

    Attributes
    ----------
    shapes : "unstable" or "all" or "none"
        Which mode shapes are written, for ParaView and as pictures.
    report : bool
        Whether report.html is written: one page with charts, shapes that move, and what the result rests on.
    """

    shapes: Literal["unstable", "all", "none"] = "unstable"
    report: bool = True
