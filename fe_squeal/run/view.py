"""From where the shapes of a model are seen."""

from __future__ import annotations

from ..assembly.discretisation import Discretisation

Z_AXIS = (0.0, 0.0, 1.0)


def view_axis(model: Discretisation | None) -> tuple[float, float, float]:
    """Return the axis of the disc, or the normal of the belt: that of the first contact; z where there is none."""
    for contact in model.contacts.values() if model is not None else ():
        x, y, z = contact.normals.mean(axis=0).tolist()
        return x, y, z
    return Z_AXIS
