"""The axis along which pictures show the shapes of a model."""

from __future__ import annotations

import numpy as np

from ..assembly.discretisation import Discretisation
from ..fem.contact import ContactOperators

Z_AXIS = (0.0, 0.0, 1.0)
_TURNS = 1e-3  # of the largest singular value of the directions of sliding: on a belt, where all are the same, less
_FLAT = 0.5  # length of the mean unit normal below which a contact goes around something
_DIGITS = 12


def view_axis(discretisation: Discretisation | None) -> tuple[float, float, float]:
    """Return the unit axis about which the first contact slides, or the normal of a belt; z if there is no contact."""
    for contact in discretisation.contacts.values() if discretisation is not None else ():
        x, y, z = (np.round(_axis(contact), _DIGITS) + 0.0).tolist()  # no −0
        return x, y, z
    return Z_AXIS


def _axis(contact: ContactOperators) -> np.ndarray:
    """Return the direction across all directions of sliding, on the side of the normals, or of the larger component."""
    normal = contact.normals.mean(axis=0)
    _, sizes, axes = np.linalg.svd(contact.directions, full_matrices=False)
    turns = len(sizes) > 1 and sizes[1] > _TURNS * sizes[0]
    if not turns and np.linalg.norm(normal) >= _FLAT:
        return np.asarray(normal / np.linalg.norm(normal))
    axis = axes[-1] if turns else np.linalg.svd(contact.normals, full_matrices=False)[2][-1]
    along = float(axis @ normal)
    sign = along if abs(along) > 0.1 else axis[np.argmax(np.abs(axis))]
    return np.asarray(np.copysign(1.0, sign) * axis)
