"""What an effect is: its table of the scene, and the terms that it adds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from ..fem.motion import SteadyMotion
from ..problem.terms import Term
from ..schema.section import Section
from .context import BodyPart, ContactPart, Context
from .static_state import StaticState


@dataclass(frozen=True)
class Outline:
    """What a scene has, as far as effects are checked against it before a mesh is read.

    Attributes
    ----------
    bodies : tuple of str
    mixed_bodies : tuple of str
        Names of the bodies of the mixed formulation.
    sliding_contacts : tuple of str
    """

    bodies: tuple[str, ...]
    mixed_bodies: tuple[str, ...]
    sliding_contacts: tuple[str, ...]


class Effect(Section):
    """Base of all effects: the keys of `[effects.NAME]`, and functions that do nothing unless an effect has its own.

    The assembly calls them for the effects that are on, in this order: `motions`, then `static_state`, which needs the
    motions, then the terms, which need both, then `warnings`. None is called for an effect without a table, but for
    `warnings_without`.

    Attributes of the class
    -----------------------
    name : str
        Key of the table in `[effects]`; terms are called NAME.BODY, NAME.CONTACT or NAME.
    summary : str
        What it is, for the list of effects in docs/scene.md.
    needs : mapping of effect to str
        Effects without which it makes no sense; the text ends the message "given NAME without EFFECT".
    own_of_body : str
        Where a body may have this table of its own, `[bodies.BODY.NAME]`: what it is, for docs/scene.md.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    needs: ClassVar[Mapping[str, str]] = {}
    own_of_body: ClassVar[str] = ""

    @property
    def acts(self) -> bool:
        """Whether it changes anything with the numbers that it has."""
        return True

    def check_effects(self, others: Mapping[str, Effect]) -> None:
        """Raise ValueError where the effects that are on make no sense together."""

    def check_scene(self, outline: Outline) -> None:
        """Raise ValueError, with the path of the key, where the scene does not have what the effect needs."""

    def parameters(self) -> tuple[str, ...]:
        """Return names of parameters that the problem has even where no term scales with them."""
        return ()

    def surfaces(self) -> Mapping[str, str]:
        """Return the surface groups that it names, by the paths of their keys."""
        return {}

    def motions(self, context: Context) -> Mapping[str, SteadyMotion]:
        """Return the motions of bodies that rotate; `context` has neither motions nor a static state yet."""
        return {}

    def static_state(self, context: Context) -> StaticState | None:
        """Return the static state about which the brake vibrates; `context` has the motions."""
        return None

    def state_parameters(self, context: Context) -> frozenset[str]:
        """Return the parameters that this static state depends on."""
        return frozenset()

    def contact_terms(self, context: Context, contact: ContactPart) -> Sequence[Term]:
        """Return the terms of one contact that is not tied."""
        return ()

    def terms(self, context: Context) -> Sequence[Term]:
        """Return the terms of the whole model."""
        return ()

    def body_terms(self, context: Context, body: BodyPart, path: str) -> Sequence[Term]:
        """Return the terms of one body; `path` is that of this table, the scene's or the body's own."""
        return ()

    def warnings(self, context: Context, others: Sequence[Term], parameters: Mapping[str, float]) -> Sequence[str]:
        """Return a sentence for what is allowed, but probably not meant.

        Parameters
        ----------
        others : sequence of Term
            All terms but those of this effect.
        parameters : mapping of name to value
            Values of the parameters of all terms.
        """
        return ()

    @classmethod
    def warnings_without(cls, context: Context) -> Sequence[str]:
        """Return a sentence for what in the scene has no effect because this effect is not on."""
        return ()
