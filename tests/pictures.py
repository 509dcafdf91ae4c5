"""Find out what a picture shows, by its pixels."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from matplotlib import image
from matplotlib.colors import to_rgb


def pixels(path: Path) -> np.ndarray:
    """Return (height, width, 3) float from 0 to 1."""
    return np.asarray(image.imread(path), float)[..., :3]


def of_colour(path: Path, colour) -> np.ndarray:
    """Return which pixels, (height, width) bool, have a colour to two parts in 256."""
    return (np.abs(pixels(path) - to_rgb(colour)) < 2 / 255).all(axis=2)


def longest_bar(path: Path, colour) -> int:
    """Return the length in pixels of the longest horizontal line of one colour."""
    rows = of_colour(path, colour)
    return max((sum(1 for _ in run) for row in rows[rows.any(axis=1)] for on, run in itertools.groupby(row) if on),
               default=0)


def ink(path: Path) -> np.ndarray:
    """Return (height, width) bool, which pixels differ from the background, the pixel in the upper left corner."""
    found = pixels(path)
    return (np.abs(found - found[0, 0]) > 0.1).any(axis=2)
