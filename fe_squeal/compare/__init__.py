"""Finite-element models of the lumped systems, held against the lumped systems."""

from .cases import Case, minimal, nine_dof, two_mass, uncoupled_disc
from .table import SETUPS, compare, compare_case

__all__ = ["SETUPS", "Case", "compare", "compare_case", "minimal", "nine_dof", "two_mass", "uncoupled_disc"]
