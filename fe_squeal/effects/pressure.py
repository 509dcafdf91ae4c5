"""Effects that act on the pressure in contacts: whether the scene says what it is."""

from __future__ import annotations

from collections.abc import Mapping

from .context import Context
from .effect import Effect
from .preload import Preload


def check_pressure(
    name: str, own: float | None, others: Mapping[str, Effect], default: float | None = None
) -> None:
    """Raise ValueError where an effect has no pressure, or one of its own beside that of the preload.

    Parameters
    ----------
    name : str
        Name of the effect.
    own : float or None, Pa
        The effect's own pressure.
    others : mapping of effect to table
    default : float or None, Pa
        What counts where there is neither an own one nor preload.
    """
    pressed = Preload.name in others
    if pressed and own is not None:
        raise ValueError(f"given {name}.contact_pressure and preload, which gives the pressure; expected one")
    if not pressed and own is None and default is None:
        raise ValueError(
            f"given {name} without a pressure; expected {name}.contact_pressure, or [effects.preload]"
        )


def warnings_without_friction(name: str, context: Context) -> list[str]:
    """Return a sentence for an effect of friction, by its name, where friction acts in no contact that slides.

    Not where the sweep or the study gives one of them a ratio.
    """
    sliding = [c for c in context.contacts.values() if c.kind == "sliding"]
    if any(c.slides_with_friction or f"{c.path}.friction_ratio" in context.moved for c in sliding):
        return []
    return [f"effects.{name} has no effect: friction_ratio is 0 in every contact that slides"]
