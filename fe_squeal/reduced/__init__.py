"""Sweeps on a reduced model of the problem."""

from .model import ReducedModel
from .vectors import SlowMotions, lift

__all__ = ["ReducedModel", "SlowMotions", "lift"]
