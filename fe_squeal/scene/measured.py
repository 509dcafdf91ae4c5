"""What was measured: frequencies of squeal, and shapes of test."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import model_validator

from ..schema.section import Direction, Positive, Section, Text, Vector


class Measured(Section):
    """A measured frequency, a file of them, or a file with a measured shape; nothing of it changes what is solved.

    Columns of a .csv file of frequencies: frequency_hz, and if known level_db and label. Columns of one with a shape:
    x, y, z of each point, and of the displacement ux_re, ux_im, uy_re, uy_im, uz_re, uz_im, as many as were measured;
    without an imaginary part it is zero. Universal files (.unv, .uff) have points in data set 2411 or 15 and shapes in
    55, or frequency responses in 58, of which the line nearest to `frequency_hz` is taken; `frequency_hz` has to be in
    the measured range. A component that is 0 at all nodes of a shape in 55 counts as not measured. Points and
    displacements may be in coordinate systems of data set 2420. Of a roving hammer the points of excitation are those
    of the shape.

    Attributes
    ----------
    frequency_hz : float, Hz
        Frequency of squeal; beside a file with a shape, the frequency of that shape.
    level_db : float
        Sound pressure level.
    label : str
        Name in figures and tables.
    file : str
        A file instead, relative to the scene file.
    reference : str
        Which responses of a universal file to take: node and direction of their reference, such as "5z", or of the
        response that stands still while a hammer moves; without it those of one that has all points that any has.
    length_unit : "m" or "mm"
        Unit of the points in the file.
    axes : two vectors
        Directions of the file's x and y axes in the model.
    origin : vector, m
        Where the file's origin is in the model.
    distance : float, m
        A point belongs to the nearest node of the surface up to here; points farther off are left out, and told.
    """

    frequency_hz: Positive | None = None
    level_db: float | None = None
    label: str = ""
    file: Text | None = None
    reference: Text | None = None
    length_unit: Literal["m", "mm"] = "m"
    axes: tuple[Direction, Direction] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    origin: Vector = (0.0, 0.0, 0.0)
    distance: Positive = 0.005

    @model_validator(mode="before")
    @classmethod
    def _lists(cls, data: object) -> object:
        """Take the lists of TOML for the pair of axes."""
        if isinstance(data, dict) and isinstance(data.get("axes"), list) and len(data["axes"]) == 2:
            return {**data, "axes": tuple(data["axes"])}
        return data

    @model_validator(mode="after")
    def _either(self) -> Measured:
        if self.frequency_hz is None and self.file is None:
            raise ValueError("given neither frequency_hz nor file; expected one of them")
        first, second = (np.array(v) / np.linalg.norm(v) for v in self.axes)
        if abs(first @ second) > 1e-6:
            raise ValueError(f"axes: given {[list(v) for v in self.axes]}; expected two vectors at right angles")
        return self

    @property
    def frame(self) -> np.ndarray:
        """(3, 3): the file's axes as rows, in the model."""
        first, second = (np.array(v) / np.linalg.norm(v) for v in self.axes)
        return np.array([first, second, np.cross(first, second)])
