"""The branches of a sweep as arrays, to be drawn, from the tables of modes and onsets."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fe_squeal.errors import one_line

_LETTERS = 9  # of a title in an inch

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

PARAMETER_LABELS = {
    "mu": "friction coefficient μ (–)",
    "effects.friction.mu": "friction coefficient μ (–)",
}


@dataclass(frozen=True)
class Branch:
    """One mode followed through the sweep; points are the values of the sweep and the onsets of the mode between them.

    Attributes
    ----------
    number : int
        As in the column `branch`.
    value : (k,) float
        The parameter, ascending.
    frequency_hz : (k,) float, Hz
    re : (k,) float, 1/s
        Growth rate; zero at an onset. Where two modes that grow already meet or part it is interpolated, or NaN where
        the branch grows on one side alone.
    re_uncertainty : (k,) float, 1/s
        Uncertainty of `re` by the solver and, if it was estimated, by the mesh; zero where it is unknown. At an onset
        it lies between those at the values around it, or is what the error of the onset makes of it.
    unstable : (k,) bool
    onset : (k,) int
        1 for an onset into instability, −1 for one out of it, 0 for a value of the sweep and where modes that grow
        already meet or part.
    joined : (k − 1,) bool
        Whether points i and i + 1 are neighbours in the sweep; a branch may be missing at some values.
    speed : (k,) float
        At an onset how steeply growth begins, the column `crossing_speed`; NaN elsewhere.
    rooted : (k,) bool
        At an onset whether growth begins like the square root of the distance (two modes meet), and not linearly.
    passing : (k,) bool
        Where two modes that grow already meet or part.
    told : (k,) bool
        At an onset whether its table says so; else `rooted` is whether two branches meet.
    leads : (k,) bool
        At an onset whether the branch is its `branch_a`. A window between two onsets is drawn on this branch.
    """

    number: int
    value: Floats
    frequency_hz: Floats
    re: Floats
    re_uncertainty: Floats
    unstable: Bools
    onset: NDArray[np.int64]
    joined: Bools
    speed: Floats
    rooted: Bools
    passing: Bools
    told: Bools
    leads: Bools

    @property
    def windows(self) -> Bools:
        """(k − 1,) bool, which stretches between neighbouring points are windows of instability between two onsets."""
        opens = (self.onset[:-1] == 1) & self.leads[:-1]
        return self.joined & opens & (self.onset[1:] == -1) & self.leads[1:]

    @property
    def swings(self) -> Bools:
        """(k,) bool, where the mode does not surely decay faster than it swings; else its frequency says nothing.

        Where it does, it may also be another mode than the one before it.
        """
        return np.asarray(~(-self.re - self.re_uncertainty > 2 * np.pi * self.frequency_hz))

    @property
    def grows(self) -> bool:
        """Whether the mode is unstable anywhere in the sweep, at its values or between them."""
        return bool(self.unstable.any() or self.windows.any())

    @property
    def peak(self) -> int:
        """Position of the unstable point with the largest growth rate.

        Without unstable points it is that of the onset at which a window begins, or else of the largest growth rate.
        """
        found = self.unstable & ~self.passing
        if not found.any() and self.windows.any():
            return int(np.argmax(self.windows))
        candidates = np.where(found, self.re, -np.inf) if found.any() else self.re
        return int(np.argmax(np.where(np.isnan(candidates), -np.inf, candidates)))

    def unstable_segments(self) -> Bools:
        """Return (k − 1,) bool, which stretches between neighbouring points are unstable throughout."""
        marked = self.unstable | (self.onset != 0)
        inside = self.unstable[:-1] | self.unstable[1:]
        return np.asarray((self.joined & marked[:-1] & marked[1:] & inside) | self.windows)


def parameter_name(modes: pd.DataFrame) -> str:
    """Return the name of the swept parameter of a table of modes."""
    return str(modes["parameter"].iloc[0]) if len(modes) else "mu"


def figure_text(text: str) -> str:
    r"""Return a title or name for Matplotlib: dollar signs are escaped, and control characters are spelled out.

    Examples
    --------
    >>> print(figure_text("100 $, 50 $"))
    100 \$, 50 \$
    """
    return one_line(text).replace("$", r"\$")


def title_text(text: str, width: float) -> str:
    """Return the title of a figure of a width, inches, in as many lines as it takes, see `figure_text`."""
    return textwrap.fill(figure_text(text), int(_LETTERS * width))


def parameter_symbol(name: str) -> str:
    """Return the short name of a parameter for labels and heads of tables: `μ`, or the last part of a dotted path.

    A number at the end of a path goes with the part before it. Of several paths with unlike names the first is named.

    Examples
    --------
    >>> parameter_symbol("contacts.outer.normal_stiffness"), parameter_symbol("mu")
    ('normal_stiffness', 'μ')
    >>> parameter_symbol("materials.lining.youngs_modulus.0"), parameter_symbol("mu, springs.piston.damping")
    ('youngs_modulus.0', 'μ, …')
    """
    first, *more = dict.fromkeys(_symbol(path) for path in name.split(", "))
    return first + (", …" if more else "")


def _symbol(path: str) -> str:
    if path in PARAMETER_LABELS:
        return "μ"
    parts = path.split(".")
    return ".".join(parts[-2:] if parts[-1].isdigit() else parts[-1:])


def value_text(value: float) -> str:
    """Return a value of the sweep for a label: with two decimals if they suffice (0.60), else with up to six digits."""
    return f"{value:.2f}" if 0 <= value < 100 and round(value, 2) == value else f"{value:.6g}"


def distinct_texts(values: Floats, form: str) -> list[str]:
    """Return numbers (n,) as texts with three decimals ("f") or four digits ("g"); more if some would look equal.

    What three decimals do not show gets two digits.

    Examples
    --------
    >>> distinct_texts(np.array([0.30121, 0.30149, 0.5]), "f"), distinct_texts(np.array([0.3, 0.5, 3.4e-8]), "f")
    (['0.3012', '0.3015', '0.500'], ['0.300', '0.500', '3.4e-08'])
    """
    first, most = (3, 9) if form == "f" else (4, 12)

    def text(value: float, digits: int) -> str:
        tiny = form == "f" and 0 < abs(value) < 10.0**-first
        return f"{value:.{digits - 1}g}" if tiny else f"{value:.{digits}{form}}"

    texts = [text(v, first) for v in values]
    for digits in range(first + 1, most + 1):
        meant: dict[str, set[float]] = {}
        for known, value in zip(texts, values.tolist(), strict=True):
            meant.setdefault(known, set()).add(value)
        texts = [text(v, digits) if len(meant[t]) > 1 else t for t, v in zip(texts, values, strict=True)]
    return texts


def frequency_text(frequency_hz: float) -> str:
    """Return a frequency for a label, in Hz or from 1000 Hz in kHz."""
    return f"{frequency_hz / 1000:.2f} kHz" if frequency_hz >= 1000 else f"{frequency_hz:.4g} Hz"


def covered_text(covered: tuple[float, float | None]) -> str:
    """Return a range of frequencies, Hz, in words, for a sentence.

    Examples
    --------
    >>> covered_text((0.0, 2009.1)), covered_text((0.0, None))
    ('below 2.01 kHz', 'at any frequency of the model')
    >>> covered_text((12.0, 2009.1)), covered_text((12.0, None))
    ('from 12 Hz to 2.01 kHz', 'above 12 Hz')
    """
    low, high = covered
    if low > 0:
        above = frequency_text(low)
        return f"above {above}" if high is None else f"from {above} to {frequency_text(high)}"
    return "at any frequency of the model" if high is None else f"below {frequency_text(high)}"


def numbers(frame: pd.DataFrame, column: str) -> Floats:
    """Return a column as (n,) float, NaN where it is empty or if the table does not have it."""
    if column not in frame.columns:
        return np.full(len(frame), np.nan)
    return np.asarray(pd.to_numeric(frame[column], errors="coerce").to_numpy(dtype=float, na_value=np.nan))


def total_uncertainty(modes: pd.DataFrame) -> Floats:
    """Return |re_uncertainty| + |re_discretisation| of each row, (n,) float, 1/s; NaN counts as zero."""
    parts = [np.abs(numbers(modes, column)) for column in ("re_uncertainty", "re_discretisation")]
    return np.nansum(parts, axis=0)


def collect_branches(modes: pd.DataFrame, onsets: pd.DataFrame) -> list[Branch]:
    """Return the branches of a sweep in the order of their numbers.

    Parameters
    ----------
    modes, onsets : DataFrame
        As in `modes.csv` and `onsets.csv`. Rows without a branch number are left out.

    Examples
    --------
    >>> modes = pd.DataFrame({"parameter": "mu", "value": [0.0, 0.1], "branch": 1, "re": [0.0, 3.0],
    ...                       "frequency_hz": [100.0, 101.0], "stability": ["marginal", "unstable"]})
    >>> onsets = pd.DataFrame({"value": [0.04], "frequency_hz": [100.5], "direction": ["into"], "branch_a": [1]})
    >>> [branch] = collect_branches(modes, onsets)
    >>> branch.value.tolist(), branch.unstable_segments().tolist()
    ([0.0, 0.04, 0.1], [False, True])
    """
    sweep = np.unique(numbers(modes, "value"))
    columns = np.column_stack([numbers(modes, "value"), numbers(modes, "frequency_hz"), numbers(modes, "re"),
                               total_uncertainty(modes)])
    unstable = np.asarray(modes["stability"] == "unstable", dtype=bool) if len(modes) else np.zeros(0, bool)
    branch = numbers(modes, "branch")
    crossings = np.column_stack([numbers(onsets, "value"), numbers(onsets, "frequency_hz")])
    sign = np.where(_text(onsets, "direction") == "out of", -1, 1)
    partners = np.column_stack([numbers(onsets, "branch_a"), numbers(onsets, "branch_b")])
    width = np.hypot(numbers(onsets, "uncertainty"), numbers(onsets, "discretisation"))
    speed, law = np.abs(numbers(onsets, "crossing_speed")), _text(onsets, "law")
    paired = np.where(law == "", np.isfinite(partners[:, 1]), law == "root").astype(bool)

    result = []
    for number in np.unique(branch[np.isfinite(branch)]):
        rows, mine = branch == number, (partners == number).any(axis=1) & np.isfinite(crossings).all(axis=1)
        # At an onset Re λ is zero as exactly as at the values around it. Where one mode crosses alone, that is also how
        # exactly the onset is known, times the slope.
        known = np.argsort(columns[rows, 0], kind="stable")
        around = np.interp(crossings[mine, 0], columns[rows, 0][known], columns[rows, 3][known])
        bars = np.fmin(around, np.where(paired[mine], np.nan, speed[mine] * width[mine]))
        going = law[mine] == "parting"
        growing = known[unstable[rows][known]]
        there = np.full(mine.sum(), np.nan)
        if len(growing):
            at, rates = columns[rows][growing, 0], columns[rows][growing, 2]
            there = np.interp(crossings[mine, 0], at, rates, left=np.nan, right=np.nan)
        value, frequency, re, uncertainty = np.concatenate([
            columns[rows], np.column_stack([crossings[mine], np.where(going, there, 0.0), bars])
        ]).T
        kind = np.concatenate([np.zeros(rows.sum(), dtype=np.int64), np.where(going, 0, sign[mine])])
        grows = np.concatenate([unstable[rows], going & (len(growing) > 0)])
        at, own = np.full(rows.sum(), np.nan), np.zeros(rows.sum(), dtype=bool)
        speeds, rooted = np.append(at, speed[mine]), np.append(own, paired[mine])
        told, passing = np.append(own, law[mine] != ""), np.append(own, going)
        leads = np.append(own, partners[mine, 0] == number)
        order = np.argsort(value, kind="stable")
        # Values of the sweep have the places 0, 1, 2, ... and onsets places between them. So two neighbouring points of
        # a branch are joined if their places differ by at most one.
        place = np.interp(value[order], sweep, np.arange(len(sweep)))
        result.append(Branch(int(number), value[order], frequency[order], re[order], uncertainty[order], grows[order],
                             kind[order], np.diff(place) < 1 + 1e-9, speeds[order], rooted[order],
                             passing[order], told[order], leads[order]))
    return result


def find_mirror(branch: Branch, branches: list[Branch], onsets: pd.DataFrame) -> Branch | None:
    """Return the decaying partner of a growing branch, or None.

    It is the branch that it meets at an onset, or else the one with the same frequency (to 1e-3) where it grows
    fastest. A branch that grows itself is no partner.
    """
    others = {other.number: other for other in branches if not other.grows}
    for a, b in zip(numbers(onsets, "branch_a"), numbers(onsets, "branch_b"), strict=True):
        for own, partner in ((a, b), (b, a)):
            if own == branch.number and partner in others:
                return others[int(partner)]
    value, frequency = branch.value[branch.peak], branch.frequency_hz[branch.peak]
    best, distance = None, 1e-3 * frequency
    for other in others.values():
        at = np.flatnonzero((other.value == value) & (other.re < 0) & (other.onset == 0))
        if len(at) and abs(other.frequency_hz[at[0]] - frequency) <= distance and frequency > 0:
            best, distance = other, abs(other.frequency_hz[at[0]] - frequency)
    return best


def _text(frame: pd.DataFrame, column: str) -> NDArray[np.object_]:
    if column not in frame.columns:
        return np.full(len(frame), "", dtype=object)
    return np.asarray(frame[column].astype(object).fillna(""), dtype=object)
