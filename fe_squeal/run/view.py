"""The axis along which pictures show the shapes of a model."""

from __future__ import annotations

from ..assembly.discretisation import Discretisation

Z_AXIS = (0.0, 0.0, 1.0)


def view_axis(discretisation: Discretisation | None) -> tuple[float, float, float]:
    """Return the axis of the disc or the normal of the belt of the first contact; z if there is no contact."""
    for contact in discretisation.contacts.values() if discretisation is not None else ():
        x, y, z = contact.normals.mean(axis=0).tolist()
        return x, y, z
    return Z_AXIS
