"""The lumped models by name."""

from ..model import LumpedModel
from .minimal import Minimal, critical_friction
from .nine_dof import NineDof
from .oscillator import Oscillator
from .two_mass import TwoMass
from .uncoupled_disc import RigidPad, UncoupledDisc

MODELS: dict[str, type[LumpedModel]] = {c.name: c for c in (Oscillator, Minimal, TwoMass, NineDof, UncoupledDisc)}

__all__ = [
    "MODELS", "LumpedModel", "Minimal", "NineDof", "Oscillator", "RigidPad", "TwoMass", "UncoupledDisc",
    "critical_friction",
]  # fmt: skip
