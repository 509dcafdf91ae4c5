"""Result of a scatter: its tables, and the probability of instability by band of frequency."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..sweep.noise import classify_noise
from .indices import index_rows
from .models import Solver
from .outcome import COLUMNS, MODE_COLUMNS

if TYPE_CHECKING:
    import pandas as pd


OWN_COLUMNS = ("sample", *COLUMNS, "method", "unstable_modes")  # of samples.csv, beside those of the parameters


@dataclass(frozen=True)
class ScatterResult:
    """Result of a scatter.

    Attributes
    ----------
    names : tuple of str
        The d parameters.
    points : (m, d) float
        Values of the parameters at the m samples.
    rows : (m, columns) float
        What is kept of the modes of each sample, see `Outcome.row`.
    modes : (k, 1 + columns) float
        For every unstable mode the number of its sample, from 0, and `MODE_COLUMNS`.
    edges : (b + 1,) float, Hz
        Edges of the b bands of frequency.
    again : (d, q, columns) float
        `rows` of the first q samples with one parameter after the other drawn anew.
    again_modes : list of d (k, 1 + columns) float
        `modes` of these.
    solver : Solver
        How the modes were solved for.
    """

    names: tuple[str, ...]
    points: np.ndarray
    rows: np.ndarray
    modes: np.ndarray
    edges: np.ndarray
    again: np.ndarray
    again_modes: list[np.ndarray]
    solver: Solver = field(repr=False)

    @property
    def probability(self) -> float:
        """The part of the samples that have an unstable mode among those solved for."""
        return float(self.rows[:, 0].mean())

    @property
    def found(self) -> tuple[float, float, float]:
        """The same, and the 95 % interval of the probability of instability; it ends at 1 where modes are not known."""
        return _probability(self.rows[:, 0] > 0, not np.isfinite(self.known_hz))

    @property
    def known_hz(self) -> float:
        """Up to which frequency, Hz, all modes of every sample are known; infinite where they are all there are."""
        return float(self.rows[:, COLUMNS.index("known_hz")].min(initial=np.inf))

    @property
    def samples(self) -> pd.DataFrame:
        """A table with a row per sample and the columns of samples.csv."""
        import pandas as pd

        frame = pd.DataFrame(self.rows, columns=list(COLUMNS))
        frame.insert(0, "sample", np.arange(1, len(frame) + 1))
        for i, name in enumerate(self.names):
            frame.insert(1 + i, name, self.points[:, i])
        frame["unstable"] = frame["unstable"].astype(int)
        frame = frame.drop(columns=["known_hz", "unsearched"])
        frame["method"] = np.where(frame.pop("direct") > 0, "direct", "reduced")
        frame["worst_re_uncertainty"] = frame.pop("worst_re_uncertainty")  # becomes the last column
        frame["unstable_modes"] = np.bincount(self.modes[:, 0].astype(int), minlength=len(frame))
        return frame

    @property
    def unstable_modes(self) -> pd.DataFrame:
        """A table with a row per unstable mode and the columns of unstable_modes.csv."""
        import pandas as pd

        frame = pd.DataFrame(self.modes, columns=["sample", *MODE_COLUMNS])
        frame["sample"] = frame["sample"].astype(int) + 1
        frame["noise"] = [classify_noise(f) for f in frame["frequency_hz"]]
        return frame

    @property
    def bands(self) -> pd.DataFrame:
        """A table of the probability of instability by band, with its 95 % interval and the columns of bands.csv.

        The interval is that of Clopper and Pearson. It is right for any number of independent samples, and a little too
        wide for Sobol points. Above the range in which the modes of all samples are known it says nothing of what was
        not found: its upper end is 1 there. The last row is the whole range of frequencies in which the modes of all
        samples are known; samples that are unstable above it alone do not count in it, but do in `probability`.
        """
        import pandas as pd

        count = len(self.rows)
        rows = [(a, b, *_probability(hit, b <= self.known_hz), count) for a, b, hit in self._by_band()]
        return pd.DataFrame(rows, columns=["low_hz", "high_hz", "probability", "lower", "upper", "samples"])

    @property
    def indices(self) -> pd.DataFrame:
        """A table of Sobol indices, with half the widths of their 95 % intervals and the columns of indices.csv."""
        import pandas as pd

        outputs = {"unstable": self.rows[:, 0], "worst_re": self.rows[:, 1]}
        again = {"unstable": self.again[:, :, 0], "worst_re": self.again[:, :, 1]}
        for low, high, hit in self._by_band()[:-1]:
            if 0 < hit.sum() < len(hit):
                name = f"unstable_{low:g}_{high:g}_hz"
                outputs[name] = hit.astype(float)
                changed = [_in_band(m, self.again.shape[1], low, high) for m in self.again_modes]
                again[name] = np.array(changed, float).reshape(len(self.names), -1)
        rows = index_rows(self.names, self.points, outputs, again)
        return pd.DataFrame(rows, columns=["parameter", "output", "first", "first_error", "total", "total_error"])

    def dangerous(self, count: int) -> list[int]:
        """Return the positions of the `count` unstable samples that grow most, or of all if there are fewer."""
        grows = np.flatnonzero(self.rows[:, 0] > 0)
        return [int(i) for i in grows[np.argsort(-self.rows[grows, 1], kind="stable")][:count]]

    def _by_band(self) -> list[tuple[float, float, np.ndarray]]:
        """Return the edges of each band, Hz, and (m,) bool which samples have an unstable mode in it.

        The last entry is the whole range of frequencies: that of the bands, or from 0 on and up to the highest unstable
        mode where there are unstable modes beside them, as far as the modes of all samples are known.
        """
        count, hz = len(self.rows), self.modes[:, 1]
        found = [(float(a), float(b), _in_band(self.modes, count, a, b)) for a, b in pairwise(self.edges)]
        low, high = float(self.edges[0]), float(self.edges[-1])
        if hz.min(initial=np.inf) < low or self.known_hz <= low:
            low = 0.0
        high = min(max(high, float(hz.max(initial=0.0))), self.known_hz)
        beyond = float(np.nextafter(high, np.inf))  # the highest mode that is known counts
        return [*found, (low, high, _in_band(self.modes, count, low, beyond))]


def _probability(hit: np.ndarray, whole: bool) -> tuple[float, float, float]:
    """Return the part of samples (m,) bool that are hit, and its 95 % interval, without upper limit if not `whole`."""
    from scipy.stats import binomtest

    k, count = int(hit.sum()), len(hit)
    interval = binomtest(k, count).proportion_ci(0.95, method="exact")
    return k / count, float(interval.low), float(interval.high) if whole else 1.0


def _in_band(modes: np.ndarray, count: int, low: float, high: float) -> np.ndarray:
    inside = (modes[:, 1] >= low) & (modes[:, 1] < high)
    return np.bincount(modes[inside, 0].astype(int), minlength=count)[:count] > 0
