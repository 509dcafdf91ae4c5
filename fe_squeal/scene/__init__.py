"""The scene: what the user wrote, validated before any mesh is read."""

from .matrices import MatrixScene
from .numbers import NOT_PHYSICS, number_at, with_numbers
from .scene import Scene

__all__ = ["NOT_PHYSICS", "MatrixScene", "Scene", "number_at", "with_numbers"]
