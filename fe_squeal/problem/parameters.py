"""Names of parameters: the path of a number of the scene, "mu" for short the friction coefficient."""

from __future__ import annotations

MU = "mu"
_LONG = "effects.friction.mu"


def canonical(path: str) -> str:
    """Return the name under which a path is known: "mu" for effects.friction.mu, else itself."""
    return MU if path == _LONG else path.removeprefix("parameters.")


def paths_of(parameter: str) -> list[str]:
    """Return the paths that one sweep parameter moves together.

    Examples
    --------
    >>> paths_of("springs.left.damping, springs.right.damping")
    ['springs.left.damping', 'springs.right.damping']
    """
    return [p.strip() for p in parameter.split(",")]
