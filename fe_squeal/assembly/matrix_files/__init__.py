"""Real square matrices that other programs exported: Matrix Market, SciPy .npz, NumPy .npy and MATLAB .mat files."""

from ...problem.symmetry import measure_symmetry
from .read import read_matrix

__all__ = ["measure_symmetry", "read_matrix"]
