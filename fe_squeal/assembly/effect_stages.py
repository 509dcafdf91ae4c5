"""The effects of a scene, in the order in which one needs another: motions, static state, terms, warnings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..effects.context import BodyPart, ContactPart, Context
from ..effects.effect import Effect
from ..fem.motion import SteadyMotion
from ..problem.terms import Term

Owned = tuple[str, Term]  # the name of the effect that a term is of, "" where it is of none


def with_motions(context: Context, on: Mapping[str, Effect]) -> Context:
    """Return the context with the motions of bodies that rotate."""
    motions: dict[str, SteadyMotion] = {}
    for effect in on.values():
        motions |= effect.motions(context)
    return replace(context, motions=motions)


def with_static_state(context: Context, on: Mapping[str, Effect]) -> Context:
    """Return the context with the static state, if there is one, also in each contact that it has."""
    for effect in on.values():
        state = effect.static_state(context)
        if state is not None:
            contacts = {name: replace(c, state=state.contacts.get(name)) for name, c in context.contacts.items()}
            return replace(context, static_state=state, contacts=contacts)
    return context


def terms_of_contact(context: Context, on: Mapping[str, Effect], contact: ContactPart) -> list[Owned]:
    """Return the terms of all effects in a contact that is not tied."""
    return [(name, term) for name, effect in on.items() for term in effect.contact_terms(context, contact)]


def terms_of_whole(context: Context, on: Mapping[str, Effect]) -> list[Owned]:
    """Return the terms of all effects that belong to neither a contact nor a body."""
    return [(name, term) for name, effect in on.items() for term in effect.terms(context)]


def terms_of_body(context: Context, known: Sequence[type[Effect]], body: BodyPart) -> list[Owned]:
    """Return the terms of all effects in a body, which may have tables of its own."""
    found = []
    for kind in known:
        table = context.table_of_body(kind, body)
        if table is not None:
            effect, path = table
            found += [(kind.name, term) for term in effect.body_terms(context, body, path)]
    return found


def parameters_of(on: Mapping[str, Effect]) -> set[str]:
    """Return the parameters that the problem has even where no term scales with them."""
    return {name for effect in on.values() for name in effect.parameters()}


def state_parameters(context: Context, on: Mapping[str, Effect]) -> frozenset[str]:
    """Return the parameters that the static state depends on."""
    if context.static_state is None:
        return frozenset()
    return frozenset(p for effect in on.values() for p in effect.state_parameters(context))


def warnings_of(
    context: Context, known: Sequence[type[Effect]], on: Mapping[str, Effect], terms: Sequence[Owned],
    parameters: Mapping[str, float],
) -> list[str]:  # fmt: skip
    """Return a sentence for what looks doubtful in an effect that is on, or needs an effect that is not."""
    found: list[str] = []
    for kind in known:
        if kind.name in on:
            others = [term for owner, term in terms if owner != kind.name]
            found += on[kind.name].warnings(context, others, parameters)
        else:
            found += kind.warnings_without(context)
    return found
