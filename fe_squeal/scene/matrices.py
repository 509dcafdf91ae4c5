"""A scene whose matrices come from another program."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, get_args

import numpy as np
from pydantic import Field, field_validator, model_validator

from ..errors import SceneError, suggest
from ..problem.parameters import parameter_name, paths_of, product_of_powers
from ..schema.section import Section, Text
from .base import BaseScene
from .control import Output, Solve, SweepSection
from .measured import Measured
from .study import StudySection

Role = Literal["mass", "damping", "stiffness"]


class TermSection(Section):
    """One matrix of (λ²M + λC + K)u = 0 from a file; terms of the same role add up.

    Attributes
    ----------
    role : "mass" or "damping" or "stiffness"
        Where it counts.
    file : str
        Matrix Market .mtx or .mtx.gz, SciPy .npz, NumPy .npy or MATLAB .mat, relative to the scene file; real and
        square. Nothing in a file is executed.
    variable : str
        Name of the matrix in a .mat file; needed where the file holds several.
    scale : float
        Factor.
    powers : table of int
        Parameter = exponent: the term counts with Π parameter^exponent, negative exponents too (default: constant).
    imaginary : bool
        Whether the term counts with i, as structural damping does; with role "stiffness" alone.
    """

    role: Role
    file: Text
    variable: str | None = None
    scale: float = 1.0
    powers: dict[str, int] = {}
    imaginary: bool = False

    @field_validator("role", mode="before")
    @classmethod
    def _known(cls, value: object) -> object:
        if isinstance(value, str) and value not in get_args(Role):
            raise ValueError(f"expected a role{suggest(value, get_args(Role))}")
        return value

    @field_validator("powers")
    @classmethod
    def _sensible(cls, value: dict[str, int]) -> dict[str, int]:
        for name, exponent in value.items():
            if not -20 <= exponent <= 20:
                raise ValueError(f"{name}: given {exponent}; expected an exponent from -20 to 20")
        return value

    @model_validator(mode="after")
    def _where(self) -> TermSection:
        if self.imaginary and self.role != "stiffness":
            raise ValueError(f'given imaginary = true with role = "{self.role}"; expected it with role = "stiffness"')
        return self


class MatrixScene(BaseScene):
    """A scene of matrices; `load_scene` reads one from TOML that has `[[terms]]`.

    Attributes
    ----------
    title : str
        For figures and run.json.
    units : "SI" or "any"
        Those of the matrices. "any": another consistent set of units; the page then names none.
    parameters : table of float
        Parameters by name, with their nominal values.
    terms : list of tables
        The matrices, all of one size.
    sweep : table
        Where to solve; without it once, at the nominal values.
    study : table
        What `fe-squeal study` does: the scatter of several numbers, or a map over two.
    solve : table
        Number of modes and accuracy.
    output : table
        What is written.
    measured : list of tables
        Measured squeal, shown beside what is computed.
    """

    title: str = ""
    units: Literal["SI", "any"] = "SI"
    parameters: dict[str, float] = {}
    terms: Annotated[list[TermSection], Field(min_length=1)]
    sweep: SweepSection | None = None
    study: StudySection | None = None
    solve: Solve = Solve()
    output: Output = Output()
    measured: list[Measured] = []

    @property
    def effect_names(self) -> tuple[str, ...]:
        """No effects: what the matrices stand for is not known."""
        return ()

    @model_validator(mode="after")
    def _consistent(self) -> MatrixScene:
        for name in self.parameters:
            if "," in name or not (known := parameter_name(name)):
                raise ValueError(f'parameters: given the name "{name}"; expected one not empty, and without a comma')
            if known != name:
                raise ValueError(f'parameters: given the name "{name}"; expected "{known}", as it is known')
        for i, term in enumerate(self.terms):
            for name, exponent in term.powers.items():
                if name not in self.parameters:
                    raise ValueError(
                        f'terms[{i}].powers.{name}: is no parameter{suggest(name, self.parameters)}; expected'
                        " [parameters] to have it"
                    )
                if exponent < 0 and self.parameters[name] == 0:
                    raise ValueError(f"terms[{i}].powers.{name}: given {exponent}, and parameters.{name} = 0")
        if not any(t.role == "mass" for t in self.terms) or not any(t.role == "stiffness" for t in self.terms):
            raise ValueError('terms: expected at least one of role = "mass" and one of role = "stiffness"')
        self._check_powers({})
        if self.sweep is not None:
            self._check_sweep(self.sweep)
            self._check_powers({self.sweep.parameter: (self.sweep.grid.min(), self.sweep.grid.max())})
        if self.study is not None:
            self._check_study(self.study)
            ends = zip(self.study.names, self.study.ends, strict=True)
            above_0 = self.study.positive  # none of these is 0, whatever end is given
            self._check_powers({n: tuple(None if n in above_0 and not x else x for x in both) for n, both in ends})
        return self

    def _check_powers(self, ends: Mapping[str, tuple[float | None, ...]]) -> None:
        """Raise ValueError where what a term is multiplied by overflows at the ends of what parameters are moved over.

        Parameters
        ----------
        ends : mapping of parameter to (least, largest)
            None where there is none; other parameters stay at their own values.
        """
        for i, term in enumerate(self.terms):
            values = dict(self.parameters)
            for name, both in ends.items():
                paths, given = paths_of(name), [float(end) for end in both if end is not None]
                grows = sum(term.powers.get(path, 0) for path in paths) > 0
                if given:
                    values |= dict.fromkeys(paths, max(given, key=abs) if grows else min(given, key=abs))
            for key, powers in (*((f".{name}", {name: e}) for name, e in term.powers.items()), ("", term.powers)):
                try:
                    product_of_powers(powers, values)
                except SceneError as error:
                    raise ValueError(f"terms[{i}].powers{key}: {error}") from error

    def _check_study(self, study: StudySection) -> None:
        for name, ends in zip(study.names, study.ends, strict=True):
            least = np.finfo(float).tiny if name in study.positive else -np.inf
            low, high = max(least, -np.inf if ends[0] is None else ends[0]), np.inf if ends[1] is None else ends[1]
            for path in paths_of(name):
                if path not in self.parameters:
                    raise ValueError(f'study: given "{path}", which is no parameter{suggest(path, self.parameters)}')
                if low <= 0 <= high and any(t.powers.get(path, 0) < 0 for t in self.terms):
                    raise ValueError(f"study: given 0 among the values of {path}, of which a term has a negative power")

    def _check_sweep(self, sweep: SweepSection) -> None:
        for path in paths_of(sweep.parameter):
            if path not in self.parameters:
                known = suggest(path, self.parameters)
                raise ValueError(f'sweep.parameter: given "{path}", which is no parameter{known}')
            if sweep.grid.min() <= 0 <= sweep.grid.max() and any(t.powers.get(path, 0) < 0 for t in self.terms):
                raise ValueError(
                    f"sweep: given {path} from {sweep.grid.min():g} to {sweep.grid.max():g}, of which a term has a"
                    " negative power; expected values that are all above 0 or all below"
                )
