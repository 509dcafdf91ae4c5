"""How far results are from those of an infinitely fine mesh, and how much time and memory a smaller error takes."""

from .discretisation import with_discretisation

__all__ = ["with_discretisation"]
