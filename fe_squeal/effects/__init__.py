"""Effects: what is simulated beyond elasticity, springs and contact stiffness, one file each.

A file holds the keys of the effect's table in the scene, its formula and its terms. `EFFECTS` lists them, in the order
in which the scene file, results and docs name them. A new effect needs its file and its place in that list: the table
`[effects]`, the assembly, docs/scene.md, warnings and the benchmark of costs go over the list.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from .effect import Effect
from .falling_friction import FallingFriction
from .friction import Friction
from .friction_damping import FrictionDamping
from .preload import Preload
from .rayleigh import Rayleigh
from .rotation import Rotation
from .stress_stiffening import StressStiffening
from .structural_damping import StructuralDamping

EFFECTS: tuple[type[Effect], ...] = (
    Friction, Preload, StressStiffening, FrictionDamping, FallingFriction, Rayleigh, StructuralDamping, Rotation
)  # fmt: skip
_added: list[type[Effect]] = []


def known_effects() -> tuple[type[Effect], ...]:
    """Return the effects that a scene may call for: those of the program, and those that were added to them.

    Examples
    --------
    >>> [effect.name for effect in known_effects()][:2]
    ['friction', 'preload']
    """
    return (*EFFECTS, *_added)


@contextmanager
def added_effect(effect: type[Effect]) -> Iterator[None]:
    """Let scenes that are read inside the block call for one more effect, as `[effects.NAME]`.

    A scene keeps the effects it was read with, and can be assembled and run after the block too.

    Raises
    ------
    ValueError
        There is an effect of this name.
    """
    if any(effect.name == known.name for known in known_effects()):
        raise ValueError(f'given an effect "{effect.name}", which there is; expected another name')
    _added.append(effect)
    try:
        yield
    finally:
        _added.remove(effect)
