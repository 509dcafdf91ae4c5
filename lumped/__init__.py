"""Lumped models of brake squeal: the references against which finite-element results are checked."""

from .models import MODELS, LumpedModel, Minimal, NineDof, Oscillator, RigidPad, TwoMass, UncoupledDisc
from .models.minimal import critical_friction
