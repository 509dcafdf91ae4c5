"""The scene: what the user wrote, validated before any mesh is read."""

from .matrices import MatrixScene
from .numbers import number_at, with_numbers
from .scene import Scene

__all__ = ["MatrixScene", "Scene", "number_at", "with_numbers"]
