"""Abaqus decks written from scikit-fem meshes, for tests."""

from __future__ import annotations

import numpy as np
import skfem

from fe_squeal.mesh.checking import jacobian_range
from fe_squeal.mesh.elements import REFERENCE, matching, mirror_order

_TYPES = {skfem.MeshTet1: ("tetra", "C3D4"), skfem.MeshTet2: ("tetra10", "C3D10"),
          skfem.MeshHex1: ("hexahedron", "C3D8"), skfem.MeshHex2: ("hexahedron20", "C3D20")}  # fmt: skip
_FACES = {"tet": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
          "hex": ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))}  # fmt: skip


def rows(numbers, per_line=12):
    """Return whole numbers as data lines."""
    numbers = [str(n) for n in numbers]
    return "".join(", ".join(numbers[i : i + per_line]) + "\n" for i in range(0, len(numbers), per_line))


def deck_of(mesh: skfem.Mesh, scale: float = 1.0, first: int = 0, element_type: str = "") -> str:
    """Return a mesh as text of a deck: nodes, elements, element sets, surfaces, and node sets N_NAME of the surfaces.

    Parameters
    ----------
    scale
        Units of length of the deck in a metre.
    first
        Is added to all numbers of nodes and elements.
    """
    kind, name = next(found for cls, found in _TYPES.items() if type(mesh) is cls)
    local = mesh.dofs.element_dofs if mesh.doflocs.shape[1] > mesh.t.max() + 1 else mesh.t
    full = "hexahedron27" if kind == "hexahedron20" else kind
    nodes = local.T[:, matching(REFERENCE[full], np.asarray(mesh.elem.doflocs))][:, : len(REFERENCE[kind])]
    left = jacobian_range(kind, mesh.doflocs.T, nodes)[1] < 0  # scikit-fem allows left-handed elements, decks do not
    nodes[left] = nodes[left][:, mirror_order(kind)]
    used = np.unique(nodes)
    text = "*Node\n" + "".join(
        f"{i + 1 + first}, " + ", ".join(repr(float(x)) for x in scale * mesh.doflocs[:, i]) + "\n" for i in used
    )
    text += f"*Element, type={element_type or name}\n"
    for e, row in enumerate(nodes):
        line = [str(number) for number in (e + 1 + first, *(row + 1 + first))]
        text += ", ".join(line[:11]) + (",\n" + ", ".join(line[11:]) if len(line) > 11 else "") + "\n"
    for group, cells in (mesh.subdomains or {}).items():
        text += f"*Elset, elset={group}\n" + rows(np.asarray(cells) + 1 + first)
    shape = "tet" if kind.startswith("tet") else "hex"
    corners = nodes[:, : 4 if shape == "tet" else 8]
    for group, facets in (mesh.boundaries or {}).items():
        found = []
        for facet in np.asarray(facets):
            cell, on = mesh.f2t[0, facet], set(mesh.facets[:, facet])
            side = next(i for i, face in enumerate(_FACES[shape]) if {int(corners[cell][c]) for c in face} == on)
            found.append(f"{cell + 1 + first}, S{side + 1}\n")
        members = np.isin(used, mesh.facets[:, facets])
        if len(used) > mesh.t.max() + 1:
            members = np.isin(used, mesh.dofs.get_facet_dofs(facets).flatten())
        text += f"*Surface, name={group}, type=ELEMENT\n" + "".join(found)
        text += f"*Nset, nset=N_{group}\n" + rows(used[members] + 1 + first)
    return text
