"""Meshes: read from a file or taken from Python, checked, with named volume and surface groups."""

from .from_python import from_skfem
from .groups import LoadedMesh, surface_group, volume_group
from .loading import load_mesh

__all__ = ["LoadedMesh", "from_skfem", "load_mesh", "surface_group", "volume_group"]
