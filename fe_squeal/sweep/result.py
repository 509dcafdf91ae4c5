"""The result of a sweep: modes at every value, branches, onsets, and tables of these."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..eigen.request import Completeness
from ..problem.description import DESCRIPTOR_COLUMNS, undescribed
from ..problem.energy import Share, energy_balance
from ..problem.problem import Problem
from ..reduced import ReducedModel
from .noise import classify_noise
from .onset import Onset
from .point import LiftedShapes, SweepPoint

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

MODE_COLUMNS = (
    "parameter", "value", "mode", "branch", "re", "im", "frequency_hz", "damping_ratio", "stability", "noise",
    "backward_error", "re_uncertainty", "re_discretisation", "im_discretisation", *DESCRIPTOR_COLUMNS,
)  # fmt: skip
ONSET_COLUMNS = (
    "parameter", "value", "frequency_hz", "kind", "direction", "crossing_speed", "branch_a", "branch_b", "uncertainty",
    "two_mode_value", "discretisation", "law",
)  # fmt: skip
CONTRIBUTION_COLUMNS = ("parameter", "value", "mode", "branch", "term", "re_share", "energy_share", "energy")
SENSITIVITY_COLUMNS = ("parameter", "value", "mode", "branch", "number", "at", "dre", "dim")


@dataclass(frozen=True)
class Sweep:
    """Result of a sweep: the modes at every value, followed into branches, and the onsets of instability.

    Attributes
    ----------
    problem : Problem
        That was solved.
    parameter : str
        Name of the parameter.
    points : tuple of SweepPoint
        The modes at each value, ascending; also in the middle of windows of instability between values (`between`).
    onsets : tuple of Onset
        The critical values, ascending.
    completeness : Completeness
        Whether a count confirms that no mode is missing at the first value.
    seconds : mapping of str to float, s
        Time by stage.
    warnings : tuple of str
        Sentences about what is not certain.
    reduced_model : ReducedModel or None
        The reduced model that the modes were found on; None if every value was solved directly.
    window : float
        Every window of instability wider than this, in the parameter, was found.
    unsettled : tuple of str
        The warnings that are about onsets.
    max_frequency : float or None, Hz
        All modes up to it were asked for; None if a number of them was.
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
    max_frequency: float | None = None

    def __repr__(self) -> str:
        ends = f"{self.points[0].value:g} to {self.points[-1].value:g}"
        found = f"{len(self.points)} values, {len(self.onsets)} onsets"
        return f"Sweep({self.parameter} = {ends}, {found}, {self.problem!r})"

    @property
    def method(self) -> str:
        """How the modes at the first value were found, in words, such as "reduced model of 211 vectors"."""
        return self.points[0].modes.method

    @property
    def values(self) -> tuple[float, ...]:
        """The values of the sweep that were solved, without the middles of windows between them."""
        return tuple(p.value for p in self.points if not p.between)

    @property
    def onsets_complete(self) -> dict[str, object]:
        """Whether all onsets of the modes asked for, between the first and the last value, were found.

        "sure" is False if an onset was not refined or the number of unstable modes is not explained, see `unsettled`. A
        window of instability narrower than "width", in the parameter, may have been missed.
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
        """Return a row per mode and value, with the columns of modes.csv; λ as re and im, 1/s and rad/s.

        If the error of the mesh was estimated, `re_extrapolated` and `im_extrapolated` are the likely values for an
        infinitely fine mesh, and `re_extrapolated_discretisation` and `im_extrapolated_discretisation` their errors.
        """
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

            def column(of: str) -> np.ndarray:
                own = [(np.full(len(p.modes), unknown), getattr(p, of)) for p in self.points]
                return np.concatenate([none if known is None else known for none, known in own])

            bar, lam = column("extrapolated_discretisation"), column("extrapolated")
            frame["re_extrapolated_discretisation"], frame["im_extrapolated_discretisation"] = bar.real, bar.imag
            frame["re_extrapolated"], frame["im_extrapolated"] = lam.real, lam.imag
        counts = ["nodal_diameters", "nodal_circles", "other_nodal_diameters"]
        shares = ["out_of_plane", "body_share", "nodal_diameters_share", "other_share", "travelling"]
        return frame.astype(dict.fromkeys(counts, "Int64") | dict.fromkeys(shares, float) | {"body": object})

    def onsets_dataframe(self) -> pd.DataFrame:
        """Return a row per onset, with the columns of onsets.csv.

        If the error of the mesh was estimated, `value_extrapolated` is the likely value for an infinitely fine mesh,
        and `extrapolated_discretisation` its error.
        """
        import pandas as pd

        rows = [
            (o.parameter, o.value, o.frequency_hz, o.kind, o.direction, o.crossing_speed, o.branch_a, o.branch_b,
             o.uncertainty, o.two_mode_value, o.discretisation, o.law)
            for o in self.onsets
        ]  # fmt: skip
        frame = pd.DataFrame(rows, columns=list(ONSET_COLUMNS))
        if any(point.extrapolated is not None for point in self.points):
            frame["extrapolated_discretisation"] = [o.extrapolated_discretisation for o in self.onsets]
            frame["value_extrapolated"] = [o.extrapolated for o in self.onsets]
        return frame.astype({"branch_a": "Int64", "branch_b": "Int64"})

    def balance(self, point: SweepPoint, i: int) -> dict[str, Share]:
        """Return the shares of all terms in Re λ and in the energy of mode i of a point, by the name of the term.

        Raises
        ------
        KeyError
            The shape of this mode is not known: only those of unstable modes are, unless `keep_shapes` was asked for.
        """
        problem, shapes = self.problem, point.shapes
        if self.reduced_model is not None and isinstance(shapes, LiftedShapes):
            problem, shapes = self.reduced_model.projected, shapes.coordinates
        return energy_balance(problem.at({self.parameter: point.value}), complex(point.modes.lam[i]), shapes[i])

    def exact_shapes(self, point: SweepPoint, positions: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Return shapes (n, k) of some modes of a point, and their backward errors (k,), which meet the tolerance.

        Shapes of a reduced model are less accurate than its eigenvalues, and are corrected first.

        Parameters
        ----------
        point : SweepPoint
        positions : sequence of int
            Positions of modes whose shapes are known.
        """
        if self.reduced_model is not None and isinstance(point.shapes, LiftedShapes):
            return self.reduced_model.shapes(point.value, positions)
        shapes = np.stack([point.shapes[i] for i in positions], axis=1)
        return shapes, point.modes.backward_error[list(positions)]

    def contributions_dataframe(self) -> pd.DataFrame:
        """Return a row per unstable mode and term with its shares in Re λ (1/s) and energy: contributions.csv."""
        import pandas as pd

        rows = []
        for point in self.points:
            for i in np.flatnonzero(point.modes.stability == "unstable"):
                found = self.balance(point, int(i))
                key = (self.parameter, point.value, i + 1, point.branches[i])
                rows += [(*key, term, share.growth, share.energy, share.kind) for term, share in found.items()]
                rows.append((*key, "sum", sum(share.growth for share in found.values()), np.nan, ""))
        return pd.DataFrame(rows, columns=list(CONTRIBUTION_COLUMNS))

    def sensitivities_dataframe(self) -> pd.DataFrame:
        """Return a row per unstable mode and number of the scene, with ∂Re λ and ∂Im λ by this: sensitivities.csv.

        The numbers are those that terms are proportional to, or to a power of.
        """
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
        path : str or Path, optional
            The file to write; its suffix chooses the format (png, pdf, svg). Without it nothing is written.

        Returns
        -------
        matplotlib.figure.Figure
        """
        return _viewer().plot_stability(self, path)

    def plot_damping(self, value: float | None = None, path: str | Path | None = None) -> Figure:
        """Draw the damping ratio −Re λ/|λ| against the frequency of all modes at one value.

        Parameters
        ----------
        value : float, optional
            The value of the sweep nearest to this is drawn; by default the last one.
        path : str or Path, optional
            As for `plot_stability`.

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
            The number of the branch, as in the column "branch" of the tables. Its shape has to be known, as those of
            unstable modes are.
        off_screen : bool
            Whether to open no window: the plotter that is returned can take a screenshot.

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
        """Return HTML for a notebook: the answer in words, and tables of unstable modes and of onsets."""
        return str(_viewer().html(self))


def _viewer() -> Any:
    """Return the module that draws. It imports this one, and so is looked up by name when it is needed."""
    return importlib.import_module("fe_squeal.run.show")
