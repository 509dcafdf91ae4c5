"""Elements of an archive that become nothing in the scene: listed by their type, with what that means."""

from __future__ import annotations

import numpy as np

from ...mesh.elements import corner_count
from ...mesh.raw import rows_of
from ...mesh.readers.ansys import left_over
from ...mesh.readers.ansys_faces import FIRST, LABEL, pressures
from ..draft import Weight
from .content import Content

_ANOTHER = "without which the structure is another one"
_SPRINGS = f"springs, dampers or links, {_ANOTHER}; give [[springs]]"
_MATRICES = f"matrices of the user, {_ANOTHER}"
_TIES = f"ties between parts, {_ANOTHER}; give [[rigid]], [[averaged]] or [[contacts]]"
_SOLIDS = "write them as SOLID185, SOLID186, SOLID187 or SOLID285"
_NO_SOLIDS = "no solids, which are left out with their stiffness and mass"
_UNKNOWN = "a type that is not known here; without it the structure may be another one"
# Families of elements with their numbers (Ansys element reference), and what leaving them out means.
_FAMILIES: tuple[tuple[str, tuple[int, ...], str, Weight], ...] = (
    ("COMBIN", (7, 14, 37, 39, 40), _SPRINGS, "missing"), ("COMBI", (165, 214), _SPRINGS, "missing"),
    ("LINK", (1, 8, 10, 11, 160, 167, 180), _SPRINGS, "missing"), ("CABLE", (280,), _SPRINGS, "missing"),
    ("MATRIX", (27, 50), _MATRICES, "missing"), ("USER", (300,), _MATRICES, "missing"),
    ("MPC", (184,), _TIES, "missing"), ("PRETS", (179,), _TIES, "missing"), ("TARGE", (169,), _TIES, "missing"),
    ("CONTA", (171, 172, 175, 176, 177, 178), _TIES, "missing"), ("CONTAC", (12, 26, 48, 49, 52), _TIES, "missing"),
    ("INTER", (192, 193, 194, 195, 202, 203, 204, 205), _TIES, "missing"),
    ("SOLID", (5, 45, 46, 62, 64, 65, 72, 73, 92, 95, 98, 147, 148, 164, 168, 191, 226, 227, 272, 273), _SOLIDS,
     "missing"),
    ("SOLSH", (190,), _SOLIDS, "missing"),
    ("SHELL", (28, 41, 43, 51, 61, 63, 91, 93, 99, 143, 150, 163, 181, 208, 209, 281), _NO_SOLIDS, "changes"),
    ("BEAM", (3, 4, 23, 24, 44, 54, 161, 188, 189), _NO_SOLIDS, "changes"),
    ("PIPE", (16, 17, 18, 20, 59, 60, 288, 289), _NO_SOLIDS, "changes"), ("ELBOW", (290,), _NO_SOLIDS, "changes"),
    ("REINF", (263, 264, 265), _NO_SOLIDS, "changes"), ("SURF", (153, 155, 156), _NO_SOLIDS, "changes"),
)  # fmt: skip
_SURFACE_LOAD = 154
_LAYERED = (185, 186), "3", "1"  # kinds, key option and its value of solids of layers
_OWN = [3, 5, 6]  # places of the foundation's stiffness, the mass per area and the thickness among its real constants


def list_left_over(content: Content) -> None:
    """List the elements that become nothing in the scene, once for each type, with their number.

    SURF154 only carries pressures here; what else it has is listed too.
    """
    for kind, number in left_over(content.archive).items():
        found = next((family for family in _FAMILIES if kind in family[1]), None)
        name, text = (f"{found[0]}{kind}", found[2]) if found else (f"element type {kind}", _UNKNOWN)
        many = f"{number} elements are" if number > 1 else "1 element is"
        content.draft.find(name, "", f"{many} not read: {text}", found[3] if found else "missing")
    loads = {int(row[0]) for row in content.archive.ekey if int(row[1]) == _SURFACE_LOAD}
    for real in sorted({int(row[2]) for row in content.archive.elem if int(row[1]) in loads}):
        constants = content.archive.reals.get(real, np.zeros(0))
        if any(constants[i] for i in _OWN if i < len(constants)):
            text = f"foundation, mass per area and thickness of real constants {real} are left out"
            content.draft.find("SURF154", "", text)
    _ask_for_layers(content)
    inward = _inward(content)
    if inward:
        which = f"elements {inward[0]}, ..., {len(inward)} in all," if len(inward) > 1 else f"element {inward[0]}"
        text = f"the normal of {which} points into the solid, and pressure pulls: give its sign in [effects.preload]"
        content.draft.find("SURF154", "", text, "missing")


def _inward(content: Content) -> list[int]:
    """Return the numbers of SURF154 under pressure whose normals, right-handed about I, J, K, point into a solid.

    The pressure acts against the normal of the element (Ansys element reference, SURF154).
    """
    archive, raw, points = content.archive, content.raw, content.raw.points
    types = [int(row[0]) for row in archive.ekey if int(row[1]) == _SURFACE_LOAD]
    loaded = [e for faces in pressures(archive, content.text, content.source).values() for e, *_ in faces]
    rows = archive.elem[np.isin(archive.elem[:, 1], types) & np.isin(archive.elem[:, LABEL], loaded)]
    faces = rows_of(rows[:, FIRST : FIRST + 4], raw.node_labels)
    on = np.zeros(len(points), bool)
    on[faces] = True
    solids: dict[int, list[np.ndarray]] = {}
    for block in raw.blocks if len(rows) else ():
        corners = block.nodes[:, : corner_count(block.kind)]
        for own in corners[on[corners].sum(axis=1) > 2]:
            for node in own[on[own]].tolist():
                solids.setdefault(node, []).append(own)
    found = []
    for label, face in zip(rows[:, LABEL].tolist(), faces.tolist(), strict=True):
        first, second, third = list(dict.fromkeys(face))[:3]
        normal = np.cross(points[second] - points[first], points[third] - points[first])
        behind = [own for own in solids.get(first, []) if set(face) <= set(own.tolist())]
        if len(behind) == 1 and normal @ (points[behind[0]].mean(axis=0) - points[first]) > 0:
            found.append(label)
    return found


def _ask_for_layers(content: Content) -> None:
    """Ask for the materials of solids of layers, which are those of their section, and not those of EBLOCK."""
    kinds, key, layered = _LAYERED
    used = {str(int(row[0])) for row in content.archive.ekey if int(row[1]) in kinds} & {
        str(int(number)) for number in np.unique(content.archive.elem[:, 1])}  # fmt: skip
    given = [(f, where) for f, where in content.lines if f[0].startswith("KEYOP") and f[2:3] == [key]]
    options = {f[1]: (f[3], where) for f, where in given if f[3:]}
    for number in sorted(used & set(options)):
        value, where = options[number]
        if value == layered:
            text = f"solids of type {number} are of layers, whose materials are not read; give those of their bodies"
            content.draft.find("KEYOPT(3)", where, text, "missing")
