"""Real square matrices that other programs exported: Matrix Market, SciPy .npz, NumPy .npy and MATLAB .mat files."""

from .read import read_matrix
from .symmetry import measure_symmetry

__all__ = ["measure_symmetry", "read_matrix"]
