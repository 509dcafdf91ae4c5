"""Sweeps on a small model of the problem."""

from .basis import lift
from .model import ReducedModel

__all__ = ["ReducedModel", "lift"]
