"""Lumped models of brake squeal: the references against which finite-element results are checked."""

from .critical_points import CriticalPoint
from .models import (
    MODELS,
    LumpedModel,
    Minimal,
    NineDof,
    Oscillator,
    RigidPad,
    TwoMass,
    UncoupledDisc,
    critical_friction,
)
from .parameters import parse_settings
from .run import evaluate, run_study
from .studies import STUDIES

__all__ = [
    "MODELS",
    "STUDIES",
    "CriticalPoint",
    "LumpedModel",
    "Minimal",
    "NineDof",
    "Oscillator",
    "RigidPad",
    "TwoMass",
    "UncoupledDisc",
    "critical_friction",
    "evaluate",
    "parse_settings",
    "run_study",
]  # fmt: skip
