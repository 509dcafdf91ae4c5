"""What a sweep gives: modes at every value, branches, onsets, and their tables."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..eigen.pencil import Modes
from ..eigen.request import Completeness
from ..problem.description import DESCRIPTOR_COLUMNS, undescribed
from ..problem.energy import Share, energy_balance
from ..problem.problem import Problem
from ..reduced import ReducedModel, lift
from .noise import classify_noise
from .onset import Onset

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

MODE_COLUMNS = (
    "parameter", "value", "mode", "branch", "re", "im", "frequency_hz", "damping_ratio", "stability", "noise",
    "backward_error", "re_uncertainty", "re_discretisation", "im_discretisation", *DESCRIPTOR_COLUMNS,
)  # fmt: skip
ONSET_COLUMNS = (
    "parameter", "value", "frequency_hz", "kind", "direction", "crossing_speed", "branch_a", "branch_b", "uncertainty",
    "two_mode_value", "discretisation",
)  # fmt: skip
CONTRIBUTION_COLUMNS = ("parameter", "value", "mode", "branch", "term", "re_share", "energy_share")
SENSITIVITY_COLUMNS = ("parameter", "value", "mode", "branch", "number", "at", "dre", "dim")


class LiftedShapes(Mapping[int, np.ndarray]):
    """Shapes Vy (n,) by position of the mode, made from their coordinates y on a basis when they are asked for."""

    def __init__(self, coordinates: Mapping[int, np.ndarray], V: np.ndarray) -> None:
        self.coordinates, self._V = coordinates, V

    def __getitem__(self, i: int) -> np.ndarray:
        return lift(self._V, self.coordinates[i])

    def __iter__(self) -> Iterator[int]:
        return iter(self.coordinates)

    def __len__(self) -> int:
        return len(self.coordinates)


@dataclass(frozen=True)
class SweepPoint:
    """The modes at one value of the parameter.

    Attributes
    ----------
    value : float
    modes : Modes
        Without shapes.
    branches : (k,) int
    shapes : mapping of mode position to (n,) shape
        Of the unstable modes, and of all modes where the sweep was asked to keep them.
    sensitivities : mapping of mode position to {path: (number, ∂λ/∂number)}
        Of the unstable modes.
    pressed : mapping of contact to {quantity: number}
        Pressed area, force and the like in the static state under preload, see `contact_summary`.
    discretisation : (k,) complex or None
        Errors of Re λ and Im λ by the mesh, where they are estimated.
    extrapolated : (k,) complex or None, rad/s
        The λ that meshes finer and finer are likely to tend to, where that is estimated; NaN for a mode that the
        refined mesh does not have.
    above : tuple of complex, rad/s
        Unstable λ beyond the modes that were asked for, as far as the solver happened to find any.
    between : bool
        Whether this is no value of the sweep but the middle of a window of instability between two of them.
    description : mapping of column to (k,) entries
        What the modes look like, see `fe_squeal.problem.description`; empty where nobody says.
    """

    value: float
    modes: Modes
    branches: np.ndarray
    shapes: Mapping[int, np.ndarray]
    sensitivities: Mapping[int, Mapping[str, tuple[float, complex]]] = field(default_factory=dict)
    pressed: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    discretisation: np.ndarray | None = None
    extrapolated: np.ndarray | None = None
    above: tuple[complex, ...] = ()
    between: bool = False
    description: Mapping[str, Sequence[object]] = field(default_factory=dict)


@dataclass(frozen=True)
class Sweep:
    """Result of a sweep.

    Attributes
    ----------
    problem : Problem
    parameter : str
    points : tuple of SweepPoint
    onsets : tuple of Onset
    completeness : Completeness
        Of the modes at the first value.
    seconds : mapping of stage to float, s
    warnings : tuple of str
        Sentences about what could not be made sure.
    reduced_model : ReducedModel or None
        On which the modes were found; None where every value was solved directly.
    window : float
        Every window of instability wider than this was found, in the parameter.
    unsettled : tuple of str
        Those of the warnings that are about onsets.
    """

    problem: Problem
    parameter: str
    points: tuple[SweepPoint, ...]
    onsets: tuple[Onset, ...]
    completeness: Completeness
    seconds: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    reduced_model: ReducedModel | None = field(default=None, repr=False)
    window: float = 0.0
    unsettled: tuple[str, ...] = ()

    def __repr__(self) -> str:
        ends = f"{self.points[0].value:g} to {self.points[-1].value:g}"
        found = f"{len(self.points)} values, {len(self.onsets)} onsets"
        return f"Sweep({self.parameter} = {ends}, {found}, {self.problem!r})"

    @property
    def method(self) -> str:
        """How the modes were solved for."""
        return self.points[0].modes.method

    @property
    def values(self) -> tuple[float, ...]:
        """The values of the sweep that were solved, without those between."""
        return tuple(p.value for p in self.points if not p.between)

    @property
    def onsets_complete(self) -> dict[str, object]:
        """Whether all onsets between the first and the last value are there, of the modes that were asked for.

        "sure" is False where an onset was left unrefined or unexplained, see `unsettled`. A window of instability
        narrower than "width", in the parameter, could have been overlooked.
        """
        return {
            "sure": not self.unsettled,
            "what": f"onsets for {self.parameter} from {self.points[0].value:g} to {self.points[-1].value:g}",
            "how": "eigenvalues that may meet, as one smooth matrix between values, with values added where in doubt;"
            " modes counted on both sides of each onset",
            "width": self.window,
            "open": list(self.unsettled),
        }

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per mode and value, the columns of modes.csv, and those extrapolated where they are known."""
        import pandas as pd

        rows = []
        for point in self.points:
            m = point.modes
            looks = list(zip(*(point.description or undescribed(len(m))).values(), strict=True))
            mesh = np.full(len(m), np.nan * (1 + 1j)) if point.discretisation is None else point.discretisation
            for i, lam in enumerate(m.lam):
                size, unstable = abs(lam), m.stability[i] == "unstable"
                rows.append((
                    self.parameter, point.value, i + 1, point.branches[i], lam.real, lam.imag, m.frequency_hz[i],
                    -lam.real / size if size else 0.0, m.stability[i],
                    classify_noise(m.frequency_hz[i]) if unstable else "",
                    m.backward_error[i], m.re_uncertainty[i], mesh[i].real, mesh[i].imag,
                    *looks[i],
                ))  # fmt: skip
        frame = pd.DataFrame(rows, columns=list(MODE_COLUMNS))
        if any(point.extrapolated is not None for point in self.points):
            unknown = np.nan * (1 + 1j)
            lam = np.concatenate([np.full(len(p.modes), unknown) if p.extrapolated is None else p.extrapolated
                                  for p in self.points])  # fmt: skip
            frame["re_extrapolated"], frame["im_extrapolated"] = lam.real, lam.imag
        counts = ["nodal_diameters", "nodal_circles", "other_nodal_diameters"]
        shares = ["out_of_plane", "body_share", "nodal_diameters_share", "other_share", "travelling"]
        return frame.astype(dict.fromkeys(counts, "Int64") | dict.fromkeys(shares, float) | {"body": object})

    def onsets_dataframe(self) -> pd.DataFrame:
        """Return one row per onset, the columns of onsets.csv, and the value extrapolated where it is known."""
        import pandas as pd

        rows = [
            (o.parameter, o.value, o.frequency_hz, o.kind, o.direction, o.crossing_speed, o.branch_a, o.branch_b,
             o.uncertainty, o.two_mode_value, o.discretisation)
            for o in self.onsets
        ]  # fmt: skip
        frame = pd.DataFrame(rows, columns=list(ONSET_COLUMNS))
        if any(point.extrapolated is not None for point in self.points):
            frame["value_extrapolated"] = [o.extrapolated for o in self.onsets]
        return frame.astype({"branch_a": "Int64", "branch_b": "Int64"})

    def balance(self, point: SweepPoint, i: int) -> dict[str, Share]:
        """Return the shares of the terms in one mode whose shape is known."""
        problem, shapes = self.problem, point.shapes
        if self.reduced_model is not None and isinstance(shapes, LiftedShapes):
            problem, shapes = self.reduced_model.projected, shapes.coordinates
        return energy_balance(problem.at({self.parameter: point.value}), complex(point.modes.lam[i]), shapes[i])

    def exact_shapes(self, point: SweepPoint, positions: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Return shapes (n, k) of some modes of a point and their backward errors (k,), which meet the tolerance.

        Those of a reduced model, whose eigenvalues are more exact than its shapes, are corrected for that.
        """
        if self.reduced_model is not None and isinstance(point.shapes, LiftedShapes):
            return self.reduced_model.shapes(point.value, positions)
        shapes = np.stack([point.shapes[i] for i in positions], axis=1)
        return shapes, point.modes.backward_error[list(positions)]

    def contributions_dataframe(self) -> pd.DataFrame:
        """Return the shares of Re λ and of the energy by term, of every unstable mode (contributions.csv)."""
        import pandas as pd

        rows = []
        for point in self.points:
            for i in np.flatnonzero(point.modes.stability == "unstable"):
                found = self.balance(point, int(i))
                key = (self.parameter, point.value, i + 1, point.branches[i])
                rows += [(*key, term, share.growth, share.energy) for term, share in found.items()]
                rows.append((*key, "sum", sum(share.growth for share in found.values()), np.nan))
        return pd.DataFrame(rows, columns=list(CONTRIBUTION_COLUMNS))

    def sensitivities_dataframe(self) -> pd.DataFrame:
        """Return ∂Re λ and ∂Im λ by every number that terms scale with, of every unstable mode (sensitivities.csv)."""
        import pandas as pd

        rows = [
            (self.parameter, point.value, i + 1, point.branches[i], path, at, d.real, d.imag)
            for point in self.points
            for i, found in point.sensitivities.items()
            for path, (at, d) in found.items()
        ]
        return pd.DataFrame(rows, columns=list(SENSITIVITY_COLUMNS))

    def plot_stability(self, path: str | Path | None = None) -> Figure:
        """Draw frequencies and growth rates over the parameter, into a file or a notebook.

        Parameters
        ----------
        path : path, optional
            Where to write; the suffix chooses the format (png, pdf, svg).

        Returns
        -------
        matplotlib.figure.Figure
        """
        return _viewer().plot_stability(self, path)

    def plot_damping(self, value: float | None = None, path: str | Path | None = None) -> Figure:
        """Draw damping ratio against frequency at the value of the sweep nearest to the given one, by default the last.

        Returns
        -------
        matplotlib.figure.Figure
        """
        return _viewer().plot_damping(self, value, path)

    def show(self, branch: int, off_screen: bool = False) -> Any:
        """Show the shape of a branch in 3-D, where it grows fastest, in a window or a notebook.

        Parameters
        ----------
        branch : int
            As in the column of that name; its shape has to be known, as those of unstable modes are.
        off_screen : bool
            Open nothing; the plotter that is returned can take a screenshot.

        Returns
        -------
        pyvista.Plotter

        Raises
        ------
        SceneError
            No shape of this branch is known, or the problem has no mesh.
        """
        return _viewer().show(self, branch, off_screen)

    def _repr_html_(self) -> str:
        """Return the answer in words, with tables of what is unstable and of the onsets, for a notebook."""
        return str(_viewer().html(self))


def _viewer() -> Any:
    """Return the module that draws: it imports this room, so that this room cannot import it, but looks it up."""
    return importlib.import_module("fe_squeal.run.show")
