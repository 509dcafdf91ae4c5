"""The reduced model: a projection of the problem that holds over an interval of a parameter."""

from .model import ReducedModel
from .vectors import SlowMotions, lift

__all__ = ["ReducedModel", "SlowMotions", "lift"]
