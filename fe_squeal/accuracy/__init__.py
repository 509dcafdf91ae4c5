"""How far results are from those of an infinitely fine mesh, and what it costs to come nearer."""

from .estimate import with_discretisation

__all__ = ["with_discretisation"]
