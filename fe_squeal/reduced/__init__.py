"""Sweeps on a small model of the problem."""

from .model import ReducedModel
from .vectors import lift

__all__ = ["ReducedModel", "lift"]
