"""Sweeps on a small model of the problem."""

from .model import ReducedModel
from .vectors import FreeMotions, lift

__all__ = ["FreeMotions", "ReducedModel", "lift"]
