"""The scene: what the user wrote, validated before any mesh is read."""

from .matrices import MatrixScene
from .paths import MU, canonical, number_at, paths_of, with_numbers
from .scene import Scene

__all__ = ["MU", "MatrixScene", "Scene", "canonical", "number_at", "paths_of", "with_numbers"]
